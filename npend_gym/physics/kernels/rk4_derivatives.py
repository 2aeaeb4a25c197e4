"""Runge-Kutta steps of an ensemble with their tangents and adjoints."""

from __future__ import annotations

from typing import Any

from npend_gym._checks import FloatArray
from npend_gym.compiled.jit import inlined_kernel, inner_kernel, spliced_kernel
from npend_gym.compiled.packs import any_of, where
from npend_gym.physics.kernels.advance import MAX_PARTS, substep_parts
from npend_gym.physics.kernels.dynamics import AnyArrays, copy
from npend_gym.physics.kernels.layout import Group, Timing
from npend_gym.physics.kernels.rk4 import RK4, rk4_step, rk4_sum
from npend_gym.physics.kernels.stages import (
    ALPHA,
    OMEGA,
    SHARED_ROWS,
    STAGE_ROWS,
    change_stages,
    return_stages,
    spread,
    stage_of,
    take_poses,
    take_stages,
)
from npend_gym.physics.kernels.tangent import POSE_ROWS

# Tableau and weights as tuples, which are constants on a GPU too
_A: Any = tuple(tuple(row) for row in RK4.tableau[:4, :4].tolist())
_END: Any = tuple(RK4.end[:4].tolist())
TAPE_ROWS = 4 * STAGE_ROWS

# Rows of the work space of one group: those of `stages`; a change at the start of a step, and
# coordinates of a stage, their change or derivatives by them; the state on its way; in how many
# parts each lane takes the substep; slopes, and the pose for each stage; then the tapes
_BEGIN, _, _X, _THETA, _OMEGA_NOW, _PARTS, _SLOPES = range(SHARED_ROWS, SHARED_ROWS + 7)
_POSES = _SLOPES + 8
TAPE = _POSES + 4 * POSE_ROWS


@inlined_kernel
def _part_length(parts: Any, part: int, timing: FloatArray) -> Any:
    """Return the length of a part of a substep, zero in the lanes that have fewer."""
    return where(parts > part, timing[Timing.DT] / timing[Timing.SUBSTEPS] / parts, 0.0)


@inner_kernel
def _kept_step(
    q: FloatArray, u: FloatArray, h: Any, torque: FloatArray, chain: AnyArrays, x: FloatArray,
    tape: FloatArray,
) -> None:  # fmt: skip
    """Take a Runge-Kutta step in place with the bits of `rk4_step`; keep its stages in `tape`."""
    take_stages(h, _A, 4, q, u, torque, chain, x, tape)
    one, two, three, four = (
        stage_of(tape, 0),
        stage_of(tape, 1),
        stage_of(tape, 2),
        stage_of(tape, 3),
    )
    sixth = h / 6.0
    for i in range(q.size):
        q[i] += sixth * rk4_sum(one[OMEGA, i], two[OMEGA, i], three[OMEGA, i], four[OMEGA, i])
        u[i] += sixth * rk4_sum(one[ALPHA, i], two[ALPHA, i], three[ALPHA, i], four[ALPHA, i])


@inlined_kernel
def _take_part(group: Group, h: Any, rest: FloatArray, tape: FloatArray) -> None:
    """Take a part of a substep from the state in `rest`."""
    size = group.theta.size
    q, u, x = rest[_THETA][:size], rest[_OMEGA_NOW][:size], rest[_X][:size]
    _kept_step(q, u, h, group.torque, group.chain, x, tape)


@inlined_kernel
def _change(
    h: Any, group: Group, tape: FloatArray, q: FloatArray, u: FloatArray, pushed: FloatArray,
    changed: FloatArray, rest: FloatArray,
) -> None:  # fmt: skip
    """Carry changes of `q` and `u` at the start of a Runge-Kutta step to its end, in place."""
    change_stages(
        h, _A, _END, 4, 1, group.chain, group.mass, tape, rest[_POSES:], q, u, pushed, changed,
        rest[_BEGIN:], rest[_SLOPES:], rest,
    )  # fmt: skip


@inlined_kernel
def _return(
    h: Any, group: Group, tape: FloatArray, bars: FloatArray, chain_bar: FloatArray,
    rest: FloatArray,
) -> None:  # fmt: skip
    """Take derivatives by the end of a Runge-Kutta step, the rows of `bars`, back to its start.

    They are by theta, omega and, added up, the torques.
    """
    size, slopes = group.theta.size, rest[_SLOPES:]
    q_bar, u_bar = bars[0][:size], bars[1][:size]
    spread(_END, h, q_bar, u_bar, slopes, 4, True)
    return_stages(
        h, _A, 4, group.chain, group.mass, tape, q_bar, u_bar, bars[2:3], chain_bar,
        rest[_X][:size], slopes, rest,
    )  # fmt: skip


@inlined_kernel
def _count_parts(group: Group, timing: FloatArray, rest: FloatArray) -> Any:
    """Return into how many parts each lane cuts the substep from the state in `rest`."""
    whole, omega = timing[Timing.DT] / timing[Timing.SUBSTEPS], rest[_OMEGA_NOW]
    return substep_parts(omega, group.velocity.size, whole, timing[Timing.PER_ROTATION])


