r"""How hard it is to keep a chain upright: limits that follow from its unstable poles.

The system is x' = A x + B u with \|u\| <= `limit`, and it starts at rest. Every `dt` the positions
are measured, with white noise of the same deviation each, and u is chosen.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.theory.unstable_modes import UnstableModes


@dataclass(frozen=True, eq=False)
class LeastAction:
    """The linear controller with the least mean squared action, and the noise that it survives.

    Attributes
    ----------
    mean_square : float
        Least mean of (u / limit)^2 that any linear controller needs, per square of the noise
        [1/rad^2].
    return_level : float
        Command, in limits, from which the system just returns when commands are clipped at 1.
    noise : float
        Largest standard deviation of the noise [rad], of a cart's position [m].
    feedback : ndarray, shape (2m,), with a lag (2m + 1,)
        K of the command u / limit = -K x; x is the estimate, predicted over the delay. With a lag,
        the last entry belongs to the motor's output over the limit.
    estimator : ndarray, shape (2m, m), with a lag (2m + 1, m)
        L of the filter: it adds L (measured - expected) to the estimate.
    """

    mean_square: float
    return_level: float
    noise: float
    feedback: FloatArray
    estimator: FloatArray


@dataclass(frozen=True, eq=False)
class Hardness:
    """The sensors, motor and controller that a system needs to be kept upright.

    Attributes
    ----------
    poles : ndarray
        The unstable poles [1/s], increasing.
    noise : float
        Largest standard deviation of white noise of the sensors [rad], see `least_action`.
    delay : float
        Largest delay [s] that the controller knows, with noise of `share` times `noise`.
    lag : float
        Largest time constant [s] of a motor that the controller knows, with the same noise.
    static_delay : float
        At this delay [s] and beyond, no constant feedback of the delayed state keeps it upright.
    """

    poles: FloatArray
    noise: float
    delay: float
    lag: float
    static_delay: float

    @property
    def resolution(self) -> float:
        """Step [rad] of sensors that round: its error has the deviation resolution / sqrt(12)."""
        return math.sqrt(12.0) * self.noise

    @property
    def motor_bandwidth(self) -> float:
        """Least bandwidth of the motor [rad/s], 1 / `lag`."""
        return 1.0 / self.lag

    @property
    def pole_sum(self) -> float:
        """Sum of the unstable poles [1/s]: the rate at which volumes of states grow."""
        return float(self.poles.sum())

    @property
    def pole_product(self) -> float:
        """Product of the unstable poles, in powers of 1/s."""
        return float(self.poles.prod())

    @property
    def bits_per_second(self) -> float:
        """Bits that must pass from the sensors to the motor in a second, by the data-rate theorem.

        The sum of the unstable poles over ln 2.
        """
        return self.pole_sum / math.log(2.0)

    def peak_sensitivity(self, bandwidth: float) -> float:
        r"""Return a lower bound of the peak of \|S\| if \|S\| <= 1 above `bandwidth` [rad/s].

        Bode's integral of ln \|S\| over all frequencies is pi times the sum of the unstable poles
        of the loop, where its gain falls faster than 1/s. A stable controller adds none. Beyond the
        largest float the bound is infinite.
        """
        log_peak = math.pi * self.pole_sum / _checks.positive_number("bandwidth", bandwidth)
        return math.exp(log_peak) if log_peak < 709.0 else math.inf


def least_action(
    a: ArrayLike,
    b: ArrayLike,
    *,
    limit: float = 1.0,
    dt: float = 0.02,
    seconds: float = 20.0,
    delay: float = 0.0,
    lag: float = 0.0,
) -> LeastAction:
    r"""Return the controller with the least mean squared action, and the noise that it survives.

    Parameters
    ----------
    a, b : array_like, shapes (2m, 2m) and (2m, 1)
        A and B of `npend_gym.physics.linearise`. The first m states are measured.
    limit : float
        Largest action, in units of the input [N m, or N of a cart].
    dt : float
        Time between measurements, for which the action is held [s].
    seconds : float
        Time [s] that half of all episodes must survive.
    delay : float
        Known delay [s] from a measurement to its action.
    lag : float
        Known time constant [s] of a motor that follows the command as a first-order system.

    Returns
    -------
    LeastAction

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, there is no unstable pole, poles are complex or coincide, or
        `seconds` are too few for the fastest one; or if its growth in `dt` and `delay` overflows.

    Notes
    -----
    If noise drives the command beyond the limit, the system may fall. Half of the episodes last for
    T = `seconds` if the deviation of u is sqrt(c) / k, with c the `return_level` and k^2 = 2 ln(T p
    / (pi ln 2)), p the fastest pole. For one pole and short steps this is Kramers' rate of escape:
    c is 2, and the barrier is half of that without saturation. For several poles it is a rule that
    agrees with simulations of the linear system.

    The system is followed in steps until it returns, which takes a time proportional to 1 / (dt p),
    with p the slowest pole: some seconds for 1 / (dt p) = 5000. `hardness` does so dozens of times.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, physics, theory
    >>> A, B = physics.linearise(Chain.uniform(1), np.pi)
    >>> round(theory.least_action(A, B, limit=4.905).noise, 3)  # rad
    0.189
    """
    seconds = _checks.positive_number("seconds", seconds)
    delay = _checks.nonnegative_number("delay", delay)
    try:
        with np.errstate(over="raise"):
            modes = _modes(a, b, limit, dt, lag)
            news = modes.news(delay)
        with np.errstate(over="raise", invalid="raise"):
            mean_square, level = modes.mean_square(news), modes.return_level(news)
    except (FloatingPointError, OverflowError) as error:
        raise ValueError(
            "dt and delay must be short enough for the growth of the unstable modes in them, which "
            f"overflows; got {_checks.show(dt)} and {delay:g} s"
        ) from error
    rate = float(modes.poles[-1]) / (math.pi * math.log(2.0))
    if seconds * rate < 2.0:
        raise ValueError(
            f"seconds must be {2.0 / rate:.3g} or more, in which the fastest mode grows, "
            f"got {seconds:g}"
        )
    noise = math.sqrt(level / (2.0 * math.log(seconds * rate) * mean_square))
    estimator = modes.from_modes @ modes.error_covariance() @ modes.outputs.T
    return LeastAction(mean_square, level, noise, modes.gain() @ modes.to_modes, estimator)


def _modes(a: ArrayLike, b: ArrayLike, limit: float, dt: float, lag: float) -> UnstableModes:
    """Return the unstable modes of a system whose arguments are checked."""
    limit, dt = _checks.positive_number("limit", limit), _checks.positive_number("dt", dt)
    lag = _checks.nonnegative_number("lag", lag)
    of_state, of_action = _square(a), _checks.array("b", b)
    if of_action.shape != (len(of_state), 1):
        raise ValueError(
            f"b must have the shape {(len(of_state), 1)}, as `linearise` returns it for one motor, "
            f"got {of_action.shape}"
        )
    return UnstableModes.of(of_state, of_action * limit, dt, lag)


def _square(a: ArrayLike) -> FloatArray:
    matrix = _checks.array("a", a)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or len(matrix) % 2 or not matrix.size:
        raise ValueError(f"a must have the shape (2m, 2m), m > 0, got {matrix.shape}")
    return matrix


def hardness(
    a: ArrayLike,
    b: ArrayLike,
    *,
    limit: float = 1.0,
    dt: float = 0.02,
    seconds: float = 20.0,
    share: float = 0.1,
) -> Hardness:
    r"""Return the sensors, motor and controller that a linearised chain needs to be kept upright.

    Parameters
    ----------
    a, b, limit, dt, seconds
        As for `least_action`.
    share : float
        Delay and lag are found at this share of the largest noise; between 0 and 1. A controller
        that knows them is limited only by the noise that they amplify.

    Returns
    -------
    Hardness

    Raises
    ------
    ValueError, TypeError
        As `least_action` does, or if `share` is not between 0 and 1, or so small that delay or lag
        overflow.

    Notes
    -----
    A feedback k x(t - T) leads to the roots of d(s) exp(s T) + k(s), where d has the poles of A and
    k any coefficients below the degree N of d. If all of them are stable, so are the roots of the
    N-th derivative, exp(s T) (T + d/ds)^N d(s). Its value at 0 is positive up to `static_delay`.
    For one rod that is sqrt(2) / p, where three roots meet at zero: J. Sieber and B. Krauskopf,
    *Extending the permissible control loop latency for the controlled inverted pendulum* (2004).

    The theorems behind other numbers: G. N. Nair, F. Fagnani, S. Zampieri and R. J. Evans,
    *Feedback control under data rate constraints: an overview*, Proceedings of the IEEE 95 (2007),
    for `bits_per_second`; N. Wan, D. Li and N. Hovakimyan, arXiv:1811.09884, for the integrals of
    Bode, and of Freudenberg and Looze.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, physics, theory
    >>> found = theory.hardness(*physics.linearise(Chain.uniform(2), np.pi), limit=14.715)
    >>> found.poles.round(4).tolist(), round(found.bits_per_second, 1)
    ([2.3972, 5.7874], 11.8)
    """
    if not 0.0 < (share := _checks.number("share", share)) < 1.0:
        raise ValueError(f"share must be between 0 and 1, got {share:g}")

    def noise(delay: float, lag: float) -> float:
        known = {"delay": delay, "lag": lag}
        return least_action(a, b, limit=limit, dt=dt, seconds=seconds, **known).noise

    largest, poles = noise(0.0, 0.0), _modes(a, b, limit, dt, 0.0).poles
    wanted, first = share * largest, 0.1 / float(poles[-1])
    try:
        delay = _root(lambda delay: math.log(noise(delay, 0.0) / wanted), first)
        lag = _root(lambda lag: math.log(noise(0.0, lag) / wanted), first)
    except ValueError as error:  # where it is not found for the largest noise
        raise ValueError(
            f"share must be larger, so that delay and lag do not overflow; got {share:g}"
        ) from error
    coefficients = np.asarray(np.poly(np.linalg.eigvals(_square(a))).real, np.float64)
    factorials = np.cumprod(np.maximum(np.arange(float(coefficients.size)), 1.0))
    taylor = (coefficients / factorials)[::-1]
    static = _root(lambda delay: float(np.polyval(taylor, delay)), 0.1 * first)
    return Hardness(poles, largest, delay, lag, static)


def _root(function: Callable[[float], float], step: float) -> float:
    """Return the first root of a function that is positive at zero, to a ten-thousandth."""
    low, high = 0.0, step
    while function(high) > 0.0:
        low, high = high, 1.25 * high
    return float(brentq(function, low, high, rtol=1e-4))
