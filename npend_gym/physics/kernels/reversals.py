"""Which bobs turn within a substep of many chains, and when; and their centres of mass.

`mark` finds the few that must be looked at, in all lanes together, and `follow_marked` follows
these alone. The centre of mass has the last entry of the record, where it is measured. Of a chain
that began beyond 90 degrees the velocities around the pivot count (see `turning_points`). Those of
the centre of mass are kept times the square of the chain's mass.
"""

# ruff: noqa: ARG001  what measures, and what does not, share their parameters
from __future__ import annotations

import math
from typing import Any

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import lane
from npend_gym.compiled.jit import chosen_by_type, inlined_kernel, inner_kernel, outlined_kernel
from npend_gym.compiled.packs import any_of, where
from npend_gym.compiled.sincos import sincos
from npend_gym.physics.kernels.dynamics import accelerations
from npend_gym.physics.kernels.layout import RK4, Group, Member, Scratch
from npend_gym.physics.kernels.rk4 import K_4, WORK
from npend_gym.physics.kernels.turning_points import (
    BOB,
    Cubic,
    Interval,
    Record,
    TurningRule,
    cubic_at,
    follow_interval,
)

_ROOT_TOLERANCE = 1e-13  # of a substep
_MARGIN = 1.1  # for what the acceleration of the last stage is off by


@inlined_kernel
def _mark_one(
    record: Record, i: int, before: Any, velocity: Any, acceleration: Any, threshold: Any, h: Any,
    active: Any,
) -> Any:  # fmt: skip
    """Update the sign of entry `i` of a record; or return that it must be followed instead."""
    side, sign, risen = record.orientation[i], record.sign[i], record.risen[i]
    now = side * velocity
    up, down = now > threshold, now < -threshold
    falls = (sign * risen > 0.0) & (down | ((side * before > 0.0) & (now <= 0.0)))
    leaves = acceleration * velocity  # positive where the velocity moves away from zero
    twice = (before * velocity > 0.0) & (_MARGIN * (leaves * h) >= velocity * velocity)
    unknown = active & (record.period[i] != record.period[i])  # the period is NaN
    marked = unknown & (falls | (twice & (sign != 0.0)))
    plain = unknown ^ marked
    record.risen[i] = where(plain & up & (sign < 0.0), 1.0, risen)
    record.sign[i] = where(plain & up, 1.0, where(plain & down, -1.0, sign))
    return marked


@inlined_kernel
def mark(
    group: Group, with_com: bool, around: Any, threshold: Any, h: Any, active: Any, scratch: Any
) -> bool:
    """Update the signs of the velocities; mark the bobs that must be followed instead.

    Those of `active` members that have not completed their period; others are left alone. The
    centre of mass, if it is measured, comes after them. `around` says in which lanes velocities
    around the pivot count.

    Marked are bobs that may complete their period in the substep, and those that may have turned
    twice in it: their velocity kept its sign, but by the acceleration at the end it would have been
    zero within the substep. The last Runge-Kutta stage gives nearly this acceleration. For all
    others the signs at its ends say everything. Return whether any bob is marked; the entry after
    those of the bobs and the centre of mass tells it of each lane.
    """
    s, c, alpha = scratch[Scratch.SIN], scratch[Scratch.COS], scratch[RK4 + K_4]
    omega, length, record, n = group.omega, group.chain.length, group.record, group.velocity.size
    marks, before, acceleration = scratch[Scratch.MARKED], scratch[Scratch.VELOCITY], 0.0
    found, any_around = threshold < 0.0, any_of(around)  # found in no lane
    right = down = up = up_acceleration = 0.0  # the bob's place, velocity and acceleration
    for i in range(n):
        acceleration = acceleration + length[i] * (alpha[i] * c[i] - (omega[i] * omega[i]) * s[i])
        u, v, a = before[i], group.velocity[i], acceleration
        if any_around:
            right, down = right + length[i] * s[i], down + length[i] * c[i]
            up = up + length[i] * (omega[i] * s[i])
            lifted = alpha[i] * s[i] + (omega[i] * omega[i]) * c[i]
            up_acceleration = up_acceleration + length[i] * lifted
            u = where(around, record.orientation[i] * record.sign[i], u)  # its sign is enough
            v = where(around, right * up + down * v, v)
            a = where(around, right * up_acceleration + down * a, a)
        marked = _mark_one(record, i, u, v, a, threshold, h, active)
        marks[i] = where(marked, 1.0, 0.0)
        found = found | marked
    if with_com:
        momentum = force = mass = 0.0
        right = down = up = up_acceleration = 0.0
        for i in range(n):
            mass = mass + group.mass[i]
            momentum = momentum + group.carried[i] * (omega[i] * c[i])
            turned = alpha[i] * c[i] - (omega[i] * omega[i]) * s[i]
            force = force + group.carried[i] * turned
            if any_around:
                right, down = right + group.carried[i] * s[i], down + group.carried[i] * c[i]
                up = up + group.carried[i] * (omega[i] * s[i])
                lifted = alpha[i] * s[i] + (omega[i] * omega[i]) * c[i]
                up_acceleration = up_acceleration + group.carried[i] * lifted
        velocity, change = momentum / mass, force / mass
        if any_around:
            velocity = where(around, right * up + down * momentum, velocity)
            change = where(around, right * up_acceleration + down * force, change)
        # its velocity before the substep is not known, but its sign
        before_it = record.orientation[n] * record.sign[n]
        marked = _mark_one(record, n, before_it, velocity, change, threshold, h, active)
        marks[n] = where(marked, 1.0, 0.0)
        found = found | marked
    marks[n + 1] = where(found, 1.0, 0.0)
    return any_of(found)


