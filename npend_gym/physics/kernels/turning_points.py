"""When a bob or a rod turns: the one rule, the one root finder.

A *signal* is a quantity of one rod, or of the chain, whose zeros are turning points of a
definition:

==========  ============================================  =========================
definition     signal                                        slope
==========  ============================================  =========================
BOB         horizontal velocity of the bob                its horizontal acceleration
LINK        angular velocity of the rod                   its angular acceleration
HEIGHT      height of the bob above its start             its vertical velocity
COM         horizontal velocity of the centre of mass     its horizontal acceleration
AROUND      velocity of the bob around the pivot          its change
COM_AROUND  velocity of the centre of mass around it      its change
==========  ============================================  =========================

A bob that passes 90 degrees reverses its horizontal velocity there, in the middle of a swing. So
the last two stand for BOB and COM where a rod is released from beyond. With the place r from the
pivot their signal is r x v over the distance in a straight chain, and the slope r x a over it.

A motion is cut into intervals in which signal and slope are known at any fraction of a step: by the
dense output of DOP853, or as the cubic through both ends. Where the slope changes its sign within
an interval, the extremum is located and the interval cut there. So an excursion shorter than an
interval is seen too: between cuts a signal is monotone.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import aligned_zeros
from npend_gym.compiled.jit import inlined_kernel, inner_kernel, spliced_kernel
from npend_gym.compiled.packs import where

BOB, LINK, HEIGHT, COM, AROUND, COM_AROUND = range(6)
_THRESHOLD = 1e-6  # of sqrt(g/l): below it a sign is rounding noise
_MAX_ITERATIONS = 100


class Record(NamedTuple):
    """What is known of the turning points of each rod so far; all of shape (n,).

    For COM, where the chain as a whole turns, all but the last have one entry.
    """

    period: FloatArray  # s; NaN: not complete yet
    # +1 where the rod was released from positive angles, else -1; around the pivot over the
    # distance of the bob, or of the centre of mass, in a straight chain [m]
    orientation: FloatArray
    sign: FloatArray  # of the signal, once it counted; 0 before
    risen: FloatArray  # 1 where the signal has crossed from - to +
    zero: FloatArray  # s; latest zero of the signal
    # For HEIGHT: the angle at the start; where rods stretch, how far each reaches down there [m].
    # For COM: what moves with the end of each rod, from its own joint, over the whole mass; so for
    # COM_AROUND, and ones for AROUND.
    per_rod: FloatArray


class TurningRule(NamedTuple):
    """What counts as a turning point."""

    definition: int
    threshold: float  # a sign counts once the signal has exceeded this
    tolerance: float  # of the instants, as a fraction of the step


class Interval(NamedTuple):
    """A part of a step, with the signal of one rod and its slope by the fraction at both ends."""

    t: float  # s, start of the step
    h: float  # s, its length
    left: float  # fractions of the step at which the interval begins and ends
    right: float
    signal_left: float
    slope_left: float
    signal_right: float
    slope_right: float


class Cubic(NamedTuple):
    """The cubic through the values f, g at 0 and 1 with the slopes df, dg there."""

    f: float
    df: float
    g: float
    dg: float


def new_record(per_rod: FloatArray, orientation: FloatArray) -> Record:
    """Return the record of a release: nothing seen yet."""
    period, side, sign, risen, zero = aligned_zeros(5, orientation.size)
    period[:] = zero[:] = np.nan
    side[:] = orientation
    kept = aligned_zeros(1, per_rod.size)[0]
    kept[:] = per_rod
    return Record(period, side, sign, risen, zero, kept)


def speed_threshold(natural: Any, fastest: Any) -> Any:
    """Return the angular velocity [rad/s] above which a sign counts, 1e-6 sqrt(g/l).

    Parameters
    ----------
    natural : float or ndarray
        sqrt(g/l), l being the mean length of the rods [rad/s].
    fastest : float or ndarray
        Largest angular velocity at the release, which sets the scale without gravity [rad/s].
    """
    return _THRESHOLD * where(natural > 0.0, natural, fastest)


@inner_kernel
def cubic_at(cubic: Cubic, x: float) -> tuple[float, float]:
    """Return the value of the cubic at `x`, and its slope."""
    f, g, u = cubic.f, cubic.g, 1.0 - x
    a = cubic.df - (g - f)
    b = (g - f) - cubic.dg
    bend = a * u + b * x
    value = (u * f + x * g) + (x * u) * bend
    return value, (g - f) + (u - x) * bend + (x * u) * (b - a)


@inner_kernel
def find_root(
    evaluate: Any, motion: Any, of_slope: bool, a: float, fa: float, b: float, fb: float,
    tolerance: float,
) -> tuple[float, float]:  # fmt: skip
    """Return where the signal (or its slope) is zero between `a` and `b`, and the signal there.

    `evaluate(motion, x)` gives the signal and its slope at the fraction `x`; `fa` and `fb` are the
    values at the ends, of different sign. Illinois variant of regula falsi: it keeps the bracket
    and needs no derivative.
    """
    x, signal = b, fb
    for _ in range(_MAX_ITERATIONS):
        x = b if fb == 0.0 else b - fb * ((b - a) / (fb - fa))
        signal, slope = evaluate(motion, x)
        f = slope if of_slope else signal
        if f == 0.0 or abs(x - b) <= tolerance:
            break
        if (f > 0.0) == (fb > 0.0):
            fa *= 0.5
        else:
            a, fa = b, fb
        b, fb = x, f
    return x, signal


@inner_kernel
def _update_record(
    rule: TurningRule, record: Record, i: int, t: float, signal: float, at_extremum: bool
) -> None:
    """Update the record of rod `i` with the value of its signal at time `t`."""
    sign = record.sign[i]
    if rule.definition == HEIGHT and sign != 0.0 and at_extremum and abs(signal) <= rule.threshold:
        record.period[i] = t  # touches the starting height without crossing it
        return
    if abs(signal) <= rule.threshold:
        return
    new = 1.0 if signal > 0.0 else -1.0
    if sign == -new:
        if rule.definition == HEIGHT or (new < 0.0 and record.risen[i] == 1.0):
            record.period[i] = record.zero[i]
        elif new > 0.0:
            record.risen[i] = 1.0
    record.sign[i] = new


@inlined_kernel
def latest_sign(signal: Any, threshold: Any, sign: Any) -> Any:
    """Return the sign of the signal where it counts, else the one before; floats or packs."""
    return where(signal > threshold, 1.0, where(signal < -threshold, -1.0, sign))


@inlined_kernel
def may_turn(
    record: Record, i: int, threshold: float, signal: float, slope: float, signal_end: float,
    slope_end: float,
) -> bool:  # fmt: skip
    """Return whether an interval can change the record of rod `i`; floats or packs.

    It can where the signal turns, crosses zero or comes to a sign that counts, and the period is
    not known yet.
    """
    sign = record.sign[i]
    new = latest_sign(signal_end, threshold, sign)
    event = (slope * slope_end < 0.0) | (new != sign)
    event = event | ((signal <= 0.0) & (signal_end > 0.0))
    event = event | ((signal >= 0.0) & (signal_end < 0.0))
    return event & (record.period[i] != record.period[i])  # the period is NaN


@spliced_kernel
def follow_interval(
    evaluate: Any, motion: Any, rule: TurningRule, interval: Interval, record: Record, i: int
) -> None:
    """Update the record of rod `i` with its turning points in the interval."""
    left, signal = interval.left, interval.signal_left
    turns = interval.slope_left * interval.slope_right < 0.0
    for last in (False, True):
        if not (math.isnan(record.period[i]) and (last or turns)):
            continue
        right, end = interval.right, interval.signal_right
        if not last:
            right, end = find_root(
                evaluate, motion, not last, interval.left, interval.slope_left, interval.right,
                interval.slope_right, rule.tolerance,
            )  # fmt: skip
        crosses = (signal <= 0.0 and end > 0.0) or (signal >= 0.0 and end < 0.0)
        if crosses and record.sign[i] != 0.0:
            # `bool` hides the constant, for which Numba would compile another version
            x, _ = find_root(
                evaluate, motion, bool(0), left, signal, right, end, rule.tolerance
            )  # fmt: skip
            record.zero[i] = interval.t + interval.h * x
        _update_record(rule, record, i, interval.t + interval.h * right, end, not last)
        left, signal = right, end
