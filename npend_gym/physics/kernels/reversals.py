"""Which bobs turn within a substep of many chains, and when; and their centres of mass.

`mark` finds the few that must be looked at, in all lanes together, and `follow_marked` follows
these alone. The centre of mass has the last entry of the record, where it is measured.
"""

from __future__ import annotations

import math
from typing import Any

from npend_gym._checks import FloatArray
from npend_gym.compiled.jit import inlined_kernel, inner_kernel
from npend_gym.compiled.packs import any_of, where
from npend_gym.compiled.sincos import sincos
from npend_gym.physics.kernels.dynamics import accelerations
from npend_gym.physics.kernels.layout import (
    RK4,
    Group,
    Member,
    Model,
    Scratch,
    group_of,
    model_of_lane,
)
from npend_gym.physics.kernels.rk4 import K_4, WORK
from npend_gym.physics.kernels.turning_points import (
    BOB,
    COM,
    Cubic,
    Interval,
    Rule,
    cubic_at,
    follow_interval,
)

_ROOT_TOLERANCE = 1e-13  # of a substep
_MARGIN = 1.1  # for what the acceleration of the last stage is off by


@inlined_kernel
def mark(group: Group, threshold: Any, h: Any, waiting: Any, scratch: FloatArray) -> bool:
    """Update the signs of the velocities; mark the bobs that must be followed instead.

    Those of members that are `waiting` for a bob to complete its period; others are left alone.

    Marked are bobs that may complete their period in the substep, and those that may have turned
    twice in it: their velocity kept its sign, but from the acceleration at the end (that of the
    last Runge-Kutta stage, which is near it) it would have been zero within the substep. For all
    others the signs at its ends say everything. Return whether any bob is marked; the entry after
    those of the bobs tells it of each lane.
    """
    s, c, alpha = scratch[Scratch.SIN], scratch[Scratch.COS], scratch[RK4 + K_4]
    omega, length, record = group.omega, group.chain.length, group.record
    acceleration = 0.0
    found = threshold < 0.0  # in no lane
    for i in range(group.velocity.size):
        acceleration = acceleration + length[i] * (alpha[i] * c[i] - (omega[i] * omega[i]) * s[i])
        side, sign, risen = record.orientation[i], record.sign[i], record.risen[i]
        before, velocity = scratch[Scratch.VELOCITY][i], group.velocity[i]
        now = side * velocity
        up, down = now > threshold, now < -threshold
        falls = (sign * risen > 0.0) & (down | ((side * before > 0.0) & (now <= 0.0)))
        leaves = acceleration * velocity  # positive where the velocity moves away from zero
        twice = (before * velocity > 0.0) & (_MARGIN * (leaves * h) >= velocity * velocity)
        unknown = waiting & (record.period[i] != record.period[i])  # the period is NaN
        mark = unknown & (falls | (twice & (sign != 0.0)))
        plain = unknown ^ mark
        record.risen[i] = where(plain & up & (sign < 0.0), 1.0, risen)
        record.sign[i] = where(plain & up, 1.0, where(plain & down, -1.0, sign))
        scratch[Scratch.MARKED][i] = where(mark, 1.0, 0.0)
        found = found | mark
    scratch[Scratch.MARKED][group.velocity.size] = where(found, 1.0, 0.0)
    return any_of(found)


@inlined_kernel
def mark_com(group: Group, threshold: Any, h: Any, waiting: Any, scratch: FloatArray) -> bool:
    """Do as `mark` for the centre of mass; the entry after that of `mark` tells it of each lane.

    The velocity before the substep is not known, but its sign.
    """
    s, c, alpha = scratch[Scratch.SIN], scratch[Scratch.COS], scratch[RK4 + K_4]
    omega, carried, record, n = group.omega, group.carried, group.record, group.velocity.size
    momentum = force = mass = 0.0
    for i in range(n):
        mass = mass + group.mass[i]
        momentum = momentum + carried[i] * (omega[i] * c[i])
        force = force + carried[i] * (alpha[i] * c[i] - (omega[i] * omega[i]) * s[i])
    side, sign = record.orientation[n], record.sign[n]
    now, least = side * momentum, threshold * mass
    up, down = now > least, now < -least
    falls = (sign * record.risen[n] > 0.0) & (now <= least)
    twice = (sign * now > 0.0) & (_MARGIN * ((momentum * force) * h) >= momentum * momentum)
    found = waiting & (falls | twice)
    plain = waiting ^ found
    record.risen[n] = where(plain & up & (sign < 0.0), 1.0, record.risen[n])
    record.sign[n] = where(plain & up, 1.0, where(plain & down, -1.0, sign))
    scratch[Scratch.MARKED][n + 1] = where(found, 1.0, 0.0)
    return any_of(found)


@inlined_kernel
def _of_com(group: Group, of_bobs: FloatArray) -> Any:
    """Return what the centre of mass has of a quantity that adds up along the rods, as speed."""
    total = mass = above = 0.0
    for i in range(group.velocity.size):
        total = total + group.carried[i] / group.chain.length[i] * (of_bobs[i] - above)
        mass, above = mass + group.mass[i], of_bobs[i]
    return total / mass


