"""One step of the environments in one compiled call: actions, physics, and what is told of it.

Actions become torques, `advance_group` of the physics moves the chains, and the new state becomes
observations, the quantities that modes judge by, and the numbers of the info.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.compiled.arrays import NumbersOf, bare, packs
from npend_gym.compiled.jit import inlined_kernel, kernel, spliced_kernel
from npend_gym.compiled.packs import WIDTH, any_of, where
from npend_gym.compiled.sincos import ROUND
from npend_gym.envs.modes import (
    Balance,
    Calm,
    Passive,
    Quantities,
    SwingUp,
    Transition,
    left_rail,
    rail_factor,
)
from npend_gym.envs.rows import (
    MAX_CART_ENTRY,
    MODE_NUMBERS,
    SINCOS,
    Episode,
    Flag,
    Output,
    Task,
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
    group_of,
)

ObsArray = NDArray[np.float32]

_PI, _TWO_PI, _INVERSE_TWO_PI = math.pi, 2.0 * math.pi, 0.5 / math.pi
_PI_32 = float(np.float32(np.pi))
# angles above it would become _PI_32 as float32, which is more than pi
_BELOW_PI_32 = 0.5 * (_PI_32 + float(np.nextafter(np.float32(np.pi), np.float32(0.0))))


def _compiled(formula: Any) -> Any:
    """Return a formula of a mode, compiled: its `self` is None."""
    return inlined_kernel(formula)


_passive_reward = _compiled(Passive.reward)
_swing_up_reward, _swing_up_achieved = _compiled(SwingUp.reward), _compiled(SwingUp.achieved)
_balance_reward, _balance_failed = _compiled(Balance.reward), _compiled(Balance.failed)
_balance_achieved = _compiled(Balance.achieved)
_calm_reward, _calm_achieved = _compiled(Calm.reward), _compiled(Calm.achieved)
_transition_reward = _compiled(Transition.reward)
_transition_achieved = _compiled(Transition.achieved)
_left_rail, _rail_factor = _compiled(left_rail), _compiled(rail_factor)


@inlined_kernel
def _apply_actions(
    numbers: FloatArray, g: int, group: Group, actions: FloatArray, task: FloatArray
) -> None:
    """Turn the actions (joints, lanes) of a group into torques; beyond +-1 they are clipped."""
    squares = 0.0
    for row in range(actions.shape[0]):
        action, joint = _within(actions[row, g], 1.0), int(task[len(Task) + row])
        of_cart = joint == group.velocity.size
        limit = numbers[Episode.MAX_FORCE if of_cart else Episode.MAX_TORQUE, g]
        group.torque[joint] = limit * action
        squares = squares + action * action
    if actions.shape[0] > 1:
        squares = squares / actions.shape[0]
    numbers[Episode.MEAN_SQUARED_ACTION, g] = squares


@inlined_kernel
def _approach(
    numbers: FloatArray, g: int, group: Group, c: FloatArray, outputs: FloatArray
) -> tuple[Any, Any]:
    """Return closeness to the goal and distance from it; write the cosines of the angles."""
    n = group.velocity.size
    goals, cosines = numbers.shape[0] - n, outputs.shape[0] - n
    distance = missed = size = 0.0 * c[0]
    for i in range(n):
        away, weight = abs(c[i] - numbers[goals + i, g]), abs(group.carried[i])
        distance = where(away > distance, away, distance)
        missed, size = missed + weight * away, size + weight
        outputs[cosines + i, g] = c[i]
    return 1.0 - 0.5 * (missed / size), distance


@inlined_kernel
def _measure(
    numbers: FloatArray, g: int, group: Group, scratch: FloatArray, outputs: FloatArray,
    flags: BoolArray, task: FloatArray,
) -> Quantities[Any]:  # fmt: skip
    """Write and return the quantities of a group whose sines, cosines and velocities are known.

    The energy of lanes that start becomes that of the start.
    """
    s, c = scratch[Scratch.SIN], scratch[Scratch.COS]
    kinetic, lift, tip = energies(
        group.omega, group.carried, group.mass, group.velocity, group.chain, s, c
    )
    total, first = 0.0, len(Output)
    n = group.velocity.size
    for i in range(n):
        period = group.record.period[i]
        known = where(period > 0.0, period, 0.0)
        total = total + known
        outputs[first + i, g] = known
        outputs[first + n + i, g] = group.theta[i]
        outputs[first + 2 * n + i, g] = group.omega[i]
    energy = kinetic + group.chain.gravity[0] * lift
    starts = numbers[Episode.STARTING, g] > 0.0
    start = where(starts, energy, numbers[Episode.START_ENERGY, g])
    numbers[Episode.START_ENERGY, g] = start
    squares = where(starts, 0.0, numbers[Episode.MEAN_SQUARED_ACTION, g])
    numbers[Episode.MEAN_SQUARED_ACTION, g] = squares
    scale = where(energy > start, energy, start)
    drift = (energy - start) - numbers[Member.WORK, g]
    per_energy, completed = numbers[Episode.PER_ENERGY, g], numbers[Member.COMPLETED, g]
    share = energy / where(start > 0.0, start, 1.0)
    closeness = distance = place = 0.0 * lift
    if task[Task.RAIL] > 0.0:
        outputs[Output.CART_POSITION, g] = group.theta[n]
        outputs[Output.CART_VELOCITY, g] = group.omega[n]
        place = group.theta[n] / task[Task.RAIL]
    if task[Task.GOALS] > 0.0:
        closeness, distance = _approach(numbers, g, group, c, outputs)
    quantities = Quantities(
        lift * numbers[Episode.PER_LIFT, g], tip * numbers[Episode.PER_LENGTH, g],
        energy * per_energy, kinetic * per_energy,
        where(start > 0.0, share, energy * per_energy), squares, closeness, distance,
        place, group.theta, group.omega,
    )  # fmt: skip
    if task[Task.MODE] == 0.0 or task[Task.GOALS] > 0.0:
        rows = outputs[first + 3 * n :]
        rows[0, g], rows[1, g], rows[2, g] = quantities[0], quantities[1], quantities[2]
        rows[3, g], rows[4, g], rows[5, g] = quantities[3], quantities[4], quantities[5]
        rows[6, g], rows[7, g], rows[8, g] = quantities[6], quantities[7], quantities[8]
    outputs[Output.TIME, g] = numbers[Member.TIME, g]
    outputs[Output.ENERGY, g] = energy
    outputs[Output.ENERGY_ERROR, g] = drift / where(scale > 0.0, scale, 1.0)
    outputs[Output.PSEUDO_PERIOD, g] = total / where(completed > 0.0, completed, 1.0)
    of_com = group.record.period[n]
    outputs[Output.PSEUDO_PERIOD_COM, g] = where(of_com > 0.0, of_com, 0.0)
    outputs[Output.IDEAL_PERIOD, g] = numbers[Episode.IDEAL_PERIOD, g]
    outputs[Output.TIP_HEIGHT, g] = tip
    outputs[Output.COMPLETED, g] = completed
    flags[Flag.MEASURED, g] = completed > 0.0
    flags[Flag.DIVERGED, g] = numbers[Member.DIVERGED, g] > 0.0
    return quantities


@inlined_kernel
def _judge(
    numbers: FloatArray, g: int, quantities: Quantities[Any], outputs: FloatArray,
    flags: BoolArray, task: FloatArray, observes: bool,
) -> None:  # fmt: skip
    """Write reward, end and success by the formulas of the built-in mode; count the steps.

    Where Python judges, it does so afterwards. A lane that starts has no reward and no end.
    """
    mode = int(task[Task.MODE])
    failed = quantities.height != quantities.height
    reward, achieved = 0.0 * quantities.height, failed
    if mode == MODE_NUMBERS.PASSIVE:
        reward = _passive_reward(None, quantities)
    elif mode == MODE_NUMBERS.SWING_UP:
        reward = _swing_up_reward(None, quantities)
        achieved = _swing_up_achieved(None, quantities)
    elif mode == MODE_NUMBERS.BALANCE:
        reward, failed = _balance_reward(None, quantities), _balance_failed(None, quantities)
        achieved = _balance_achieved(None, quantities)
    elif mode == MODE_NUMBERS.CALM:
        reward, achieved = _calm_reward(None, quantities), _calm_achieved(None, quantities)
    elif mode == MODE_NUMBERS.TRANSITION:
        reward = _transition_reward(None, quantities)
        achieved = _transition_achieved(None, quantities)
    if task[Task.RAIL] > 0.0:
        place = quantities.rail_position
        left = _left_rail(place)
        reward = where(left, 0.0, reward * _rail_factor(place))
        achieved, failed = achieved & (abs(place) <= 1.0), failed | left
    if task[Task.SPARSE] > 0.0:
        reward = where(achieved, 1.0, 0.0)
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


@inlined_kernel
def _welcome(numbers: FloatArray, g: int) -> None:
    """Let the lanes that start take part from the next step on."""
    numbers[Episode.STARTING, g] = 0.0 * numbers[Episode.STARTING, g]
    numbers[Member.ACTIVE, g] = 1.0 + numbers[Episode.STARTING, g]


@inlined_kernel
def wrapped(theta: Any) -> Any:
    """Return an angle without whole turns, in [-pi, pi)."""
    turns = (theta + _PI) * _INVERSE_TWO_PI
    whole = (turns + ROUND) - ROUND
    whole = where(whole > turns, whole - 1.0, whole)
    return theta - _TWO_PI * whole


@inlined_kernel
def _within(x: Any, limit: float) -> Any:
    """Return a number clipped to +-limit."""
    return where(x > limit, limit, where(x < -limit, -limit, x))


@inlined_kernel
def _write_columns(numbers: FloatArray, width: int, columns: ObsArray) -> None:
    """Write numbers, the lane innermost, into some columns of the observations of a group."""
    for i in range(columns.shape[1]):
        for k in range(width):
            columns[k, i] = numbers[i * width + k]


@inlined_kernel
def _observe_angles(theta: FloatArray, angles: FloatArray, n: int) -> None:
    """Write the wrapped angles of a group."""
    for i in range(n):
        angle = wrapped(theta[i])
        angles[i] = where(angle > _BELOW_PI_32, -_PI_32, angle)


@inlined_kernel
def _observe_speeds(omega: FloatArray, speeds: FloatArray, n: int, task: FloatArray) -> None:
    """Write the scaled angular velocities of a group."""
    for i in range(n):
        speeds[i] = _within(omega[i] * task[task.size - n + i], task[Task.SPEED_LIMIT])


@inlined_kernel
def _observe_cart(
    theta: FloatArray, omega: FloatArray, cart: FloatArray, n: int, task: FloatArray
) -> None:
    """Write place and velocity of the carts of a group."""
    cart[0] = _within(theta[n] / task[Task.RAIL], MAX_CART_ENTRY)
    cart[1] = _within(omega[n] * task[Task.PER_CART_SPEED], MAX_CART_ENTRY)


@spliced_kernel
def observe(
    view: NumbersOf, width: int, members: FloatArray, g: int, theta: FloatArray,
    omega: FloatArray, scratch: FloatArray, observation: ObsArray, task: FloatArray,
) -> None:  # fmt: skip
    """Write the observations of group `g`.

    Where sines are observed, they and the cosines are in the work space. `theta` and `omega` have
    n + 1 numbers for each lane: that of a cart is the last.
    """
    n, shown = omega.size // width - 1, scratch[Scratch.OBSERVED]
    rows, column = observation[g * width : (g + 1) * width], 2 * n
    if task[Task.FORM] == SINCOS:
        column = 3 * n
        _observe_speeds(view(omega), view(shown), n, task)
        _write_columns(scratch[Scratch.SIN], width, rows[:, :n])
        _write_columns(scratch[Scratch.COS], width, rows[:, n : 2 * n])
        _write_columns(shown, width, rows[:, 2 * n : column])
    else:
        _observe_angles(view(theta), view(shown), n)
        _write_columns(shown, width, rows[:, :n])
        _write_columns(omega, width, rows[:, n:column])
    if task[Task.RAIL] > 0.0:
        _observe_cart(view(theta), view(omega), view(shown), n, task)
        _write_columns(shown, width, rows[:, column : column + 2])
        column += 2
    if task[Task.OBSERVED_GOALS] > 0.0:
        for i in range(n):
            goal = members[members.shape[0] - n + i, g * width : (g + 1) * width]
            _write_columns(goal, width, rows[:, column + i : column + i + 1])


@spliced_kernel
def _step(
    view: NumbersOf, width: int, members: FloatArray, rods: FloatArray, model: Model,
    actions: FloatArray, written: tuple[ObsArray, FloatArray, BoolArray], task: FloatArray,
    timing: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    observation, outputs, flags = written[0], view(written[1]), view(written[2])
    numbers, work = view(members), view(scratch)
    observes = timing[Timing.SUBSTEPS] == 0.0
    for g in range(int(timing[Timing.FIRST_GROUP]), int(timing[Timing.LAST_GROUP])):
        group = group_of(numbers, view(rods), view(model), g)
        if observes:
            if not any_of(numbers[Episode.OBSERVED, g] > 0.0):
                continue
            bob_velocities(group, work[Scratch.SIN], work[Scratch.COS])
        else:
            if timing[Timing.FIRST_SUBSTEP] == 0.0 and actions.shape[0] > 0:
                _apply_actions(numbers, g, group, view(actions), task)
            advance_group(view, width, members, rods, model, timing, scratch, g, group)
        if timing[Timing.LAST_SUBSTEP] == timing[Timing.SUBSTEPS]:
            quantities = _measure(numbers, g, group, work, outputs, flags, task)
            _judge(numbers, g, quantities, outputs, flags, task, observes)
            if observation.shape[1] > 0:
                theta, omega = rods[g, Rod.THETA], rods[g, Rod.OMEGA]
                observe(view, width, members, g, theta, omega, scratch, observation, task)
            if any_of(numbers[Episode.STARTING, g] > 0.0) and task[Task.MODE] > 0.0:
                _welcome(numbers, g)


@kernel
def step_one(
    members: FloatArray, rods: FloatArray, model: Model, actions: FloatArray,
    observation: ObsArray, outputs: FloatArray, flags: BoolArray, task: FloatArray,
    timing: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Take a step of one environment; see `step_many`."""
    written = bare(observation), bare(outputs), bare(flags)
    _step(
        bare, 1, bare(members), bare(rods), bare(model), bare(actions), written, bare(task),
        bare(timing), bare(scratch),
    )  # fmt: skip