@inlined_kernel
def _of_com(chain: Group, of_bobs: FloatArray) -> float:
    """Share of the centre of mass in a quantity that adds up along the rods, such as speed."""
    total = mass = above = 0.0
    for i in range(chain.velocity.size):
        total = total + chain.carried[i] / chain.chain.length[i] * (of_bobs[i] - above)
        mass, above = mass + chain.mass[i], of_bobs[i]
    return total / mass


@inlined_kernel
def _find_accelerations(chain: Group, scratch: FloatArray) -> None:
    """Write the horizontal accelerations of the bobs at the start and at the end of the substep."""
    length, rk4, n = chain.chain.length, scratch[RK4:], chain.velocity.size
    alpha, end = rk4[0], rk4[1]  # two rows of the step that has been taken
    accelerations(chain.theta, chain.omega, chain.torque, chain.chain, rk4[WORK:], end)
    total = total_end = 0.0
    for i in range(n):
        s, c = sincos(scratch[Scratch.THETA, i])
        omega = scratch[Scratch.OMEGA, i]
        total = total + length[i] * (alpha[i] * c - (omega * omega) * s)
        scratch[Scratch.ACCELERATION, i] = total
        s, c, omega = scratch[Scratch.SIN, i], scratch[Scratch.COS, i], chain.omega[i]
        total_end = total_end + length[i] * (end[i] * c - (omega * omega) * s)
        scratch[Scratch.ACCELERATION_END, i] = total_end


@inner_kernel
def _go_around(
    chain: Group, theta: FloatArray, omega: FloatArray, alpha: FloatArray, velocity: FloatArray,
    change: FloatArray,
) -> None:  # fmt: skip
    """Write the velocities around the pivot of bobs and centre of mass in a state, and changes."""
    n = chain.velocity.size
    for of_com in (False, True):
        if of_com and not math.isnan(chain.record.period[n]):
            continue  # it is known, or not measured
        px = py = vx = vy = ax = ay = 0.0
        for i in range(n):
            s, c = sincos(theta[i])
            k, own = chain.carried[i] if of_com else chain.chain.length[i], n if of_com else i
            px, py = px + k * s, py - k * c
            vx, vy = vx + k * (omega[i] * c), vy + k * (omega[i] * s)
            ax = ax + k * (alpha[i] * c - (omega[i] * omega[i]) * s)
            ay = ay + k * (alpha[i] * s + (omega[i] * omega[i]) * c)
            velocity[own] = px * vy - py * vx
            change[own] = px * ay - py * ax


@inlined_kernel
def _cubic_of(chain: Group, i: int, around: bool, h: float, scratch: FloatArray) -> Cubic:
    """Return the velocity in a substep of a bob, or of the centre of mass, on its own side."""
    side, before = chain.record.orientation[i], scratch[Scratch.VELOCITY]
    begin, end = scratch[Scratch.ACCELERATION], scratch[Scratch.ACCELERATION_END]
    if around:
        f, df, g, dg = before[i], begin[i], scratch[Scratch.VELOCITY_END, i], end[i]
    elif i < chain.velocity.size:
        f, df, g, dg = before[i], begin[i], chain.velocity[i], end[i]
    else:
        f, df = _of_com(chain, before), _of_com(chain, begin)
        g, dg = _of_com(chain, chain.velocity), _of_com(chain, end)
    return Cubic(side * f, h * (side * df), side * g, h * (side * dg))


