"""One step of the environments in one compiled call: actions, physics and results.

Actions become torques, and `advance_group` of the physics moves the chains. The new state becomes
observations, the quantities that modes judge by, and the numbers of the info.
"""

# ruff: noqa: ARG001  what measures, and what does not, share their parameters
from __future__ import annotations

import math
from typing import Any

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.compiled.arrays import NumbersOf, bare, packs
from npend_gym.compiled.jit import chosen_by_type, inlined_kernel, kernel, spliced_kernel
from npend_gym.compiled.packs import WIDTH, any_of, where
from npend_gym.compiled.philox import Keys
from npend_gym.envs.laws import law
from npend_gym.envs.modes import Mode, Quantities
from npend_gym.envs.motors import Commands, drive, mean_torque
from npend_gym.envs.observing import ObsArray, observe
from npend_gym.envs.rows import (
    NUMBER_OF,
    OF_LANE,
    Block,
    Episode,
    Flag,
    Output,
    Pose,
    Task,
    Wiring,
    first_row,
)
from npend_gym.physics.kernels.advance import advance_group, bob_velocities
from npend_gym.physics.kernels.dynamics import energies
from npend_gym.physics.kernels.layout import (
    Group,
    Member,
    Model,
    Rod,
    Scratch,
    Timing,
    Turns,
    group_of,
)
from npend_gym.physics.kernels.turning_points import Record

_first_row = inlined_kernel(first_row)


@inlined_kernel
def _approach(
    goal: FloatArray, g: int, group: Group, c: FloatArray, outputs: FloatArray
) -> tuple[Any, Any]:
    """Return closeness to the goal and distance from it; write the cosines of the angles."""
    n = group.velocity.size
    cosines = _first_row(Block.COSINES, n)
    distance = missed = size = 0.0 * c[0]
    for i in range(n):
        deviation, weight = abs(c[i] - goal[i]), abs(group.carried[i])
        distance = where(deviation > distance, deviation, distance)
        missed, size = missed + weight * deviation, size + weight
        outputs[cosines + i, g] = c[i]
    return 1.0 - 0.5 * (missed / size), distance


@inlined_kernel
def _no_periods(record: None, numbers: FloatArray, g: int, n: int, outputs: FloatArray) -> None:
    return


@inlined_kernel
def _periods(record: Record, numbers: FloatArray, g: int, n: int, outputs: FloatArray) -> None:
    total, first = 0.0, _first_row(Block.PSEUDO_PERIODS, n)
    for i in range(n):
        period = record.period[i]
        known = where(period > 0.0, period, 0.0)
        total = total + known
        outputs[first + i, g] = known
    completed, of_com = numbers[Member.COMPLETED, g], record.period[n]
    outputs[Output.BOBS_COMPLETED, g] = completed
    outputs[Output.PSEUDO_PERIOD, g] = total / where(completed > 0.0, completed, 1.0)
    outputs[Output.PSEUDO_PERIOD_COM, g] = where(of_com > 0.0, of_com, 0.0)
    outputs[Output.IDEAL_PERIOD, g] = numbers[Episode.IDEAL_PERIOD, g]


@chosen_by_type("record", {0: _no_periods, Record: _periods})
def _write_periods(
    record: Record | None, numbers: FloatArray, g: int, n: int, outputs: FloatArray
) -> None:
    """Write the pseudo-periods of a group of chains of `n` rods, where they are measured."""
    raise NotImplementedError


