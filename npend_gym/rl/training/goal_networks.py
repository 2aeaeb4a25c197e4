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

_GATE = 64.0  # tanh is -1 to rounding where twice this is missing


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

        A gate keeps the units of other goals at -1, as long as the rest of what they are given is
        at most 100. So it is known what they add to the outputs. One more unit for each goal, 1
        where it is the goal and else -1, takes that away.
        """
        n, count = len(self._rods), len(self.networks)
        goals = 1.0 - 2.0 * (np.arange(count)[:, None] >> np.arange(n) & 1)
        first, *middle, last = zip(*map(_layers, self.networks), strict=True)
        weights, biases = list[FloatArray](), list[FloatArray]()
        for (weight, bias), goal in zip(first, goals, strict=True):
            biases.append(bias + weight[:, -n:] @ goal - _GATE * n)
            weights.append(np.hstack([weight[:, :-n], np.tile(_GATE * goal, (len(weight), 1))]))
        gates = np.hstack([np.zeros((count, weights[0].shape[1] - n)), _GATE * goals])
        whole: list[tuple[Any, Any]] = [
            (np.vstack([*weights, gates]), np.hstack([*biases, np.full(count, -_GATE * (n - 1))]))
        ]
        idle: list[FloatArray] = [-np.ones(len(bias)) for _, bias in first]
        for layer in middle:
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
