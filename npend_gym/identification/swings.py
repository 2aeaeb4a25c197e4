"""One pendulum's swings: period against amplitude, g or length, damping and Q, with errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.identification.motion import Motion, passes
from npend_gym.physics.arguments import warn_caller
from npend_gym.theory import pendulum_factor

_HARMONICS = 1, 3, 5  # of a swing, beside a decay in proportion to time
_DEGREES = math.pi / 180.0, 180.0 / math.pi  # times the angles: units that were mistaken
_BETTER = 3.0  # times smaller is the error of a period from amplitudes in their own unit
_QUICK, _SLOW = 0.05, 60.0  # s, of pendulums of 0.6 mm and 900 m
_EARTH, _FAR = 9.81, 1.1  # m/s^2, and the factor from which on a measured one is doubted
_ROWS = 2 * len(_HARMONICS) + 3  # of a swing, at least
_LEAST = 4  # swings, which determine a period, a decay and the errors of both


@dataclass(frozen=True, eq=False)
class Swings:
    """The results of `measure_swings`.

    Attributes
    ----------
    times, amplitudes, periods : ndarray, shape (S,)
        Middle [s], amplitude [rad] and period [s] of each swing.
    small_period, small_period_error : float
        Period of small swings [s]: each period divided by the elliptic integral of its amplitude.
    decay, decay_error : float
        Rate at which the amplitude decays, the gamma of exp(-gamma t) [1/s].
    quality, quality_error : float
        Q, pi over gamma times the period; infinite where nothing decays.
    gravity, gravity_error, length, length_error : float
        Acceleration of gravity [m/s^2], and distance from the pivot to the bob's centre [m]. The
        given one has the given error; NaN if neither was given.
    centre : float
        Middle of the swings [rad]: the zero of the sensor.
    """

    times: FloatArray
    amplitudes: FloatArray
    periods: FloatArray
    small_period: float
    small_period_error: float
    decay: float
    decay_error: float
    quality: float
    quality_error: float
    gravity: float
    gravity_error: float
    length: float
    length_error: float
    centre: float

    def as_dict(self) -> dict[str, Any]:
        """Return all numbers except the lists of swings; NaN and infinity become None."""
        numbers = {k: v for k, v in vars(self).items() if isinstance(v, float)}
        return {k: v if math.isfinite(v) else None for k, v in numbers.items()}


def measure_swings(
    motion: Motion,
    *,
    length: float | None = None,
    length_error: float = 0.0,
    radius: float = 0.0,
    gravity: float | None = None,
) -> Swings:
    """Measure one pendulum's period, decay, and g from its length, or its length from g.

    Parameters
    ----------
    motion : Motion
        Angles of one link that swings freely, as `read_motion` returns them.
    length : float, optional
        Distance from the pivot to the centre of the bob [m]; it gives g.
    length_error : float
        Standard error of the length [m].
    radius : float
        Radius of the bob, a solid ball on a thread without mass [m].
    gravity : float, optional
        Acceleration of gravity [m/s^2]; it gives the length.

    Returns
    -------
    Swings

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, there are several links or torques, or not four swings.

    Notes
    -----
    A swing lasts from one passage through its middle to the next. The instants of the passages are
    regressed on the sum of the elliptic factors, (2/pi) K(sin(A/2)) of amplitude A; the slope is
    the period of small swings. Its standard error is from the regression. Damping makes a period
    longer by the factor 1 + 1/(8 Q^2), which is divided out.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, simulate
    >>> from npend_gym.identification import measure_swings
    >>> from npend_gym.identification.motion import check_motion
    >>> times = np.arange(0.0, 20.0, 0.02)
    >>> theta = simulate(Chain([1.0], [0.8], gravity=9.81), 0.7, 0.0, times).theta
    >>> round(measure_swings(check_motion(times, theta), length=0.8).gravity, 3)
    9.81
    """
    if motion.links != 1 or motion.forced:
        got = f"{motion.links} links" if motion.links != 1 else "torques of a motor"
        got = "a pivot, or a cart, that moves" if motion.acceleration is not None else got
        raise ValueError(
            f"motion must be that of one pendulum without a motor, got {got}: `npend identify` "
            "fits chains, motors and carts"
        )
    if (length is not None) and (gravity is not None):
        raise ValueError("gravity must be left out with length: one gives the other")
    length = None if length is None else _checks.positive_number("length", length)
    gravity = None if gravity is None else _checks.positive_number("gravity", gravity)
    length_error = _checks.nonnegative_number("length_error", length_error)
    radius = _checks.nonnegative_number("radius", radius)
    if length is None and length_error > 0.0:
        raise ValueError(f"length_error must be left out without length, got {length_error:g}")
    if length is None and gravity is None and radius > 0.0:
        raise ValueError(f"radius must be left out without length or gravity, got {radius:g}")
    runs = [_swings_of(motion.times[rows], motion.theta[rows, 0]) for rows in motion.stretches()]
    runs = [run for run in runs if run[1].size]
    if sum(run[1].size for run in runs) < _LEAST:
        raise ValueError(
            f"motion must have {_LEAST} whole swings at least without a gap, none of which turns "
            f"over, each of {_ROWS} rows or more; are these degrees (--degrees), or counts of an "
            "encoder?"
        )
    times, amplitudes, periods = (np.concatenate([run[k] for run in runs]) for k in (1, 2, 3))
    period, period_error = _fit_period(runs)
    other = min((_fit_period(runs, size)[1], size) for size in _DEGREES)
    if other[0] * _BETTER < period_error:
        wrong, way = ("degrees", "--degrees") if other[1] < 1.0 else ("radians", "no --degrees")
        warn_caller(
            f"the periods depend on the amplitude as if the angles were {wrong}: give {way}; those "
            f"given reach {math.degrees(amplitudes.max()):.3g} degrees"
        )
    logs = [(run[1], np.log(run[2])) for run in runs if run[1].size > 1]
    slope, decay_error = _slope(logs) if logs else (math.nan, math.nan)
    decay = -slope
    quality = math.pi / (decay * period) if decay > 0.0 else math.inf
    period /= 1.0 + 1.0 / (8.0 * quality**2)
    if not _QUICK < period < _SLOW:
        warn_caller(f"a swing lasts {period:.3g} s: are times in seconds? milliseconds seem longer")
    square = (2.0 * math.pi / period) ** 2
    found, found_error, long, long_error = math.nan, math.nan, math.nan, math.nan
    if length is not None:
        reduced = length + 0.4 * radius**2 / length
        found, long, long_error = square * reduced, length, length_error
        by_length = square * (1.0 - 0.4 * radius**2 / length**2) * length_error
        found_error = math.hypot(2.0 * found * period_error / period, by_length)
    elif gravity is not None:
        reduced = gravity / square
        long = 0.5 * (reduced + math.sqrt(max(reduced**2 - 1.6 * radius**2, 0.0)))
        found, found_error, long_error = gravity, 0.0, 2.0 * reduced * period_error / period
    if radius >= long:
        raise ValueError(
            f"radius must be less than the distance of the bob's centre, {long:.4g} m, got "
            f"{radius:g} m"
        )
    if length is not None and not 1.0 / _FAR < found / _EARTH < _FAR:
        warn_caller(
            f"gravity is about {_EARTH} m/s^2 on the Earth, but {found:.4g} m/s^2 follows from "
            f"the length {length:.4g} m: that must be from the pivot to the centre of a bob on "
            f"a thread, in metres; or times must be divided by {math.sqrt(_EARTH / found):.3g}"
        )
    return Swings(
        times=times, amplitudes=amplitudes, periods=periods, small_period=period,
        small_period_error=period_error, decay=decay, decay_error=decay_error, quality=quality,
        quality_error=quality * decay_error / decay if decay > 0.0 else math.nan, gravity=found,
        gravity_error=found_error, length=long, length_error=long_error,
        centre=float(np.mean(np.concatenate([run[4] for run in runs]))),
    )  # fmt: skip


def _fit_period(runs: Sequence[tuple[FloatArray, ...]], size: float = 1.0) -> tuple[float, float]:
    """Return the period of small swings and its standard error, for amplitudes times `size`."""
    if max(float(run[2].max()) for run in runs) * size >= math.pi:
        return math.nan, math.inf
    factors = [np.r_[0.0, np.cumsum(pendulum_factor(run[2] * size))] for run in runs]
    return _slope([(factor, run[0]) for factor, run in zip(factors, runs, strict=True)])


def _swings_of(times: FloatArray, theta: FloatArray) -> tuple[FloatArray, ...]:
    """Return passages (S + 1,), and middle, amplitude, period and centre of each swing (S,)."""
    centre, passed, found = float(np.median(theta)), theta[:0], list[tuple[float, ...]]()
    for _ in range(3):  # the middle between turning points is that of the swings
        passed = passes(times, theta - centre)
        found.clear()
        for first, last in zip(passed[:-1].tolist(), passed[1:].tolist(), strict=True):
            inside = (times >= first) & (times <= last)
            if inside.sum() < _ROWS:
                continue
            middle, size = _turning_points(times[inside], theta[inside], first, last)
            found.append((0.5 * (first + last), size, last - first, middle))
        if not found or max(one[1] for one in found) >= math.pi or len(found) < passed.size - 1:
            return tuple(np.empty(0) for _ in range(5))
        centre = float(np.mean([one[3] for one in found]))
    return passed, *np.array(found).T


def _turning_points(
    times: FloatArray, theta: FloatArray, first: float, last: float
) -> tuple[float, float]:
    """Return middle and amplitude of a swing, by harmonics that decay a little in it."""

    def columns(at: FloatArray) -> FloatArray:
        phase = 2.0 * math.pi * (at - first) / (last - first)
        waves = [f(k * phase) for k in _HARMONICS for f in (np.sin, np.cos)]
        decaying = (phase - math.pi) * np.sin(phase)
        return np.column_stack([np.ones_like(at), decaying, *waves])

    fitted = np.linalg.lstsq(columns(times), theta, rcond=None)[0]
    fitted[1] = 0.0  # of the amplitude in the middle
    curve = columns(np.linspace(first, last, 201)) @ fitted
    return float(fitted[0]), 0.5 * float(np.ptp(curve))


def _slope(runs: list[tuple[FloatArray, FloatArray]]) -> tuple[float, float]:
    """Return the common slope of lines through (x, y) of each run, and its standard error."""
    x, y = (np.concatenate([run[k] - run[k].mean() for run in runs]) for k in (0, 1))
    slope = float(x @ y / (x @ x))
    free = x.size - len(runs) - 1
    error = math.sqrt(float(np.sum((y - slope * x) ** 2)) / free / float(x @ x)) if free else 0.0
    return slope, error if free else math.nan
