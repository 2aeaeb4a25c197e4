"""Pseudo-periods while integrating: the instants at which each bob or rod turns.

A *signal* is a quantity of one rod whose zeros are the turning points of a reading:

=======  ============================================  =========================
reading  signal                                        slope
=======  ============================================  =========================
BOB      horizontal velocity of the bob                its horizontal acceleration
LINK     angular velocity of the rod                   its angular acceleration
HEIGHT   height of the bob above its start             its vertical velocity
=======  ============================================  =========================

Each step is cut into pieces at whose ends the signals and slopes are taken from the dense output.
Where the slope changes sign within a piece, the extremum is located and the piece is cut there, so
that an excursion shorter than a piece is seen too: between cuts a signal is monotone.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.physics.kernels.dop853 import Solver, prepare_dense, step
from npend_gym.physics.kernels.dynamics import Rods, copy
from npend_gym.physics.kernels.jit import kernel
from npend_gym.physics.kernels.sincos import sincos

BOB, LINK, HEIGHT = 0, 1, 2
_PIECES = 4  # of a step; at these tolerances a step is about a radian of the fastest mode
_ROOT_TOLERANCE = 1e-11  # s
_MAX_ITERATIONS = 100


class Turns(NamedTuple):
    """What is known of each rod's turning points so far; all of shape (n,)."""

    period: FloatArray  # s; NaN until complete
    orientation: FloatArray  # +1 where the rod was released from positive angles, else -1
    sign: FloatArray  # of the signal, once it counted; 0 before
    risen: FloatArray  # 1 where the signal has crossed from - to +
    zero: FloatArray  # s; latest zero of the signal
    start: FloatArray  # starting angle; its cosine gives the starting height


def new_turns(theta: FloatArray, orientation: FloatArray) -> Turns:
    """Return the record of a release from `theta`, nothing seen yet."""
    n = theta.size
    nan = np.full(n, np.nan)
    return Turns(nan, orientation, np.zeros(n), np.zeros(n), nan.copy(), theta.copy())


@kernel
def _at(solver: Solver, x: float, j: int) -> tuple[float, float]:
    """Return component `j` of the state at fraction `x` of the step, and its time derivative."""
    poly = solver.poly
    u = 1.0 - x
    p = poly[6, j]
    d = 0.0
    for row in range(5, -1, -1):
        # multiplied by x and by 1 - x in turn, as in `interpolate`
        if row % 2 == 1:
            d = d * x + p
            p = p * x + poly[row, j]
        else:
            d = d * u - p
            p = p * u + poly[row, j]
    return solver.y_old[j] + p * x, (d * x + p) / (solver.clock[1] - solver.clock[0])


@kernel
def _signals(
    reading: int, solver: Solver, x: float, first: int, last: int, turns: Turns, rods: Rods,
    signal: FloatArray, slope: FloatArray,
) -> None:  # fmt: skip
    """Write signal and slope of rods first..last at fraction `x` of the step.

    A bob's motion is the sum over the rods above it: but for LINK, `first` must be 0.
    """
    n = turns.start.size
    value = 0.0
    rate = 0.0
    for i in range(first, last + 1):
        omega, alpha = _at(solver, x, n + i)
        if reading == LINK:
            value, rate = omega, alpha
        else:
            theta, _ = _at(solver, x, i)
            s, c = sincos(theta)
            l = rods.length[i]
            if reading == BOB:
                value += l * (omega * c)
                rate += l * (alpha * c - (omega * omega) * s)
            else:
                _, c0 = sincos(turns.start[i])
                value += l * (c0 - c)
                rate += l * (omega * s)
        signal[i] = turns.orientation[i] * value
        slope[i] = turns.orientation[i] * rate