@inlined_kernel
def _bob_accelerations(
    s: FloatArray, c: FloatArray, omega: FloatArray, alpha: FloatArray, length: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Write the horizontal acceleration of every bob."""
    total = 0.0
    for i in range(out.size):
        total = total + length[i] * (alpha[i] * c[i] - (omega[i] * omega[i]) * s[i])
        out[i] = total


@inlined_kernel
def _find_accelerations(group: Group, scratch: FloatArray) -> None:
    """Write the accelerations of the bobs at the start and at the end of the substep."""
    theta, omega, length = group.theta, group.omega, group.chain.length
    before, omega_before = scratch[Scratch.THETA], scratch[Scratch.OMEGA]
    rk4, n = scratch[RK4:], group.velocity.size
    alpha, s, c = rk4[0], rk4[1], rk4[2]  # two rows of the step that has been taken
    for i in range(n):
        s[i], c[i] = sincos(before[i])
    _bob_accelerations(s, c, omega_before, alpha, length, scratch[Scratch.ACCELERATION][:n])
    accelerations(theta, omega, group.torque, group.chain, rk4[WORK:], alpha)
    s, c = scratch[Scratch.SIN], scratch[Scratch.COS]
    _bob_accelerations(s, c, omega, alpha, length, scratch[Scratch.ACCELERATION_END][:n])


@inlined_kernel
def _follow_bobs(chain: Group, t: float, h: float, threshold: float, scratch: FloatArray) -> int:
    """Follow the marked bobs of one chain through a substep, from `t` [s], of `h` seconds.

    Return how many bobs have completed their pseudo-period.
    """
    velocity, acceleration = scratch[Scratch.VELOCITY], scratch[Scratch.ACCELERATION]
    acceleration_end, marked = scratch[Scratch.ACCELERATION_END], scratch[Scratch.MARKED]
    record, rule, completed = chain.record, Rule(BOB, threshold, _ROOT_TOLERANCE), 0
    for i in range(chain.velocity.size):
        if marked[i] == 1.0 and h > 0.0 and math.isfinite(chain.velocity[i]):
            side = record.orientation[i]
            cubic = Cubic(
                side * velocity[i], h * (side * acceleration[i]), side * chain.velocity[i],
                h * (side * acceleration_end[i]),
            )  # fmt: skip
            _, slope = cubic_at(cubic, 0.0)
            _, slope_end = cubic_at(cubic, 1.0)
            interval = Interval(t, h, 0.0, 1.0, cubic.f, slope, cubic.g, slope_end)
            follow_interval(cubic_at, cubic, rule, interval, record, i)
        if not math.isnan(record.period[i]):
            completed += 1
    return completed


@inner_kernel
def follow_marked(
    members: FloatArray, rods: FloatArray, model: Model, g: int, width: int, scratch: FloatArray
) -> None:
    """Follow the marked bobs of group `g` through a substep, chain by chain.

    Mostly one lane has any, and to work on it alone, as floats, takes a third of the time.
    """
    n = rods.shape[2] // width - 1
    for k in range(width):
        if scratch[Scratch.MARKED, n * width + k] == 0.0:
            continue
        numbers, lane = members[:, k::width], scratch[:, k::width]
        chain = group_of(numbers, rods[:, :, k::width], model_of_lane(model, k, width), g)
        _find_accelerations(chain, lane)
        t, h = numbers[Member.TIME, g] + lane[Scratch.SINCE, 0], lane[Scratch.DURATION, 0]
        threshold = numbers[Member.THRESHOLD, g]
        numbers[Member.COMPLETED, g] = _follow_bobs(chain, t, h, threshold, lane)


@inner_kernel
def follow_com(
    members: FloatArray, rods: FloatArray, model: Model, g: int, width: int, scratch: FloatArray
) -> None:
    """Follow the centres of mass that are marked through a substep, as `follow_marked`."""
    n = rods.shape[2] // width - 1
    for k in range(width):
        if scratch[Scratch.MARKED, (n + 1) * width + k] == 0.0:
            continue
        numbers, lane = members[:, k::width], scratch[:, k::width]
        chain = group_of(numbers, rods[:, :, k::width], model_of_lane(model, k, width), g)
        _find_accelerations(chain, lane)
        h, side = lane[Scratch.DURATION, 0], chain.record.orientation[n]
        cubic = Cubic(
            side * _of_com(chain, lane[Scratch.VELOCITY]),
            h * (side * _of_com(chain, lane[Scratch.ACCELERATION])),
            side * _of_com(chain, chain.velocity),
            h * (side * _of_com(chain, lane[Scratch.ACCELERATION_END])),
        )
        if h > 0.0 and math.isfinite(cubic.g):
            _, slope = cubic_at(cubic, 0.0)
            _, slope_end = cubic_at(cubic, 1.0)
            t = numbers[Member.TIME, g] + lane[Scratch.SINCE, 0]
            interval = Interval(t, h, 0.0, 1.0, cubic.f, slope, cubic.g, slope_end)
            rule = Rule(COM, numbers[Member.THRESHOLD, g], _ROOT_TOLERANCE)
            follow_interval(cubic_at, cubic, rule, interval, chain.record, n)


@inlined_kernel
def com_waits(numbers: FloatArray, g: int, group: Group) -> Any:
    """Return whether the centre of mass has yet to complete its pseudo-period, of active members.

    The period is NaN then; where it is not measured, zero.
    """
    period = group.record.period[group.velocity.size]
    unknown = period != period  # noqa: PLR0124
    return unknown & (numbers[Member.ACTIVE, g] > 0.0)


@inlined_kernel
def bobs_wait(numbers: FloatArray, g: int, n: int) -> Any:
    """Return whether a bob has yet to complete its pseudo-period, of active members."""
    return (numbers[Member.COMPLETED, g] < n) & (numbers[Member.ACTIVE, g] > 0.0)
