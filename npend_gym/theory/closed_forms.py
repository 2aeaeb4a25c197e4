"""Closed forms: the paper's model of the pseudo-period, and the correct ones."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import MAX_DENSE, STANDARD_GRAVITY, Chain, check_hung

MAX_TERMS = 100_000  # of the amplitude series
_SMALL, _ENOUGH = 0.05, 6  # rad, below which the limit less 1 would lose digits; terms there


def ideal_period(chain: Chain) -> float:
    r"""Return the paper's T0(N) [s], Eq. (npesudoperiod): 2 pi N / sum_i sqrt(g m_i / (l_i M)).

    For equal masses and lengths it is 2 pi sqrt(N l/g). The paper takes the mass and stiffness
    matrices as diagonal; `fundamental_period` does not. NaN without gravity.

    Raises
    ------
    ValueError
        If the chain has links or rotors, to which the paper's formula does not apply.

    Examples
    --------
    >>> from npend_gym import Chain, theory
    >>> round(theory.ideal_period(Chain.uniform(4)), 4)
    4.0121
    """
    if not chain.has_bobs:
        raise ValueError(
            "ideal_period is the paper's formula for point masses on massless rods, and does not "
            f"apply to links: use fundamental_period; got {chain}"
        )
    check_hung(chain, "ideal_period")
    if not chain.gravity:
        return math.nan
    return paper_period(chain.masses, chain.lengths, chain.gravity)


def paper_period(masses: FloatArray, lengths: FloatArray, gravity: float) -> float:
    """Return `ideal_period` of masses and lengths (n,) under gravity; for compiled code too."""
    total = rates = 0.0
    for mass in masses:
        total += mass
    for mass, length in zip(masses, lengths):  # noqa: B905  no keywords in compiled code
        rates += math.sqrt(gravity * mass / (length * total))
    return 2.0 * math.pi * len(masses) / rates


def amplitude_correction(theta0: ArrayLike, terms: int | None = None) -> FloatArray:
    r"""Return Delta T / T0 of a single pendulum released from `theta0` [rad], of its shape.

    The series sum_{k=1}^{terms} ((2k)! / (2^{2k} (k!)^2))^2 sin^{2k}(theta0/2): the paper's
    Eq. (absolute) with 2^{2k} where it prints 2^{2 pi}. Without `terms` its limit,
    2 K(sin(theta0/2)) / pi - 1 with the complete elliptic integral K (0.0400 at pi/4).

    Raises
    ------
    ValueError
        If \|theta0\| >= pi, where the period is infinite, or `terms` is negative.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import theory
    >>> float(theory.amplitude_correction(np.pi / 4).round(4))
    0.04
    """
    given = _within_pi("theta0", theta0)
    if terms is None:
        limit, small = pendulum_factor(given) - 1.0, np.abs(given) < _SMALL
        return np.where(small, amplitude_correction(np.where(small, given, 0.0), _ENOUGH), limit)
    m = np.sin(0.5 * given) ** 2
    term, total = np.ones_like(m), np.zeros_like(m)
    for k in range(1, _checks.count("terms", terms, low=0, high=MAX_TERMS) + 1):
        term = term * ((2 * k - 1) / (2 * k)) ** 2 * m
        total = total + term
    return total


def pendulum_factor(amplitude: ArrayLike) -> FloatArray:
    r"""Return (2/pi) K(sin(a/2)), the period of one pendulum over its limit, of angles a [rad].

    Raises
    ------
    ValueError
        If \|amplitude\| >= pi.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import theory
    >>> theory.pendulum_factor([0.0, np.pi / 2]).round(4).tolist()
    [1.0, 1.1803]
    """
    from scipy.special import ellipkm1

    # K of the modulus sin(a/2), by what is left to 1 of its square: exact near pi too
    left = np.cos(0.5 * _within_pi("amplitude", amplitude)) ** 2
    return np.asarray(2.0 * ellipkm1(left) / np.pi)


def _within_pi(name: str, angle: ArrayLike) -> FloatArray:
    """Return angles [rad]; raise an error if they do not lie within pi."""
    given = _checks.array(name, angle)
    if np.any(np.abs(given) >= np.pi):
        raise ValueError(f"{name} must lie between -pi and pi, got {_checks.show(angle)}")
    return given


def pendulum_period(
    theta0: ArrayLike, length: float = 1.0, gravity: float = STANDARD_GRAVITY
) -> FloatArray:
    """Return the exact period [s] of a single pendulum released from `theta0` [rad].

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import theory
    >>> theory.pendulum_period([0.01, np.pi / 2]).round(4).tolist()
    [2.0061, 2.3678]
    """
    return single_period(length, gravity) * (1.0 + amplitude_correction(theta0))


def single_period(length: float = 1.0, gravity: float = STANDARD_GRAVITY) -> float:
    """Return 2 pi sqrt(l/g) [s], the paper's Eq. (simpleperiod).

    Examples
    --------
    >>> from npend_gym import theory
    >>> round(theory.single_period(), 4)
    2.0061
    """
    length = _checks.positive_number("length", length)
    gravity = _checks.positive_number("gravity", gravity)
    return 2.0 * math.pi * math.sqrt(length / gravity)


def uniform_frequencies(
    n: int, length: float = 1.0, gravity: float = STANDARD_GRAVITY
) -> FloatArray:
    """Return the normal frequencies [rad/s] of n equal rods and masses, increasing, shape (n,).

    omega_k^2 = (g/l) x_k with x_k the zeros of the Laguerre polynomial L_n, found as the
    eigenvalues of its Jacobi matrix.

    Examples
    --------
    >>> from npend_gym import theory
    >>> theory.uniform_frequencies(3).round(4).tolist()
    [2.0196, 4.7441, 7.8552]
    """
    from scipy.linalg import eigh_tridiagonal

    n = _checks.count("n", n, high=MAX_DENSE)
    zeros = eigh_tridiagonal(2.0 * np.arange(n) + 1.0, np.arange(1.0, n), eigvals_only=True)
    length = _checks.positive_number("length", length)
    return np.sqrt(_checks.positive_number("gravity", gravity) / length * zeros)


def large_n_period(
    n: int, length: float = 1.0, gravity: float = STANDARD_GRAVITY, *, terms: int = 1
) -> float:
    """Return the limit of the fundamental period [s] for many equal rods.

    (2/j01) 2 pi sqrt((n + 1/2) l/g), j01 = 2.4048 the first zero of the Bessel function J0: the
    paper's square root with the factor 0.83 in place of 1. Its relative error is 1.3e-3, 3.6e-4 and
    3.9e-6 at n = 5, 10 and 100.

    Parameters
    ----------
    n : int
        Number of rods.
    length, gravity : float
        [m], [m/s^2]
    terms : int
        1, or 2 for the next order as well, a factor 1 - (j01^2 - 2) / (96 (n + 1/2)^2): the error
        is then 3.7e-6, 2.8e-7 and 3.3e-11. It comes from the zeros of the Laguerre polynomial L_n,
        x_1 = j01^2 / (4 nu) (1 + (j01^2 - 2) / (48 nu^2) + ...), nu = n + 1/2 (DLMF 18.16.14).

    Examples
    --------
    >>> from npend_gym import Chain, theory
    >>> exact = theory.fundamental_period(Chain.uniform(100))
    >>> round(theory.large_n_period(100), 3), round(exact, 3)
    (16.725, 16.725)
    """
    from npend_gym.theory.rope import SLOWEST

    n = _checks.count("n", n, high=10**30)
    limit = 2.0 / SLOWEST * single_period(length, gravity) * math.sqrt(n + 0.5)
    if _checks.count("terms", terms, high=2) == 1:
        return limit
    return limit * (1.0 - (SLOWEST**2 - 2.0) / (96.0 * (n + 0.5) ** 2))


def large_n_com_period(
    n: int, amplitude: ArrayLike = 0.0, length: float = 1.0, gravity: float = STANDARD_GRAVITY
) -> FloatArray:
    r"""Return the pseudo-period [s] of many equal rods by the law, in the shape of `amplitude`.

    T(n, a) = 0.822302 * 2 pi sqrt((n + 1/2) l/g) * (2/pi) K(sin(a/2)): when the centre of mass of
    the chain, released straight from a, reverses for the second time. The factor is `com_ratio` of
    the hanging rope times 2/j01, computed and not fitted; the amplitude enters as for one pendulum.

    Parameters
    ----------
    n : int
        Number of rods.
    amplitude : array_like
        Starting angle of all rods [rad].
    length, gravity : float
        [m], [m/s^2]

    Raises
    ------
    ValueError
        If \|amplitude\| >= pi.

    Notes
    -----
    At small angles the relative error is 7e-3, 1.9e-3, 6.5e-4 and 2.6e-4 at n = 1, 2, 3 and 5, and
    below 6e-6 from n = 10; `com_period` has no such error; it describes the error at larger angles.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import theory
    >>> float(theory.large_n_com_period(100, np.pi / 4).round(4))
    17.1982
    """
    from npend_gym.theory.rope import com_ratio

    limit = com_ratio() * large_n_period(n, length, gravity)
    return limit * pendulum_factor(amplitude)