@kernel
def _root(
    of_slope: bool, reading: int, i: int, solver: Solver, a: float, fa: float, b: float, fb: float,
    turns: Turns, rods: Rods, scratch: FloatArray,
) -> tuple[float, float]:  # fmt: skip
    """Return where rod i's signal (or its slope) is zero between `a` and `b`, and the signal there.

    Illinois variant of regula falsi: keeps the bracket, no derivative needed.
    """
    first = i if reading == LINK else 0
    tolerance = _ROOT_TOLERANCE / (solver.clock[1] - solver.clock[0])
    x = b
    for _ in range(_MAX_ITERATIONS):
        x = b if fb == 0.0 else b - fb * ((b - a) / (fb - fa))
        _signals(reading, solver, x, first, i, turns, rods, scratch[0], scratch[1])
        f = scratch[1, i] if of_slope else scratch[0, i]
        if f == 0.0 or abs(x - b) <= tolerance:
            break
        if (f > 0.0) == (fb > 0.0):
            fa *= 0.5
        else:
            a, fa = b, fb
        b, fb = x, f
    return x, scratch[0, i]


@kernel
def count_sign(
    reading: int, i: int, t: float, f: float, at_extremum: bool, threshold: float, turns: Turns
) -> None:
    """Take note that rod i's signal has come to `f` at time `t`, its latest zero being known."""
    sign = turns.sign[i]
    if reading == HEIGHT and sign != 0.0 and at_extremum and abs(f) <= threshold:
        turns.period[i] = t  # touches the starting height without crossing it
        return
    if abs(f) <= threshold:
        return
    new = 1.0 if f > 0.0 else -1.0
    if sign == -new:
        if reading == HEIGHT or (new < 0.0 and turns.risen[i] == 1.0):
            turns.period[i] = turns.zero[i]
        elif new > 0.0:
            turns.risen[i] = 1.0
    turns.sign[i] = new


@kernel
def _scan_piece(
    reading: int, solver: Solver, a: float, b: float, threshold: float, turns: Turns, rods: Rods,
    scratch: FloatArray,
) -> int:  # fmt: skip
    """Follow every signal from fraction `a` of the step to `b`; return how many are complete."""
    ends = scratch[2:]  # signal and slope at the left and at the right end of the piece
    n = turns.start.size
    t_old = solver.clock[0]
    h = solver.clock[1] - t_old
    copy(ends[2], ends[0])
    copy(ends[3], ends[1])
    _signals(reading, solver, b, 0, n - 1, turns, rods, ends[2], ends[3])
    complete = 0
    for i in range(n):
        left, f = a, ends[0, i]
        turning = ends[1, i] * ends[3, i] < 0.0
        for last in (False, True):
            if not (math.isnan(turns.period[i]) and (last or turning)):
                continue
            right, g = b, ends[2, i]
            if not last:
                right, g = _root(
                    True, reading, i, solver, a, ends[1, i], b, ends[3, i], turns, rods, scratch
                )
            crosses = (f <= 0.0 and g > 0.0) or (f >= 0.0 and g < 0.0)
            if crosses and turns.sign[i] != 0.0:
                x, _ = _root(False, reading, i, solver, left, f, right, g, turns, rods, scratch)
                turns.zero[i] = t_old + h * x
            count_sign(reading, i, t_old + h * right, g, not last, threshold, turns)
            left, f = right, g
        if not math.isnan(turns.period[i]):
            complete += 1
    return complete


@kernel
def measure(
    reading: int, solver: Solver, t_end: float, max_steps: int, rods: Rods, torque: FloatArray,
    rtol: float, atol: float, threshold: float, turns: Turns, scratch: FloatArray,
) -> int:  # fmt: skip
    """Integrate until every rod is complete or `t_end`; `turns.period` holds what was found.

    `scratch` (6, n) belongs to one release, from the first call to the last.

    Return 1 when finished, 0 after `max_steps` steps, -1 where the integration cannot go on.
    """
    n = turns.start.size
    for _ in range(max_steps):
        if not step(solver, t_end, rods, torque, rtol, atol):
            return -1
        prepare_dense(solver, rods, torque)
        if solver.clock[0] == 0.0:
            _signals(reading, solver, 0.0, 0, n - 1, turns, rods, scratch[4], scratch[5])
        complete = 0
        for piece in range(_PIECES):
            a, b = piece / _PIECES, (piece + 1) / _PIECES
            complete = _scan_piece(reading, solver, a, b, threshold, turns, rods, scratch)
        if complete == n or solver.clock[1] >= t_end:
            return 1
    return 0