@inlined_kernel
def _measure(
    numbers: FloatArray, rows: FloatArray, g: int, group: Group, scratch: FloatArray,
    outputs: FloatArray, flags: BoolArray, task: FloatArray,
) -> Quantities[Any]:  # fmt: skip
    """Write and return the quantities of a group whose sines, cosines and velocities are known.

    The energy of sub-environments that start becomes that of the start.
    """
    s, c = scratch[Scratch.SIN], scratch[Scratch.COS]
    kinetic, lift, tip = energies(
        group.omega, group.carried, group.mass, group.velocity, group.chain, s, c
    )
    n = group.velocity.size
    _write_periods(group.record, numbers, g, n, outputs)
    theta, omega = _first_row(Block.THETA, n), _first_row(Block.OMEGA, n)
    for i in range(n):
        outputs[theta + i, g] = group.theta[i]
        outputs[omega + i, g] = group.omega[i]
    energy = kinetic + group.chain.gravity[0] * lift
    starts = numbers[Episode.STARTING, g] > 0.0
    start = where(starts, energy, numbers[Episode.START_ENERGY, g])
    numbers[Episode.START_ENERGY, g] = start
    squares = where(starts, 0.0, numbers[Episode.MEAN_SQUARED_ACTION, g])
    numbers[Episode.MEAN_SQUARED_ACTION, g] = squares
    scale = where(energy > start, energy, start)
    drift = (energy - start) - numbers[Member.WORK, g]
    per_energy = numbers[Episode.PER_ENERGY, g]
    share = energy / where(start > 0.0, start, 1.0)
    closeness = distance = place = pace = 0.0 * lift
    upright, reach = -c[0], rows[Rod.LENGTH][0] * s[0]
    for i in range(1, n):
        upright = where(-c[i] < upright, -c[i], upright)
        reach = reach + rows[Rod.LENGTH][i] * s[i]
    per_length = numbers[Episode.PER_LENGTH, g]
    high, reach = tip * per_length, reach * per_length
    away = math.sqrt(reach * reach + (1.0 - high) * (1.0 - high))
    if task[Task.RAIL] > 0.0:
        outputs[Output.CART_POSITION, g] = group.theta[n]
        outputs[Output.CART_VELOCITY, g] = group.omega[n]
        place, pace = group.theta[n] / task[Task.RAIL], group.omega[n]
    if task[Task.GOALS] > 0.0:
        closeness, distance = _approach(rows[Pose.GOAL], g, group, c, outputs)
    quantities = Quantities(
        lift * numbers[Episode.PER_LIFT, g], high,
        energy * per_energy, kinetic * per_energy,
        where(start > 0.0, share, energy * per_energy), squares, closeness, distance,
        place, upright, away, pace, group.theta, group.omega,
    )  # fmt: skip
    if task[Task.MODE] == 0.0 or task[Task.GOALS] > 0.0:
        judging = outputs[_first_row(Block.QUANTITIES, n) :]
        for row, quantity in enumerate(quantities[:OF_LANE]):
            judging[row, g] = quantity
    outputs[Output.TIME, g] = numbers[Member.TIME, g]
    outputs[Output.ENERGY, g] = energy
    outputs[Output.ENERGY_ERROR, g] = drift / where(scale > 0.0, scale, 1.0)
    outputs[Output.TIP_HEIGHT, g] = tip
    flags[Flag.DIVERGED, g] = numbers[Member.DIVERGED, g] > 0.0
    return quantities


@spliced_kernel
def _never(_: None, quantities: Quantities[Any]) -> Any:
    """Return False for each sub-environment."""
    return quantities.height != quantities.height


@spliced_kernel
def _no_mode(_: int, quantities: Quantities[Any]) -> tuple[Any, Any, Any]:
    """Reward, failure and success where Python judges: none of them."""
    no = _never(None, quantities)
    return 0.0 * quantities.height, no, no


def _dispatch(modes: list[type[Mode]]) -> Any:
    """Return a kernel: number of a mode, quantities -> reward, failed, achieved.

    Formulas are compiled as they stand, with None as their `self`. They are spliced: as functions,
    each would be compiled on its own first, for longer than the formula takes.
    """
    if not modes:
        return _no_mode
    first, others = modes[0], _dispatch(modes[1:])
    number, always_achieved = NUMBER_OF[first], first.achieved is Mode.achieved
    reward: Any = spliced_kernel(first.reward)
    failed: Any = _never if first.failed is Mode.failed else spliced_kernel(first.failed)
    achieved: Any = _never if always_achieved else spliced_kernel(first.achieved)

    @spliced_kernel
    def judge(mode: int, quantities: Quantities[Any]) -> tuple[Any, Any, Any]:
        if mode != number:
            return others(mode, quantities)
        has_failed = failed(None, quantities)
        # `Mode.achieved`: the goal is met unless the episode has failed
        unless = where(has_failed, 0.0, 1.0) > 0.0
        met = unless if always_achieved else achieved(None, quantities)
        return reward(None, quantities), has_failed, met

    return judge


