"""Many chains in one block of memory, and what is seen of them: energies, heights, observations.

Lanes are worked through in tiles that fit the cache. A tile's arrays are flat with the lane
innermost, as in `accelerations`; those of all lanes have a row per lane. No lane's result depends
on the tile it falls into.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.physics.kernels.dynamics import WORK_ROWS, Rods, copy
from npend_gym.physics.kernels.jit import inlined_kernel, kernel
from npend_gym.physics.kernels.rk4 import STAGE_ROWS
from npend_gym.physics.kernels.sincos import sincos
from npend_gym.physics.kernels.turning import Turns

TILE = 64  # lanes
MAX_SPEED = 1e6  # rad/s; a chain beyond this, or beyond MAX_ANGLE, has diverged
# Rows of `Seen.scalars`: what a mode judges by, then what only the info tells
HEIGHT, TIP, ENERGY, KINETIC, LEFT, EFFORT, TIME, JOULES, DRIFT, PERIOD = range(10)
TIP_METRES, COMPLETED, DIVERGED = range(10, 13)
SCALARS = 13
_PI, _TWO_PI, _INVERSE_TWO_PI = math.pi, 2.0 * math.pi, 0.5 / math.pi
_PI_32 = np.float32(np.pi)
# Rows of the scratch: the tile's state, then work space
THETA, OMEGA, TORQUE, THETA_0, OMEGA_0, SIN, COS = range(7)
VALUE_0, VALUE_1, SLOPE_0, SLOPE_1, ALPHA, DAMPING = range(7, 13)
WRAPPED = SLOPE_0  # and the rows after it: free once the turning points are found
STAGES, WORK, ROWS = 13, 13 + STAGE_ROWS, 13 + STAGE_ROWS + WORK_ROWS


class Lanes(NamedTuple):
    """The state and the parameters of B chains of n rods, written in place."""

    theta: FloatArray  # (B, n)
    omega: FloatArray  # (B, n)
    velocity: FloatArray  # horizontal, of every bob, m/s, (B, n)
    turns: Turns  # (B n,)
    rods: Rods  # tile after tile, each flat with the lane innermost
    mass: FloatArray  # likewise
    carried: FloatArray  # mass that hangs on a rod times its length, kg m, likewise
    time: FloatArray  # s, (B,)
    start_energy: FloatArray  # J above rest, (B,)
    work_done: FloatArray  # J, by torque and damping since the start, (B,)
    threshold: FloatArray  # speed above which a bob's direction counts, m/s, (B,)
    per_reach: FloatArray  # 1 over the length of the chain, 1/m, (B,)
    per_unit: FloatArray  # 1 over the unit of energy, 1/J, (B,)
    lift_share: FloatArray  # height of the centre of mass over the lifted mass times length, (B,)
    completed: NDArray[np.int64]  # bobs whose pseudo-period is known, (B,)
    diverged: NDArray[np.int64]  # 1 where the state has left all bounds, (B,)
    active: NDArray[np.int64]  # 1 where the next step is to be taken, (B,)
    action: FloatArray  # torque at the actuated joints over its limit, (B, J)
    joints: NDArray[np.int64]  # the actuated joints, (J,)


class Seen(NamedTuple):
    """What is seen of the lanes, written anew each time."""

    observation: NDArray[np.float32]  # (B, 2n) or (B, 3n)
    scalars: FloatArray  # (SCALARS, B)
    periods: FloatArray  # s, 0 where not known, (B, n)
    theta: FloatArray  # (B, n)
    omega: FloatArray  # (B, n)


def memory_sizes(count: int, n: int, actuated: int) -> tuple[int, int, int]:
    """Return the sizes of the floats and integers of `Lanes`, and of the floats of `Seen`."""
    return (
        count * (12 * n + 9 + actuated),
        count * (2 * n + 3) + actuated,
        count * (SCALARS + 3 * n),
    )


def new_scratch(n: int, count: int) -> FloatArray:
    """Return the work space of one thread, for tiles of up to TILE of `count` lanes."""
    return np.zeros((ROWS, (n + 2) * min(count, TILE)))


@inlined_kernel
def lanes_of(floats: FloatArray, integers: NDArray[np.int64], count: int, n: int) -> Lanes:
    """Return the named parts of two blocks of memory.

    Passing two arrays into compiled code takes microseconds less than passing all the parts.
    """
    m = count * n
    actuated = integers.size - 2 * m - 3 * count
    per_rod = floats[: 11 * m].reshape((11, m))
    inverse_mass = floats[11 * m : 12 * m + count]
    per_lane = floats[12 * m + count : 12 * m + 9 * count].reshape((8, count))
    action = floats[12 * m + 9 * count :].reshape((count, actuated))
    signs = integers[: 2 * m].reshape((2, m))
    counts = integers[2 * m : 2 * m + 3 * count].reshape((3, count))
    turns = Turns(per_rod[3], per_rod[4], signs[0], signs[1], per_rod[5], per_rod[5])
    rods = Rods(inverse_mass, per_rod[6], per_rod[7], per_rod[8], per_lane[0])
    return Lanes(
        per_rod[0].reshape((count, n)), per_rod[1].reshape((count, n)),
        per_rod[2].reshape((count, n)), turns, rods, per_rod[9], per_rod[10],
        per_lane[1], per_lane[2], per_lane[3], per_lane[4], per_lane[5], per_lane[6],
        per_lane[7], counts[0], counts[1], counts[2], action, integers[2 * m + 3 * count :],
    )  # fmt: skip


@inlined_kernel
def seen_of(observation: NDArray[np.float32], floats: FloatArray, count: int, n: int) -> Seen:
    """Return the named parts of a block of memory, see `lanes_of`."""
    m = count * n
    per_rod = floats[SCALARS * count :].reshape((3, m))
    return Seen(
        observation,
        floats[: SCALARS * count].reshape((SCALARS, count)),
        per_rod[0].reshape((count, n)),
        per_rod[1].reshape((count, n)),
        per_rod[2].reshape((count, n)),
    )


@kernel
def load(source: FloatArray, first: int, lanes: int, target: FloatArray) -> None:
    """Bring the tile's lanes of `source` (B, n) into the tile's order."""
    for k in range(lanes):
        for i in range(source.shape[1]):
            target[i * lanes + k] = source[first + k, i]


@kernel
def unload(source: FloatArray, first: int, lanes: int, target: FloatArray) -> None:
    """Bring a row of the tile back into its lanes of `target` (B, n)."""
    for k in range(lanes):
        row = target[first + k]
        for i in range(row.size):
            row[i] = source[i * lanes + k]


@kernel
def bob_velocities(
    theta: FloatArray, omega: FloatArray, length: FloatArray, lanes: int, s: FloatArray,
    c: FloatArray, value: FloatArray,
) -> None:  # fmt: skip
    """Write sines, cosines and the horizontal velocity of every bob."""
    for j in range(theta.size):
        s[j], c[j] = sincos(theta[j])
    for j in range(theta.size):
        value[j] = length[j] * (omega[j] * c[j])
    below = value[lanes:]
    for j in range(below.size):
        below[j] += value[j]


@kernel
def observe_tile(
    first: int, lanes: int, n: int, scratch: FloatArray, observation: NDArray[np.float32]
) -> None:
    """Write the observations of a tile."""
    omega, s, c = scratch[OMEGA], scratch[SIN], scratch[COS]
    if observation.shape[1] == 3 * n:
        for k in range(lanes):
            row = observation[first + k]
            for i in range(n):
                row[i] = s[i * lanes + k]
                row[n + i] = c[i * lanes + k]
                row[2 * n + i] = omega[i * lanes + k]
        return
    theta, wrapped = scratch[THETA], scratch[WRAPPED]
    for j in range(n * lanes):
        wrapped[j] = theta[j] - _TWO_PI * np.floor((theta[j] + _PI) * _INVERSE_TWO_PI)
    for k in range(lanes):
        row = observation[first + k]
        for i in range(n):
            angle = np.float32(wrapped[i * lanes + k])
            row[i] = -_PI_32 if angle >= _PI_32 else angle  # float32 may round up to pi
            row[n + i] = omega[i * lanes + k]


@inlined_kernel
def describe_tile(
    all_lanes: Lanes, marked: NDArray[np.int64], starting: bool, first: int, lanes: int,
    scratch: FloatArray, seen: Seen,
) -> None:  # fmt: skip
    """Write what is seen of a tile, its sines and cosines being known.

    If `starting`, the energy of the marked lanes becomes that of the start.
    """
    count, n = all_lanes.theta.shape
    end = n * lanes
    part = slice(first * n, first * n + end)
    omega, s, c = scratch[OMEGA], scratch[SIN], scratch[COS]
    length, mass = all_lanes.rods.length[part], all_lanes.mass[part]
    carried = all_lanes.carried[part]
    scalars, periods = seen.scalars, all_lanes.turns.period[part]
    shown = seen.periods.reshape(count * n)[part]
    for r in range(end):
        shown[r] = 0.0 if math.isnan(periods[r]) else periods[r]
    copy(all_lanes.theta.reshape(count * n)[part], seen.theta.reshape(count * n)[part])
    copy(all_lanes.omega.reshape(count * n)[part], seen.omega.reshape(count * n)[part])
    for k in range(lanes):
        lane = first + k
        vx = vy = kinetic = lift = tip = 0.0
        for j in range(k, end, lanes):
            vx += length[j] * (omega[j] * c[j])
            vy += length[j] * (omega[j] * s[j])
            kinetic += (0.5 * mass[j]) * (vx * vx + vy * vy)
            # 1 - cos, without cancellation near the bottom
            near = (s[j] * s[j]) / (1.0 + max(c[j], 0.0))
            lift += carried[j] * (near if c[j] > 0.0 else 1.0 - c[j])
            tip -= length[j] * c[j]
        energy = kinetic + all_lanes.rods.gravity[lane] * lift
        if starting and marked[lane] == 1:
            all_lanes.start_energy[lane] = energy
        start, per_unit = all_lanes.start_energy[lane], all_lanes.per_unit[lane]
        scale = max(energy, start)
        drift = (energy - start) - all_lanes.work_done[lane]
        scalars[HEIGHT, lane] = lift * all_lanes.lift_share[lane]
        scalars[TIP, lane] = tip * all_lanes.per_reach[lane]
        scalars[ENERGY, lane] = energy * per_unit
        scalars[KINETIC, lane] = kinetic * per_unit
        scalars[LEFT, lane] = energy / start if start > 0.0 else energy * per_unit
        scalars[TIME, lane] = all_lanes.time[lane]
        scalars[JOULES, lane] = energy
        scalars[DRIFT, lane] = drift / (scale if scale > 0.0 else 1.0)
        scalars[TIP_METRES, lane] = tip
        scalars[PERIOD, lane] = 0.0
        done = all_lanes.completed[lane]
        scalars[COMPLETED, lane], scalars[DIVERGED, lane] = done, all_lanes.diverged[lane]
        if done > 0:
            total = 0.0
            for i in range(n):
                total += shown[k * n + i]
            scalars[PERIOD, lane] = total / done


@kernel
def describe(
    floats: FloatArray, integers: NDArray[np.int64], starting: NDArray[np.int64],
    everything: bool, n: int, observation: NDArray[np.float32], out: FloatArray,
    scratch: FloatArray,
) -> None:  # fmt: skip
    """Write what is seen of lanes that start an episode, or of `everything`, into new arrays."""
    count = starting.size
    all_lanes, seen = lanes_of(floats, integers, count, n), seen_of(observation, out, count, n)
    theta, omega, s, c = scratch[THETA], scratch[OMEGA], scratch[SIN], scratch[COS]
    velocity = scratch[VALUE_1]
    for first in range(0, count, TILE):
        lanes = min(TILE, count - first)
        some = everything
        for lane in range(first, first + lanes):
            if starting[lane] == 1 or everything:
                some = True
                seen.scalars[EFFORT, lane] = 0.0
        if some:
            end = n * lanes
            load(all_lanes.theta, first, lanes, theta)
            load(all_lanes.omega, first, lanes, omega)
            length = all_lanes.rods.length[first * n :]
            bob_velocities(theta[:end], omega[:end], length, lanes, s, c, velocity[:end])
            unload(velocity, first, lanes, all_lanes.velocity)
            describe_tile(all_lanes, starting, True, first, lanes, scratch, seen)
            observe_tile(first, lanes, n, scratch, observation)
