"""Chaos: how a small change of the start grows along a motion, by tangent dynamics."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks, theory
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain, check_chain
from npend_gym.physics import mass_matrix, simulate
from npend_gym.physics.arguments import check_limits, check_settings
from npend_gym.physics.integration import check_times
from npend_gym.physics.replay import replay
from npend_gym.physics.sensitivities import carry, rods_of

STEP = 0.1  # between the instants of `Growth`, in radians of the fastest normal mode
_LONGEST = 0.5  # step, in the same; at an equilibrium the motion itself would allow any


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


def tangents(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike,
    times: ArrayLike,
    vectors: FloatArray,
    *,
    rtol: float = 1e-11,
    steps: int = 256,
) -> Iterator[tuple[slice, FloatArray]]:
    """Carry tangent vectors along a motion, exactly through the steps of the integrator.

    A vector takes O(n) operations a step. Between two iterations `vectors` stands at the end of the
    last step, where it may be normalised, or made orthogonal, in place.

    Parameters
    ----------
    chain : Chain
    theta, omega : array_like, shape (n,)
        The start [rad, rad/s]; one number stands for all rods.
    times : ndarray, shape (T,)
        Instants [s]; the motion starts at the first, which is not yielded.
    vectors : ndarray, shape (D, 2n)
        Changes of (theta, omega) at the start, float64; it is overwritten.
    rtol : float
        Relative tolerance of the motion's steps, in which the absolute one is a hundredth of it.
    steps : int
        Of the motion, in one iteration, at most.

    Yields
    ------
    slice, ndarray of shape (F, D, 2n)
        Which of the instants lie in the steps, and the vectors there.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.
    FloatingPointError
        If vectors outgrow all bounds in one iteration.
    """
    n = check_chain(chain).n
    state = np.concatenate([_checks.vector("theta", theta, n), _checks.vector("omega", omega, n)])
    check_limits(state[:n], state[n:])
    if vectors.ndim != 2 or vectors.shape[1] != 2 * n or vectors.dtype != np.float64:
        raise ValueError(
            f"vectors must be float64 of shape (D, {2 * n}), got {vectors.dtype} {vectors.shape}"
        )
    longest = _LONGEST / theory.fastest_frequency(chain)
    settings = check_settings("dop853", rtol, 0.01 * rtol, longest)
    instants, none = check_times(times, n), np.zeros(n)
    motion = replay("dop853", chain.repeated(1), state, instants, none, settings)
    return carry(motion, rods_of(motion), vectors, steps=_checks.count("steps", steps))


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
    step = STEP / theory.fastest_frequency(chain)
    count = int(np.ceil(duration / step))
    vectors = np.random.default_rng(chain.n).normal(size=(1, 2 * chain.n))
    vectors /= np.linalg.norm(vectors)
    times, logarithm, total = step * np.arange(count + 1.0), np.zeros(count + 1), 0.0
    for span, frames in tangents(chain, theta, omega, times, vectors):
        logarithm[span] = total + np.log(np.linalg.norm(frames[:, 0], axis=1))
        size = np.linalg.norm(vectors)
        total += float(np.log(size))
        vectors /= size
    return Growth(times[1:], logarithm[1:])


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
    path = simulate(chain, theta0, 0.5, [0.0, duration], rtol=1e-12, atol=1e-14)
    start, end = np.linalg.slogdet(mass_matrix(chain, path.theta))[1]
    growth, unit = end - start, np.eye(2 * chain.n)
    vectors = unit.copy()
    for _ in tangents(chain, theta0, 0.5, path.times, vectors, rtol=1e-12):
        growth += np.linalg.slogdet(vectors)[1]
        vectors[:] = unit
    return float(np.exp(growth) - 1.0)