_judged: Any = _dispatch(list(NUMBER_OF))


@law
def ruled(
    task: Any, rail_position: Any, uprightness: Any, reward: Any, failed: Any, achieved: Any
) -> tuple[Any, Any, Any]:
    """Reward, failure and success of a mode, changed by what holds in all modes.

    An episode terminates off the rail, and with `max_tilt` where a rod leans by more. The reward is
    smaller by the share `Mode.rail_weight` at the ends of the rail. With `reward_type` "sparse" it
    is the success.
    """
    if task[Task.RAIL] > 0.0:
        left = abs(rail_position) > 1.0
        factor = 1.0 - task[Task.RAIL_WEIGHT] * (rail_position * rail_position)
        reward = where(left, 0.0, reward * factor)
        achieved, failed = achieved & (abs(rail_position) <= 1.0), failed | left
    if task[Task.UPRIGHTNESS] >= -1.0:
        achieved = achieved & (uprightness >= task[Task.UPRIGHTNESS])
        failed = failed | (uprightness < task[Task.UPRIGHTNESS])
    if task[Task.SPARSE] > 0.0:
        reward = where(achieved, 1.0, 0.0)
    return reward, failed, achieved


@inlined_kernel
def _judge(
    numbers: FloatArray, g: int, quantities: Quantities[Any], outputs: FloatArray,
    flags: BoolArray, task: FloatArray, observes: bool,
) -> None:  # fmt: skip
    """Write reward, end and success by the formulas of the built-in mode; count the steps.

    Where Python judges, it does so afterwards. An environment that starts has no reward and no end.
    """
    mode = int(task[Task.MODE])
    reward, failed, achieved = _judged(mode, quantities)
    reward, failed, achieved = ruled(
        task, quantities.rail_position, quantities.uprightness, reward, failed, achieved
    )
    starts = numbers[Episode.STARTING, g] > 0.0
    held, steps = numbers[Episode.STEPS_HELD, g], numbers[Episode.STEPS, g]
    if not observes:
        held, steps = held + 1.0, steps + 1.0
    held = where(starts, 1.0, held)
    if mode > 0 and not observes:
        held = where(achieved, held, 0.0)
    elif mode > 0:
        held = where(starts, where(achieved, 1.0, 0.0), held)
    steps = where(starts, 0.0, steps)
    numbers[Episode.STEPS_HELD, g], numbers[Episode.STEPS, g] = held, steps
    flags[Flag.SUCCESS, g] = held > task[Task.HOLD_STEPS]
    if not observes:
        over = (steps >= task[Task.MAX_STEPS]) | (numbers[Member.DIVERGED, g] > 0.0)
        outputs[Output.REWARD, g] = where(starts, 0.0, reward)
        flags[Flag.TERMINATED, g] = failed & (numbers[Episode.STARTING, g] == 0.0)
        flags[Flag.TRUNCATED, g] = over


