"""Chains released straight at small angles, as sums of their normal modes.

At rest at the angle a, the chain is a sum of its modes, sum_k c_k a v_k cos(omega_k t) of the
angles, with c_k = (h . v_k) / (v_k . H v_k): modes are orthogonal under H = diag(h), `Chain.lift`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain, check_hung
from npend_gym.theory.closed_forms import large_n_com_period, pendulum_factor
from npend_gym.theory.modes import normal_modes

_SAMPLES = 8  # of the fastest mode's period, between which reversals are looked for
_FRAMES = 256  # looked at together
_WINDOW = 10.0  # periods of the slowest mode, after which a bob is given up
_HALVINGS = 44  # of the time between two samples
_MOST_APART = 1e6  # frequencies: sampling takes seconds then
_MODES_UP_TO = 200  # rods: equal rods beyond have the limit of the rope, to 2e-7


def small_angle_periods(chain: Chain) -> FloatArray:
    """Return the pseudo-period [s] of every bob after a straight release from a small angle.

    The limit of `npend_gym.pseudo_periods`, definition "bob", for angles that go to zero. It is
    exact for chains of any masses, lengths and inertias, without friction, and needs no
    integration: the velocities are sums of sines. For many equal rods it tends to
    `release_profile`.

    Returns
    -------
    ndarray, shape (n,)
        NaN where a bob does not reverse twice within ten periods of the slowest mode. All are NaN
        if the straight chain is not at rest: without gravity, or with a link that rests upright.

    Notes
    -----
    Eight samples per period of the fastest mode show the reversals; bisection then locates them to
    rounding. A pair of reversals between two samples is missed.

    Examples
    --------
    >>> from npend_gym import Chain, theory
    >>> theory.small_angle_periods(Chain.uniform(2)).round(4).tolist()
    [2.4429, 2.6343]
    """
    check_hung(chain, "small_angle_periods")
    frequencies, angles = _superposition(chain)
    if frequencies.size == 0:
        return np.full(chain.n, np.nan)
    return _second_reversals(frequencies, np.cumsum(chain.lengths[:, None] * angles, axis=0))


def com_period(chain: Chain | int, amplitude: ArrayLike = 0.0) -> FloatArray:
    r"""Return the pseudo-period [s] of a chain's centre of mass by the law, in the angles' shape.

    The centre of mass of a chain that is released straight from `amplitude` reverses for the second
    time after T = T(0) (2/pi) K(sin(a/2)): T(0) is exact, by superposition of the normal modes, and
    grows with the angle as the period of one pendulum does (K is the complete elliptic integral).
    The law has no fitted number.

    Parameters
    ----------
    chain : Chain or int
        A number n stands for n equal rods of 1 m. Damping and drag are ignored.
    amplitude : array_like
        Starting angle of all rods [rad].

    Returns
    -------
    ndarray, shape of `amplitude`
        NaN without gravity, or where a link rests upright.

    Raises
    ------
    ValueError
        If \|amplitude\| >= pi, or there are more than 10 000 rods that are not equal.

    Notes
    -----
    The factor of the amplitude is exact for one pendulum. For equal rods it was found by
    simulation, and holds within 0.2 % up to 1 rad; `docs/explanation/pseudo_period.md` has its
    error for other chains, angles up to 1.2 rad and N = 1 to 1600. For more than 200 equal rods,
    T(0) is taken from `large_n_com_period`, which agrees to 2e-7.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, theory
    >>> float(theory.com_period(Chain.uniform(5), np.pi / 4).round(4))
    4.0222
    """
    if not isinstance(chain, Chain):
        chain = Chain.uniform(_checks.count("chain", chain))
    check_hung(chain, "com_period")
    factor = pendulum_factor(amplitude)
    if chain.n > _MODES_UP_TO and chain.is_uniform and chain.gravity > 0.0:
        length, gravity = float(chain.lengths[0]), chain.gravity
        return large_n_com_period(chain.n, 0.0, length, gravity) * factor
    frequencies, angles = _superposition(chain)
    if frequencies.size == 0:
        return np.full(factor.shape, np.nan)
    return _second_reversals(frequencies, (chain.lift @ angles)[None])[0] * factor


def _superposition(chain: Chain) -> tuple[FloatArray, FloatArray]:
    """Return frequencies (n,) and angular velocities (n, n), of each mode in its column.

    The chain moves with -sum_k column_k sin(omega_k t). Empty where straight is no stable rest.
    """
    lift = chain.lift
    if chain.gravity == 0.0 or np.any(lift <= 0.0):
        return np.empty(0), np.empty((chain.n, 0))
    omega, modes = normal_modes(chain)
    share = (lift @ modes) / (lift @ modes**2)
    return omega, modes * (share * omega)


def _second_reversals(frequencies: FloatArray, strengths: FloatArray) -> FloatArray:
    """Return when signals -sum_k strengths[:, k] sin(frequencies[k] t) fall after they have risen.

    Shape (signals,); NaN where none does in the window.
    """
    count = len(strengths)
    step = 2.0 * math.pi / (_SAMPLES * frequencies[-1])
    ratio = float(frequencies[-1] / frequencies[0])
    if not ratio <= _MOST_APART:
        raise ValueError(
            f"chain must have frequencies within a factor of {_MOST_APART:g}, because all of its "
            f"modes are sampled; got a factor of {ratio:.3g}"
        )
    last = math.ceil(_WINDOW * _SAMPLES * ratio)
    fallen, found = np.zeros(count, np.bool_), np.full(count, np.nan)
    for first in range(1, last, _FRAMES):
        open_ = np.flatnonzero(np.isnan(found))
        if open_.size == 0:
            break
        # the last frame of one block is the first of the next
        times = step * np.arange(first, first + _FRAMES + 1)
        above = strengths[open_] @ np.sin(np.outer(frequencies, times)) < 0.0
        # a signal that is above from the start has not risen: it must have been below before
        ever = np.logical_or.accumulate(np.column_stack([fallen[open_], ~above]), axis=1)[:, 1:]
        falls = ever[:, :-1] & above[:, :-1] & ~above[:, 1:]
        frame, hit = falls.argmax(axis=1), falls.any(axis=1)
        found[open_[hit]] = times[frame[hit]]
        fallen[open_] = ever[:, -1]
    done = np.flatnonzero(np.isfinite(found))
    low = found[done]
    high = low + step
    for _ in range(_HALVINGS):
        middle: FloatArray = 0.5 * (low + high)
        waves = np.sin(middle[:, None] * frequencies)
        positive = np.einsum("ik,ik->i", strengths[done], waves) < 0.0
        low, high = np.where(positive, middle, low), np.where(positive, high, middle)
    found[done] = 0.5 * (low + high)
    return found
