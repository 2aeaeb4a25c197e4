"""Runge-Kutta steps with their tangents and adjoints, alone and as steps of an ensemble."""

from __future__ import annotations

from typing import Any

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import bare, packs
from npend_gym.compiled.jit import inlined_kernel, kernel, spliced_kernel
from npend_gym.compiled.packs import any_of, where
from npend_gym.physics.kernels.adjoint import ADJOINT_ROWS, adjoint
from npend_gym.physics.kernels.advance import MAX_PARTS, substep_parts
from npend_gym.physics.kernels.dynamics import (
    ANSWER_ROWS,
    WORK_ROWS,
    AnyArrays,
    accelerations_kept,
    copy,
    respond,
)
from npend_gym.physics.kernels.layout import Group, Model, Timing, group_of
from npend_gym.physics.kernels.tangent import POSE_ROWS, pose, tangent

# Rows that a stage keeps: those of `accelerations_kept`, then its accelerations and velocities
_ALPHA, _OMEGA = WORK_ROWS + 1, WORK_ROWS + 2
STAGE_ROWS = WORK_ROWS + 3
STEP_ROWS = 4 * STAGE_ROWS

_OFFSETS = (0.0, 0.5, 0.5, 1.0, 0.0)  # where in the step each stage is; there is none after four
_WEIGHTS = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)

# Rows of the work space of one group: the state on its way, in how many parts each lane takes the
# substep, what `respond` leaves, what a tangent or an adjoint needs, the poses of the four stages;
# then the tapes
_THETA, _OMEGA_NOW, _X, _PARTS, _ANSWER_ROWS = 0, 1, 2, 3, 4
_FIRST = _ANSWER_ROWS + ANSWER_ROWS
_X_BAR, _W_BAR, _A_BAR, _LAM, _THETA_BAR, _OMEGA_BAR = range(6)
_ADJOINT = 6
_TURNED, _SPED, _FORCE, _GAIN, _SUM_THETA, _SUM_OMEGA, _OUT = range(7)
_POSES = _FIRST + max(_ADJOINT + ADJOINT_ROWS, _OUT + 4)
TAPE = _POSES + 4 * POSE_ROWS


@spliced_kernel  # on a GPU no other function may return a view
def _stage(tape: FloatArray, k: int) -> FloatArray:
    return tape[k * STAGE_ROWS : (k + 1) * STAGE_ROWS]


@inlined_kernel
def _rk4_kept(
    theta: FloatArray, omega: FloatArray, h: Any, torque: FloatArray, chain: AnyArrays,
    x: FloatArray, tape: FloatArray,
) -> None:  # fmt: skip
    """Take a Runge-Kutta step, with the bits of `rk4_step`, that leaves its stages in `tape`."""
    size = theta.size
    copy(theta, x)
    copy(omega, _stage(tape, 0)[_OMEGA][:size])
    for k in range(4):
        stage = _stage(tape, k)
        w = stage[_OMEGA][:size]
        if k > 0:
            before, part = _stage(tape, k - 1), _OFFSETS[k] * h
            for i in range(size):
                x[i] = theta[i] + part * before[_OMEGA][i]
                w[i] = omega[i] + part * before[_ALPHA][i]
        accelerations_kept(x, w, torque, chain, stage, stage[_ALPHA][:size])
    sixth = h / 6.0
    one, two, three, four = _stage(tape, 0), _stage(tape, 1), _stage(tape, 2), _stage(tape, 3)
    for i in range(size):
        ends, inner = one[_OMEGA][i] + four[_OMEGA][i], two[_OMEGA][i] + three[_OMEGA][i]
        theta[i] = theta[i] + sixth * (ends + 2.0 * inner)
        ends, inner = one[_ALPHA][i] + four[_ALPHA][i], two[_ALPHA][i] + three[_ALPHA][i]
        omega[i] = omega[i] + sixth * (ends + 2.0 * inner)


