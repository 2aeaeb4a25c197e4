"""Chaos: how a small change of the start grows along a motion, by tangent dynamics."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import theory
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.physics import linearise, mass_matrix, simulate

STEP = 0.1  # of the tangent equation, in radians of the fastest normal mode
_ENTRIES = 200_000  # of the matrices held at once: they stay in the processor's cache


@dataclass(frozen=True, eq=False)
class Growth:
    """How a small change of the start grows along a motion.

    Attributes
    ----------
    times : ndarray, shape (T,)
        Instants [s], the first being a step after the start.
    logarithm : ndarray, shape (T,)
        Logarithm of the length of the tangent vector, by that at the start.
    """

    times: FloatArray
    logarithm: FloatArray

    def exponent(self, until: float = 1.0) -> float:
        """Return the largest Lyapunov exponent [1/s] as estimated at the fraction `until`."""
        k = max(1, round(until * self.times.size)) - 1
        return float(self.logarithm[k] / self.times[k])

    @property
    def rate(self) -> float:
        """Mean rate of growth [1/s] over the second half: ln 2 / (T/2) if growth is linear."""
        half = self.times.size // 2
        span = self.times[-1] - self.times[half - 1]
        return float((self.logarithm[-1] - self.logarithm[half - 1]) / span)

    @property
    def bound(self) -> float:
        """Rate [1/s] below which this run cannot tell chaos from the linear growth of order.

        Linear growth, with swings of a factor of 30 on top, over the second half.
        """
        return math.log(2.0 * 30.0) / (0.5 * float(self.times[-1]))

    @property
    def chaotic(self) -> bool:
        """Whether the growth is faster than a regular motion's."""
        return self.rate > self.bound


def propagators(chain: Chain, theta: FloatArray, omega: FloatArray, step: float) -> FloatArray:
    """Return the matrices that carry tangent vectors over each step of a motion.

    The variational equation V' = A(t) V is solved by RK4, with A from states half a step apart.

    Parameters
    ----------
    chain : Chain
    theta, omega : ndarray, shape (2 steps + 1, n)
        The motion at instants half a step apart.
    step : float
        [s]

    Returns
    -------
    ndarray, shape (steps, 2n, 2n)
    """
    a = linearise(chain, theta, omega).A
    start, middle, end = a[:-1:2], a[1::2], a[2::2]
    one = np.eye(2 * chain.n)
    k2 = middle @ (one + 0.5 * step * start)
    k3 = middle @ (one + 0.5 * step * k2)
    k4 = end @ (one + step * k3)
    return one + step / 6.0 * (start + 2.0 * (k2 + k3) + k4)


def tangent_growth(
    chain: Chain, theta: ArrayLike, omega: ArrayLike = 0.0, *, duration: float
) -> Growth:
    """Return the growth of a small change of the start along a motion.

    The motion comes from the error-controlled integrator; the tangent vector starts in a random
    direction, which is the same in every call.

    Parameters
    ----------
    chain : Chain
    theta, omega : array_like, shape (n,)
        The start [rad, rad/s]; one number stands for all rods.
    duration : float
        How long the motion is followed [s].
    """
    n = chain.n
    step = STEP / theory.fastest_frequency(chain)
    count = int(np.ceil(duration / step))
    vector = np.random.default_rng(n).normal(size=2 * n)
    vector /= np.linalg.norm(vector)
    logarithm, total = np.empty(count), 0.0
    chunk = min(1000, max(10, _ENTRIES // n**2))
    for first in range(0, count, chunk):
        steps = min(chunk, count - first)
        times = 0.5 * step * np.arange(2 * steps + 1)
        path = simulate(chain, theta, omega, times, rtol=1e-11, atol=1e-13)
        theta, omega = path.theta[-1], path.omega[-1]
        for k, matrix in enumerate(propagators(chain, path.theta, path.omega, step), first):
            vector = matrix @ vector
            size = float(np.linalg.norm(vector))
            vector /= size
            total += np.log(size)
            logarithm[k] = total
    return Growth(step * np.arange(1.0, count + 1.0), logarithm)


def neighbour_distance(
    chain: Chain, theta: ArrayLike, change: ArrayLike, times: ArrayLike
) -> FloatArray:
    """Return how far two releases from rest are apart, as tightly integrated as can be.

    Parameters
    ----------
    chain : Chain
    theta, change : array_like, shape (n,)
        Angles of the one start, and how much those of the other differ from them [rad].
    times : array_like, shape (T,)
        Instants [s].

    Returns
    -------
    ndarray, shape (T,)
        The largest difference of an angle [rad].
    """
    first, second = (
        simulate(chain, start, 0.0, times, rtol=1e-13, atol=1e-14).theta
        for start in (np.asarray(theta), theta + np.asarray(change))
    )
    return np.abs(second - first).max(axis=1)


def volume_change(chain: Chain, theta0: float = 1.0, duration: float = 2.0) -> float:
    """Return by how much volume in phase space changes along a motion, relatively.

    The determinant of the flow's derivative in (theta, omega), times that of the mass matrix at
    the end by that at the start: the volume in angles and momenta. The motion starts with all rods
    at `theta0` [rad] and 0.5 rad/s, and lasts `duration` [s].
    """
    steps = 8 * math.ceil(duration * theory.fastest_frequency(chain) / STEP)
    times = np.linspace(0.0, duration, 2 * steps + 1)
    path = simulate(chain, theta0, 0.5, times, rtol=1e-12, atol=1e-13)
    start, end = np.linalg.slogdet(mass_matrix(chain, path.theta[[0, -1]]))[1]
    matrices = propagators(chain, path.theta, path.omega, duration / steps)
    return float(np.exp(end - start + np.linalg.slogdet(matrices)[1].sum()) - 1.0)
