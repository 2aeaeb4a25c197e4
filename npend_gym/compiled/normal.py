"""Normally distributed numbers from uniform ones, the same bits on every machine.

The natural logarithm is that of FreeBSD's msun (fdlibm ``e_log.c``, Sun Microsystems 1993), without
branches.
"""

from __future__ import annotations

import math

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.compiled.jit import inlined_kernel, kernel
from npend_gym.compiled.sincos import sincos

_ONE, _ROOT_HALF = 0x3FF0000000000000, 0x3FE6A09E667F3BCD  # the bits of 1 and of sqrt(1/2)
_FRACTION = 2**52 - 1  # the bits below the exponent
# ln 2 in two pieces: an exponent times the first is exact
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_L1, _L2, _L3 = 6.666666666666735130e-01, 3.999999999940941908e-01, 2.857142874366239149e-01
_L4, _L5, _L6 = 2.222219843214978396e-01, 1.818357216161805012e-01, 1.531383769920937332e-01
_L7 = 1.479819860511658591e-01


@kernel
def log(x: float) -> float:
    """Return the natural logarithm of a positive normal number, within 1 ulp."""
    # x = 2^k (1 + f) with 1 + f between sqrt(1/2) and sqrt(2)
    bits = np.float64(x).view(np.int64) + (_ONE - _ROOT_HALF)
    k = np.float64((bits >> 52) - 1023)
    f = np.int64((bits & _FRACTION) + _ROOT_HALF).view(np.float64) - 1.0

    # log(1 + f) = log((1 + s) / (1 - s)) = 2 s + s r
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    even = w * (_L2 + w * (_L4 + w * _L6))
    r = z * (_L1 + w * (_L3 + w * (_L5 + w * _L7))) + even
    half_square = 0.5 * f * f
    return k * _LN2_HIGH - ((half_square - (s * (half_square + r) + k * _LN2_LOW)) - f)


@inlined_kernel
def normal_pair(u: float, v: float) -> tuple[float, float]:
    """Return two independent numbers of mean 0 and standard deviation 1, from two in [0, 1).

    The cosine and the sine of 2 pi v, times sqrt(-2 log(1 - u)): at most 8.6 for numbers of
    `philox.unit` (Box and Muller, Ann. Math. Stat. 29, 1958).
    """
    radius = math.sqrt(-2.0 * log(1.0 - u))
    sine, cosine = sincos(2.0 * math.pi * v)
    return radius * cosine, radius * sine


@kernel
def make_normal(u: FloatArray, v: FloatArray) -> None:
    """Put pairs of normally distributed numbers in place of pairs of numbers in [0, 1), (m,) each.

    A loop of its own, which the compiler vectorises: 3 ns a number. In a loop that also draws the
    words, a number takes 17 ns.
    """
    for i in range(u.size):
        u[i], v[i] = normal_pair(u[i], v[i])