@spliced_kernel
def _step(
    view: NumbersOf, width: int, members: FloatArray, rods: FloatArray, model: Model,
    record: Turns, actions: FloatArray, observation: ObsArray, outputs: FloatArray,
    flags: BoolArray, task: FloatArray, wiring: FloatArray, keys: Keys | None,
    past: FloatArray | None, commands: Commands, timing: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    members, rods, model, record = bare(members), bare(rods), bare(model), bare(record)
    actions, observation, task, wiring = bare(actions), bare(observation), bare(task), bare(wiring)
    keys, past, commands, timing = bare(keys), bare(past), bare(commands), bare(timing)
    scratch, outputs, flags = bare(scratch), view(bare(outputs)), view(bare(flags))
    numbers, work, acting = view(members), view(scratch), view(commands)
    observes, n = task[Task.OBSERVES] > 0.0, rods.shape[2] // width - 1
    for g in range(int(timing[Timing.FIRST_GROUP]), int(timing[Timing.LAST_GROUP])):
        group = group_of(numbers, view(rods), view(model), view(record), g)
        if observes:
            if not any_of(numbers[Episode.OBSERVED, g] > 0.0):
                continue
            bob_velocities(group, work[Scratch.SIN], work[Scratch.COS])
        else:
            for piece in range(int(task[Task.PIECES])):
                if timing[Timing.FIRST_SUBSTEP] == 0.0:
                    drive(
                        members, numbers, g, width, group, (actions, view(actions)), keys, past,
                        commands, acting, wiring, task, piece, timing[Timing.DT],
                    )  # fmt: skip
                advance_group(view, width, members, timing, scratch, g, group)
        if timing[Timing.LAST_SUBSTEP] == timing[Timing.SUBSTEPS]:
            rows = view(rods)[g]
            quantities = _measure(numbers, rows, g, group, work, outputs, flags, task)
            _judge(numbers, g, quantities, outputs, flags, task, observes)
            for j in range(actions.shape[0]):
                joint = int(wiring[Wiring.JOINT, j])
                outputs[_first_row(Block.TORQUE, n) + j, g] = mean_torque(
                    acting, group, joint, j, g
                )
            if task[Task.SENSED] == 0.0:
                theta, omega = rods[g, Rod.THETA], rods[g, Rod.OMEGA]
                observe(
                    view, width, rods, g, theta, omega, scratch, observation, task, wiring
                )  # fmt: skip
            starts = numbers[Episode.STARTING, g]
            if any_of(starts > 0.0) and task[Task.MODE] > 0.0:  # they move from the next step on
                numbers[Episode.STARTING, g] = 0.0 * starts
                numbers[Member.ACTIVE, g] = 1.0 + 0.0 * starts


@kernel
def step_one(
    members: FloatArray, rods: FloatArray, model: Model, record: Turns, actions: FloatArray,
    observation: ObsArray, outputs: FloatArray, flags: BoolArray, task: FloatArray,
    wiring: FloatArray, keys: Keys | None, past: FloatArray | None, commands: Commands,
    timing: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Take a step of one environment; see `step_many`."""
    _step(
        bare, 1, members, rods, model, record, actions, observation, outputs, flags, task, wiring,
        keys, past, commands, timing, scratch,
    )  # fmt: skip


@kernel
def step_many(
    members: FloatArray, rods: FloatArray, model: Model, record: Turns, actions: FloatArray,
    observation: ObsArray, outputs: FloatArray, flags: BoolArray, task: FloatArray,
    wiring: FloatArray, keys: Keys | None, past: FloatArray | None, commands: Commands,
    timing: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Take a step of the active sub-environments, and write the results of every sub-environment.

    Parameters
    ----------
    members, rods, model, record, timing, scratch
        As for `npend_gym.physics.kernels.advance.advance_many`, `members` with the rows of
        `Episode`; `timing` is of a piece of the step.
    actions : ndarray, shape (joints, lanes)
        Torque over its limit at each actuated joint; beyond +-1 it is clipped.
    observation : ndarray, float32, shape (lanes, numbers)
        Written.
    outputs : ndarray, shape (rows, columns of `members`)
        Written; the rows are those of `Output`, then the blocks of `Block`.
    flags : ndarray, bool, shape (len(Flag), sub-environments)
        Written.
    task : ndarray, shape (len(Task),)
    wiring : ndarray, shape (len(Wiring), n + 1)
    keys : ndarray, uint64, shape (2, lanes)
        This and what follows: None where motors are ideal.
    past : ndarray, shape (lanes, slots, joints)
        Clipped actions of the last steps, kept here; slots is a power of two.
    commands : tuple of one ndarray, shape (len(Command), max(joints, 1), lanes)
        Written; LAGGED is kept from step to step.
    """
    _step(
        packs, WIDTH, members, rods, model, record, actions, observation, outputs, flags, task,
        wiring, keys, past, commands, timing, scratch,
    )  # fmt: skip
