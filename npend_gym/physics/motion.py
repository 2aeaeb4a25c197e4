"""Motions integrated in time: their states at given instants, and the steps that lead there."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym._threads import Call
from npend_gym.compiled.arrays import innermost
from npend_gym.compiled.packs import WIDTH
from npend_gym.compiled.sincos import MAX_ANGLE
from npend_gym.physics.drives import Drives
from npend_gym.physics.equations import States
from npend_gym.physics.integration import (
    RODS_PER_CALL,
    RODS_PER_PACK_CALL,
    IntegrationError,
    check_angles,
    check_going,
    count_steps,
    diverged,
)
from npend_gym.physics.kernels.drive import Frames, Observer, drive_many, drive_one
from npend_gym.physics.kernels.driven import Torque
from npend_gym.physics.kernels.dynamics import AnyArrays
from npend_gym.physics.kernels.methods import METHODS
from npend_gym.physics.kernels.rk4 import new_rk4_scratch, rk4_frames, rk4_frames_of_packs
from npend_gym.physics.kernels.solver import (
    RUNNING,
    STATUS,
    STUCK,
    Problem,
    Solver,
    new_solver,
)
from npend_gym.physics.mechanism import Mechanism

_STEPS_KEPT = 4096  # in one compiled call that keeps them
MAX_BYTES = 2**33  # of the steps of a motion that are kept


class TakenSteps(NamedTuple):
    """Steps one after another, with the polynomials between their ends, if these are kept."""

    begin: FloatArray  # s, (S,)
    end: FloatArray  # (S,)
    states: FloatArray  # at the beginning of each, (S, 2m)
    polynomials: FloatArray  # (S, powers, 2m)
    refused: FloatArray  # steps refused in the compiled call so far, (S, 1)

    def states_at(self, step: NDArray[np.int64], fraction: FloatArray) -> FloatArray:
        """Return the states at fractions of steps, shape (..., 2m); the bits of `interpolate`."""
        poly, x = self.polynomials[step], fraction[..., None]
        u, last = 1.0 - x, self.polynomials.shape[1] - 1
        p = poly[..., last, :] * x
        for row in range(last - 1, 0, -1):
            p = (p + poly[..., row, :]) * (u if row % 2 else x)
        return self.states[step] + (p + poly[..., 0, :]) * x

    def times_at(self, step: NDArray[np.int64], fraction: FloatArray) -> FloatArray:
        """Return the instants at fractions of steps [s]."""
        begin = self.begin[step]
        return begin + fraction * (self.end[step] - begin)

    def columns(self, which: slice) -> TakenSteps:
        """Return the same steps with some entries of the states."""
        parts = self.states[:, which], self.polynomials[..., which]
        return TakenSteps(self.begin, self.end, *parts, self.refused)

    def sound(self, n: int) -> TakenSteps:
        """Return the steps of `n` rods up to the first that has diverged."""
        finite = np.isfinite(self.polynomials).all(axis=(1, 2))
        sound = finite & (np.abs(self.states[:, :n]) <= MAX_ANGLE).all(axis=1)
        last = int(np.append(sound, False).argmin())
        return TakenSteps(*(each[:last] for each in self))

    def counts(self, end: float) -> FloatArray:
        """Return the `Segment.counts` of the steps that begin before the instant `end` [s]."""
        taken = int(np.searchsorted(self.begin, end))
        return np.array([taken, self.refused[:taken].max(initial=0.0), taken])

    def at(self, times: FloatArray) -> FloatArray:
        """Return the states at instants within the steps, shape (..., 2m)."""
        step = np.clip(np.searchsorted(self.end, times), 0, self.end.size - 1)
        fraction = (times - self.begin[step]) / (self.end - self.begin)[step]
        return self.states_at(step, fraction)


class _Run(NamedTuple):
    """An integration in progress, but by Runge-Kutta 4."""

    lanes: tuple[Solver, Problem]
    status: FloatArray  # see `drive_many`


Advance = Callable[[int, FloatArray], tuple[int, FloatArray, FloatArray, Exception | None]]
_FAILURES = ValueError, IntegrationError  # that end a motion, not the program


class Segment(NamedTuple):
    """What comes from one compiled call."""

    frames: slice  # which of the instants have been passed
    states: FloatArray  # there, (lanes, F, 2m)
    steps: list[TakenSteps]  # of each lane, if they are kept
    counts: FloatArray  # steps taken, refused, and with dense output, (3 lanes,); zeros for "rk4"
    after: FloatArray  # the state at the end of the last step, as that of `Integration`
    torque: Torque  # what acted


class Integration:
    """A motion from a state, or a pack of them, to be integrated by a method of `simulate`.

    Parameters
    ----------
    mechanism : Mechanism
        Of one chain, or of each in a pack.
    state : ndarray, shape (2m,) or (2m WIDTH,)
        Of all coordinates, then their rates; the lane innermost.
    drives : Drives
        What acts on it in the course of time; they have begun. On a pack constants alone act.
    settings : mapping
        "rtol", "atol" and perhaps "dt", or "dt" alone, as the method takes them.
    members : slice, optional
        Which motions of the caller's stand in the pack, where errors shall name them.
    method : str
        One of `METHODS`.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        state: FloatArray,
        drives: Drives,
        settings: Mapping[str, float],
        members: slice | None = None,
        method: str = "dop853",
    ) -> None:
        self.mechanism: Mechanism = mechanism
        self.state: FloatArray = state
        self.drives: Drives = drives
        self.settings: Mapping[str, float] = settings
        self.members: slice | None = members
        self.arrays: AnyArrays = mechanism.arrays()
        self.width: int = state.size // (2 * mechanism.size)
        self.method = METHODS[method]
        # whether a step ends at each of the instants that are asked for
        self.stops: bool = method == "rk4"
        most = RODS_PER_CALL if self.width == 1 else RODS_PER_PACK_CALL
        self.steps_of_call: int = max(1, most // (mechanism.n * self.width))

    def segments(
        self, times: FloatArray, *, kept: bool = False, dense: bool = True, most: int = 0
    ) -> Iterator[Segment]:
        """Integrate from ``times[0]`` to ``times[-1]``.

        Where the integration fails, the steps before come first, then the exception.

        Parameters
        ----------
        times : ndarray, shape (T,)
            Instants at which the state is wanted [s].
        kept, dense : bool
            Whether the steps are kept, and their polynomials with them.
        most : int
            Steps in one compiled call; by default as many as take a sixth of a second.
        """
        state, width, size = self.state, self.width, 2 * self.mechanism.size
        count = self.steps_of_call
        count = min(count, most or (_STEPS_KEPT if kept else count))
        columns = 2 + size + (self.method.rows[1] * size + 1 if dense else 0)
        begin = self._fixed if self.stops else self._driven
        for piece, torque in self.drives.pieces(float(times[0]), float(times[-1])):
            first, last = np.searchsorted(times, piece, side="right")
            inner = times[first:last]
            # the last instant of a piece need not be one that is asked for
            extra = inner.size == 0 or inner[-1] != piece[1]
            ends = np.concatenate([piece[:1], inner, piece[1:] if extra else inner[:0]])
            frames, done = np.empty((width, ends.size, size)), 1
            advance = begin(state, ends, frames, torque)
            while done < ends.size:
                visited = np.zeros((width, count if kept else 0, columns if kept else 0))
                before, (done, counts, state, failure) = done, advance(count, visited)
                span = slice(int(first) + before - 1, int(first) + min(done, last - first + 1) - 1)
                states = frames[:, before : before + span.stop - span.start]
                steps = [_steps_of(rows, size) for rows in visited] if kept else []
                if failure is not None:
                    steps = [each.sound(self.mechanism.n) for each in steps]
                yield Segment(span, states, steps, counts, state, torque)
                if failure is not None:
                    raise failure

    def _driven(
        self, state: FloatArray, ends: FloatArray, frames: FloatArray, torque: Torque
    ) -> Advance:
        """A function that takes a number of steps at most, up to the last of `ends`.

        It returns how many of the frames are written, what was counted, the state reached, and
        the exception that ended the steps, if one did.
        """
        run = self._begin(float(ends[0]), state, torque)
        solver, progress = run.lanes[0], np.array([[1], [0]]).repeat(self.width, axis=1)

        def advance(
            count: int, visited: FloatArray
        ) -> tuple[int, FloatArray, FloatArray, Exception | None]:
            solver.counts[:], progress[1], failure = 0.0, 0, None
            try:
                self._take(run, Frames(ends, progress, frames, visited), float(ends[-1]), count)
            except _FAILURES as error:
                failure = error
            return int(progress[0].min()), solver.counts.copy(), solver.y.copy(), failure

        return advance

    def follow(self, begin: float, end: float, observer: Observer, call: Call) -> None:
        """Integrate from `begin` to `end` [s], or as far as is observed."""
        for _, torque in self.drives.pieces(begin, end):
            run = self._begin(begin, self.state, torque)
            while np.any(run.status[: self.width] == RUNNING) and not call.stopped:
                self._take(run, observer, end, self.steps_of_call)

    def _begin(self, t: float, state: FloatArray, torque: Torque) -> _Run:
        tolerances = self.settings.get("rtol", 0.0), self.settings.get("atol", 0.0)
        problem = Problem(self.arrays, torque, *tolerances)
        status = np.full(2 * self.width, RUNNING)
        return _Run((new_solver(t, state, self.method.rows, self.width), problem), status)

    def _take(self, run: _Run, observer: Observer, end: float, count: int) -> None:
        """Take at most `count` steps."""
        (solver, _), status, n = run.lanes, run.status, self.mechanism.n
        longest, half = self.settings.get("dt", math.inf), solver.y.size // 2
        # lanes that are done have no next step either
        starting = not np.any(solver.clock[2 * self.width : 3 * self.width])
        with self.drives.interruptible():
            kernel = drive_one if self.width == 1 else drive_many
            kernel(run.lanes, self.method, observer, starting, end, longest, count, status)
        q, u, t = solver.y[:half], solver.y[half:], float(solver.clock[self.width])
        self.drives.check(q, u, t, stuck=status[STATUS] == STUCK)
        check_going(run.lanes, status, n, self.members)

    def _fixed(
        self, state: FloatArray, ends: FloatArray, frames: FloatArray, torque: Torque
    ) -> Advance:
        """A function that takes steps of Runge-Kutta 4; see `_driven`."""
        y, dt, n, width = state.copy(), self.settings["dt"], self.mechanism.n, self.width
        steps, progress = count_steps(ends, dt), np.array([1, 0, 0])
        rods = torque, self.arrays, new_rk4_scratch(self.mechanism.size, width)
        kernel = rk4_frames if width == 1 else rk4_frames_of_packs

        def check(done: int, *, sound: bool) -> None:
            half, t = y.size // 2, float(ends[done - 1])
            self.drives.check(y[:half], y[half:], t, stuck=not sound)
            check_angles(y[: n * width], t)
            if not sound:
                springs = self.mechanism.springs is not None
                raise diverged(ends[done - 1 : done + 1], dt, springs=springs)

        def advance(
            count: int, visited: FloatArray
        ) -> tuple[int, FloatArray, FloatArray, Exception | None]:
            progress[2], failure = count, None
            with self.drives.interruptible():
                sound = kernel(y, ends, steps, progress, rods, frames, visited)
            sound = sound and bool(np.isfinite(y).all())  # also between two times
            try:
                check(int(progress[0]), sound=sound)
            except _FAILURES as error:
                failure = error
            return int(progress[0]), np.zeros(3 * width), y.copy(), failure

        return advance

    def steps(self, times: FloatArray) -> TakenSteps:
        """Return all steps from ``times[0]`` to ``times[-1]`` [s], which are taken once more."""
        parts: list[TakenSteps] = []
        ends = times if self.stops else times[[0, -1]]
        for segment in self.segments(ends, kept=True):
            parts += segment.steps
            if sum(part.polynomials.nbytes for part in parts) > MAX_BYTES:
                raise ValueError(
                    f"the steps of a motion must take at most {MAX_BYTES:g} bytes: "
                    "simulate it in segments"
                )
        return TakenSteps(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def _steps_of(visited: FloatArray, size: int) -> TakenSteps:
    visited = visited[visited[:, 1] > visited[:, 0]]
    states, rest = visited[:, 2 : 2 + size], visited[:, 2 + size :]
    powers = rest.shape[1] // size
    polynomials = rest[:, : powers * size].reshape(len(rest), powers, size)
    return TakenSteps(visited[:, 0], visited[:, 1], states, polynomials, rest[:, powers * size :])


def packs_of(count: int, kinds: Sequence[int] = ()) -> list[slice]:
    """Return which of `count` motions stand in a pack together: neighbours of one kind.

    `kinds` has the kind of each, if they may differ.
    """
    ends = [k for k, (one, next_one) in enumerate(pairwise(kinds), 1) if one != next_one]
    return [
        slice(k, min(k + WIDTH, last))
        for first, last in pairwise([0, *ends, count])
        for k in range(first, last, WIDTH)
    ]


def pack_of(
    states: States,
    members: slice,
    settings: Mapping[str, float],
    width: int = WIDTH,
    method: str = "dop853",
) -> Integration:
    """Return the motions from some of these states, (B, m), side by side under constant loads.

    Lanes to spare repeat the last of them.
    """
    lanes = np.minimum(np.arange(width) + members.start, members.stop - 1)
    state = innermost(np.hstack([states.q[lanes], states.u[lanes]]))
    loads = innermost(states.loads[lanes])
    drives = Drives(states.mechanism.n, loads, {}, loads.size)
    return Integration(states.mechanism.of(lanes), state, drives, settings, method=method)
