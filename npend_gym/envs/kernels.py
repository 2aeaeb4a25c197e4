"""One step of the environments in one compiled call: actions, physics, and what is told of it.

Actions become torques, `advance_group` of the physics moves the chains, and the new state becomes
observations, the quantities that modes judge by, and the numbers of the info.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import NumbersOf, bare, packs
from npend_gym.compiled.jit import inlined_kernel, kernel, spliced_kernel
from npend_gym.compiled.packs import WIDTH, any_of, where
from npend_gym.compiled.sincos import ROUND
from npend_gym.physics.kernels.dynamics import energies
from npend_gym.physics.kernels.ensemble import advance_group, bob_velocities
from npend_gym.physics.kernels.layout import (
    Group,
    Member,
    Model,
    Rod,
    Scratch,
    Timing,
    group_of,
)

ObsArray = NDArray[np.float32]

_PI, _TWO_PI, _INVERSE_TWO_PI = math.pi, 2.0 * math.pi, 0.5 / math.pi
_PI_32 = np.float32(np.pi)


class EpisodeFields(NamedTuple):
    """Rows of the ensemble's `members` that belong to the environments."""

    START_ENERGY: int = len(Member)  # J, at the start of the episode
    MEAN_SQUARED_ACTION: int = len(Member) + 1  # of the last step, 0 to 1
    STARTING: int = len(Member) + 2  # 1 where an episode starts, for a call that only observes
    OBSERVED: int = len(Member) + 3  # 1 where such a call is to write
    MAX_TORQUE: int = len(Member) + 4  # N m of the action 1
    MOTORS: int = len(Member) + 5  # number of actuated joints, at least 1
    PER_ENERGY: int = len(Member) + 6  # 1/J, of the energy that lifts the chain upright
    PER_LENGTH: int = len(Member) + 7  # 1/m, of the chain's length
    PER_LIFT: int = (
        len(Member) + 8
    )  # 1/(kg m): height of the centre of mass over sum carried * (1-cos)


Episode = EpisodeFields()


EPISODE_ROWS = len(Episode)


class OutputFields(NamedTuple):
    """Rows of `quantities`, an entry for each lane: first what a mode judges by."""

    HEIGHT: int = 0
    TIP: int = 1
    ENERGY: int = 2
    KINETIC_ENERGY: int = 3
    ENERGY_FRACTION: int = 4
    MEAN_SQUARED_ACTION: int = 5
    TIME: int = 6  # s
    ENERGY_JOULES: int = 7
    ENERGY_ERROR: int = 8
    PSEUDO_PERIOD: int = 9  # s
    TIP_HEIGHT: int = 10  # m
    COMPLETED: int = 11
    DIVERGED: int = 12


Output = OutputFields()


PERIODS, ANGLES, SPEEDS = range(3)  # blocks of `per_rod`, (lanes, n) each


@inlined_kernel
def _apply_actions(numbers: FloatArray, g: int, group: Group, actions: FloatArray) -> None:
    """Turn the actions of a group, one a joint, into torques; beyond +-1 they are clipped."""
    limit = numbers[Episode.MAX_TORQUE, g]
    squares = 0.0 * limit
    for j in range(group.torque.size):
        action = where(actions[j] > 1.0, 1.0, where(actions[j] < -1.0, -1.0, actions[j]))
        group.torque[j] = limit * action
        squares = squares + action * action
    numbers[Episode.MEAN_SQUARED_ACTION, g] = squares / numbers[Episode.MOTORS, g]


@inlined_kernel
def _judge(
    numbers: FloatArray, g: int, group: Group, scratch: FloatArray, quantities: FloatArray
) -> None:
    """Write the quantities of a group whose sines, cosines and velocities are known.

    The energy of lanes that start becomes that of the start.
    """
    s, c = scratch[Scratch.SIN], scratch[Scratch.COS]
    kinetic, lift, tip = energies(
        group.omega, group.carried, group.mass, group.velocity, group.chain, s, c
    )
    total = 0.0
    for i in range(group.velocity.size):
        period = group.record.period[i]
        total = total + where(period > 0.0, period, 0.0)
    energy = kinetic + group.chain.gravity[0] * lift
    start = where(numbers[Episode.STARTING, g] > 0.0, energy, numbers[Episode.START_ENERGY, g])
    numbers[Episode.START_ENERGY, g] = start
    scale = where(energy > start, energy, start)
    drift = (energy - start) - numbers[Member.WORK, g]
    per_energy, completed = numbers[Episode.PER_ENERGY, g], numbers[Member.COMPLETED, g]
    fraction = energy / where(start > 0.0, start, 1.0)
    quantities[Output.HEIGHT, g] = lift * numbers[Episode.PER_LIFT, g]
    quantities[Output.TIP, g] = tip * numbers[Episode.PER_LENGTH, g]
    quantities[Output.ENERGY, g] = energy * per_energy
    quantities[Output.KINETIC_ENERGY, g] = kinetic * per_energy
    quantities[Output.ENERGY_FRACTION, g] = where(start > 0.0, fraction, energy * per_energy)
    quantities[Output.MEAN_SQUARED_ACTION, g] = numbers[Episode.MEAN_SQUARED_ACTION, g]
    quantities[Output.TIME, g] = numbers[Member.TIME, g]
    quantities[Output.ENERGY_JOULES, g] = energy
    quantities[Output.ENERGY_ERROR, g] = drift / where(scale > 0.0, scale, 1.0)
    quantities[Output.PSEUDO_PERIOD, g] = total / where(completed > 0.0, completed, 1.0)
    quantities[Output.TIP_HEIGHT, g] = tip
    quantities[Output.COMPLETED, g] = completed
    quantities[Output.DIVERGED, g] = numbers[Member.DIVERGED, g]


