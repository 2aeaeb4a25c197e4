"""The loop of a motion, or of WIDTH in a pack with steps of their own; its observers.

An *observer* looks at each step that is taken, and may end the motions it has seen enough of:
`Frames` keeps states and steps, `Flips` waits for a rod that turns over, `Releases` for the turning
points of all bobs.
"""

# ruff: noqa: ARG001  all observers share the parameters of a kernel
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import NumbersOf, bare, lane, packs
from npend_gym.compiled.jit import (
    chosen_by_type,
    inlined_kernel,
    inner_kernel,
    kernel,
    spliced_kernel,
)
from npend_gym.compiled.packs import WIDTH, any_of, where
from npend_gym.physics.kernels.dynamics import copy
from npend_gym.physics.kernels.methods import Method, attempt, prepare_dense, start
from npend_gym.physics.kernels.releases import Releases, observe_release
from npend_gym.physics.kernels.solver import (
    DONE,
    RUNNING,
    STATUS,
    STUCK,
    TAKEN,
    Problem,
    Solver,
    interpolate,
    state_at,
)

_HALVINGS = 60  # of a step: its length times 2^-60 is below what time resolves


class Frames(NamedTuple):
    """The states of each lane at given times, and the steps that lead there."""

    times: FloatArray  # (T,)
    progress: NDArray[np.int64]  # frames that are written, rows of `visited` that are: (2, lanes)
    frames: FloatArray  # (lanes, T, 2m)
    # Begin and end of each step and the state at its beginning, then, if there is room, its
    # polynomial and the count of refused steps: (lanes, steps, 2 + 2m or 3 + 2m (1 + powers)); or
    # nothing where steps are not kept
    visited: FloatArray


class Flips(NamedTuple):
    """When a rod first turns over, of motions that begin with `n` rods within a half turn."""

    n: int
    instants: FloatArray  # (lanes,)


Observer = Frames | Flips | Releases


@inlined_kernel
def _observe_frames(
    view: NumbersOf, width: int, solver: Solver, problem: Problem, method: Method, taken: bool,
    observer: Frames, status: FloatArray,
) -> None:  # fmt: skip
    times, visited, size = observer.times, observer.visited, observer.frames.shape[2]
    keeps = visited.shape[2] > 2 + size
    dense = keeps
    if keeps:
        prepare_dense(solver, problem, method)
    for k in range(width):
        if status[TAKEN * width + k] == 0.0:
            continue
        own, done, within = lane(solver, k), observer.progress[0, k], keeps
        begin, end = own.clock[0], own.clock[1]
        if visited.shape[1] > 0:
            row = visited[k, observer.progress[1, k]]
            observer.progress[1, k] += 1
            row[0], row[1] = begin, end
            copy(own.y_old, row[2:])
            if keeps:
                for p in range(own.poly.shape[0]):
                    copy(own.poly[p], row[2 + (p + 1) * size :])
                row[2 + (own.poly.shape[0] + 1) * size] = own.counts[1]
        while done < times.size and times[done] <= end:
            if times[done] == end:
                copy(own.y, observer.frames[k, done])
            else:
                if not dense:
                    prepare_dense(solver, problem, method)
                    dense = True
                within = True
                interpolate(own, (times[done] - begin) / (end - begin), observer.frames[k, done])
            done += 1
        observer.progress[0, k] = done
        own.counts[2] += 1.0 if within else 0.0


@inlined_kernel
def _zero(solver: Solver, i: int, level: float, high: float) -> float:
    """Return the fraction of the step, up to `high`, at which component `i` passes `level`."""
    low = 0.0
    before = state_at(solver, low, i)[0] < level
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if (state_at(solver, middle, i)[0] < level) == before:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@inner_kernel
def _first_flip(solver: Solver, n: int) -> float:
    """Return the fraction of the last step at which a rod first stands upright; NaN if none does.

    A rod that turns round within the step is looked at where it does.
    """
    rates, earliest = solver.y.size // 2, math.nan
    for i in range(n):
        begin, end = solver.y_old[i], solver.y[i]
        high = 1.0
        if abs(end) < math.pi:
            if solver.y_old[rates + i] * solver.y[rates + i] >= 0.0:
                continue
            high = _zero(solver, rates + i, 0.0, 1.0)
            end, _ = state_at(solver, high, i)
            if abs(end) < math.pi:
                continue
        x = _zero(solver, i, math.pi if end > begin else -math.pi, high)
        if not x >= earliest:
            earliest = x
    return earliest