@inlined_kernel
def _rk4_adjoint(
    h: Any, group: Group, tape: FloatArray, bars: FloatArray, chain_bar: FloatArray,
    answer: FloatArray, rows: FloatArray,
) -> None:  # fmt: skip
    """Take derivatives by the end of a step, the rows of `bars`, back to its start, in place.

    They are by theta, omega and, added up, the torques.
    """
    size = group.theta.size
    theta_bar, omega_bar, torque_bar = bars[0][:size], bars[1][:size], bars[2][:size]
    x, w, a, lam = rows[_X_BAR][:size], rows[_W_BAR][:size], rows[_A_BAR][:size], rows[_LAM][:size]
    theta_end, omega_end = rows[_THETA_BAR], rows[_OMEGA_BAR]
    weight = _WEIGHTS[3] * h
    for i in range(size):
        theta_end[i], omega_end[i] = theta_bar[i], omega_bar[i]
        w[i], a[i] = weight * theta_bar[i], weight * omega_bar[i]
    for back in range(4):
        k = 3 - back
        stage = _stage(tape, k)
        respond(a, group.chain, stage, answer, lam)
        adjoint(
            stage[_OMEGA][:size], stage[_ALPHA][:size], lam, group.chain, group.mass, stage,
            answer, rows[_ADJOINT:], x, w, torque_bar, chain_bar,
        )  # fmt: skip
        part, weight = _OFFSETS[k] * h, _WEIGHTS[k - 1] * h
        for i in range(size):
            by_theta, by_omega = x[i], w[i]
            theta_bar[i] = theta_bar[i] + by_theta
            omega_bar[i] = omega_bar[i] + by_omega
            w[i] = weight * theta_end[i] + part * by_theta
            a[i] = weight * omega_end[i] + part * by_omega


@inlined_kernel
def _rk4_tangent(
    h: Any, group: Group, tape: FloatArray, poses: FloatArray, change: FloatArray,
    pushed: FloatArray, changed: FloatArray, answer: FloatArray, rows: FloatArray,
) -> None:  # fmt: skip
    """Carry a `change` of theta and omega at the start of a step to its end, in place."""
    size, chain = group.theta.size, group.chain
    theta, omega, turned, sped = change[0], change[1], rows[_TURNED][:size], rows[_SPED][:size]
    force, gain = rows[_FORCE][:size], rows[_GAIN][:size]
    sum_theta, sum_omega = rows[_SUM_THETA], rows[_SUM_OMEGA]
    for i in range(size):
        turned[i], sped[i] = theta[i], omega[i]
        sum_theta[i] = sum_omega[i] = 0.0 * theta[i]
    for k in range(4):
        stage = _stage(tape, k)
        tangent(
            stage[_OMEGA][:size], stage[_ALPHA][:size], turned, sped, pushed, changed, chain,
            group.mass, poses[k * POSE_ROWS :], rows[_OUT:], force,
        )  # fmt: skip
        respond(force, chain, stage, answer, gain)
        part, weight = _OFFSETS[k + 1] * h, _WEIGHTS[k]
        for i in range(size):
            faster, gained = sped[i], gain[i]
            sum_theta[i] = sum_theta[i] + weight * faster
            sum_omega[i] = sum_omega[i] + weight * gained
            turned[i], sped[i] = theta[i] + part * faster, omega[i] + part * gained
    for i in range(size):
        theta[i] = theta[i] + h * sum_theta[i]
        omega[i] = omega[i] + h * sum_omega[i]


@inlined_kernel
def _part_length(parts: Any, part: int, timing: FloatArray) -> Any:
    """Return the length of a part of a substep, zero in the lanes that have fewer."""
    return where(parts > part, timing[Timing.DT] / timing[Timing.SUBSTEPS] / parts, 0.0)


@inlined_kernel
def _take_part(group: Group, h: Any, rest: FloatArray, tape: FloatArray) -> None:
    """Take a Runge-Kutta step from the state in `rest`."""
    size = group.theta.size
    theta, omega, x = rest[_THETA][:size], rest[_OMEGA_NOW][:size], rest[_X][:size]
    _rk4_kept(theta, omega, h, group.torque, group.chain, x, tape)


@inlined_kernel
def _count_parts(group: Group, timing: FloatArray, rest: FloatArray) -> Any:
    """Return into how many parts each lane cuts the substep from the state in `rest`."""
    whole, omega = timing[Timing.DT] / timing[Timing.SUBSTEPS], rest[_OMEGA_NOW]
    return substep_parts(omega, group.velocity.size, whole, timing[Timing.PER_ROTATION])


@inlined_kernel
def _directions(changed: FloatArray, d: int, first: int) -> FloatArray:
    """Return how direction `d` changes parameters; empty before the first that does."""
    return changed[max(0, d - first)][: changed.shape[1] if d >= first else 0]


