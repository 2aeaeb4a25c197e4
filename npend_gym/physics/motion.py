"""One motion integrated in time: its states at given instants, and the steps that lead there."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.physics.drives import Drives
from npend_gym.physics.integration import (
    RODS_PER_CALL,
    check_adaptive_steps,
    check_fixed_steps,
    count_steps,
)
from npend_gym.physics.kernels.dop853 import Problem, dop853_frames, new_solver
from npend_gym.physics.kernels.driven import Torque
from npend_gym.physics.kernels.rk4 import new_rk4_scratch, rk4_frames
from npend_gym.physics.mechanism import Mechanism

_STEPS_KEPT = 4096  # in one compiled call that keeps them
MAX_BYTES = 2**33  # of the steps of a motion that are kept
_NOWHERE = np.zeros((0, 0))  # steps are not recorded
_POWERS = {"dop853": 7, "rk4": 3}  # rows of the polynomial of a step


class Steps(NamedTuple):
    """Steps one after another, with the polynomials between their ends, if these are kept."""

    begin: FloatArray  # s, (S,)
    end: FloatArray  # (S,)
    states: FloatArray  # at the beginning of each, (S, 2m)
    polynomials: FloatArray  # (S, powers, 2m)

    def states_at(self, step: NDArray[np.int64], fraction: FloatArray) -> FloatArray:
        """Return the states at fractions of steps, shape (..., 2m); the bits of `interpolate`."""
        poly, x = self.polynomials[step], fraction[..., None]
        u, last = 1.0 - x, self.polynomials.shape[1] - 1
        p = poly[..., last, :] * x
        for row in range(last - 1, 0, -1):
            p = (p + poly[..., row, :]) * (u if row % 2 else x)
        return self.states[step] + (p + poly[..., 0, :]) * x

    def parts(self, size: int) -> Iterator[Steps]:
        """Yield these steps, so many at a time."""
        for first in range(0, len(self.begin), size):
            yield Steps(*(each[first : first + size] for each in self))

    def at(self, times: FloatArray) -> FloatArray:
        """Return the states at instants within the steps, shape (..., 2m)."""
        step = np.clip(np.searchsorted(self.end, times), 0, self.end.size - 1)
        fraction = (times - self.begin[step]) / (self.end - self.begin)[step]
        return self.states_at(step, fraction)


Advance = Callable[[int, FloatArray], tuple[int, FloatArray, FloatArray]]


class Segment(NamedTuple):
    """What comes from one compiled call."""

    frames: slice  # which of the instants have been passed
    states: FloatArray  # there, (F, 2m)
    steps: Steps | None  # if they are kept
    counts: FloatArray  # steps taken, refused, and with dense output; zeros for "rk4"
    after: FloatArray  # the state at the end of the last step, (2m,)
    torque: Torque  # what acted


class Motion:
    """A motion from a state, to be integrated by one of the methods of `simulate`.

    Parameters
    ----------
    mechanism : Mechanism
        Of one chain.
    state : ndarray, shape (2m,)
        Of all coordinates, then their rates.
    drives : Drives
        What acts on it in the course of time; they have begun.
    settings : mapping
        "rtol", "atol" and perhaps "dt", or "dt" alone, as `simulate` takes them.
    """

    def __init__(
        self, mechanism: Mechanism, state: FloatArray, drives: Drives, settings: Mapping[str, float]
    ) -> None:
        self.mechanism, self.state = mechanism, state
        self.drives, self.settings = drives, settings
        self.arrays = mechanism.arrays()
        self.method = "dop853" if "rtol" in settings else "rk4"

    def segments(
        self, times: FloatArray, *, kept: bool = False, dense: bool = True, most: int = 0
    ) -> Iterator[Segment]:
        """Integrate from ``times[0]`` to ``times[-1]``.

        Parameters
        ----------
        times : ndarray, shape (T,)
            Instants at which the state is wanted [s].
        kept, dense : bool
            Whether the steps are kept, and their polynomials with them.
        most : int
            Steps in one compiled call; by default as many as take a sixth of a second.
        """
        state, size, n = self.state, self.state.size, self.mechanism.n
        count = max(1, RODS_PER_CALL // n)
        count = min(count, most or (_STEPS_KEPT if kept else count))
        width = 2 + (1 + (_POWERS[self.method] if dense else 0)) * size
        begin = self._adaptive if self.method == "dop853" else self._fixed
        for piece, torque in self.drives.pieces(float(times[0]), float(times[-1])):
            first, last = np.searchsorted(times, piece, side="right")
            inner = times[first:last]
            # the last instant of a piece need not be one that is asked for
            extra = inner.size == 0 or inner[-1] != piece[1]
            ends = np.concatenate([piece[:1], inner, piece[1:] if extra else inner[:0]])
            frames, done = np.empty((ends.size, size)), 1
            advance = begin(state, ends, frames, torque)
            while done < ends.size:
                visited = np.zeros((count, width)) if kept else _NOWHERE
                before, (done, counts, after) = done, advance(count, visited)
                span = slice(int(first) + before - 1, int(first) + min(done, last - first + 1) - 1)
                states = frames[before : before + span.stop - span.start]
                steps = _steps_of(visited, size) if kept else None
                yield Segment(span, states, steps, counts, after, torque)
            state = frames[-1]

    def _adaptive(
        self, state: FloatArray, ends: FloatArray, frames: FloatArray, torque: Torque
    ) -> Advance:
        """Return what takes at most so many steps of DOP853, up to the last of `ends`.

        It returns how many of the frames are written, what was counted, and the state reached.
        """
        solver = new_solver(float(ends[0]), state)
        problem = Problem(self.arrays, torque, self.settings["rtol"], self.settings["atol"])
        longest, n, done = self.settings.get("dt", math.inf), self.mechanism.n, 1
        starting = True

        def advance(count: int, visited: FloatArray) -> tuple[int, FloatArray, FloatArray]:
            nonlocal done, starting
            counted = solver.counts.copy()
            with self.drives.interruptible():
                done = dop853_frames(
                    solver, problem, starting, ends, done, count, longest, frames, visited
                )
            starting = False
            q, u = np.split(solver.y, 2)
            self.drives.check(q, u, float(solver.clock[1]), stuck=done < 0)
            check_adaptive_steps(done, solver, problem, n)
            return done, solver.counts - counted, solver.y.copy()

        return advance

    def _fixed(
        self, state: FloatArray, ends: FloatArray, frames: FloatArray, torque: Torque
    ) -> Advance:
        """Return what takes steps of Runge-Kutta 4; see `_adaptive`."""
        y, m, dt, n = state.copy(), state.size // 2, self.settings["dt"], self.mechanism.n
        steps, progress, scratch = count_steps(ends, dt), np.array([1, 0, 0]), new_rk4_scratch(m)

        def advance(count: int, visited: FloatArray) -> tuple[int, FloatArray, FloatArray]:
            progress[2] = count
            with self.drives.interruptible():
                sound = rk4_frames(
                    y, ends, steps, progress, torque, self.arrays, scratch, frames, visited
                )
            done = int(progress[0])
            self.drives.check(y[:m], y[m:], float(ends[done - 1]), stuck=not sound)
            springs = self.mechanism.springs is not None
            check_fixed_steps(sound, y[:n], ends, done, dt, springs=springs)
            return done, np.zeros(3), y.copy()

        return advance

    def steps(self, times: FloatArray) -> Steps:
        """Return all steps from ``times[0]`` to ``times[-1]`` [s], which are taken once more."""
        parts: list[Steps] = []
        ends = times if self.method == "rk4" else times[[0, -1]]
        for segment in self.segments(ends, kept=True):
            parts += [] if segment.steps is None else [segment.steps]
            if sum(part.polynomials.nbytes for part in parts) > MAX_BYTES:
                raise ValueError(
                    f"the steps of a motion must take at most {MAX_BYTES:g} bytes: "
                    "simulate it in segments"
                )
        return Steps(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def _steps_of(visited: FloatArray, size: int) -> Steps:
    visited = visited[visited[:, 1] > visited[:, 0]]
    states, rest = visited[:, 2 : 2 + size], visited[:, 2 + size :]
    polynomials = rest.reshape(len(rest), rest.shape[1] // size, size)
    return Steps(visited[:, 0], visited[:, 1], states, polynomials)