@inlined_kernel
def _wrap(theta: FloatArray, wrapped: FloatArray) -> None:
    """Write the angles without whole turns, in [-pi, pi)."""
    for i in range(theta.size):
        turns = (theta[i] + _PI) * _INVERSE_TWO_PI
        whole = (turns + ROUND) - ROUND
        whole = where(whole > turns, whole - 1.0, whole)
        wrapped[i] = theta[i] - _TWO_PI * whole


@inlined_kernel
def _observe(
    rows: FloatArray, first: int, width: int, scratch: FloatArray, observation: ObsArray,
    per_rod: FloatArray,
) -> None:  # fmt: skip
    """Write observations, pseudo-periods, angles and speeds of a group, lane by lane.

    `rows` are the group's rows of the ensemble's `rods`, `first` is its first lane.
    """
    s, c, wrapped = scratch[Scratch.SIN], scratch[Scratch.COS], scratch[Scratch.WRAPPED]
    theta, omegas, period = rows[Rod.THETA], rows[Rod.OMEGA], rows[Rod.PERIOD]
    n = per_rod.shape[2]
    with_sines = observation.shape[1] == 3 * n
    for k in range(width):
        row, periods = observation[first + k], per_rod[PERIODS, first + k]
        angles, speeds = per_rod[ANGLES, first + k], per_rod[SPEEDS, first + k]
        for i in range(n):
            j = i * width + k
            omega = omegas[j]
            periods[i] = 0.0 if math.isnan(period[j]) else period[j]
            angles[i] = theta[j]
            speeds[i] = omega
            if with_sines:
                row[i] = s[j]
                row[n + i] = c[j]
                row[2 * n + i] = omega
            else:
                angle = np.float32(wrapped[j])
                row[i] = -_PI_32 if angle >= _PI_32 else angle  # float32 may round up to pi
                row[n + i] = omega


@spliced_kernel
def _step(
    view: NumbersOf, width: int, members: FloatArray, rods: FloatArray, model: Model,
    actions: FloatArray, outputs: tuple[ObsArray, FloatArray, FloatArray], timing: FloatArray,
    scratch: FloatArray,
) -> None:  # fmt: skip
    observation, quantities, per_rod = outputs
    numbers, work = view(members), view(scratch)
    observes = timing[Timing.SUBSTEPS] == 0.0
    for g in range(int(timing[Timing.FIRST_GROUP]), int(timing[Timing.LAST_GROUP])):
        group = group_of(numbers, view(rods), view(model), g)
        if observes:
            if not any_of(numbers[Episode.OBSERVED, g] > 0.0):
                continue
            bob_velocities(group, work[Scratch.SIN], work[Scratch.COS])
        else:
            if timing[Timing.FIRST_SUBSTEP] == 0.0:
                _apply_actions(numbers, g, group, view(actions)[g])
            advance_group(view, width, members, rods, timing, scratch, g, group)
        if timing[Timing.LAST_SUBSTEP] == timing[Timing.SUBSTEPS]:
            _judge(numbers, g, group, work, view(quantities))
            if observation.shape[1] == 2 * group.theta.size:
                _wrap(group.theta, work[Scratch.WRAPPED])
            _observe(rods[g], g * width, width, scratch, observation, per_rod)


@kernel
def step_one(
    members: FloatArray, rods: FloatArray, model: Model, actions: FloatArray,
    observation: ObsArray, quantities: FloatArray, per_rod: FloatArray, timing: FloatArray,
    scratch: FloatArray,
) -> None:  # fmt: skip
    """Take a step of one environment; see `step_many`."""
    outputs = bare(observation), bare(quantities), bare(per_rod)
    _step(
        bare, 1, bare(members), bare(rods), bare(model), bare(actions), outputs, bare(timing),
        bare(scratch),
    )  # fmt: skip


@kernel
def step_many(
    members: FloatArray, rods: FloatArray, model: Model, actions: FloatArray,
    observation: ObsArray, quantities: FloatArray, per_rod: FloatArray, timing: FloatArray,
    scratch: FloatArray,
) -> None:  # fmt: skip
    """Take a step of the active lanes, and write what is told of every lane.

    Parameters
    ----------
    members, rods, model, timing, scratch
        As for `npend_gym.physics.kernels.ensemble.advance_many`, `members` with the rows of
        `Episode`. With 0 substeps nothing moves: the call only observes, in the groups with a lane
        to be OBSERVED.
    actions : ndarray, shape (groups, n * width)
        Action at each joint; 0 at joints without a motor.
    observation : ndarray, float32, shape (lanes, 2n) or (lanes, 3n)
    quantities : ndarray, shape (len(Output), lanes)
    per_rod : ndarray, shape (3, lanes, n)
        Written: pseudo-periods (0.0 where not complete), angles, angular velocities.
    """
    outputs = bare(observation), bare(quantities), bare(per_rod)
    _step(
        packs, WIDTH, bare(members), bare(rods), bare(model), bare(actions), outputs,
        bare(timing), bare(scratch),
    )  # fmt: skip
