"""What imitation learns from: inputs of the student, and actions of the expert."""

# torch's stubs leave parts unknown
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

from typing import Any

import numpy as np
import torch

from npend_gym._checks import FloatArray
from npend_gym.rl.controllers.tracking import Tracking

_MAX_LABEL = 1.5  # of the expert's actions, in units of the limit


class Dataset:
    """What a student was given, what the expert would have done, and how much that matters."""

    changes: tuple[str, ...] = ("size", "filled")

    def __init__(self, max_states: int, inputs: int, joints: int) -> None:
        self.size: int = 0
        self.inputs: torch.Tensor = torch.empty(max_states, inputs)
        self.actions: torch.Tensor
        self.weights: torch.Tensor
        self.actions, self.weights = torch.empty(2, max_states, joints)

    @property
    def filled(self) -> list[torch.Tensor]:
        """The rows that are in use, of inputs, actions and weights."""
        return [part[: self.size].clone() for part in self._parts()]

    @filled.setter
    def filled(self, rows: list[torch.Tensor]) -> None:
        for part, saved in zip(self._parts(), rows, strict=True):
            part[: len(saved)] = saved

    def _parts(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        return self.inputs, self.actions, self.weights

    def add(
        self, inputs: torch.Tensor, tracking: Tracking, chosen: Any, rng: np.random.Generator
    ) -> None:
        """Add the states of the `chosen` environments."""
        count, places = int(chosen.sum()), len(self.inputs)
        rows = np.arange(self.size, self.size + count)
        if self.size + count > places:
            rows = rng.integers(self.size, size=count)
        else:
            self.size += count
        self.inputs[rows] = inputs[torch.from_numpy(chosen)]
        labels = tracking.actions[chosen].clip(-_MAX_LABEL, _MAX_LABEL)
        weights: FloatArray = np.sqrt(tracking.action_weight[chosen])
        self.actions[rows] = torch.from_numpy(labels.astype(np.float32))
        self.weights[rows] = torch.from_numpy(weights.astype(np.float32))


def differences(
    length: int, obs_scale: torch.Tensor, change_scale: torch.Tensor, joints: int
) -> torch.Tensor:
    """Return the matrix that makes the frames of a `History`, as a row, inputs of a network.

    These are the newest observation over `obs_scale`, (k,), by how much the others changed from
    each to the next, over `change_scale`, and the actions. Angular velocities are then as easy to
    find in the angles as in what is observed of them. A `length` of 1 is an observation alone.
    """
    if length == 1:
        return torch.diag(1.0 / obs_scale)
    size = len(obs_scale)
    matrix = torch.zeros(length, size + joints, length, size + joints)
    entries = torch.arange(size)
    for j in range(length):
        matrix[j, size:, j, size:] = torch.eye(joints)
        matrix[j, entries, j, entries] = 1.0 / (change_scale if j > 0 else obs_scale)
        if j > 0:
            matrix[j - 1, entries, j, entries] = -1.0 / change_scale
    return matrix.reshape(length * (size + joints), -1)
