"""Networks side by side, one for each goal; and one plain network that acts as they do."""

# torch's stubs leave parts unknown
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from scipy.linalg import block_diag
from torch import nn

from npend_gym._checks import FloatArray

_GATE, _SHUT = 64.0, 16.0  # tanh is -1 or 1 to rounding, beyond either


class GoalNetworks(nn.Module):
    """Networks of hidden tanh layers, one of which acts: that for the goal.

    The last numbers that they are given are the goal, for each rod 1 (hangs) or -1 (stands). What a
    single network learns about one goal changes what it does about the others.
    """

    def __init__(self, networks: Sequence[nn.Sequential]) -> None:
        super().__init__()
        self.networks: nn.ModuleList = nn.ModuleList(networks)
        self._rods = torch.arange(len(networks).bit_length() - 1)

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """Return the outputs, (B, joints), for inputs (B, k)."""
        stands = inputs[:, -len(self._rods) :] < 0.0
        numbers = (stands.long() << self._rods).sum(dim=1)
        order = torch.argsort(numbers)
        counts = torch.bincount(numbers, minlength=len(self.networks)).tolist()
        parts = zip(self.networks, inputs[order].split(counts), strict=True)
        outputs = torch.cat([network(part) for network, part in parts])
        return outputs[torch.argsort(order)]

    def merged(self) -> nn.Sequential:
        """Return a network with the units of all of them.

        One more unit of the first layer for each goal is 1 where it is the goal and else -1. Where
        it is not, a gate keeps the second layer for that goal at -1: what the first, between -1
        and 1, can add there is less. So it is known what such units add to the outputs, and the
        unit of the goal takes that away.
        """
        n, count = len(self._rods), len(self.networks)
        goals = 1.0 - 2.0 * (np.arange(count)[:, None] >> np.arange(n) & 1)
        first, second, *later, last = zip(*map(_layers, self.networks), strict=True)
        unseen = np.zeros((count, first[0][0].shape[1] - n))
        shut = np.full(count, -_GATE * (n - 1))
        whole: list[tuple[Any, Any]] = [(
            np.vstack([*(weight for weight, _ in first), np.hstack([unseen, _GATE * goals])]),
            np.hstack([*(bias for _, bias in first), shut]),
        )]  # fmt: skip
        gates = [np.abs(weight).sum(axis=1) + np.abs(bias) + _SHUT for weight, bias in second]
        joined = block_diag(*(weight for weight, _ in second), _GATE * np.eye(count))
        joined[:-count, -count:] = block_diag(*(gate[:, None] for gate in gates))
        biases = [bias - gate for (_, bias), gate in zip(second, gates, strict=True)]
        whole.append((joined, np.hstack([*biases, np.zeros(count)])))
        idle: list[FloatArray] = [-np.ones(len(bias)) for _, bias in second]
        for layer in later:
            parts = zip(layer, idle, strict=True)
            idle = [np.tanh(weight @ values + bias) for (weight, bias), values in parts]
            joined = block_diag(*(weight for weight, _ in layer), _GATE * np.eye(count))
            whole.append((joined, np.hstack([*(bias for _, bias in layer), np.zeros(count)])))
        left = [weight @ values for (weight, _), values in zip(last, idle, strict=True)]
        added = [bias for _, bias in last]
        outputs = np.hstack([*(weight for weight, _ in last), 0.5 * np.add(added, left).T])
        whole.append((outputs, 0.5 * np.subtract(added, left).sum(axis=0)))
        modules = [module for layer in whole for module in (_linear(*layer), nn.Tanh())]
        return nn.Sequential(*modules[:-1])


def _layers(network: Any) -> list[tuple[FloatArray, FloatArray]]:
    """Return weights and biases of the layers of a network."""
    arrays = [each.detach().numpy().astype(np.float64) for each in network.parameters()]
    return list(zip(arrays[::2], arrays[1::2], strict=True))


def _linear(weight: FloatArray, bias: FloatArray) -> nn.Linear:
    layer = nn.Linear(weight.shape[1], weight.shape[0])
    layer.weight, layer.bias = (
        nn.Parameter(torch.from_numpy(each.astype(np.float32))) for each in (weight, bias)
    )
    return layer
