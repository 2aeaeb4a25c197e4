"""Sections: the states in which a rod passes an angle, or once in a period of what drives it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain, check_chain
from npend_gym.chaos.variations import count_parts, motion_of, record
from npend_gym.physics import simulate
from npend_gym.physics.arguments import check_rtol, warn_caller
from npend_gym.physics.functions import takes_time_alone
from npend_gym.physics.integration import check_times
from npend_gym.physics.mechanism import AXIAL, PIVOT
from npend_gym.physics.motion import Integration
from npend_gym.physics.signals import Signal, TimeVarying

_PART = 10.0  # rad of the fastest mode, at least, in one simulation
_MOST = 10**7  # points of a section
_STEPS = 16  # of a period, at least: so no pulse is missed that lasts a sixtieth of it
_PHASES = np.sqrt(np.arange(2.0, 8.0)) % 1.0  # of a period, at which drives are compared
_ALIKE = 1e-3  # of their size: what a rounded period brings


@dataclass(frozen=True, eq=False)
class Section:
    """States of a motion: where a rod passes an angle, or once in a period of the drive.

    Attributes
    ----------
    times : ndarray, shape (K,)
        Instants [s].
    theta : ndarray, shape (K, n)
        Angles [rad] there, from -pi to below pi.
    omega : ndarray, shape (K, n)
        Angular velocities [rad/s] there.
    provenance : dict
        How it was made: versions and arguments.
    """

    times: FloatArray
    theta: FloatArray
    omega: FloatArray
    provenance: dict[str, Any]

    def period(self, tolerance: float = 1e-6) -> int | None:
        """Return the number of points after which the section repeats, or None.

        It is None if it would exceed half of the number of points. Angles and angular velocities
        repeat to the `tolerance` [rad, rad/s], whole turns aside. In a stroboscopic section it is
        the period of the attractor: 2 after a period doubling.
        """
        tolerance = _checks.positive_number("tolerance", tolerance)
        points = len(self.times)

        def near(first: Any, second: Any) -> Any:
            turned = 2.0 * np.abs(np.sin(0.5 * (self.theta[first] - self.theta[second])))
            faster = np.abs(self.omega[first] - self.omega[second])
            return np.all(np.maximum(turned, faster) <= tolerance, axis=-1)

        for k in 1 + np.flatnonzero(near(slice(1, points // 2 + 1), slice(1))):
            if np.all(near(slice(k, None), slice(points - k))):
                return int(k)
        return None


def poincare_section(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike = 0.0,
    *,
    duration: float,
    rod: int = 0,
    angle: float = 0.0,
    direction: int = 1,
    rtol: float = 1e-10,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
    torque: ArrayLike | TimeVarying | None = None,
    force: ArrayLike | TimeVarying = 0.0,
    pivot_acceleration: ArrayLike | TimeVarying | None = None,
) -> Section:
    """Return the states in which a rod passes an angle, whole turns aside, in one direction.

    Parameters
    ----------
    chain : Chain
    theta, omega : array_like, shape (n,)
        The start [rad, rad/s]; one number stands for all rods. It is no point of the section.
    duration : float
        How long the motion is followed [s].
    rod : int
        Rod that passes the angle, counted from 0 at the pivot; -1 is the last.
    angle : float
        Angle of the rod [rad], from the downward vertical.
    direction : {1, -1}
        1: the rod's angular velocity is positive there; -1: negative.
    rtol : float
        Relative tolerance of the motion's steps; the absolute tolerance is a hundredth of it.
    progress : callable
        Wraps the iteration over parts of the duration, for a progress bar.
    torque, force, pivot_acceleration : array_like, Signal or callable, optional
        What drives the chain, as in `simulate`.

    Returns
    -------
    Section

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, or the rod never passes the angle.
    IntegrationError
        If the motion diverges.

    Notes
    -----
    Points are events of `simulate`, located to 1e-12 s. Two passages within a quarter of a step may
    be missed, where a rod turns back just after the angle.

    For two rods with a given energy and one direction, the section is a plane. Regular motion draws
    curves there, and chaos fills areas (M. Henon and C. Heiles, Astron. J. 69, 1964).

    Examples
    --------
    >>> from npend_gym import Chain, chaos
    >>> section = chaos.poincare_section(Chain.uniform(2), [0.5, 0.5], duration=20.0)
    >>> section.theta.shape[1], bool(abs(section.theta[:, 0]).max() < 1e-8)
    (2, True)
    """
    n = check_chain(chain).n
    rod = _checks.count("rod", rod, low=-n, high=n - 1)
    angle = _checks.number("angle", angle)
    if direction not in (1, -1):
        raise ValueError(f"direction must be 1 or -1, got {_checks.show(direction)}")
    direction = int(direction)
    parts = min(100, count_parts(chain, duration, _PART))
    state = _checks.vector("theta", theta, n), _checks.vector("omega", omega, n)
    start = np.concatenate(state)
    drives = {"torque": torque, "force": force, "pivot_acceleration": pivot_acceleration}
    more: dict[str, Any] = {**drives}
    given = {"duration": float(duration), "rod": rod, "angle": angle, "direction": direction}
    given["rtol"] = check_rtol(rtol)
    event, times = _Passage(rod % n, angle, direction), np.linspace(0.0, duration, parts + 1)
    found: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    for part in progress(range(parts)):
        ends = times[part : part + 2]
        path = simulate(chain, *state, ends, events=event, rtol=rtol, atol=0.01 * rtol, **more)
        found.append((path.t_events[0], path.theta_events[0], path.omega_events[0]))
        state = path.theta[-1], path.omega[-1]
        others = {name: getattr(path, name) for name in (*PIVOT, *AXIAL)}
        more |= {name: each[-1] for name, each in others.items() if each is not None}
    instants, thetas, omegas = (np.concatenate(each) for each in zip(*found, strict=True))
    near = np.cos(thetas[:, rod] - angle) > 0.0  # half a turn away the sine is zero, too
    if not near.any():
        raise ValueError(
            f"rod {rod} does not pass the angle {angle:g} rad within {duration:g} s in the "
            f"direction {direction}: choose another angle, or follow the motion for longer"
        )
    made_by = record(chain, start, **given, **drives)
    return Section(instants[near], _wrapped(thetas[near]), omegas[near], made_by)


def stroboscopic_section(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike = 0.0,
    *,
    period: float,
    count: int,
    discard: int = 0,
    rtol: float = 1e-10,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
    torque: ArrayLike | TimeVarying | None = None,
    force: ArrayLike | TimeVarying = 0.0,
    pivot_acceleration: ArrayLike | TimeVarying | None = None,
) -> Section:
    """Return the states of a driven chain once per period of its drive.

    Parameters
    ----------
    chain : Chain
        A cart starts at rest, and springs with the tensions of rigid rods.
    theta, omega : array_like, shape (n,)
        The start [rad, rad/s]; one number stands for all rods. It is no point of the section.
    period : float
        Period of the drive [s].
    count : int
        Number of points, K.
    discard : int
        Number of periods before the first point, in which the motion approaches its attractor.
    rtol : float
        Relative tolerance of the motion's steps; the absolute tolerance is a hundredth of it.
    progress : callable
        Wraps the iteration over hundredths of the motion, for a progress bar.
    torque, force, pivot_acceleration : array_like, Signal or callable, optional
        What drives the chain, as in `simulate`; a function may depend on the state, too.

    Returns
    -------
    Section

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.
    IntegrationError
        If the motion diverges.

    Warns
    -----
    UserWarning
        If a function of time does not repeat after the period.

    Notes
    -----
    Points are the states at (discard + 1) T, ..., (discard + K) T, T being the period. No step is
    longer than T / 16. Periodic motion is a few points, see `Section.period`; quasi-periodic motion
    draws closed curves; chaos with damping draws a strange attractor (G. L. Baker and J. P. Gollub,
    Chaotic Dynamics, 1996).

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, chaos
    >>> chain = Chain.uniform(1, gravity=1.0, damping=0.5)
    >>> drive = {"period": 3.0 * np.pi, "torque": lambda t: 1.07 * np.cos(2.0 * t / 3.0)}
    >>> section = chaos.stroboscopic_section(chain, 0.2, count=8, discard=100, **drive)
    >>> section.theta.shape, section.period()
    ((8, 1), 2)
    """
    period = _checks.positive_number("period", period)
    count = _checks.count("count", count, high=_MOST)
    discard = _checks.count("discard", discard, low=0, high=_MOST)
    total, n = discard + count, check_chain(chain).n
    count_parts(chain, total * period, _PART, "(discard + count) * period")
    times = check_times(period * np.arange(total + 1.0), chain.coordinates)
    drives = {"torque": torque, "force": force, "pivot_acceleration": pivot_acceleration}
    longest = period / _STEPS
    motion = motion_of(chain, theta, omega, rtol, drives, times, longest=longest, alone=False)
    motion.mechanism.check_vibrations(float(times[-1]))
    if total > 1:  # what a function returns after the motion is nobody's concern
        _warn_of_period(motion, period)
    m, segments, done = motion.mechanism.size, motion.segments(times), 0
    states = np.empty((total + 1, 2 * m))
    for mark in progress([total * k // 100 for k in range(1, 101)]):
        while done < mark:
            segment = next(segments)
            states[segment.frames] = segment.states[0]
            done = segment.frames.stop - 1
    kept = slice(discard + 1, None)
    given = {"period": period, "count": count, "discard": discard, "rtol": check_rtol(rtol)}
    made_by = record(chain, motion.state, **given, **drives)
    theta, omega = _wrapped(states[kept, :n]), states[kept, m : m + n].copy()
    return Section(times[kept], theta, omega, made_by)


def _warn_of_period(motion: Integration, period: float) -> None:
    """Warn where a function of time differs after the period: points would look like chaos."""
    varying = motion.drives.varying
    if any(isinstance(each, Signal) or not takes_time_alone(each) for each in varying.values()):
        return
    times = period * np.append(_PHASES, 1.0 + _PHASES)
    states = np.tile(motion.state, (times.size, 1))
    first, second = np.split(motion.drives.at(times, *np.split(states, 2, axis=1)), 2)
    if np.abs(second - first).max() > _ALIKE * np.abs(first).max():
        warn_caller(
            f"{' and '.join(varying)} should repeat after the period, {period:g} s, but differs "
            "by more than a thousandth: a section of periodic motion then looks like chaos"
        )


def _wrapped(theta: FloatArray) -> FloatArray:
    """Return angles from -pi to below pi."""
    return (theta + np.pi) % (2.0 * np.pi) - np.pi


@dataclass(frozen=True)
class _Passage:
    """The event that a rod passes an angle, whole turns aside, or is half a turn away from it."""

    rod: int
    angle: float
    direction: int

    def __call__(self, _t: float, theta: FloatArray, _omega: FloatArray) -> float:
        """Return the sine of the angle that is left."""
        return float(np.sin(theta[self.rod] - self.angle))
