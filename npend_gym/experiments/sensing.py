"""A release as a sensor shows it: samples with noise, a shifted zero and a wrong scale."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._streams import Purpose
from npend_gym.chain import Chain
from npend_gym.compiled.normal import make_normal
from npend_gym.compiled.philox import generator
from npend_gym.period import CODES, codes_of, distances, orientation, slowest_period
from npend_gym.physics import Trajectory, simulate
from npend_gym.physics.energy import sincos
from npend_gym.physics.kernels.turning_points import speed_threshold

_WINDOWS = 2.0, 10.0  # fundamental periods: most bobs complete in the first, none after the second
_DEVIATIONS = 5.0  # of the noise: below it the sign of a sample does not count
_MOST_SAMPLES = 20_000_000  # of all bobs in one release: 160 MB


class Sensor(NamedTuple):
    """What shows the signal of a definition, with its errors.

    Of a signal s it shows scale * s + offset + noise.
    """

    interval: float  # s, between two samples; the first is at the release
    noise: float = 0.0  # standard deviation, in the unit of the signal
    offset: float = 0.0
    scale: float = 1.0

    @property
    def is_ideal(self) -> bool:
        """Whether it shows what is there, but for the samples."""
        return self.noise == 0.0 and self.offset == 0.0 and self.scale == 1.0

    def check(self) -> None:
        """Refuse errors that no sensor has, or that lack the time between samples."""
        interval = _checks.nonnegative_number("sensor_interval", self.interval)
        _checks.nonnegative_number("sensor_noise", self.noise)
        _checks.number("sensor_offset", self.offset)
        _checks.positive_number("sensor_scale", self.scale)
        if interval == 0.0 and not self.is_ideal:
            raise ValueError(
                "sensor_interval must be given with sensor_noise, sensor_offset or sensor_scale, "
                "because a sensor has samples, such as one every 0.01 s; got 0"
            )


def sensed_periods(
    chain: Chain, start: float, definition: str, sensor: Sensor, duration: float | None, seed: int
) -> FloatArray:
    """Return the pseudo-periods [s] that the samples of a sensor give, shape (n,).

    The chain is released from rest, with all rods at `start` [rad]. Definition and duration are
    those of `npend_gym.pseudo_periods`; for "com" all entries are the same. `seed` is that of the
    noise.
    """
    n, periods = chain.n, np.full(chain.n, math.nan)
    if chain.gravity == 0.0:
        return periods
    if duration is None:
        slowest = slowest_period(chain.hung())
        windows = [one * slowest for one in _WINDOWS]
    else:
        windows = [duration]
    for window in windows:
        if window / sensor.interval * n > _MOST_SAMPLES:
            raise ValueError(
                f"a release must give at most {_MOST_SAMPLES} samples, got one of {n} bobs every "
                f"{sensor.interval:g} s for {window:.3g} s; take a longer sensor_interval or a "
                "shorter duration"
            )
        times: FloatArray = sensor.interval * np.arange(math.floor(window / sensor.interval) + 1.0)
        motion = simulate(chain, start, 0.0, times)
        signal = signals(motion, definition)
        shown = _shown(motion, signal, definition, sensor, seed)
        threshold = max(sensor.scale * _least(chain, definition), _DEVIATIONS * sensor.noise)
        code = int(codes_of(chain, motion.theta[0], definition))
        sides = np.sign(orientation(chain, motion.theta[0], code))
        if definition == "height":  # a bob that first rises is back on its way down
            first = np.argmax(np.abs(signal) > threshold / sensor.scale, axis=0)
            sides = np.where(signal[first, np.arange(n)] > 0.0, -1.0, 1.0)
        periods[:] = [  # one for all bobs, where the definition is that of the chain
            _completed(crossings(times, side * one, threshold), definition)
            for side, one in zip(sides, shown.T, strict=True)
        ]
        if np.all(np.isfinite(periods)):
            break
    return periods


def signals(motion: Trajectory, definition: str) -> FloatArray:
    """Return the signal of every bob whose changes of sign a definition counts, shape (T, n).

    That is the bob's horizontal velocity [m/s], its rod's angular velocity [rad/s], or its height
    above the start [m]. For "com" it is the horizontal velocity of the centre of mass [m/s],
    shape (T, 1). From a start beyond 90 degrees velocities around the pivot replace horizontal
    ones, see `npend_gym.pseudo_periods`.
    """
    chain, code = motion.chain, int(codes_of(motion.chain, motion.theta[0], definition))
    if code != CODES[definition]:
        places, velocities = motion.positions(), motion.velocities()
        if definition == "com":
            shares = (chain.lift / chain.lengths)[:, None] / chain.masses.sum()
            ends = (np.diff(each, axis=1, prepend=0.0) for each in (places, velocities))
            places, velocities = ((shares * each).sum(axis=1, keepdims=True) for each in ends)
        turned = places[..., 0] * velocities[..., 1] - places[..., 1] * velocities[..., 0]
        return turned / distances(chain, code)
    if definition in ("bob", "horizontal"):
        return motion.velocities()[..., 0]
    if definition == "link":
        return motion.omega
    if definition == "height":
        height = motion.positions()[..., 1]
        return height - height[0]
    if chain.stiffness is None:
        momentum = (sincos(motion.theta)[1] * motion.omega) @ chain.lift
    else:
        momentum = motion.velocities()[..., 0] @ chain.masses
    return momentum[:, None] / chain.masses.sum()


def _shown(
    motion: Trajectory, signal: FloatArray, definition: str, sensor: Sensor, seed: int
) -> FloatArray:
    """Reading of the sensor for a motion; a height is measured from where the bob rests."""
    hanging, chain = 0.0, motion.chain
    if definition == "height":
        lengths = chain.lengths
        if chain.stiffness is not None:
            lengths = lengths + chain.gravity * chain.carried_masses / chain.stiffness
        lengths = np.where(chain.lift < 0.0, -lengths, lengths)  # a link that rests upright
        hanging = -np.cumsum(lengths) - motion.positions()[0, :, 1]
    shown = sensor.scale * (signal - hanging) + hanging + sensor.offset
    if sensor.noise == 0.0:
        return shown
    pairs = -(-signal.shape[1] // 2)
    units = generator(seed, chain.n, Purpose.SENSOR, 0).random((len(signal), 2, pairs))
    first, second = np.ascontiguousarray(units.transpose(1, 0, 2))
    make_normal(first.reshape(-1), second.reshape(-1))
    return shown + sensor.noise * np.hstack([first, second])[:, : signal.shape[1]]


def _least(chain: Chain, definition: str) -> float:
    """Return the size above which a sign counts without noise, as `npend_gym.pseudo_periods`."""
    mean = float(chain.lengths.mean())
    if definition == "height":
        return 1e-9 * chain.total_length
    rate = float(speed_threshold(math.sqrt(chain.gravity / mean), 0.0))
    return rate if definition == "link" else rate * mean


def crossings(times: FloatArray, shown: FloatArray, threshold: float) -> list[tuple[float, float]]:
    """Return where samples cross zero: instants [s], and +1 for upwards, -1 for downwards.

    A sign counts once a sample has exceeded the threshold. A line is fitted to the samples from
    the last of one sign to the first of the other, and its zero is the instant. Where only these
    two are, that is linear interpolation.
    """
    counted = np.flatnonzero(np.abs(shown) > threshold)
    positive = shown[counted] > 0.0
    found: list[tuple[float, float]] = []
    for k in np.flatnonzero(positive[1:] != positive[:-1]).tolist():
        first, last = int(counted[k]), int(counted[k + 1])
        t, u = times[first : last + 1], shown[first : last + 1]
        away = t - t.mean()
        slope = float(away @ u / (away @ away))
        zero = float(t.mean() - u.mean() / slope) if slope != 0.0 else float(t.mean())
        found.append((min(max(zero, float(t[0])), float(t[-1])), 1.0 if positive[k + 1] else -1.0))
    return found


def _completed(found: list[tuple[float, float]], definition: str) -> float:
    """Return the crossing that completes a pseudo-period: downwards after one upwards.

    For "height" it is the first one upwards.
    """
    risen = False
    for instant, direction in found:
        if (direction > 0.0 and definition == "height") or (direction < 0.0 and risen):
            return instant
        risen = risen or direction > 0.0
    return math.nan
