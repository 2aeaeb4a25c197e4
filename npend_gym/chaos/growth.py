"""How a small change of the start grows along a motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain, check_chain
from npend_gym.chaos.variations import count_parts, motion_of, tangents
from npend_gym.physics import mass_matrix, simulate
from npend_gym.physics.mechanism import in_frame_of_pivot
from npend_gym.physics.motion import Integration
from npend_gym.physics.sensitivities import carry
from npend_gym.physics.substeps import fastest_rate

STEP = 0.1  # between the instants of `Growth`, in radians of the fastest normal mode


@dataclass(frozen=True, eq=False)
class Growth:
    """How a small change of the start grows along a motion.

    Attributes
    ----------
    times : ndarray, shape (T,)
        Instants [s], the first being a step after the start; the last is the duration.
    logarithm : ndarray, shape (T,)
        Logarithm of the length of the tangent vector, divided by its length at the start.
    """

    times: FloatArray
    logarithm: FloatArray

    def exponent(self, until: float = 1.0) -> float:
        """Return the largest Lyapunov exponent [1/s] as estimated at the fraction `until`."""
        if not 0.0 <= (until := _checks.number("until", until)) <= 1.0:
            raise ValueError(f"until must be between 0 and 1, got {until:g}")
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
        """Rate [1/s] below which this run cannot tell chaos from linear, regular growth.

        Linear growth, with swings of a factor of 30 on top, over the second half.
        """
        return math.log(2.0 * 30.0) / (0.5 * float(self.times[-1]))

    def onset(self, rate: float = 0.3, share: float = 0.02) -> float | None:
        """Return when fast growth begins [s]: at `rate` [1/s] and more over a `share` of the run.

        None if it does not begin. The time depends on both arguments: it is a property of this run
        and not of the motion.

        Raises
        ------
        TypeError, ValueError
            If `rate` is not a number, or `share` is not a number between 0 and 1.
        """
        rate = _checks.number("rate", rate)
        if not 0.0 <= (share := _checks.number("share", share)) <= 1.0:
            raise ValueError(f"share must be between 0 and 1, got {share:g}")
        window = max(1, min(round(share * self.times.size), self.times.size - 1))
        rates = (self.logarithm[window:] - self.logarithm[:-window]) / (
            self.times[window:] - self.times[:-window]
        )
        fast = np.flatnonzero(rates > rate)
        return float(self.times[fast[0]]) if fast.size else None

    def rate_after(self, start: float | None) -> float:
        """Return the mean rate of growth [1/s] from the time `start` [s] on; None: of all.

        Raises
        ------
        TypeError, ValueError
            If `start` is not a time between 0 and the duration.
        """
        last, end = self.times.size - 1, float(self.times[-1])
        if start is not None and not 0.0 <= (start := _checks.number("start", start)) <= end:
            raise ValueError(
                f"start must be between 0 and the duration of the run, {end:g} s, got {start:g}"
            )
        k = 0 if start is None else min(int(np.searchsorted(self.times, start)), last - 1)
        span = float(self.times[-1] - self.times[k])
        return float((self.logarithm[-1] - self.logarithm[k]) / span)

    @property
    def chaotic(self) -> bool:
        """Whether the growth is faster than a regular motion's."""
        return self.rate > self.bound


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
        How long the motion is followed [s]: two steps of `STEP` at least.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.

    Examples
    --------
    >>> from npend_gym import Chain, chaos
    >>> growth = chaos.tangent_growth(Chain.uniform(2), [2.0, 2.0], duration=10.0)
    >>> bool(growth.logarithm[-1] > 0.0)
    True
    """
    return Growth(*log_growth(chain, motion_of(chain, theta, omega), duration))


def log_growth(
    chain: Chain,
    motion: Integration,
    duration: float,
    rate: float | None = 1.0,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
    least: int = 2,
) -> tuple[FloatArray, FloatArray]:
    """Return instants [s], and the logarithm of a tangent vector's length there, (T,) each.

    Its length is that of (theta, omega / rate), 1 at the start, lengths counted in mean rods;
    without a `rate` it is that of the fastest mode. The vector leaves a pivot that is moved where
    it is. `progress` wraps the iteration over hundredths of the duration, for which the `motion` of
    the chain is followed. A duration of fewer than `least` steps raises a ValueError.
    """
    felt = in_frame_of_pivot(chain, motion.mechanism.pivot_acceleration)
    count, step = count_parts(felt, duration, STEP), STEP / fastest_rate(felt)
    if count < least:
        raise ValueError(
            f"duration must be at least {least * step:g} s for this chain, got {duration:g}"
        )
    rate = fastest_rate(felt) if rate is None else rate
    m = motion.mechanism.size
    # lengths by that of a rod, so that they compare with angles
    units = np.where(np.arange(m) < chain.n, 1.0, 1.0 / float(chain.lengths.mean()))
    scale = np.concatenate([units, units / rate])
    vectors = np.random.default_rng(chain.n).normal(size=(1, 2 * m))
    if motion.mechanism.pivot_acceleration is not None:
        vectors.reshape(2, m)[:, chain.n : chain.n + 2] = 0.0
    vectors /= np.linalg.norm(vectors)
    vectors /= scale
    times, logarithm, total = step * np.arange(count + 1.0), np.zeros(count + 1), 0.0
    times[-1] = duration
    carried, done = carry(motion, times, vectors), 0
    for mark in progress([count * k // 100 for k in range(1, 101)]):
        while done < mark:
            span, frames, _ = next(carried)
            logarithm[span] = total + np.log(np.linalg.norm(frames[:, 0] * scale, axis=1))
            size, done = np.linalg.norm(vectors * scale), span.stop - 1
            total += float(np.log(size))
            vectors /= size
    return times[1:], logarithm[1:]


def neighbour_distance(
    chain: Chain, theta: ArrayLike, change: ArrayLike, times: ArrayLike
) -> FloatArray:
    """Return the distance of two releases from rest, integrated as tightly as possible.

    Parameters
    ----------
    chain : Chain
    theta, change : array_like, shape (n,)
        Angles of the first start, and the change that gives the second start [rad].
    times : array_like, shape (T,)
        Instants [s], increasing; both releases happen at the first of them.

    Returns
    -------
    ndarray, shape (T,)
        The largest difference of an angle [rad].

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, chaos
    >>> times = np.linspace(0.0, 5.0, 6)
    >>> apart = chaos.neighbour_distance(Chain.uniform(2), [2.0, 2.0], 1e-9, times)
    >>> apart.shape
    (6,)
    """
    n = check_chain(chain).n
    start, apart = _checks.vector("theta", theta, n), _checks.vector("change", change, n)
    first, second = (
        simulate(chain, each, 0.0, times, rtol=1e-13, atol=1e-14).theta
        for each in (start, start + apart)
    )
    return np.abs(second - first).max(axis=1)


def volume_change(chain: Chain, theta0: float = 1.0, duration: float = 2.0) -> float:
    """Return the relative change of a volume in phase space along a motion.

    This is the volume in angles and momenta: the determinant of the flow's derivative in (theta,
    omega), times the ratio of the mass matrix's determinants at the end and at the start. The
    motion starts with all rods at `theta0` [rad] and 0.5 rad/s, and lasts `duration` [s].

    Examples
    --------
    >>> from npend_gym import Chain, chaos
    >>> abs(chaos.volume_change(Chain.uniform(2))) < 1e-6  # Liouville: none without damping
    True
    """
    path = simulate(chain, theta0, 0.5, [0.0, duration], rtol=1e-12, atol=1e-14)
    masses = mass_matrix(chain, path.theta, stretch=path.stretch)
    start, end = np.linalg.slogdet(masses)[1]
    growth, unit = end - start, np.eye(2 * chain.coordinates)
    vectors = unit.copy()
    for _ in tangents(chain, theta0, 0.5, path.times, vectors, rtol=1e-12):
        growth += np.linalg.slogdet(vectors)[1]
        vectors[:] = unit
    return float(np.exp(growth) - 1.0)
