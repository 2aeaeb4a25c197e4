"""How far an exponential decay has come, by polynomial: the same bits on every machine."""

from __future__ import annotations

from typing import Any

from npend_gym.compiled.jit import inlined_kernel
from npend_gym.compiled.packs import where

_DOUBLINGS = 8
_SCALE = 2.0**-_DOUBLINGS
_COMPLETE = 40.0  # exp(-40) is below half the spacing of floats at 1
_TERMS = 12


@inlined_kernel
def one_minus_exp(x: Any) -> Any:
    """Return 1 - exp(-x) of a number x >= 0, or of a pack; the relative error is below 2e-15.

    Of x / 256 it is a short series, sum_k -(-x / 256)^k / k!, and D(2 x) = D(x) (2 - D(x)) has
    no cancellation: also where x is tiny, the relative error stays that of the series.
    """
    r = _SCALE * where(x < _COMPLETE, x, _COMPLETE)
    rest = 1.0 + 0.0 * r
    for k in range(_TERMS, 1, -1):
        rest = 1.0 - (r * rest) * (1.0 / k)
    d = r * rest
    for _ in range(_DOUBLINGS):
        d = d * (2.0 - d)
    return d