@spliced_kernel
def tangents_of_group(
    group: Group, timing: FloatArray, changes: FloatArray, pushed: FloatArray,
    changed: FloatArray, reached: FloatArray, rest: FloatArray,
) -> None:  # fmt: skip
    """See `tangents_many`; without any `changes` it is a step alone."""
    size, poses, tape = group.theta.size, rest[_POSES:], rest[TAPE:]
    count, first = changes.shape[0], changes.shape[0] - changed.shape[0]
    copy(group.theta, rest[_THETA])
    copy(group.omega, rest[_OMEGA_NOW])
    for _ in range(int(timing[Timing.SUBSTEPS])):
        parts = _count_parts(group, timing, rest)
        part = 0
        while part == 0 or any_of(parts > part):
            h = _part_length(parts, part, timing)
            _take_part(group, h, rest, tape)
            for k in range(4 if count > 0 else 0):
                stage = _stage(tape, k)
                u, alpha = stage[_OMEGA][:size], stage[_ALPHA][:size]
                pose(u, alpha, group.chain, group.mass, stage, poses[k * POSE_ROWS :])
            for d in range(count):
                _rk4_tangent(
                    h, group, tape, poses, changes[d], pushed[d], _directions(changed, d, first),
                    rest[_ANSWER_ROWS:], rest[_FIRST:],
                )  # fmt: skip
            part += 1
    copy(rest[_THETA][:size], reached[0])
    copy(rest[_OMEGA_NOW][:size], reached[1])