@kernel
def step_many(
    members: FloatArray, rods: FloatArray, model: Model, actions: FloatArray,
    observation: ObsArray, outputs: FloatArray, flags: BoolArray, task: FloatArray,
    timing: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Take a step of the active lanes, and write what is told of every lane.

    Parameters
    ----------
    members, rods, model, timing, scratch
        As for `npend_gym.physics.kernels.advance.advance_many`, `members` with the rows of
        `Episode`. With 0 substeps nothing moves: the call only observes, in the groups with a lane
        to be OBSERVED.
    actions : ndarray, shape (joints, lanes)
        Torque over its limit at each actuated joint; beyond +-1 it is clipped. Without rows the
        torques stay as they are: `npend_gym.envs.motors` has set them.
    observation : ndarray, float32, shape (lanes, 2n) or (lanes, 3n)
        Written. Without columns `npend_gym.envs.sensors` writes it afterwards.
    outputs : ndarray, shape (rows, columns of `members`)
        Written; the rows are those of `Output` and what follows them.
    flags : ndarray, bool, shape (len(Flag), lanes)
        Written.
    task : ndarray, shape (len(Task) + joints + n,)
    """
    written = bare(observation), bare(outputs), bare(flags)
    _step(
        packs, WIDTH, bare(members), bare(rods), bare(model), bare(actions), written, bare(task),
        bare(timing), bare(scratch),
    )  # fmt: skip
