"""The hanging rope: the limit of a chain of many equal rods, released straight at a small angle.

Let x be the square root of the height above the free end over the length L, and tau the time over 2
sqrt(L/g). The rope then moves as a round membrane does: y_tautau = (1/x) (x y_x)_x, y = 0 at x = 1.
Its modes are J0(j_k x), with the angular frequencies j_k, the zeros of J0. What is asked of them is
where sums over all modes are zero; `docs/notes/period_growth.md` derives them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.special import hankel1e, hankel2e, j0, j1, jn_zeros

from npend_gym import _checks
from npend_gym._checks import FloatArray

_FIRST = 40  # modes are added one by one up to this one, and all at once from it on
_ZEROS: FloatArray = jn_zeros(0, _FIRST - 1)
SLOWEST = float(_ZEROS[0])  # j01
_TAU_1 = 2.0 * math.pi / SLOWEST  # T1 in units of tau
_STRAIGHT = 1e-5  # from the pivot, over which the profile changes by less than 1e-11

_Complex = Any  # float or complex, number or array
_h1: Any = hankel1e  # J0 + i Y0 without exp(i x), and its conjugate at real numbers
_h2: Any = hankel2e
_Amplitude = Callable[[_Complex], _Complex]


def _nodes(count: int) -> tuple[FloatArray, FloatArray]:
    """Return places and weights of Gauss's quadrature from 0 to 1."""
    x, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 * (x + 1.0), 0.5 * weights


_x, _w = _nodes(120)
_LONG, _LONG_WEIGHTS = _FIRST * _x / (1.0 - _x), _FIRST * _w / (1.0 - _x) ** 2  # 0 to infinity
_x, _w = _nodes(60)
_SHORT, _SHORT_WEIGHTS = 12.0 * _x, 12.0 * _w / np.expm1(2.0 * math.pi * 12.0 * _x)


class _Wave(NamedTuple):
    """Terms of a sum over modes: the imaginary part of amplitude(j_k) exp(i j_k phase)."""

    phase: float
    alternates: int  # 1 where they have the sign (-1)^k besides
    amplitude: _Amplitude  # a function that is analytic right of zero
    mirrored: _Amplitude  # and the one that is its conjugate at real numbers


def release_profile(s: ArrayLike) -> FloatArray:
    r"""Return when each part of a hanging rope completes its pseudo-period, in units of T1.

    The rope is released straight from a small angle. This is the limit of many equal rods, for the
    definition "bob"; their T1 is `large_n_period`.

    Parameters
    ----------
    s : array_like
        Height above the free end over the length, 0 (tip) to 1 (pivot). Bob i = 1 ... N of a chain
        stands at s = (N - i + 1/2) / (N + 1/2).

    Returns
    -------
    ndarray, shape of `s`
        1.051386 at the tip, 0.950024 in the middle (the median, because it falls all the way),
        0.936614 at the pivot as a limit; the mean over the rope is 0.963675.

    Raises
    ------
    ValueError
        If `s` is not between 0 and 1.

    Notes
    -----
    The second root t of sum_k J0(j_k sqrt(s)) sin(j_k t/2) / (j_k^2 J1(j_k)), t in sqrt(L/g). Its
    terms fall only as 1/k^2, and no faster at the front. So the sum from the 40th term on is turned
    into integrals (Abel and Plana's formula), and is exact to rounding. The bobs of N equal rods in
    small motion (`small_angle_periods`) differ from it, at N = 20, 100 and 1000. The root mean
    square is 1.5e-3, 2.4e-4 and 1.5e-5, and the worst bob differs by 4.9e-3, 1.2e-3 and 1.3e-4.
    This leaves out a few bobs near the pivot that turn early: 2, 4 and 12 of them.

    Examples
    --------
    >>> from npend_gym import theory
    >>> theory.release_profile([0.2, 0.8]).round(3).tolist()
    [0.988, 0.938]
    """
    height = _checks.array("s", s)
    if np.any((height < 0.0) | (height > 1.0)):
        raise ValueError(f"s must lie between 0 (tip) and 1 (pivot), got {_checks.show(s)}")
    turns = [_turn_at(math.sqrt(one)) for one in height.ravel().tolist()]
    return np.array(turns).reshape(height.shape)


