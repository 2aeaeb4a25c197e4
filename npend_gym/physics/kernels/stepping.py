"""One step of many chains in one pass: substeps, turning points, work, and what is seen of it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.compiled.jit import inlined_kernel, inner_kernel, kernel, spliced_kernel
from npend_gym.compiled.packs import WIDTH, NumbersOf, any_of, bare, packs, where
from npend_gym.compiled.sincos import MAX_ANGLE, ROUND
from npend_gym.physics.kernels import lanes as row
from npend_gym.physics.kernels.dynamics import accelerations, copy
from npend_gym.physics.kernels.lanes import (
    Group,
    any_positive,
    bob_velocities,
    describe_group,
    floats_of,
    group_of,
    hand_out,
    turns_of,
    wrap,
)
from npend_gym.physics.kernels.reversals import bob_accelerations, follow
from npend_gym.physics.kernels.rk4 import rk4_step

MAX_PARTS = 32.0  # of a substep


@inlined_kernel
def _load_torque(
    action: FloatArray, joints: NDArray[np.int64], limit: float, torque: FloatArray
) -> FloatArray:
    """Write the torques of clipped actions (joints,); return the mean of the clipped squares."""
    squares = 0.0 * torque[0]
    for m in range(joints.size):
        share = where(action[m] > 1.0, 1.0, where(action[m] < -1.0, -1.0, action[m]))
        torque[joints[m]] = limit * share
        squares = squares + share * share
    return squares / max(joints.size, 1)


@inlined_kernel
def _damping_power(omega: FloatArray, damping: FloatArray) -> FloatArray:
    """Return the power that the dampers take, sum_i damping_i (omega_i - omega_{i-1})^2."""
    total = damping[0] * (omega[0] * omega[0])
    for i in range(1, omega.size):
        relative = omega[i] - omega[i - 1]
        total = total + damping[i] * (relative * relative)
    return total


@inlined_kernel
def _torque_work(torque: FloatArray, before: FloatArray, theta: FloatArray) -> FloatArray:
    """Return the work of constant torques over a step that began at the angles `before`."""
    above = theta[0] - before[0]
    total = torque[0] * above
    for i in range(1, theta.size):
        turned = theta[i] - before[i]
        total = total + torque[i] * (turned - above)
        above = turned
    return total


@inlined_kernel
def _count_signs(group: Group, threshold: FloatArray, scratch: FloatArray) -> bool:
    """Take note of the signs of the velocities, as `count_sign` does; return whether any is marked.

    Marked, and left to be followed, are bobs that may complete: what happens within a substep
    matters for no other.
    """
    marked = threshold < 0.0  # in no lane
    for i in range(group.theta.size):
        side, sign, risen = group.orientation[i], group.sign[i], group.risen[i]
        before, now = side * scratch[row.VELOCITY_1][i], side * group.velocity[i]
        new = where(now > threshold, 1.0, where(now < -threshold, -1.0, sign))
        unknown = group.period[i] != group.period[i]  # a period that is no number
        ready = unknown & (sign > 0.0) & (risen > 0.0)
        mark = ready & ((new < 0.0) | ((before > 0.0) & (now <= 0.0)))
        group.risen[i] = where(unknown & (sign < 0.0) & (new > 0.0), 1.0, risen)
        group.sign[i] = where(unknown & (mark ^ unknown), new, sign)
        scratch[row.MARKED][i] = where(mark, 1.0, 0.0)
        marked = marked | mark
    return any_of(marked)


@inlined_kernel
def _mark_turned(group: Group, threshold: FloatArray, scratch: FloatArray) -> bool:
    """Mark the bobs that may have turned in the substep; return whether there are any.

    Those whose velocity has changed its sign, or has none yet that counts, and those whose
    acceleration has changed its sign, for they may have turned twice.
    """
    found = False
    for i in range(group.theta.size):
        before, now = scratch[row.VELOCITY_1][i], group.velocity[i]
        sign = group.sign[i]
        turned = (before * now <= 0.0) | (sign * group.orientation[i] * now <= 0.0)
        turned = turned & ((sign != 0.0) | (abs(now) > threshold))
        turned = turned | (scratch[row.SLOPE_1][i] * scratch[row.SLOPE_2][i] < 0.0)
        turned = turned & (group.period[i] != group.period[i])
        scratch[row.MARKED][i] = where(turned, 1.0, 0.0)
        found = found | any_of(turned)
    return found


@inner_kernel
def _follow_marked(
    floats: FloatArray, part: FloatArray, lanes: int, first: int, width: int, n: int,
    scratch: FloatArray,
) -> bool:  # fmt: skip
    """Follow the marked bobs through a substep.

    Return whether any bob of the group is yet to complete its pseudo-period.
    """
    turns = turns_of(part, n, width)
    velocity, velocity_1 = part[row.VELOCITY * n * width :], scratch[row.VELOCITY_1]
    slope_1, slope_2, marked = scratch[row.SLOPE_1], scratch[row.SLOPE_2], scratch[row.MARKED]
    pending = False
    for k in range(width):
        lane = first + k
        if floats[row.ACTIVE * lanes + lane] == 0.0:
            continue
        complete = 0
        t, h = floats[row.TIME * lanes + lane] + scratch[row.SINCE][k], scratch[row.H][k]
        threshold = floats[row.THRESHOLD * lanes + lane]
        for i in range(n):
            r = i * width + k
            side, g = turns.orientation[r], velocity[r]
            if marked[r] == 1.0 and h > 0.0 and math.isfinite(g):
                follow(
                    turns, r, t, h, side * velocity_1[r], side * slope_1[r], side * g,
                    side * slope_2[r], threshold,
                )  # fmt: skip
            if not math.isnan(turns.period[r]):
                complete += 1
        floats[row.COMPLETED * lanes + lane] = complete
        pending = pending or complete < n
    return pending


@inlined_kernel
def _parts(omega: FloatArray, h: float, per_turn: float) -> Any:
    """Return into how many parts a substep is cut, so that no rod turns by more than 1/per_turn."""
    fastest = abs(omega[0])
    for i in range(1, omega.size):
        speed = abs(omega[i])
        fastest = where(speed > fastest, speed, fastest)
    wanted = fastest * (h * per_turn)
    wanted = where(wanted > 1.0, wanted, 1.0)
    wanted = where(wanted < MAX_PARTS, wanted, MAX_PARTS)
    whole = (wanted + ROUND) - ROUND
    return where(whole < wanted, whole + 1.0, whole)


@spliced_kernel
def _substeps(
    view: NumbersOf, width: int, floats: FloatArray, groups: int, g: int, group: Group, dt: float,
    per_turn: float, begin: int, end: int, substeps: int, careful: bool, scratch: FloatArray,
) -> None:  # fmt: skip
    """Advance a group by some of its `substeps`; note what is lost [J].

    Lanes whose rods turn fast take a substep in several parts, while the others wait.
    """
    theta, omega, length = group.theta, group.omega, group.rods.length
    n, lanes = theta.size, groups * width
    numbers, rest = view(floats), view(scratch)
    stages, work, torque = rest[row.STAGES :], rest[row.WORK :], rest[row.TORQUE]
    theta_1, omega_1 = rest[row.THETA_1][:n], rest[row.OMEGA_1][:n]
    waiting = (numbers[row.COMPLETED * groups + g] < n) & (numbers[row.ACTIVE * groups + g] > 0.0)
    pending = any_of(waiting)
    damped = any_positive(group.rods.damping)
    lost = rest[row.LOST][0]
    whole = dt / substeps
    for substep in range(begin, end):
        parts = _parts(omega, whole, per_turn)
        some_wait, part, more = any_of(parts > 1.0), 0, True
        while more:
            h = where(parts > part, whole / parts, 0.0)
            rest[row.H][0] = h
            rest[row.SINCE][0] = substep * whole + part * h
            part += 1
            more = any_of(parts > part)
            if pending:
                copy(group.velocity, rest[row.VELOCITY_1])
            if pending or some_wait:
                copy(theta, theta_1)
                copy(omega, omega_1)
            if damped:
                lost = lost + (h / 6.0) * _damping_power(omega, group.rods.damping)
            lost = lost + rk4_step(theta, omega, h, torque, group.rods, work, stages)
            if damped:
                for stage in range(4, 7):
                    weight = h / 6.0 if stage == 6 else h / 3.0
                    lost = lost + weight * _damping_power(stages[stage][:n], group.rods.damping)
            if some_wait:
                for i in range(n):
                    theta[i] = where(h > 0.0, theta[i], theta_1[i])
                    omega[i] = where(h > 0.0, omega[i], omega_1[i])
            if pending or (substep == substeps - 1 and not more):
                bob_velocities(theta, omega, length, rest[row.SIN], rest[row.COS], group.velocity)
            if pending:
                threshold = numbers[row.THRESHOLD * groups + g]
                # slopes take an evaluation of the dynamics
                found = careful or _count_signs(group, threshold, rest)
                if found:
                    alpha = rest[row.ALPHA][:n]
                    accelerations(theta, omega, torque, group.rods, work, alpha)
                    bob_accelerations(theta_1, omega_1, stages[0], length, rest[row.SLOPE_1])
                    bob_accelerations(theta, omega, alpha, length, rest[row.SLOPE_2])
                if careful:
                    found = _mark_turned(group, threshold, rest)
                if found:
                    of_group, first = floats_of(floats, width, groups, g, n), g * width
                    pending = _follow_marked(floats, of_group, lanes, first, width, n, scratch)
    rest[row.LOST][0] = lost


@inlined_kernel
def _take_over(
    numbers: FloatArray, groups: int, g: int, group: Group, dt: float, scratch: FloatArray
) -> None:  # fmt: skip
    """Take note of the step; lanes that are not active, or have diverged, keep their last state."""
    theta, omega, n = group.theta, group.omega, group.theta.size
    theta_0, omega_0 = scratch[row.THETA_0], scratch[row.OMEGA_0]
    unsound = numbers[row.DIVERGED * groups + g] > 0.0
    for i in range(n):
        unsound = unsound | (abs(theta[i]) > MAX_ANGLE) | (theta[i] != theta[i])
        unsound = unsound | (abs(omega[i]) > row.MAX_SPEED) | (omega[i] != omega[i])
    active = numbers[row.ACTIVE * groups + g] > 0.0
    numbers[row.DIVERGED * groups + g] = where(unsound & active, 1.0, 0.0)
    stays = unsound | (numbers[row.ACTIVE * groups + g] == 0.0)
    if any_of(stays):
        for i in range(n):
            theta[i] = where(stays, theta_0[i], theta[i])
            omega[i] = where(stays, omega_0[i], omega[i])
        bob_velocities(
            theta, omega, group.rods.length, scratch[row.SIN], scratch[row.COS], group.velocity
        )
    done = numbers[row.WORK_DONE * groups + g]
    work = (done - scratch[row.LOST][0]) + _torque_work(scratch[row.TORQUE], theta_0, theta)
    numbers[row.WORK_DONE * groups + g] = where(stays, done, work)
    time = numbers[row.TIME * groups + g]
    numbers[row.TIME * groups + g] = where(stays, time, time + dt)


@spliced_kernel
def _advance(
    view: NumbersOf, width: int, floats: FloatArray, joints: NDArray[np.int64], limit: float,
    dt: float, substeps: int, per_turn: float, groups: int, n: int, first_group: int,
    last_group: int, begin: int, end: int, observation: NDArray[np.float32], out: FloatArray,
    scratch: FloatArray,
) -> None:  # fmt: skip
    lanes = groups * width
    floats, joints, out = bare(floats), bare(joints), bare(out)
    observation, scratch = bare(observation), bare(scratch)
    numbers, rest, actuated = view(floats), view(scratch), joints.size
    actions = numbers[numbers.size - groups * actuated :]
    scalars, per_rod = view(out[: row.SEEN_ROWS * lanes]), out[row.SEEN_ROWS * lanes :]
    careful = actuated == 0
    for g in range(first_group, last_group):
        group = group_of(numbers, groups, g, n)
        if begin == 0:
            action = actions[g * actuated : (g + 1) * actuated]
            effort = _load_torque(action, joints, limit, rest[row.TORQUE])
            numbers[row.EFFORT * groups + g] = effort
            copy(group.theta, rest[row.THETA_0])
            copy(group.omega, rest[row.OMEGA_0])
            rest[row.LOST][0] = 0.0 * numbers[row.TIME * groups + g]
        _substeps(
            view, width, floats, groups, g, group, dt, per_turn, begin, end, substeps, careful,
            scratch,
        )  # fmt: skip
        if end < substeps:
            continue
        _take_over(numbers, groups, g, group, dt, rest)
        describe_group(numbers, groups, g, n, group, rest, scalars)
        wrap(group.theta, rest[row.WRAPPED])
        part = floats_of(floats, width, groups, g, n)
        hand_out(part, g * width, lanes, width, n, scratch, observation, per_rod)


@kernel
def advance_one(
    floats: FloatArray, joints: NDArray[np.int64], limit: float, dt: float, substeps: int,
    per_turn: float, groups: int, n: int, first_group: int, last_group: int, begin: int, end: int,
    observation: NDArray[np.float32], out: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Advance one chain; see `advance_many`."""
    _advance(
        bare, 1, floats, joints, limit, dt, substeps, per_turn, groups, n, first_group,
        last_group, begin, end, observation, out, scratch,
    )  # fmt: skip


@kernel
def advance_many(
    floats: FloatArray, joints: NDArray[np.int64], limit: float, dt: float, substeps: int,
    per_turn: float, groups: int, n: int, first_group: int, last_group: int, begin: int, end: int,
    observation: NDArray[np.float32], out: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Advance the active lanes of some groups by `dt` seconds in equal substeps.

    Where a rod would turn by more than 1 / `per_turn` in a substep, its lane takes it in equal
    parts, MAX_PARTS at most. The substeps from `begin` to `end` are taken. A step taken in
    pieces, which must be of one group and with the same scratch, is the same to the last bit.

    The action, clipped to [-1, 1] and times `limit` [N m], acts at the joints all the while.
    What is seen of every lane is written.
    """
    _advance(
        packs, WIDTH, floats, joints, limit, dt, substeps, per_turn, groups, n, first_group,
        last_group, begin, end, observation, out, scratch,
    )  # fmt: skip
