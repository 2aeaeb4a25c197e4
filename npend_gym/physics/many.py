"""Many motions side by side in packs: those that constants alone drive."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym._threads import Call, share_out
from npend_gym.compiled.arrays import innermost
from npend_gym.compiled.packs import WIDTH
from npend_gym.physics.integration import (
    MAX_BYTES,
    RODS_PER_CALL,
    RODS_PER_PACK_CALL,
    IntegrationError,
    check_angles,
    count_steps,
    diverged_text,
)
from npend_gym.physics.kernels.dop853 import Problem, Solver, new_solver
from npend_gym.physics.kernels.dop853_packs import RUNNING, STUCK, many_frames
from npend_gym.physics.kernels.rk4 import new_rk4_scratch, rk4_frames_of_packs
from npend_gym.physics.mechanism import AXIAL, PIVOT, Mechanism
from npend_gym.physics.start import Start
from npend_gym.physics.trajectory import EVENTS, Trajectory


class Packs(NamedTuple):
    """Motions to be integrated side by side."""

    mechanism: Mechanism
    states: FloatArray  # of each at the start, (B, 2m)
    loads: FloatArray  # constant torques, and forces on carts, (B, n) or (B, n + 1)
    settings: dict[str, float]


class Group(NamedTuple):
    """Up to WIDTH motions, not yet begun, as the kernels take them; spare lanes repeat the last."""

    solver: Solver
    problem: Problem
    members: slice


def new_group(packs: Packs, begin: float, members: slice) -> Group:
    """Return the motions of `members`, to be integrated by DOP853."""
    lanes = np.minimum(np.arange(WIDTH) + members.start, members.stop - 1)
    solver = new_solver(begin, innermost(packs.states[lanes]), WIDTH)
    arrays, loads = packs.mechanism.of(lanes).arrays(), innermost(packs.loads[lanes])
    tolerances = packs.settings["rtol"], packs.settings["atol"]
    return Group(solver, Problem(arrays, loads, *tolerances), members)


def packs_of(count: int) -> list[slice]:
    """Return which of `count` motions stand in a pack together."""
    return [slice(k, min(k + WIDTH, count)) for k in range(0, count, WIDTH)]


def check_going(group: Group, status: FloatArray, n: int) -> None:
    """Raise an error where a motion of the group cannot go on."""
    solver, members = group.solver, group.members
    clock = solver.clock.reshape(-1, WIDTH)[1]
    check_angles(solver.y[: n * WIDTH], float(clock.max()))
    if np.any(status[:WIDTH] == STUCK):
        lane = int(np.argmin(status[:WIDTH]))
        raise IntegrationError(
            f"no step is small enough at t = {clock[lane]:g} s for motion "
            f"{min(members.start + lane, members.stop - 1)} with rtol = {group.problem.rtol:g} and "
            f"atol = {group.problem.atol:g}: loosen them, or check its state and parameters"
        )


def frames_of_packs(
    packs: Packs, times: FloatArray, threads: int
) -> tuple[FloatArray, FloatArray | None]:
    """Return the states at all times, (B, T, 2m), and of DOP853 what was counted, (3, B)."""
    count, size = packs.states.shape
    n = packs.mechanism.n
    if 8 * times.size * count * size > MAX_BYTES:
        raise ValueError(
            f"times must hold at most {MAX_BYTES // (8 * size * count)} instants for {n * count} "
            f"rods in all, got {times.size}: simulate them in segments"
        )
    frames, counts = np.empty((count, times.size, size)), np.zeros((3, count))
    frames[:, 0] = packs.states
    adaptive = "rtol" in packs.settings

    def follow(members: slice, call: Call) -> None:
        width = members.stop - members.start
        if adaptive:
            group = new_group(packs, float(times[0]), members)
            own = _adaptive_frames(group, times, packs.settings.get("dt", math.inf), n, call)
            counts[:, members] = group.solver.counts.reshape(3, WIDTH)[:, :width]
        else:
            own = _fixed_frames(packs, times, members, call)
        frames[members, 1:] = own[:width, 1:]

    if times.size > 1:
        share_out(packs_of(count), threads, follow)
    return frames, counts if adaptive else None


def _adaptive_frames(
    group: Group, times: FloatArray, longest: float, n: int, call: Call
) -> FloatArray:
    """Return the states of the lanes of a group at all times, (WIDTH, T, 2m)."""
    frames = np.empty((WIDTH, times.size, group.solver.y.size // WIDTH))
    status, done = np.full(WIDTH, RUNNING), np.ones(WIDTH, np.int64)
    attempts, starting = max(1, RODS_PER_PACK_CALL // (n * WIDTH)), True
    while np.any(status == RUNNING) and not call.stopped:
        lanes = group.solver, group.problem
        many_frames(lanes, starting, times, longest, attempts, status, done, frames)
        starting = False
        check_going(group, status, n)
    return frames


def _fixed_frames(packs: Packs, times: FloatArray, members: slice, call: Call) -> FloatArray:
    """Return the same by Runge-Kutta 4."""
    lanes = np.minimum(np.arange(WIDTH) + members.start, members.stop - 1)
    n, dt, y = packs.mechanism.n, packs.settings["dt"], innermost(packs.states[lanes])
    arrays, loads = packs.mechanism.of(lanes).arrays(), innermost(packs.loads[lanes])
    steps, progress = count_steps(times, dt), np.array([1, 0, 0])
    scratch = new_rk4_scratch(packs.mechanism.size, WIDTH)
    frames = np.empty((times.size, y.size))
    while progress[0] < times.size and not call.stopped:
        before = int(progress[0])
        progress[2] = max(1, RODS_PER_CALL // (n * WIDTH))
        rk4_frames_of_packs(y, times, steps, progress, loads, arrays, scratch, frames)
        written = frames[before : int(progress[0])]
        lost = ~np.isfinite(written).all(axis=1)
        if lost.any():
            at = before + int(np.argmax(lost))
            raise IntegrationError(diverged_text(times[at - 1 : at + 1], dt))
        check_angles(y[: n * WIDTH], float(times[progress[0] - 1]))
    return frames.reshape(times.size, -1, WIDTH).transpose(2, 0, 1)


def stacked(each: Sequence[Trajectory], started: Start) -> Trajectory:
    """Return motions from the same instants as one trajectory.

    After a terminal event there is no motion: the states are NaN, and its `status` is 1.
    """
    times = max((motion.times for motion in each if not np.any(motion.status)),
                key=len, default=None)  # fmt: skip
    if times is None:
        times = max((motion.times[:-1] for motion in each), key=len)
    own: dict[str, Any] = {}
    for name in ("theta", "omega", *PIVOT, *AXIAL):
        rows = [getattr(motion, name) for motion in each]
        own[name] = None
        if rows[0] is not None:
            own[name] = np.full((len(each), times.size, *rows[0].shape[1:]), np.nan)
            for to, row, motion in zip(own[name], rows, each, strict=True):
                size = min(len(row) - motion.status, times.size)
                to[:size] = row[:size]
    first, counts = each[0], [motion.counts for motion in each if motion.counts is not None]
    for name in EVENTS:
        own[name] = [list(found) for found in zip(*(getattr(m, name) for m in each), strict=True)]
    recipe = None if first.recipe is None else started.recipe(first.recipe.settings)
    return Trajectory(
        first.chain, times, provenance=first.provenance | {"motions": len(each)}, recipe=recipe,
        chains=started.chains if len(started.chains) > 1 else (),
        status=np.array([motion.status for motion in each]),
        counts=np.array(counts).T if counts else None, **own,
    )  # fmt: skip
