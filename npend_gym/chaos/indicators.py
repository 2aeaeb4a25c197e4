"""Whether a motion is chaotic: its largest Lyapunov exponent, and MEGNO, from one vector."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import cumulative_trapezoid

from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.chaos.growth import log_growth
from npend_gym.chaos.variations import motion_of, record
from npend_gym.physics.motion import Integration
from npend_gym.physics.signals import TimeVarying

_SETTLING = 10  # a tenth of the motion, in which the vector turns into the direction that grows
_BLOCKS = (8, 16, 32)  # of equal length, whose rates scatter
_SAMPLES = 400  # of the histories, at most


@dataclass(frozen=True, eq=False)
class LargestExponent:
    """The largest Lyapunov exponent of a motion, and how its estimate converged.

    Attributes
    ----------
    exponent : float
        In 1/s, the last of `history`.
    error : float
        Its standard error [1/s]. For a regular motion, whose exponent is zero, it is the expected
        size of the estimate.
    times : ndarray, shape (T,)
        Instants [s], increasing, after the first tenth of the motion.
    history : ndarray, shape (T,)
        Estimates of the exponent at those instants [1/s].
    provenance : dict
        How it was made: versions and arguments.
    """

    exponent: float
    error: float
    times: FloatArray
    history: FloatArray
    provenance: dict[str, Any]

    @property
    def chaotic(self) -> bool:
        """Whether the exponent is more than three standard errors above zero."""
        return self.exponent > 3.0 * self.error


@dataclass(frozen=True, eq=False)
class Megno:
    """MEGNO of a motion: the mean exponential growth factor of nearby orbits.

    Attributes
    ----------
    value : float
        The mean of Y over the motion, the last of `history`: 2 for quasi-periodic motion, less for
        a stable periodic one, and more, without bound, for chaos.
    times : ndarray, shape (T,)
        Instants [s], increasing.
    history : ndarray, shape (T,)
        The mean of Y up to those instants.
    provenance : dict
        How it was made: versions and arguments.
    """

    value: float
    times: FloatArray
    history: FloatArray
    provenance: dict[str, Any]

    @property
    def exponent(self) -> float:
        """Largest Lyapunov exponent [1/s] by a line through the second half: twice its slope."""
        half = self.times.size // 2
        return float(2.0 * np.polyfit(self.times[half:], self.history[half:], 1)[0])


def largest_lyapunov(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike = 0.0,
    *,
    duration: float,
    rtol: float = 1e-11,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
    torque: ArrayLike | TimeVarying | None = None,
    force: ArrayLike | TimeVarying = 0.0,
    pivot_acceleration: ArrayLike | TimeVarying | None = None,
) -> LargestExponent:
    """Return the largest Lyapunov exponent of a motion, with its error, for any number of rods.

    Parameters
    ----------
    chain : Chain
    theta, omega : array_like, shape (n,)
        The start [rad, rad/s]; one number stands for all rods.
    duration : float
        How long the motion is followed [s]: the error falls off as one over its square root in
        chaos, as 1/t in regular motion.
    rtol : float
        Relative tolerance of the motion's steps; the absolute tolerance is a hundredth of it.
    progress : callable
        Wraps the iteration over hundredths of the duration, for a progress bar.
    torque, force, pivot_acceleration : array_like, Signal or callable, optional
        What drives the chain, as in `simulate`; functions of time alone.

    Returns
    -------
    LargestExponent

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.
    IntegrationError
        If the motion diverges.

    Notes
    -----
    One tangent vector is carried exactly through the steps of the integrator, O(n)
    operations each. Let L be the logarithm of its length in (theta, omega / omega_n), omega_n the
    frequency of the fastest mode, and t0 a tenth of the duration. The estimate is [L(t) - L(t0)] /
    (t - t0).

    The rates of 8, 16 and 32 blocks of equal length scatter, and the largest of the three standard
    errors of their mean is the statistical one: correlations longer than a block make it too small.
    To it is added, in quadrature, ln(10) / (t - t0), the rate of the linear growth that regular
    motion has. If a motion stays near islands of regular motion for long, the estimate cannot show
    what comes after.

    Neighbours of a driven motion have the same drive at the same time, so the exponent of time,
    which is 0, is left out. In no step with a function does the fastest mode turn by more than 0.5
    rad. Give shorter pulses as a `Signal`.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, chaos
    >>> found = chaos.largest_lyapunov(Chain.uniform(2), [2.0, 2.0], duration=100.0)
    >>> found.exponent > 0.3  # 1/s: chaotic
    True
    >>> pendulum = Chain.uniform(1, gravity=1.0, damping=0.5)  # -theta'/2 - sin theta + torque
    >>> drive = lambda t: 1.5 * np.cos(2.0 * t / 3.0)
    >>> chaos.largest_lyapunov(pendulum, 0.2, duration=900.0, torque=drive).chaotic
    True
    """
    drives = {"torque": torque, "force": force, "pivot_acceleration": pivot_acceleration}
    motion = motion_of(chain, theta, omega, rtol, drives)
    times, logarithm, made_by = _grow(chain, motion, duration, progress, drives)
    first = times.size // _SETTLING
    rates = (logarithm[first + 1 :] - logarithm[first]) / (times[first + 1 :] - times[first])
    statistical = max(_block_error(logarithm[first:], times[first:], b) for b in _BLOCKS)
    error = math.hypot(statistical, math.log(_SETTLING) / float(times[-1] - times[first]))
    kept = _spread(rates.size)
    return LargestExponent(float(rates[-1]), error, times[first + 1 :][kept], rates[kept], made_by)


def megno(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike = 0.0,
    *,
    duration: float,
    rtol: float = 1e-11,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
    torque: ArrayLike | TimeVarying | None = None,
    force: ArrayLike | TimeVarying = 0.0,
    pivot_acceleration: ArrayLike | TimeVarying | None = None,
) -> Megno:
    """Return MEGNO, which tells regular motion from chaos within a few periods, for any n.

    Parameters
    ----------
    chain, theta, omega, duration, rtol, progress, torque, force, pivot_acceleration
        As for `largest_lyapunov`. Over some hundred periods of the slowest mode it detects weak
        chaos too.

    Returns
    -------
    Megno

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.
    IntegrationError
        If the motion diverges.

    Notes
    -----
    Cincotta and Simo (Astron. Astrophys. Suppl. Ser. 147, 2000): with L the logarithm of the length
    of a tangent vector,

        Y(t) = (2/t) int_0^t L'(s) s ds = 2 L(t) - (2/t) int_0^t L(s) ds,

    and the mean of Y over [0, t] tends to 2 where neighbours part linearly, to lambda t / 2 where
    they part as exp(lambda t). It converges as 1/t, while a Lyapunov exponent of regular motion
    falls to zero as log t / t only.

    Examples
    --------
    >>> from npend_gym import Chain, chaos
    >>> chaos.megno(Chain.uniform(2), [2.0, 2.0], duration=100.0).value > 4.0  # 2 where regular
    True
    """
    drives = {"torque": torque, "force": force, "pivot_acceleration": pivot_acceleration}
    motion = motion_of(chain, theta, omega, rtol, drives)
    times, logarithm, made_by = _grow(chain, motion, duration, progress, drives)
    integral = cumulative_trapezoid(np.append(0.0, logarithm), np.append(0.0, times))
    y = 2.0 * (logarithm - integral / times)
    mean = cumulative_trapezoid(np.append(0.0, y), np.append(0.0, times)) / times
    kept = _spread(times.size)
    return Megno(float(mean[-1]), times[kept], mean[kept], made_by)


def _grow(
    chain: Chain,
    motion: Integration,
    duration: float,
    progress: Callable[[Iterable[int]], Iterable[int]],
    drives: Mapping[str, Any],
) -> tuple[FloatArray, FloatArray, dict[str, Any]]:
    """Return instants, the logarithm of a tangent vector there, and the record of the arguments."""
    least = _SETTLING * max(_BLOCKS)
    times, logarithm = log_growth(chain, motion, duration, None, progress, least)
    given = {"duration": float(duration), "rtol": float(motion.settings["rtol"])}
    return times, logarithm, record(chain, motion.state, **given, **drives)


def _block_error(logarithm: FloatArray, times: FloatArray, blocks: int) -> float:
    """Return the standard error of the mean rate, from the rates of this many blocks."""
    ends = np.linspace(0, times.size - 1, blocks + 1).astype(np.int64)
    rates = np.diff(logarithm[ends]) / np.diff(times[ends])
    return float(np.std(rates, ddof=1)) / math.sqrt(blocks)


def _spread(size: int) -> Any:
    """Return the indices of at most `_SAMPLES` instants, evenly spaced, the last among them."""
    return np.unique(np.linspace(0, size - 1, min(size, _SAMPLES)).astype(np.int64))
