"""Turning points of bobs between two states: on the cubic through velocities and accelerations.

The environments' counterpart of `turning`, for the "bob" reading: a Runge-Kutta substep has no
dense output of its own.
"""

from __future__ import annotations

import math

from npend_gym._checks import FloatArray
from npend_gym.compiled.jit import inlined_kernel, inner_kernel
from npend_gym.compiled.sincos import sincos
from npend_gym.physics.kernels.turning import BOB, Turns, count_sign

_ROOT_TOLERANCE = 1e-13  # of a substep


@inlined_kernel
def bob_accelerations(
    theta: FloatArray, omega: FloatArray, alpha: FloatArray, length: FloatArray,
    slope: FloatArray,
) -> None:  # fmt: skip
    """Write the horizontal acceleration of every bob."""
    total = 0.0
    for i in range(theta.size):
        s, c = sincos(theta[i])
        total = total + length[i] * (alpha[i] * c - (omega[i] * omega[i]) * s)
        slope[i] = total


@inner_kernel
def _hermite(f: float, df: float, g: float, dg: float, x: float) -> tuple[float, float]:
    """Return the cubic through (0, f) and (1, g) with slopes df and dg at `x`, and its slope."""
    a = df - (g - f)
    b = (g - f) - dg
    u = 1.0 - x
    bend = a * u + b * x
    value = (u * f + x * g) + (x * u) * bend
    return value, (g - f) + (u - x) * bend + (x * u) * (b - a)


@inner_kernel
def _hermite_root(
    of_slope: bool, f: float, df: float, g: float, dg: float, a: float, b: float
) -> float:
    """Return where the cubic (or its slope) is zero in [a, b], at whose ends it differs in sign."""
    value, slope = _hermite(f, df, g, dg, a)
    fa = slope if of_slope else value
    value, slope = _hermite(f, df, g, dg, b)
    fb = slope if of_slope else value
    x = b
    for _ in range(100):
        x = b if fb == 0.0 else b - fb * ((b - a) / (fb - fa))
        value, slope = _hermite(f, df, g, dg, x)
        fx = slope if of_slope else value
        if fx == 0.0 or abs(x - b) <= _ROOT_TOLERANCE:
            break
        if (fx > 0.0) == (fb > 0.0):
            fa *= 0.5
        else:
            a, fa = b, fb
        b, fb = x, fx
    return x


@inner_kernel
def follow(
    turns: Turns, r: int, t: float, h: float, f: float, df: float, g: float, dg: float,
    threshold: float,
) -> None:  # fmt: skip
    """Take note of the turning points of bob `r` from `t` to `t + h`, cubic in between."""
    left, value = 0.0, f
    for last in (False, True):
        right, end = 1.0, g
        if not last:
            if not df * dg < 0.0:
                continue
            right = _hermite_root(True, f, h * df, g, h * dg, 0.0, 1.0)
            end, _ = _hermite(f, h * df, g, h * dg, right)
        crosses = (value <= 0.0 and end > 0.0) or (value >= 0.0 and end < 0.0)
        if crosses and turns.sign[r] != 0.0:
            x = _hermite_root(False, f, h * df, g, h * dg, left, right)
            turns.zero[r] = t + h * x
        count_sign(BOB, r, t + h * right, end, not last, threshold, turns)
        if not math.isnan(turns.period[r]):
            return
        left, value = right, end
