"""Releases integrated until every bob has turned twice, many side by side in packs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from npend_gym._checks import FloatArray
from npend_gym._threads import Call
from npend_gym.chain import Chain, ChainParameters
from npend_gym.compiled.arrays import aligned_zeros, innermost
from npend_gym.compiled.packs import WIDTH
from npend_gym.physics.energy import centre_of_mass, positions, stretched
from npend_gym.physics.equations import assembled
from npend_gym.physics.kernels.releases import RELEASE_ROWS, Release
from npend_gym.physics.kernels.turning_points import (
    COM,
    HEIGHT,
    LINK,
    new_record,
    speed_threshold,
)
from npend_gym.physics.mechanism import in_frame_of_pivot
from npend_gym.physics.motion import Motion, pack_of, packs_of

_HEIGHT_TOLERANCE = 10.0  # times rtol times the chain's length: below it a height is the start's
_WORTH_A_PACK = 8  # releases; fewer are followed faster one by one


class Measurement(NamedTuple):
    """What is measured of releases, and how exactly."""

    reading: int  # BOB, LINK, HEIGHT or COM
    duration: float  # s; the release ends there, complete or not
    rtol: float
    pivot_acceleration: ArrayLike | None = None


def shares(count: int) -> list[slice]:
    """Return how `count` releases are shared out: packs, and the last few one by one."""
    last = count - count % WIDTH
    if count - last >= _WORTH_A_PACK:
        last = count
    return packs_of(last) + [slice(k, k + 1) for k in range(last, count)]


def measure(
    chain: Chain,
    theta: FloatArray,
    omega: FloatArray,
    measurement: Measurement,
    call: Call,
) -> FloatArray:
    """Return the pseudo-periods of one release, or of up to WIDTH side by side, (releases, n).

    For COM every bob has that of the chain.

    Raises
    ------
    IntegrationError
        If the integration cannot go on.
    """
    count, n = len(theta), chain.n
    lanes = 1 if count == 1 else WIDTH
    # lanes to spare repeat the last release
    theta, omega = (np.pad(x, ((0, lanes - count), (0, 0)), mode="edge") for x in (theta, omega))
    motion, release = _release(chain, theta, omega, measurement)
    motion.follow(0.0, measurement.duration, release, call)
    return np.broadcast_to(release.record.period.reshape(-1, lanes).T, (lanes, n))[:count]


def _release(
    chain: Chain,
    theta: FloatArray,
    omega: FloatArray,
    measurement: Measurement,
) -> tuple[Motion, Release]:
    """Return the motion from these states (lanes, n), and what is to be measured of it."""
    reading, _, rtol, accelerated = measurement
    lanes, n = len(theta), chain.n
    states = assembled(chain, theta, omega, np.zeros_like(theta), pivot_acceleration=accelerated)
    per_rod = theta
    rods: ChainParameters = chain.repeated(lanes)
    if chain.stiffness is not None:
        rods = stretched(chain, states.q[:, -n:])
        per_rod = -np.diff(positions(rods, theta)[..., 1], axis=1, prepend=0.0)
    if reading == COM:
        whole = chain.lengths * float(chain.masses.sum())
        per_rod = np.broadcast_to(chain.lift / whole, theta.shape)
    settings = {"rtol": rtol, "atol": 1e-2 * rtol}
    motion = pack_of(states, slice(0, lanes), settings, lanes)
    record = new_record(innermost(per_rod), innermost(_orientation(rods, theta, reading)))
    threshold = _threshold(in_frame_of_pivot(chain, accelerated), omega, reading, rtol)
    scratch = aligned_zeros(RELEASE_ROWS, n * lanes)
    return motion, Release(reading, threshold, record, scratch)


def _orientation(rods: ChainParameters, theta: FloatArray, reading: int) -> FloatArray:
    """Return +1 for rods released from positive angles (or from zero), -1 from negative ones.

    For COM (lanes, 1): for the side on which the centre of mass is.
    """
    if reading == HEIGHT:
        return np.ones_like(theta)
    if reading == COM:
        side = centre_of_mass(rods, theta)[..., :1]
    else:
        side = theta if reading == LINK else positions(rods, theta)[..., 0]
    return np.where(side < 0.0, -1.0, 1.0)


def _threshold(chain: Chain, omega: FloatArray, reading: int, rtol: float) -> FloatArray:
    """Return the size [rad/s, m/s or m] above which the sign of a signal counts, (lanes,)."""
    if reading == HEIGHT:
        return np.full(len(omega), _HEIGHT_TOLERANCE * rtol * chain.total_length)
    mean = float(chain.lengths.mean())
    rate = speed_threshold(np.sqrt(chain.gravity / mean), np.max(np.abs(omega), axis=1))
    return rate if reading == LINK else rate * mean