@cache
def com_ratio() -> float:
    """Return the pseudo-period of the rope's centre of mass over T1, 0.988746.

    The second root t of sum_k sin(j_k t/2) / j_k^3, whose terms are the contributions of the modes
    of the straight rope to the momentum.

    Examples
    --------
    >>> from npend_gym import theory
    >>> round(theory.com_ratio(), 6)
    0.988746
    """
    return _second_root(lambda tau: _sum_of_sines(lambda j: j**-3, tau))


def _turn_at(x: float) -> float:
    if 1.0 - x < _STRAIGHT:
        return _turn_at_pivot()
    return _second_root(lambda tau: _velocity(x, tau))


@cache
def _turn_at_pivot() -> float:
    """Return the limit of the profile: there the slope of the velocity is zero."""
    return _second_root(lambda tau: _sum_of_sines(lambda j: 1.0 / j, tau))


def _sum_of_sines(amplitude: _Amplitude, tau: float) -> float:
    """Return the sum of amplitude(j_k) sin(j_k tau) over all modes, of a real amplitude."""
    near = np.sum(amplitude(_ZEROS) * np.sin(_ZEROS * tau))
    return float(near) + _rest(_Wave(tau, 0, amplitude, amplitude))


def _second_root(signal: Callable[[float], float]) -> float:
    """Return the root between 0.9 and 1.1 T1, in which no signal has any but its second one."""
    root: Any = brentq(signal, 0.9 * _TAU_1, 1.1 * _TAU_1, xtol=1e-15)
    return root / _TAU_1


def _velocity(x: float, tau: float) -> float:
    """Return the velocity of the rope at x^2, over -4 sqrt(g L) times the angle of its start."""
    near = np.sum(j0(_ZEROS * x) * np.sin(_ZEROS * tau) / (_ZEROS**2 * j1(_ZEROS)))

    def half(hankel: Any) -> _Amplitude:  # 2 J0 = H1 + H2
        return lambda j: _strength(j) * (hankel(0, j * x) if x > 0.0 else 1.0)

    outwards, inwards = half(_h1), half(_h2)
    return float(near) + (
        _rest(_Wave(tau + x, 1, outwards, inwards)) + _rest(_Wave(tau - x, 1, inwards, outwards))
    )


def _strength(j: _Complex) -> _Complex:
    """Return 1 / (2 j^2 J1(j)) at the zeros of J0, without its alternating sign."""
    # J1 Y0 = 2 / (pi j) there, and Y0^2 = H1 H2
    return -math.pi / (4.0 * j) * np.sqrt(_h1(0, j) * _h2(0, j))


def _rest(wave: _Wave) -> float:
    """Return the sum of a wave's terms from the mode `_FIRST` on, to infinity.

    Abel and Plana: sum_{k >= K} F(k) = F(K)/2 + i int_0^inf F(K + iy) dy
    + i int_0^inf (F(K + iy) - F(K - iy)) / (exp(2 pi y) - 1) dy, where F decreases upwards.
    """
    turns = wave.phase + wave.alternates
    turn = math.pi * (turns - 2.0 * round(turns / 2.0))  # from one mode to the next, up to pi
    side = 1.0 if turn >= 0.0 else -1.0  # the conjugate terms decrease where these grow
    amplitude = wave.amplitude if turn >= 0.0 else wave.mirrored

    def term(k: _Complex) -> _Complex:
        j = _zero(k)
        return amplitude(j) * np.exp(1j * side * ((j - math.pi * k) * wave.phase + turn * k))

    above = term(_FIRST + 1j * _SHORT) - term(_FIRST - 1j * _SHORT)
    upwards = np.sum(_LONG_WEIGHTS * term(_FIRST + 1j * _LONG)) + np.sum(_SHORT_WEIGHTS * above)
    return side * float((0.5 * term(complex(_FIRST)) + 1j * upwards).imag)


def _zero(k: _Complex) -> _Complex:
    """Return zero k of J0 by McMahon's series, exact to rounding from the 40th on."""
    b = (k - 0.25) * math.pi
    e = 1.0 / (8.0 * b)
    f = e * e
    return b + e * (1.0 - f * (124.0 / 3.0 - f * (120928.0 / 15.0 - f * (401743168.0 / 105.0))))
