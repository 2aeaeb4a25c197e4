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

_Layer = tuple[FloatArray, FloatArray]  # weights and biases
_GATE = 16.0  # beyond it tanh is -1 or 1 to rounding


def numbers_of(stands: torch.Tensor) -> torch.Tensor:
    """Return the numbers of goals, (B,), from which rods stand in them, (B, n)."""
    return (stands.long() << torch.arange(stands.shape[1])).sum(dim=1)


class GoalNetworks(nn.Module):
    """Networks of hidden tanh layers, one of which acts: that for the goal.

    The last numbers that they are given are the goal, for each rod 1 (hangs) or -1 (stands). What a
    single network learns about one goal changes what it does about the others.
    """

    def __init__(self, networks: Sequence[nn.Sequential]) -> None:
        super().__init__()
        self.networks: nn.ModuleList = nn.ModuleList(networks)
        self._n = len(networks).bit_length() - 1  # rods

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """Return the outputs, (B, joints), for inputs (B, k)."""
        numbers = numbers_of(inputs[:, -self._n :] < 0.0)
        order = torch.argsort(numbers)
        counts = torch.bincount(numbers, minlength=len(self.networks)).tolist()
        parts = zip(self.networks, inputs[order].split(counts), strict=True)
        outputs = torch.cat([network(part) for network, part in parts])
        return outputs[torch.argsort(order)]

    def merged(self) -> nn.Sequential:
        """Return a network with the units of all of them.

        For each goal the first layer has one more unit: 1 in episodes with this goal, -1 in others.
        In others a gate holds the units of the second layer at -1. It exceeds all that the first
        layer can add, whose units lie between -1 and 1. So what idle units add to the outputs is
        known, and the unit of their goal takes it away.
        """
        n, count = self._n, len(self.networks)
        goals = 1.0 - 2.0 * (np.arange(count)[:, None] >> np.arange(n) & 1)
        first, second, *later, last = zip(*map(_layers, self.networks), strict=True)
        of_goals = np.hstack([np.zeros((count, first[0][0].shape[1] - n)), _GATE * goals])
        weights = np.vstack([*(weight for weight, _ in first), of_goals])
        biases = np.hstack([*(bias for _, bias in first), np.full(count, -_GATE * (n - 1))])
        whole: list[tuple[Any, Any]] = [(weights, biases)]
        gates = [np.abs(weight).sum(axis=1) + np.abs(bias) + _GATE for weight, bias in second]
        weights, biases = _side_by_side(second)
        weights[:-count, -count:] = block_diag(*(gate[:, None] for gate in gates))
        biases[:-count] -= np.hstack(gates)
        whole.append((weights, biases))
        idle: list[FloatArray] = [-np.ones(len(bias)) for _, bias in second]
        for layer in later:
            whole.append(_side_by_side(layer))
            parts = zip(layer, idle, strict=True)
            idle = [np.tanh(weight @ values + bias) for (weight, bias), values in parts]
        left = [weight @ values for (weight, _), values in zip(last, idle, strict=True)]
        added = [bias for _, bias in last]
        outputs = np.hstack([*(weight for weight, _ in last), 0.5 * np.add(added, left).T])
        whole.append((outputs, 0.5 * np.subtract(added, left).sum(axis=0)))
        modules = [module for layer in whole for module in (_linear(*layer), nn.Tanh())]
        return nn.Sequential(*modules[:-1])


def _side_by_side(layer: Sequence[_Layer]) -> _Layer:
    """Return the layers of all networks as one, which hands the units of the goals on."""
    count = len(layer)
    weights = block_diag(*(weight for weight, _ in layer), _GATE * np.eye(count))
    return weights, np.hstack([*(bias for _, bias in layer), np.zeros(count)])


def _layers(network: Any) -> list[_Layer]:
    """Return weights and biases of the layers of a network."""
    arrays = [each.detach().numpy().astype(np.float64) for each in network.parameters()]
    return list(zip(arrays[::2], arrays[1::2], strict=True))


def _linear(weight: FloatArray, bias: FloatArray) -> nn.Linear:
    layer = nn.Linear(weight.shape[1], weight.shape[0])
    layer.weight, layer.bias = (
        nn.Parameter(torch.from_numpy(each.astype(np.float32))) for each in (weight, bias)
    )
    return layer
