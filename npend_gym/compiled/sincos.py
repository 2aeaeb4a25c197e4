"""Sine and cosine by polynomial: branch-free, vectorised by LLVM, the same bits on every machine.

Reduction and polynomials are those of FreeBSD's msun (fdlibm ``e_rem_pio2.c``, ``k_sin.c`` and
``k_cos.c``, Sun Microsystems 1993), with its two-stage Cody-Waite reduction always taken.
"""

from __future__ import annotations

from npend_gym._checks import FloatArray
from npend_gym.compiled.jit import kernel
from npend_gym.compiled.packs import where

MAX_ANGLE = 1e5  # rad; up to here the error is below 1 ulp (largest seen 0.74)

ROUND = 6755399441055744.0  # 1.5 * 2**52: adding it rounds to an integer
_TWO_OVER_PI = 6.36619772367581382433e-01
# pi/2 in pieces of 33 bits, so that q times a piece is exact, and what each pair leaves over.
_PIO2_1 = 1.57079632673412561417e00
_PIO2_2 = 6.07710050630396597660e-11
_PIO2_2T = 2.02226624879595063154e-21
_S1, _S2, _S3 = -1.66666666666666324348e-01, 8.33333333332248946124e-03, -1.98412698298579493134e-04
_S4, _S5, _S6 = 2.75573137070700676789e-06, -2.50507602534068634195e-08, 1.58969099521155010221e-10
_C1, _C2, _C3 = 4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05
_C4, _C5, _C6 = -2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11

# What float32 numbers need instead: 1.5 * 2**23, and pi/2 in pieces of 8 bits
FLOAT32_CONSTANTS = {
    ROUND: 12582912.0, _PIO2_1: 1.5703125, _PIO2_2: 4.8351287841796875e-04,
    _PIO2_2T: 3.1391647865048132e-07,
}  # fmt: skip


@kernel
def sincos(x: float) -> tuple[float, float]:
    """Return sin x and cos x, each within 1 ulp for |x| <= 1e5."""
    # x = q pi/2 + y + y_low with |y| <= pi/4; y_low is what rounding y left over
    shifted = x * _TWO_OVER_PI + ROUND
    q = shifted - ROUND
    first = x - q * _PIO2_1
    w = q * _PIO2_2
    r = first - w
    w = q * _PIO2_2T - ((first - r) - w)
    y = r - w
    y_low = (r - y) - w

    z = y * y
    p = _S2 + z * (_S3 + z * (_S4 + z * (_S5 + z * _S6)))
    sin_y = y - ((z * (0.5 * y_low - (z * y) * p) - y_low) - (z * y) * _S1)
    p = z * (_C1 + z * (_C2 + z * (_C3 + z * (_C4 + z * (_C5 + z * _C6)))))
    hz = 0.5 * z
    top = 1.0 - hz
    cos_y = top + (((1.0 - top) - hz) + (z * p - y * y_low))

    # q mod 4 is the quadrant: an odd q swaps the two, an odd q // 2 turns the sign of the sine, and
    # one of the two alone that of the cosine. A number is odd if its half is no integer.
    half = 0.5 * q
    swap = (half + ROUND) - ROUND != half
    quarter = 0.5 * where(swap, half - 0.5, half)
    turn = (quarter + ROUND) - ROUND != quarter
    sin_x, cos_x = where(swap, cos_y, sin_y), where(swap, sin_y, cos_y)
    return where(turn, -sin_x, sin_x), where(turn ^ swap, -cos_x, cos_x)


@kernel
def sincos_all(x: FloatArray, s: FloatArray, c: FloatArray) -> None:
    """Write sine and cosine of every entry of `x` (m,) into `s` and `c` (m,)."""
    for i in range(x.size):
        s[i], c[i] = sincos(x[i])
