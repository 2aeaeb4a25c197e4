"""Many chains in one block of memory, and what is seen of them: energies, heights, observations.

The chains ("lanes") stand in groups: of WIDTH, worked on as packs, or of one where there is only
one chain. The last group is filled up with chains that hang at rest. The kernels are written for
`numbers`, which are packs or floats; no lane's result depends on the group it stands in.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.compiled.jit import inlined_kernel, kernel, spliced_kernel
from npend_gym.compiled.packs import WIDTH, NumbersOf, any_of, bare, packs, where
from npend_gym.compiled.sincos import ROUND, sincos
from npend_gym.physics.kernels.dynamics import WORK_ROWS, Rods
from npend_gym.physics.kernels.rk4 import STAGE_ROWS
from npend_gym.physics.kernels.turning import Turns

MAX_SPEED = 1e6  # rad/s; a chain beyond this, or beyond MAX_ANGLE, has diverged

# The block of memory has a row with an entry for every lane for each of these,
# s; J above rest; J by torque, damping and drag since then
TIME, START_ENERGY, WORK_DONE = range(3)
THRESHOLD = 3  # m/s, the speed above which a bob's direction counts
# 1 over length [1/m] and unit of energy [1/J]; height of the centre of mass over mass times length
PER_REACH, PER_UNIT, LIFT_SHARE = range(4, 7)
COMPLETED, EFFORT = 7, 8  # bobs whose pseudo-period is known; mean square of the actions
# 1 or 0: the state has left all bounds; the next step is to be taken; an episode starts
DIVERGED, ACTIVE, STARTING = range(9, 12)
LANE_ROWS = 12
# then, group after group, a row of the group's lanes for each rod (and joint) for each of these,
# the velocity being the bob's, horizontal, and CARRIED the mass carried times length,
THETA, OMEGA, VELOCITY, PERIOD, ORIENTATION, ZERO, SIGN, RISEN = range(8)
LENGTH, INVERSE_LENGTH, DAMPING, DRAG, QUADRATIC_DRAG, MASS, CARRIED = range(8, 15)
GRAVITY_AND_INVERSE_MASS = 15  # gravity, then the inverse masses at joints 0..n
# and at last, group after group, a row for each actuated joint: the action, torque over its limit.

# What is seen: for every lane what a mode judges by, then what only the info tells,
SEEN_HEIGHT, SEEN_TIP, SEEN_ENERGY, SEEN_KINETIC, SEEN_LEFT, SEEN_EFFORT = range(6)
SEEN_TIME, SEEN_JOULES, SEEN_DRIFT, SEEN_PERIOD, SEEN_TIP_METRES, SEEN_COMPLETED = range(6, 12)
SEEN_DIVERGED, SEEN_ROWS = 12, 13
# then pseudo-periods, theta and omega, each (lanes, n).

# Rows of the scratch of one group
SIN, COS, TORQUE, THETA_0, OMEGA_0, THETA_1, OMEGA_1, VELOCITY_1 = range(8)  # 0: at the step's,
SLOPE_1, SLOPE_2, ALPHA, MARKED, WRAPPED = range(8, 13)  # 1: at the substep's start, 2: at its end
LOST, SINCE, H = 13, 14, 15  # J that damping and drag have taken in the step; s, of the substep
STAGES, WORK, ROWS = 16, 16 + STAGE_ROWS, 16 + STAGE_ROWS + WORK_ROWS

_PI, _TWO_PI, _INVERSE_TWO_PI = math.pi, 2.0 * math.pi, 0.5 / math.pi
_PI_32 = np.float32(np.pi)


class Group(NamedTuple):
    """The state and the parameters of a group of chains of n rods, written in place."""

    theta: FloatArray  # (n,)
    omega: FloatArray  # (n,)
    velocity: FloatArray  # (n,)
    period: FloatArray  # (n,)
    orientation: FloatArray  # (n,)
    sign: FloatArray  # (n,)
    risen: FloatArray  # (n,)
    mass: FloatArray  # (n,)
    carried: FloatArray  # (n,)
    rods: Rods


def group_width(count: int) -> int:
    """Return how many lanes stand in a group, of `count` in all."""
    return 1 if count == 1 else WIDTH


def group_rows(n: int) -> int:
    """Return how many rows a group has."""
    return GRAVITY_AND_INVERSE_MASS * n + n + 2


def memory_sizes(lanes: int, n: int, actuated: int) -> tuple[int, int]:
    """Return how many floats the chains take, filled up to whole groups, and what is seen."""
    return lanes * (LANE_ROWS + group_rows(n) + actuated), lanes * (SEEN_ROWS + 3 * n)


def new_scratch(n: int, width: int) -> FloatArray:
    """Return the work space of one thread. Torques of joints that have no actuator stay zero."""
    return np.zeros((ROWS, (n + 2) * width))


@inlined_kernel
def any_positive(row: FloatArray) -> bool:
    """Return whether any lane of any entry is greater than zero; none may be less."""
    total = row[0]
    for i in range(1, row.size):
        total = total + row[i]
    return any_of(total > 0.0)


@inlined_kernel
def group_of(numbers: FloatArray, groups: int, g: int, n: int) -> Group:
    """Return the named parts of group `g`."""
    rows = GRAVITY_AND_INVERSE_MASS * n + n + 2
    first = LANE_ROWS * groups + g * rows
    part = numbers[first : first + rows]
    last = GRAVITY_AND_INVERSE_MASS * n
    drag = part[DRAG * n : (QUADRATIC_DRAG + 1) * n]
    rods = Rods(
        part[last + 1 :],
        part[LENGTH * n : (LENGTH + 1) * n],
        part[INVERSE_LENGTH * n : (INVERSE_LENGTH + 1) * n],
        part[DAMPING * n : (DAMPING + 1) * n],
        part[last : last + 1],
        drag if any_positive(drag) else part[:0],
        part[:0],
    )
    return Group(
        part[THETA * n : (THETA + 1) * n],
        part[OMEGA * n : (OMEGA + 1) * n],
        part[VELOCITY * n : (VELOCITY + 1) * n],
        part[PERIOD * n : (PERIOD + 1) * n],
        part[ORIENTATION * n : (ORIENTATION + 1) * n],
        part[SIGN * n : (SIGN + 1) * n],
        part[RISEN * n : (RISEN + 1) * n],
        part[MASS * n : (MASS + 1) * n],
        part[CARRIED * n : (CARRIED + 1) * n],
        rods,
    )


@inlined_kernel
def floats_of(floats: FloatArray, width: int, groups: int, g: int, n: int) -> FloatArray:
    """Return the rows of group `g` as floats: lane k of row r is entry r width + k."""
    rows = (GRAVITY_AND_INVERSE_MASS * n + n + 2) * width
    first = LANE_ROWS * groups * width + g * rows
    return floats[first : first + rows]


@inlined_kernel
def turns_of(part: FloatArray, n: int, width: int) -> Turns:
    """Return the turning points of the group whose floats are `part`."""
    size = n * width
    return Turns(
        part[PERIOD * size : (PERIOD + 1) * size],
        part[ORIENTATION * size : (ORIENTATION + 1) * size],
        part[SIGN * size : (SIGN + 1) * size],
        part[RISEN * size : (RISEN + 1) * size],
        part[ZERO * size : (ZERO + 1) * size],
        part[:0],
    )


@inlined_kernel
def bob_velocities(
    theta: FloatArray, omega: FloatArray, length: FloatArray, s: FloatArray, c: FloatArray,
    velocity: FloatArray,
) -> None:  # fmt: skip
    """Write sines, cosines and the horizontal velocity of every bob."""
    for i in range(theta.size):
        s[i], c[i] = sincos(theta[i])
    total = 0.0
    for i in range(theta.size):
        total = total + length[i] * (omega[i] * c[i])
        velocity[i] = total


@inlined_kernel
def describe_group(
    numbers: FloatArray, groups: int, g: int, n: int, group: Group, scratch: FloatArray,
    scalars: FloatArray,
) -> None:  # fmt: skip
    """Write the scalars of a group whose sines, cosines and velocities are known.

    The energy of lanes that start becomes that of the start.
    """
    s, c = scratch[SIN], scratch[COS]
    vertical = kinetic = lift = tip = total = 0.0
    for i in range(n):
        horizontal = group.velocity[i]
        vertical = vertical + group.rods.length[i] * (group.omega[i] * s[i])
        speed_squared = horizontal * horizontal + vertical * vertical
        kinetic = kinetic + (0.5 * group.mass[i]) * speed_squared
        # 1 - cos, without cancellation near the bottom
        near = (s[i] * s[i]) / (1.0 + where(c[i] > 0.0, c[i], 0.0))
        lift = lift + group.carried[i] * where(c[i] > 0.0, near, 1.0 - c[i])
        tip = tip - group.rods.length[i] * c[i]
        total = total + where(group.period[i] > 0.0, group.period[i], 0.0)
    energy = kinetic + group.rods.gravity[0] * lift
    starting = numbers[STARTING * groups + g] > 0.0
    start = where(starting, energy, numbers[START_ENERGY * groups + g])
    numbers[START_ENERGY * groups + g] = start
    scale = where(energy > start, energy, start)
    drift = (energy - start) - numbers[WORK_DONE * groups + g]
    per_unit, done = numbers[PER_UNIT * groups + g], numbers[COMPLETED * groups + g]
    scalars[SEEN_HEIGHT * groups + g] = lift * numbers[LIFT_SHARE * groups + g]
    scalars[SEEN_TIP * groups + g] = tip * numbers[PER_REACH * groups + g]
    scalars[SEEN_ENERGY * groups + g] = energy * per_unit
    scalars[SEEN_KINETIC * groups + g] = kinetic * per_unit
    left = energy / where(start > 0.0, start, 1.0)
    scalars[SEEN_LEFT * groups + g] = where(start > 0.0, left, energy * per_unit)
    scalars[SEEN_EFFORT * groups + g] = numbers[EFFORT * groups + g]
    scalars[SEEN_TIME * groups + g] = numbers[TIME * groups + g]
    scalars[SEEN_JOULES * groups + g] = energy
    scalars[SEEN_DRIFT * groups + g] = drift / where(scale > 0.0, scale, 1.0)
    scalars[SEEN_PERIOD * groups + g] = total / where(done > 0.0, done, 1.0)
    scalars[SEEN_TIP_METRES * groups + g] = tip
    scalars[SEEN_COMPLETED * groups + g] = done
    scalars[SEEN_DIVERGED * groups + g] = numbers[DIVERGED * groups + g]


@inlined_kernel
def hand_out(
    part: FloatArray, first: int, lanes: int, width: int, n: int, scratch: FloatArray,
    observation: NDArray[np.float32], per_rod: FloatArray,
) -> None:  # fmt: skip
    """Write pseudo-periods, angles, angular velocities and observation of a group, lane by lane."""
    s, c, wrapped = scratch[SIN], scratch[COS], scratch[WRAPPED]
    size = lanes * n
    for k in range(width):
        row = observation[first + k]
        with_sines = row.size == 3 * n
        at = (first + k) * n
        for i in range(n):
            j = i * width + k
            period = part[PERIOD * n * width + j]
            omega = part[OMEGA * n * width + j]
            per_rod[at + i] = 0.0 if math.isnan(period) else period
            per_rod[size + at + i] = part[THETA * n * width + j]
            per_rod[2 * size + at + i] = omega
            if with_sines:
                row[i] = s[j]
                row[n + i] = c[j]
                row[2 * n + i] = omega
            else:
                angle = np.float32(wrapped[j])
                row[i] = -_PI_32 if angle >= _PI_32 else angle  # float32 may round up to pi
                row[n + i] = omega


@inlined_kernel
def wrap(theta: FloatArray, wrapped: FloatArray) -> None:
    """Write the angles, whole turns taken off, in [-pi, pi)."""
    for i in range(theta.size):
        turns = (theta[i] + _PI) * _INVERSE_TWO_PI
        whole = (turns + ROUND) - ROUND
        whole = where(whole > turns, whole - 1.0, whole)
        wrapped[i] = theta[i] - _TWO_PI * whole


@spliced_kernel
def _describe(
    view: NumbersOf, width: int, floats: FloatArray, everything: bool, groups: int, n: int,
    observation: NDArray[np.float32], out: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    lanes = groups * width
    floats, observation, out, scratch = bare(floats), bare(observation), bare(out), bare(scratch)
    numbers, work = view(floats), view(scratch)
    scalars, per_rod = view(out[: SEEN_ROWS * lanes]), out[SEEN_ROWS * lanes :]
    for g in range(groups):
        if everything or any_of(numbers[STARTING * groups + g] > 0.0):
            group = group_of(numbers, groups, g, n)
            bob_velocities(
                group.theta, group.omega, group.rods.length, work[SIN], work[COS], group.velocity
            )
            describe_group(numbers, groups, g, n, group, work, scalars)
            wrap(group.theta, work[WRAPPED])
            part = floats_of(floats, width, groups, g, n)
            hand_out(part, g * width, lanes, width, n, scratch, observation, per_rod)


@kernel
def describe_one(
    floats: FloatArray, everything: bool, groups: int, n: int, observation: NDArray[np.float32],
    out: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Write what is seen of one chain into new arrays; see `describe_many`."""
    _describe(bare, 1, floats, everything, groups, n, observation, out, scratch)


@kernel
def describe_many(
    floats: FloatArray, everything: bool, groups: int, n: int, observation: NDArray[np.float32],
    out: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Write what is seen of `everything`, or of the groups in which a lane starts an episode.

    `observation` is (lanes, 2n) or (lanes, 3n), `out` and `scratch` are as in `memory_sizes` and
    `new_scratch`.
    """
    _describe(packs, WIDTH, floats, everything, groups, n, observation, out, scratch)
