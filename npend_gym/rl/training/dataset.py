"""What imitation learns from: inputs of the student, actions of the expert, and a fit to them."""

# torch's stubs leave parts unknown
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from torch import nn

from npend_gym._checks import FloatArray
from npend_gym.rl.controllers.planning import Tracking

_MAX_LABEL = 1.5  # of the expert's actions, in units of the limit


class Dataset:
    """What a student was given, what the expert would have done, and how much that matters."""

    changes = ("size", "filled")

    def __init__(self, max_states: int, inputs: int, joints: int) -> None:
        self.size = 0
        self.inputs = torch.empty(max_states, inputs)
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


class Fit:
    """A network that is fitted to a growing dataset.

    Parameters
    ----------
    student : torch.nn.Module
    dataset : Dataset
    settings : Settings
        With the fields "seed", "minibatch_size", "learning_rate", "first_updates", "updates" and
        "rounds".

    Attributes
    ----------
    distance : float
        Mean of that from the expert's actions, in the last call.
    """

    changes = ("optimizer", "shuffler", "updates", "distance")

    def __init__(self, student: nn.Module, dataset: Dataset, settings: Any) -> None:
        self.student, self.dataset, self.settings = student, dataset, settings
        self.optimizer = torch.optim.Adam(student.parameters(), fused=True)
        self.shuffler = torch.Generator().manual_seed(settings.seed)
        self.updates = 0  # so far
        self.distance = math.inf

    def __call__(self, updates: int) -> None:
        """Fit the student to the dataset."""
        settings, dataset, total = self.settings, self.dataset, 0.0
        last = settings.first_updates + settings.rounds * settings.updates
        for _ in range(updates):
            rate = 0.5 * settings.learning_rate * (1.0 + math.cos(math.pi * self.updates / last))
            self.optimizer.param_groups[0]["lr"] = rate
            rows = torch.randint(dataset.size, (settings.minibatch_size,), generator=self.shuffler)
            actions, weights = dataset.actions[rows], dataset.weights[rows]
            prediction = self.student(dataset.inputs[rows])
            losses = nn.functional.smooth_l1_loss(prediction, actions, beta=0.2, reduction="none")
            loss = (weights * losses).mean() / weights.mean()
            self.optimizer.zero_grad()
            loss.backward()
            self.optimizer.step()
            self.updates += 1
            total += float((prediction.detach() - actions).abs().mean())
        self.distance = total / updates


@torch.no_grad()
def follow(student: nn.Module, learner: nn.Module, left: float) -> None:
    """Move parameters toward those of another network; the fraction `left` of them stays.

    A student that is such a mean of what the learner was lately stands long before the learner
    does, which every few updates lead astray (B. T. Polyak, A. B. Juditsky, SIAM Journal on Control
    and Optimization 30 (1992), 838-855).
    """
    for mean, latest in zip(student.parameters(), learner.parameters(), strict=True):
        mean.lerp_(latest, 1.0 - left)


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
