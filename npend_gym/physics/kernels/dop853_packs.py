"""Many motions in packs, each lane with its own steps: their states at given times, their flips."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import bare, packs
from npend_gym.compiled.jit import inlined_kernel, inner_kernel, kernel
from npend_gym.compiled.packs import WIDTH, any_of, where
from npend_gym.physics.kernels.dop853 import (
    Problem,
    Solver,
    attempt,
    interpolate,
    lane_of_solver,
    prepare_dense,
    solver_as,
    start,
)
from npend_gym.physics.kernels.dynamics import copy

RUNNING, DONE, STUCK = 0.0, 1.0, -1.0  # stuck: no step is small enough
_HALVINGS = 60  # of a step: its length times 2^-60 is below what time resolves


@inlined_kernel
def _in_packs(problem: Problem) -> Problem:
    return Problem(packs(problem.chain), packs(problem.torque), problem.rtol, problem.atol)


@kernel
def many_frames(
    lanes: tuple[Solver, Problem], starting: bool, times: FloatArray, longest: float,
    max_steps: int, status: FloatArray, done: NDArray[np.int64], frames: FloatArray,
) -> None:  # fmt: skip
    """Write the states of WIDTH motions at all times into `frames` (WIDTH, T, 2n).

    Each lane takes steps of its own, none longer than `longest`. `status` (WIDTH,) says which go
    on, `done` (WIDTH,) how many of their frames are written. After `max_steps` attempts the call
    returns, and another continues. The bits are those of `dop853_frames`.
    """
    solver, problem, state = solver_as(packs, lanes[0]), _in_packs(lanes[1]), packs(status)
    bare_solver, clock, last = solver_as(bare, lanes[0]), solver.clock, times.size - 1
    if starting:
        start(solver, problem)
    for _ in range(max_steps):
        running = state[0] == RUNNING
        if not any_of(running):
            return
        clock[2] = where(clock[2] > longest, longest, clock[2])
        outcome = attempt(solver, where(running, times[last], clock[1]), problem)
        state[0] = where(running & (outcome < 0.0), STUCK, state[0])
        dense = False
        for lane in range(WIDTH):
            if status[lane] != RUNNING or times[done[lane]] > bare_solver.clock[WIDTH + lane]:
                continue
            own = lane_of_solver(bare_solver, lane, WIDTH)
            begin, end, within = own.clock[0], own.clock[1], False
            while done[lane] <= last and times[done[lane]] <= end:
                if times[done[lane]] == end:
                    copy(own.y, frames[lane, done[lane]])
                else:
                    if not dense:
                        prepare_dense(solver, problem)
                        dense = True
                    within = True
                    x = (times[done[lane]] - begin) / (end - begin)
                    interpolate(own, x, frames[lane, done[lane]])
                done[lane] += 1
            own.counts[2] += 1.0 if within else 0.0
            if done[lane] > last:
                status[lane] = DONE


@inlined_kernel
def _angle_at(solver: Solver, i: int, x: float) -> float:
    """Return component `i` of the state at the fraction `x` of the last step."""
    poly, u = solver.poly, 1.0 - x
    p = poly[6, i] * x
    p = (p + poly[5, i]) * u
    p = (p + poly[4, i]) * x
    p = (p + poly[3, i]) * u
    p = (p + poly[2, i]) * x
    p = (p + poly[1, i]) * u
    return solver.y_old[i] + (p + poly[0, i]) * x


@inlined_kernel
def _zero(solver: Solver, i: int, level: float, low: float, high: float) -> float:
    """Return the fraction of the step at which component `i` passes `level`, by halving."""
    before = _angle_at(solver, i, low) < level
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if (_angle_at(solver, i, middle) < level) == before:
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
            high = _zero(solver, rates + i, 0.0, 0.0, 1.0)
            if abs(_angle_at(solver, i, high)) < math.pi:
                continue
            end = _angle_at(solver, i, high)
        level = math.pi if end > begin else -math.pi
        x = _zero(solver, i, level, 0.0, high)
        if not x >= earliest:
            earliest = x
    return earliest


@kernel
def many_flips(
    lanes: tuple[Solver, Problem], n: int, starting: bool, duration: float, max_steps: int,
    status: FloatArray, flips: FloatArray,
) -> None:  # fmt: skip
    """Follow WIDTH motions from `n` rods within a half turn until one is upright, or `duration`.

    Its instant is written into `flips` (WIDTH,). `status` (2 WIDTH,) has room for which lanes have
    taken a step. See `many_frames` for the rest.
    """
    solver, problem, state = solver_as(packs, lanes[0]), _in_packs(lanes[1]), packs(status)
    bare_solver, clock = solver_as(bare, lanes[0]), solver.clock
    rates = solver.y.size // 2
    if starting:
        start(solver, problem)
    for _ in range(max_steps):
        running = state[0] == RUNNING
        if not any_of(running):
            return
        outcome = attempt(solver, where(running, duration, clock[1]), problem)
        state[0] = where(running & (outcome < 0.0), STUCK, state[0])
        taken = running & (outcome > 0.0)
        state[1] = where(taken, 1.0, 0.0)
        # where a rod may have come, at the sum of its speeds at both ends of the step
        reached = clock[1] < 0.0
        for i in range(n):
            fastest = abs(solver.y_old[rates + i]) + abs(solver.y[rates + i])
            far = abs(solver.y[i]) + (clock[1] - clock[0]) * fastest
            reached = reached | (far >= math.pi)
        if any_of(taken & reached):
            prepare_dense(solver, problem)
            for lane in range(WIDTH):
                own = lane_of_solver(bare_solver, lane, WIDTH)
                if status[WIDTH + lane] == 0.0:
                    continue
                x = _first_flip(own, n)
                if not math.isnan(x):
                    flips[lane] = own.clock[0] + x * (own.clock[1] - own.clock[0])
                    status[lane] = DONE
        state[0] = where(running & (state[0] == RUNNING) & (clock[1] >= duration), DONE, state[0])