@inlined_kernel
def _follow_chain(
    chain: Group, around: bool, t: float, threshold: float, scratch: FloatArray
) -> int:
    """Follow what is marked of one chain through a substep of a step that began at `t` [s].

    Return how many bobs have completed their pseudo-period.
    """
    _find_accelerations(chain, scratch)
    if around:
        rk4 = scratch[RK4:]
        _go_around(
            chain, scratch[Scratch.THETA], scratch[Scratch.OMEGA], rk4[0],
            scratch[Scratch.VELOCITY], scratch[Scratch.ACCELERATION],
        )  # fmt: skip
        _go_around(
            chain, chain.theta, chain.omega, rk4[1], scratch[Scratch.VELOCITY_END],
            scratch[Scratch.ACCELERATION_END],
        )  # fmt: skip
    n, record, completed = chain.velocity.size, chain.record, 0
    h, rule = scratch[Scratch.DURATION, 0], TurningRule(BOB, threshold, _ROOT_TOLERANCE)
    t += scratch[Scratch.SINCE, 0]
    for i in range(n + 1):
        if scratch[Scratch.MARKED, i] == 1.0 and h > 0.0:
            cubic = _cubic_of(chain, i, around, h, scratch)
            if math.isfinite(cubic.g):
                _, slope = cubic_at(cubic, 0.0)
                _, slope_end = cubic_at(cubic, 1.0)
                interval = Interval(t, h, 0.0, 1.0, cubic.f, slope, cubic.g, slope_end)
                follow_interval(cubic_at, cubic, rule, interval, record, i)
        if i < n and not math.isnan(record.period[i]):
            completed += 1
    return completed


@outlined_kernel
def follow_marked(
    numbers: FloatArray, g: int, group: Group, width: int, scratch: FloatArray
) -> None:
    """Follow what is marked of group `g` through a substep, chain by chain.

    Mostly one lane has any, and to work on it alone, as floats, takes a third of the time.
    """
    n = group.velocity.size
    for k in range(width):
        own, member = lane(scratch, k), lane(numbers, k)
        if own[Scratch.MARKED, n + 1] == 0.0:
            continue
        around = member[Member.AROUND, g] > 0.0
        member[Member.COMPLETED, g] = _follow_chain(
            lane(group, k), around, member[Member.TIME, g], member[Member.THRESHOLD, g], own
        )


@inlined_kernel
def _none_waits(record: None, numbers: FloatArray, g: int, n: int) -> tuple[bool, bool]:
    return False, False


@inlined_kernel
def _some_wait(record: Record, numbers: FloatArray, g: int, n: int) -> tuple[bool, bool]:
    active, period = numbers[Member.ACTIVE, g] > 0.0, record.period[n]
    of_com = any_of((period != period) & active)  # noqa: PLR0124
    return of_com or any_of((numbers[Member.COMPLETED, g] < n) & active), of_com


@chosen_by_type("record", {0: _none_waits, Record: _some_wait})
def waiting(record: Record | None, numbers: FloatArray, g: int, n: int) -> tuple[bool, bool]:
    """Return whether anything has yet to complete its pseudo-period, of active members of a group.

    Then whether a centre of mass has: its period is NaN then; where it is not measured, zero.
    """
    raise NotImplementedError


@inlined_kernel
def _follow_none(
    record: None, numbers: FloatArray, g: int, group: Group, of_com: bool, h: Any, width: int,
    scratch: FloatArray,
) -> tuple[bool, bool]:  # fmt: skip
    return False, False


@inlined_kernel
def _follow(
    record: Record, numbers: FloatArray, g: int, group: Group, of_com: bool, h: Any, width: int,
    scratch: FloatArray,
) -> tuple[bool, bool]:  # fmt: skip
    threshold, around = numbers[Member.THRESHOLD, g], numbers[Member.AROUND, g] > 0.0
    if mark(group, of_com, around, threshold, h, numbers[Member.ACTIVE, g] > 0.0, scratch):
        follow_marked(numbers, g, group, width, scratch)
        return _some_wait(record, numbers, g, group.velocity.size)
    return True, of_com


@chosen_by_type("record", {0: _follow_none, Record: _follow})
def follow(
    record: Record | None, numbers: FloatArray, g: int, group: Group, of_com: bool, h: Any,
    width: int, scratch: FloatArray,
) -> tuple[bool, bool]:  # fmt: skip
    """Follow what waits of a group through a substep; return what `waiting` does afterwards.

    `record` is that of the group.
    """
    raise NotImplementedError