@inlined_kernel
def _observe_flips(
    view: NumbersOf, width: int, solver: Solver, problem: Problem, method: Method, taken: bool,
    observer: Flips, status: FloatArray,
) -> None:  # fmt: skip
    rates, clock = solver.y.size // 2, solver.clock
    # where a rod may have come, at the sum of its speeds at both ends of the step
    reached = clock[1] < 0.0
    for i in range(observer.n):
        fastest = abs(solver.y_old[rates + i]) + abs(solver.y[rates + i])
        far = abs(solver.y[i]) + (clock[1] - clock[0]) * fastest
        reached = reached | (far >= math.pi)
    if not any_of(taken & reached):
        return
    prepare_dense(solver, problem, method)
    for k in range(width):
        if status[TAKEN * width + k] == 0.0:
            continue
        own = lane(solver, k)
        x = _first_flip(own, observer.n)
        if not math.isnan(x):
            observer.instants[k] = own.clock[0] + x * (own.clock[1] - own.clock[0])
            status[STATUS * width + k] = DONE


@chosen_by_type(
    "observer", {Frames: _observe_frames, Flips: _observe_flips, Releases: observe_release}
)
def _observe(
    view: NumbersOf, width: int, solver: Solver, problem: Problem, method: Method, taken: bool,
    observer: Observer, status: FloatArray,
) -> None:  # fmt: skip
    """Look at a step that the lanes in `taken` have taken."""
    raise NotImplementedError


@spliced_kernel
def _drive(
    view: NumbersOf, width: int, lanes: tuple[Solver, Problem], method: Method,
    observer: Observer, starting: bool, t_end: float, longest: float, steps: int,
    status: FloatArray,
) -> None:  # fmt: skip
    solver, problem = view(lanes)
    state, clock = view(status), solver.clock
    if starting:
        start(solver, problem, method, t_end - clock[1], longest)
    while steps > 0:
        running = state[STATUS] == RUNNING
        if not any_of(running):
            break
        clock[2] = where(clock[2] > longest, longest, clock[2])
        outcome = attempt(solver, where(running, t_end, clock[1]), problem, method)
        state[STATUS] = where(running & (outcome < 0.0), STUCK, state[STATUS])
        taken = running & (outcome > 0.0)
        if any_of(taken):
            state[TAKEN] = where(taken, 1.0, 0.0)
            _observe(view, width, solver, problem, method, taken, observer, bare(status))
            over = taken & (state[STATUS] == RUNNING) & (clock[1] >= t_end)
            state[STATUS] = where(over, DONE, state[STATUS])
            steps -= 1


@kernel
def drive_one(
    lanes: tuple[Solver, Problem], method: Method, observer: Observer, starting: bool,
    t_end: float, longest: float, steps: int, status: FloatArray,
) -> None:  # fmt: skip
    """Follow one motion; see `drive_many`."""
    _drive(bare, 1, lanes, bare(method), bare(observer), starting, t_end, longest, steps, status)


@kernel
def drive_many(
    lanes: tuple[Solver, Problem], method: Method, observer: Observer, starting: bool,
    t_end: float, longest: float, steps: int, status: FloatArray,
) -> None:  # fmt: skip
    """Follow WIDTH motions up to `t_end`, or until the observer ends them.

    Each lane takes steps of its own, none longer than `longest`, with the bits of `drive_one`.
    `status` has two rows, which lanes go on and which have taken the last step. After `steps` of
    the pack the call returns, and another, which is not `starting`, continues.
    """
    _drive(
        packs, WIDTH, lanes, bare(method), bare(observer), starting, t_end, longest, steps, status
    )
