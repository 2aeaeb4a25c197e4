"""Angular velocities from encoder angles, for controllers outside of environments."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray


class VelocityEstimator:
    """Estimate angular velocities from encoder angles.

    This is a fading-memory filter of degree 1. It fits a straight line to all angles so far by
    least squares. An angle of age t has the weight (1 + dt/T)^(-t/dt), nearly e^(-t/T). The
    estimate of a constant velocity is exact, also for unequal intervals. A change of the velocity
    appears 2 T + dt/2 late. A steady-state Kalman filter of an angle with white acceleration has
    the same form; here its two poles are equal.

    The filter uses sums, products and quotients only. The header of `npend_gym.export.to_c`
    therefore computes the same bits.

    Parameters
    ----------
    time_constant : float
        T [s], greater than zero. A longer one passes less noise and reacts later.
    period : float
        Range of a single-turn encoder [rad], 2 pi. The filter takes the shortest way to the next
        angle. Use 0 for the position of a cart.

    Attributes
    ----------
    theta : ndarray or None
        The filtered angles [rad], without the jumps of the encoder; None before the first call.
    omega : ndarray or None
        The estimated angular velocities [rad/s].

    Raises
    ------
    ValueError
        If the time constant is not greater than zero, or the period is less than zero.

    Examples
    --------
    >>> from npend_gym.rl import VelocityEstimator
    >>> estimator = VelocityEstimator(0.02)
    >>> for step in range(100):
    ...     omega = estimator([3.0 * 0.01 * step], 0.01)
    >>> omega.round(6).tolist()
    [3.0]
    """

    def __init__(self, time_constant: float, period: float = math.tau) -> None:
        self._time = _checks.positive_number("time_constant", time_constant)
        self._period = _checks.nonnegative_number("period", period)
        self.reset()

    def reset(self) -> None:
        """Begin again: the next angles are taken from a chain at rest."""
        self.theta: FloatArray | None = None
        self.omega: FloatArray | None = None

    def __call__(self, theta: ArrayLike, dt: float) -> FloatArray:
        """Return the angular velocities [rad/s].

        Parameters
        ----------
        theta : array_like
            The present angles [rad], of any shape, the same in every call.
        dt : float
            Time since the call before [s], by the clock of the controller. The first call does
            not use it.

        Returns
        -------
        ndarray, shape of `theta`
            Zero at the first call.

        Raises
        ------
        ValueError
            If the shape is another than before, or `dt` is not greater than zero.
        """
        shown, dt = _checks.array("theta", theta), _checks.positive_number("dt", dt)
        if self.theta is None or self.omega is None:
            self.theta, self.omega = shown, np.zeros_like(shown)
            return self.omega.copy()
        if shown.shape != self.theta.shape:
            raise ValueError(
                f"theta must have the shape {self.theta.shape} of the last call, "
                f"got {shown.shape}: call reset() before another pendulum is measured"
            )
        self.theta += dt * self.omega
        error = shown - self.theta
        if self._period > 0.0:
            error -= self._period * np.floor(error / self._period + 0.5)
        share = dt / (self._time + dt)
        self.theta += share * (2.0 - share) * error
        self.omega += share / (self._time + dt) * error
        return self.omega.copy()