@spliced_kernel
def step_of_group(group: Group, timing: FloatArray, rest: FloatArray) -> None:
    """Take a step in place; `rest` has RK4_ROWS rows."""
    theta, omega, whole = group.theta, group.omega, timing[Timing.DT] / timing[Timing.SUBSTEPS]
    for _ in range(int(timing[Timing.SUBSTEPS])):
        parts = substep_parts(omega, group.velocity.size, whole, timing[Timing.PER_ROTATION])
        part = 0
        while part == 0 or any_of(parts > part):
            h = _part_length(parts, part, timing)
            rk4_step(0.0, theta, omega, h, group.torque, group.chain, rest)
            part += 1


@inlined_kernel
def _directions(changed: FloatArray, d: int, first: int) -> FloatArray:
    """Return how direction `d` changes parameters; empty before the first that does."""
    return changed[max(0, d - first)][: changed.shape[1] if d >= first else 0]


@spliced_kernel
def tangents_of_group(
    group: Group, timing: FloatArray, changes: FloatArray, pushed: FloatArray,
    changed: FloatArray, reached: FloatArray, rest: FloatArray,
) -> None:  # fmt: skip
    """Carry D changes of the state, its rates, torques and parameters through a step.

    Two rows of `changes` are those of theta and omega, before and after; `pushed` (D, n + 1) are
    those of the torques. Those of the parameters, `changed` (K, len(Parameter) or 0, n), belong to
    the last K of the D. The state after the step is left in two rows, `reached`.
    """
    size, tape, count = group.theta.size, rest[TAPE:], pushed.shape[0]
    first = count - changed.shape[0]
    copy(group.theta, rest[_THETA])
    copy(group.omega, rest[_OMEGA_NOW])
    for _ in range(int(timing[Timing.SUBSTEPS])):
        parts = _count_parts(group, timing, rest)
        part = 0
        while part == 0 or any_of(parts > part):
            h = _part_length(parts, part, timing)
            _take_part(group, h, rest, tape)
            take_poses(4, size, group.chain, group.mass, tape, rest[_POSES:])
            for d in range(count):
                q, u = changes[2 * d][:size], changes[2 * d + 1][:size]
                _change(h, group, tape, q, u, pushed[d], _directions(changed, d, first), rest)
            part += 1
    copy(rest[_THETA][:size], reached[0])
    copy(rest[_OMEGA_NOW][:size], reached[1])


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
        _return(h, group, tape, bars, chain_bar, rest)


@spliced_kernel
def adjoint_of_group(
    group: Group, timing: FloatArray, bars: FloatArray, chain_bar: FloatArray,
    reached: FloatArray, slots: int, kept: FloatArray, rest: FloatArray,
) -> None:  # fmt: skip
    """Take derivatives by the state after a step back to its start.

    `bars` has those by theta and omega, before and after; those by the torques are added in its
    third row, and those by the parameters in `chain_bar`, len(Parameter) rows or none. The state
    after the step is left in two rows, `reached`. The tapes of `slots` substeps are kept, those of
    others made once more; `kept` says of each whether its tape is there on the way back.
    """
    size, substeps, tapes = group.theta.size, kept.size, rest[TAPE:]
    # of each substep the state at its start, behind it those of its parts, until the next
    states = tapes[(slots + 1) * TAPE_ROWS :]
    copy(group.theta, rest[_THETA])
    copy(group.omega, rest[_OMEGA_NOW])
    for step in range(substeps):
        tape = tapes[min(step, slots - 1) * TAPE_ROWS :]
        count = _advance_kept(group, timing, rest, tape, states[2 * step :])
        # the last slot is written again and again: at the end it has the last substep
        stays = step < slots - 1 or step == substeps - 1
        kept[step] = 1.0 if count == 1 and stays else 0.0
    copy(rest[_THETA][:size], reached[0])
    copy(rest[_OMEGA_NOW][:size], reached[1])
    for back in range(substeps):
        step = substeps - 1 - back
        tape, count = tapes[min(step, slots - 1) * TAPE_ROWS :], 1
        rest[_PARTS][0] = 1.0 + 0.0 * rest[_THETA][0]
        if kept[step] == 0.0:
            tape = tapes[slots * TAPE_ROWS :]
            copy(states[2 * step][:size], rest[_THETA])
            copy(states[2 * step + 1][:size], rest[_OMEGA_NOW])
            count = _advance_kept(group, timing, rest, tape, states[2 * step :])
        _return_kept(group, timing, rest, tape, states[2 * step :], count, bars, chain_bar)


def tangent_rows() -> int:
    """Return the rows of the work space of `tangents_of_group`."""
    return TAPE + TAPE_ROWS


def adjoint_rows(substeps: int, slots: int) -> int:
    """Return the rows of the work space of `adjoint_of_group`."""
    return TAPE + (slots + 1) * TAPE_ROWS + 2 * substeps + 2 * int(MAX_PARTS)
