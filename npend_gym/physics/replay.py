"""A motion integrated once more, some steps at a time, to differentiate the steps it takes."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import NamedTuple, cast

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.chain import ChainParameters
from npend_gym.physics.integration import check_adaptive_steps, check_fixed_steps, count_steps
from npend_gym.physics.kernels import dop853, rk4
from npend_gym.physics.kernels.dynamics import arrays_of
from npend_gym.physics.kernels.link_terms import LinkArrays, MachineArrays
from npend_gym.physics.kernels.sensitivities import Steps
from npend_gym.physics.kernels.tensions import ChainArrays

RigidArrays = ChainArrays | LinkArrays | MachineArrays


class Segment(NamedTuple):
    """Steps one after another, and which of the instants lie in them."""

    steps: Steps
    frames: slice


class Replay(ABC):
    """The motion of one rigid chain on a pivot at rest, from its start.

    The steps have the bits of those that `simulate` takes from the same start with the same
    settings, so that nothing of them need be kept.

    Parameters
    ----------
    parameters : ChainParameters
        Of one chain.
    state : ndarray, shape (2n,)
        theta [rad], then omega [rad/s], at ``times[0]``.
    times : ndarray, shape (T,)
        Instants [s], increasing.
    torque : ndarray, shape (n,)
        On every joint [N m].
    settings : mapping
        "rtol", "atol" and perhaps "dt", or "dt" alone, as `simulate` takes them.
    """

    stages: int  # that a step of the method has at most

    def __init__(
        self,
        parameters: ChainParameters,
        state: FloatArray,
        times: FloatArray,
        torque: FloatArray,
        settings: Mapping[str, float],
    ) -> None:
        self.chain = cast(RigidArrays, arrays_of(parameters))
        self.parameters, self.times, self.torque = parameters, times, torque
        self.settings = settings
        self.state = state.copy()  # now
        self._start()

    @abstractmethod
    def _start(self) -> None:
        """Prepare for the first step."""

    @property
    @abstractmethod
    def time(self) -> float:
        """Instant [s] of `state`."""

    @property
    @abstractmethod
    def ended(self) -> bool:
        """Whether the last instant is reached."""

    @abstractmethod
    def advance(self, count: int) -> Segment:
        """Take at most `count` steps, and return them."""

    @abstractmethod
    def mark(self) -> tuple[FloatArray, ...]:
        """Return what `go_back` needs to come to this place again."""

    @abstractmethod
    def go_back(self, mark: tuple[FloatArray, ...]) -> None:
        """Return to the place of `mark`."""


class AdaptiveReplay(Replay):
    """By the steps that DOP853 accepts."""

    stages = len(dop853.TABLEAU)

    def _start(self) -> None:
        rtol, atol = self.settings["rtol"], self.settings["atol"]
        self._problem = dop853.Problem(self.chain, self.torque, rtol, atol)
        self._longest = self.settings.get("dt", math.inf)
        self._solver = dop853.new_solver(float(self.times[0]), self.state)
        self.state = self._solver.y
        self._ends = self.times[[0, -1]]  # what lies between does not change the steps

    @property
    def time(self) -> float:
        """See `Replay`."""
        return float(self._solver.clock[1])

    @property
    def ended(self) -> bool:
        """See `Replay`."""
        return self.time >= float(self.times[-1])

    def advance(self, count: int) -> Segment:
        """See `Replay`."""
        visited, frames = np.zeros((count, 2 + self.state.size)), np.empty((2, self.state.size))
        starting = bool(self._solver.clock[2] == 0.0)  # no length of a step is chosen yet
        done = dop853.dop853_frames(
            self._solver, self._problem, starting, self._ends, 1, count, self._longest,
            frames, visited,
        )  # fmt: skip
        check_adaptive_steps(done, self._solver, self._problem, self.torque.size)
        visited = visited[visited[:, 1] > visited[:, 0]]
        begin, end, states = visited[:, 0], visited[:, 1], visited[:, 2:].copy()
        first, last = np.searchsorted(self.times, [begin[0], end[-1]], side="right")
        instants = self.times[first:last]
        at = np.searchsorted(end, instants)
        within, b = instants < end[at], dop853.TABLEAU[dop853.STAGES]
        weights = dop853.dense_weights((instants - begin[at]) / (end - begin)[at])
        weights[~within] = b
        stages = np.full(len(states), dop853.STAGES)
        stages[at[within]] = self.stages
        steps = Steps(states, end - begin, dop853.TABLEAU, stages, b.copy(), at, weights)
        return Segment(steps, slice(int(first), int(last)))

    def mark(self) -> tuple[FloatArray, ...]:
        """See `Replay`."""
        solver = self._solver
        return solver.clock.copy(), solver.y.copy(), solver.k[dop853.STAGES].copy()

    def go_back(self, mark: tuple[FloatArray, ...]) -> None:
        """See `Replay`."""
        solver = self._solver
        for to, value in zip((solver.clock, solver.y, solver.k[dop853.STAGES]), mark, strict=True):
            to[:] = value


class FixedReplay(Replay):
    """By the steps of Runge-Kutta 4 between the instants."""

    stages = len(rk4.TABLEAU)

    def _start(self) -> None:
        self._counts = count_steps(self.times, self.settings["dt"])
        self._ends = np.cumsum(self._counts) - self._counts[0]  # steps up to each instant
        self._progress = np.array([1, 0, 0])
        self._scratch = rk4.new_rk4_scratch(self.torque.size)
        self._frames = np.empty((self.times.size, self.state.size))

    @property
    def time(self) -> float:
        """See `Replay`."""
        return float(np.interp(self._done, self._ends, self.times))

    @property
    def ended(self) -> bool:
        """See `Replay`."""
        return bool(self._progress[0] == self.times.size)

    @property
    def _done(self) -> int:
        """Number of steps taken."""
        return int(self._ends[self._progress[0] - 1] + self._progress[1])

    def advance(self, count: int) -> Segment:
        """See `Replay`."""
        before = self._done
        count = min(count, int(self._ends[-1]) - before)
        states = np.empty((count, self.state.size))
        self._progress[2] = count
        sound = rk4.rk4_frames(
            self.state, self.times, self._counts, self._progress, self.torque, self.chain,
            self._scratch, self._frames, states,
        )  # fmt: skip
        theta = self.state[: self.torque.size]
        check_fixed_steps(sound, theta, self.times, int(self._progress[0]), self.settings["dt"])
        taken = np.arange(before, before + count)
        interval = np.searchsorted(self._ends, taken, side="right")
        lengths = np.diff(self.times)[interval - 1] / self._counts[interval]
        first, last = np.searchsorted(self._ends, [before, before + count], side="right")
        at = self._ends[first:last] - 1 - before
        weights = np.tile(rk4.WEIGHTS, (at.size, 1))
        stages = np.full(count, self.stages)
        steps = Steps(states, lengths, rk4.TABLEAU, stages, rk4.WEIGHTS, at, weights)
        return Segment(steps, slice(int(first), int(last)))

    def mark(self) -> tuple[FloatArray, ...]:
        """See `Replay`."""
        return self.state.copy(), self._progress.astype(float)

    def go_back(self, mark: tuple[FloatArray, ...]) -> None:
        """See `Replay`."""
        self.state[:], self._progress[:] = mark


def replay(
    method: str,
    parameters: ChainParameters,
    state: FloatArray,
    times: FloatArray,
    torque: FloatArray,
    settings: Mapping[str, float],
) -> Replay:
    """Return a replay by one of `simulate`'s methods, with its settings."""
    kind = FixedReplay if method == "rk4" else AdaptiveReplay
    return kind(parameters, state, times, torque, settings)
