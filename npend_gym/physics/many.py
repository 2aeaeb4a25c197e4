"""Many motions side by side: `simulate` of states (B, n), by steps of their own in packs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from npend_gym._checks import FloatArray
from npend_gym._provenance import provenance
from npend_gym._threads import Call, share_out
from npend_gym.chain import Chain, ChainParameters
from npend_gym.compiled.arrays import innermost
from npend_gym.compiled.packs import WIDTH
from npend_gym.physics.arguments import check_chains, check_limits, check_states, check_torque
from npend_gym.physics.integration import RODS_PER_PACK_CALL, IntegrationError, check_angles
from npend_gym.physics.kernels.dop853 import Problem, Solver, new_solver
from npend_gym.physics.kernels.dynamics import arrays_of
from npend_gym.physics.kernels.many import RUNNING, STUCK, many_frames
from npend_gym.physics.trajectory import AXIAL, MAX_BYTES, OF_PIVOT, Integration, Trajectory


class Group(NamedTuple):
    """Up to WIDTH motions, not yet begun, as the kernels take them; spare lanes repeat the last."""

    solver: Solver
    problem: Problem
    members: slice


def new_group(
    parameters: ChainParameters,
    states: Sequence[FloatArray],
    begin: float,
    settings: dict[str, float],
    members: slice,
) -> Group:
    """Return the motions of `members` from states (theta, omega, torque), (B, n) each."""
    lanes = np.minimum(np.arange(WIDTH) + members.start, members.stop - 1)
    same = len(parameters.gravity) == 1
    chains = ChainParameters(*(np.asarray(p[np.zeros_like(lanes) if same else lanes])
                               for p in parameters))  # fmt: skip
    theta, omega, torque = (values[lanes] for values in states)
    solver = new_solver(begin, innermost(np.hstack([theta, omega])), WIDTH)
    tolerances = settings["rtol"], settings["atol"]
    return Group(solver, Problem(arrays_of(chains), innermost(torque), *tolerances), members)


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


def simulate_many(
    chains: tuple[Chain, ...],
    parameters: ChainParameters,
    states: tuple[FloatArray, ...],
    times: FloatArray,
    settings: dict[str, float],
    threads: int,
) -> Trajectory:
    """Return the motions from states (theta, omega, torque), (B, n) each; see `simulate`.

    All arguments have been checked.
    """
    n, count = chains[0].n, len(states[0])
    if 16 * times.size * count * n > MAX_BYTES:
        raise ValueError(
            f"times must hold at most {MAX_BYTES // (16 * n * count)} instants for {n * count} "
            f"rods in all, got {times.size}: simulate them in segments"
        )
    frames, counts = np.empty((count, times.size, 2 * n)), np.zeros((3, count))
    frames[:, 0, :n], frames[:, 0, n:] = states[:2]

    def follow(members: slice, call: Call) -> None:
        group = new_group(parameters, states, float(times[0]), settings, members)
        size = members.stop - members.start
        own = _frames_of(group, times, settings.get("dt", math.inf), n, call)
        frames[members, 1:] = own[:size, 1:]
        counts[:, members] = group.solver.counts.reshape(3, WIDTH)[:, :size]

    if times.size > 1:
        share_out(packs_of(count), threads, follow)
    given: dict[str, Any] = {"motions": count, "method": "dop853", **settings}
    if np.all(states[2] == states[2][0]):
        given["torque"] = states[2][0].tolist()
    return Trajectory(
        chains[0], times, frames[..., :n].copy(), frames[..., n:].copy(), provenance(given),
        status=np.zeros(count, np.int64), integration=Integration("dop853", states[2], settings),
        counts=counts.astype(np.int64), chains=chains if len(chains) > 1 else (),
    )  # fmt: skip


def check_many(
    chains: tuple[Chain, ...], theta: ArrayLike, omega: ArrayLike, torque: ArrayLike | None
) -> tuple[ChainParameters, tuple[FloatArray, ...]]:
    """Return the parameters, 1 or B, and theta, omega and torque, (B, n) each."""
    parameters, members = check_chains(chains, None)
    n = parameters.masses.shape[1]
    states = check_states(n, theta=theta, omega=omega, torque=check_torque(torque, n))
    if states[0].ndim == 1:
        states = tuple(np.tile(values, (members, 1)) for values in states)
    if states[0].ndim != 2 or (members > 1 and len(states[0]) != members):
        raise ValueError(
            f"theta, omega and torque must have the shape (B, {n})"
            + (f" for B = {members} chains" if members > 1 else "")
            + f", got {states[0].shape}"
        )
    check_limits(*states[:2])
    return parameters, states


def _frames_of(group: Group, times: FloatArray, longest: float, n: int, call: Call) -> FloatArray:
    """Return the states of the lanes of a group at all times, (WIDTH, T, 2n)."""
    frames = np.empty((WIDTH, times.size, 2 * n))
    status, done = np.full(WIDTH, RUNNING), np.ones(WIDTH, np.int64)
    attempts, starting = max(1, RODS_PER_PACK_CALL // (n * WIDTH)), True
    while np.any(status == RUNNING) and not call.stopped:
        lanes = group.solver, group.problem
        many_frames(lanes, starting, times, longest, attempts, status, done, frames)
        starting = False
        check_going(group, status, n)
    return frames


def stacked(each: Sequence[Trajectory], chains: tuple[Chain, ...]) -> Trajectory:
    """Return motions from the same instants as one trajectory; `chains` where they differ.

    After a terminal event there is no motion: the states are NaN, and its `status` is 1.
    """
    times = max((motion.times for motion in each if not np.any(motion.status)),
                key=len, default=None)  # fmt: skip
    if times is None:
        times = max((motion.times[:-1] for motion in each), key=len)
    own: dict[str, Any] = {}
    for name in ("theta", "omega", *OF_PIVOT, *AXIAL):
        rows = [getattr(motion, name) for motion in each]
        own[name] = None
        if rows[0] is not None:
            own[name] = np.full((len(each), times.size, rows[0].shape[-1]), np.nan)
            for to, row, motion in zip(own[name], rows, each, strict=True):
                size = min(len(row) - motion.status, times.size)
                to[:size] = row[:size]
    first, counts = each[0], [motion.counts for motion in each if motion.counts is not None]
    for name in ("t_events", "theta_events", "omega_events"):
        own[name] = [list(found) for found in zip(*(getattr(m, name) for m in each), strict=True)]
    return Trajectory(
        first.chain, times, provenance=first.provenance | {"motions": len(each)},
        pivot=first.pivot, springs=first.springs, chains=chains,
        status=np.array([motion.status for motion in each]),
        counts=np.array(counts).T if counts else None, **own,
    )  # fmt: skip