@kernel
def tangents_many(
    members: FloatArray, rods: FloatArray, model: Model, changes: FloatArray, pushed: FloatArray,
    changed: FloatArray, reached: FloatArray, timing: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Carry changes of the members' states, torques and parameters through a step of `timing`.

    `changes` (groups, D, 2, row) has those of theta and omega, before and after; `pushed`
    (D, n + 1) those of the torques and `changed` (K, len(Parameter) or 0, n) those of the
    parameters, the same for all members, in the last K of the D. The states after the step are
    left in `reached` (groups, 2, row). The members stay as they are; arrays as in `layout`.
    """
    members, rods, changes, reached = bare(members), bare(rods), bare(changes), bare(reached)
    pushed, changed, rest = bare(pushed), bare(changed), packs(bare(scratch))
    for g in range(int(timing[Timing.FIRST_GROUP]), int(timing[Timing.LAST_GROUP])):
        group = group_of(packs(members), packs(rods), packs(model), g)
        rows, end = packs(changes)[g], packs(reached)[g]
        tangents_of_group(group, timing, rows, pushed, changed, end, rest)


@spliced_kernel
def _rates_of_group(
    group: Group, changes: FloatArray, pushed: FloatArray, changed: FloatArray, rest: FloatArray
) -> None:
    """Turn changes of theta and omega into those of the accelerations, in the second row."""
    size, stage, poses = group.theta.size, rest[TAPE:], rest[_POSES:]
    alpha, force = stage[_ALPHA][:size], rest[_FIRST + _FORCE][:size]
    accelerations_kept(group.theta, group.omega, group.torque, group.chain, stage, alpha)
    pose(group.omega, alpha, group.chain, group.mass, stage, poses)
    first = changes.shape[0] - changed.shape[0]
    for d in range(changes.shape[0]):
        change, directions = changes[d], _directions(changed, d, first)
        tangent(
            group.omega, alpha, change[0][:size], change[1][:size], pushed[d], directions,
            group.chain, group.mass, poses, rest[_FIRST + _OUT :], force,
        )  # fmt: skip
        respond(force, group.chain, stage, rest[_ANSWER_ROWS:], change[1][:size])


@kernel
def rates_many(
    members: FloatArray, rods: FloatArray, model: Model, changes: FloatArray, pushed: FloatArray,
    changed: FloatArray, timing: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Turn changes of states, torques and parameters into those of the accelerations.

    Arrays are as in `tangents_many`; the answers stand where the changes of omega were.
    """
    members, rods, changes = bare(members), bare(rods), bare(changes)
    pushed, changed, rest = bare(pushed), bare(changed), packs(bare(scratch))
    for g in range(int(timing[Timing.FIRST_GROUP]), int(timing[Timing.LAST_GROUP])):
        group = group_of(packs(members), packs(rods), packs(model), g)
        _rates_of_group(group, packs(changes)[g], pushed, changed, rest)


@inlined_kernel
def _advance_kept(
    group: Group, timing: FloatArray, rest: FloatArray, tape: FloatArray, starts: FloatArray
) -> int:
    """Take a substep from the state in `rest`; return in how many parts.

    The tape of the last part is left, and in `starts` the states at the start of all.
    """
    size, parts = group.theta.size, _count_parts(group, timing, rest)
    rest[_PARTS][0] = parts
    part = 0
    while part == 0 or any_of(parts > part):
        copy(rest[_THETA][:size], starts[2 * part])
        copy(rest[_OMEGA_NOW][:size], starts[2 * part + 1])
        _take_part(group, _part_length(parts, part, timing), rest, tape)
        part += 1
    return part


@inlined_kernel
def _return_kept(
    group: Group, timing: FloatArray, rest: FloatArray, tape: FloatArray, starts: FloatArray,
    count: int, bars: FloatArray, chain_bar: FloatArray,
) -> None:  # fmt: skip
    """Take derivatives back through a substep of `count` parts, the reverse of `_advance_kept`."""
    size = group.theta.size
    for back in range(count):
        part = count - 1 - back
        h = _part_length(rest[_PARTS][0], part, timing)
        if count > 1:
            copy(starts[2 * part][:size], rest[_THETA])
            copy(starts[2 * part + 1][:size], rest[_OMEGA_NOW])
            _take_part(group, h, rest, tape)
        _rk4_adjoint(h, group, tape, bars, chain_bar, rest[_ANSWER_ROWS:], rest[_FIRST:])


@spliced_kernel
def adjoint_of_group(
    group: Group, timing: FloatArray, bars: FloatArray, chain_bar: FloatArray,
    reached: FloatArray, slots: int, kept: FloatArray, rest: FloatArray,
) -> None:  # fmt: skip
    """See `adjoint_many`; `kept` says of each substep whether its tape is there on the way back."""
    size, substeps, tapes = group.theta.size, kept.size, rest[TAPE:]
    states = tapes[(slots + 1) * STEP_ROWS :]
    starts = states[2 * substeps :]
    copy(group.theta, rest[_THETA])
    copy(group.omega, rest[_OMEGA_NOW])
    for step in range(substeps):
        copy(rest[_THETA][:size], states[2 * step])
        copy(rest[_OMEGA_NOW][:size], states[2 * step + 1])
        tape = tapes[min(step, slots - 1) * STEP_ROWS :]
        count = _advance_kept(group, timing, rest, tape, starts)
        # the last slot is written again and again: at the end it has the last substep
        stays = step < slots - 1 or step == substeps - 1
        kept[step] = 1.0 if count == 1 and stays else 0.0
    copy(rest[_THETA][:size], reached[0])
    copy(rest[_OMEGA_NOW][:size], reached[1])
    for back in range(substeps):
        step = substeps - 1 - back
        tape, count = tapes[min(step, slots - 1) * STEP_ROWS :], 1
        rest[_PARTS][0] = 1.0 + 0.0 * rest[_THETA][0]
        if kept[step] == 0.0:
            tape = tapes[slots * STEP_ROWS :]
            copy(states[2 * step][:size], rest[_THETA])
            copy(states[2 * step + 1][:size], rest[_OMEGA_NOW])
            count = _advance_kept(group, timing, rest, tape, starts)
        _return_kept(group, timing, rest, tape, starts, count, bars, chain_bar)


@kernel
def adjoint_many(
    members: FloatArray, rods: FloatArray, model: Model, bars: FloatArray, chain_bars: FloatArray,
    reached: FloatArray, slots: int, timing: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Take derivatives by the states after a step of `timing` back to its start.

    `bars` (groups, 3, row) has those by theta and omega, before and after; those by the torques are
    added in its last row, and those by the parameters in `chain_bars` (groups, len(Parameter) or 0,
    row).
    The states after the step are left in `reached` (groups, 2, row); the members stay as they are.
    The tapes of `slots` substeps are kept in `scratch`, those of others made once more.
    """
    members, rods, bars, chain_bars = bare(members), bare(rods), bare(bars), bare(chain_bars)
    kept = np.zeros(int(timing[Timing.SUBSTEPS]))
    reached, rest = bare(reached), packs(bare(scratch))
    for g in range(int(timing[Timing.FIRST_GROUP]), int(timing[Timing.LAST_GROUP])):
        group = group_of(packs(members), packs(rods), packs(model), g)
        rows, chain_rows, end = packs(bars)[g], packs(chain_bars)[g], packs(reached)[g]
        adjoint_of_group(group, timing, rows, chain_rows, end, slots, kept, rest)


def tangent_rows() -> int:
    """Return the rows of the work space of `tangents_many`."""
    return TAPE + STEP_ROWS


def adjoint_rows(substeps: int, slots: int) -> int:
    """Return the rows of the work space of `adjoint_many`."""
    return TAPE + (slots + 1) * STEP_ROWS + 2 * substeps + 2 * int(MAX_PARTS)
