"""Motors: from the actions of a step to torques at the joints, in the step kernel.

What acts, in this order: the action is clipped; it waits for `action_delay` steps; the motor
follows it with `motor_lag`; the limit makes a torque of it; noise and ripple are added. A push at
the tip adds the torques that it exerts. Where motors are ideal, clip and limit alone are compiled.
"""

# ruff: noqa: ARG001  ideal motors, and others, share their parameters
from __future__ import annotations

from typing import Any, NamedTuple

from npend_gym._checks import FloatArray
from npend_gym._streams import Purpose
from npend_gym.compiled.arrays import bare
from npend_gym.compiled.exponential import one_minus_exp
from npend_gym.compiled.jit import (
    chosen_by_type,
    inlined_kernel,
    inner_kernel,
    kernel,
    outlined_kernel,
)
from npend_gym.compiled.normal import normal_pair
from npend_gym.compiled.packs import any_of, where
from npend_gym.compiled.philox import Keys, philox, unit
from npend_gym.compiled.sincos import ROUND, sincos
from npend_gym.envs.laws import law
from npend_gym.envs.observing import within, wrapped
from npend_gym.envs.rows import Episode, Setting, Task, Wiring
from npend_gym.physics.kernels.layout import Group

Commands = tuple[FloatArray] | None  # (len(Command), max(m, 1), lanes); None: motors are ideal


class CommandFields(NamedTuple):
    """Blocks of `commands`, with a row for each motor: what acts during a step."""

    OLDER: int = 0  # the action that acts until the fraction of the delay has passed
    NEWER: int = 1  # the one that acts then
    LAGGED: int = 2  # the action as far as the motor has followed it
    NOISE: int = 3  # N m
    ACTION: int = 4  # mean over the present piece of the step, of what the motor follows
    PUSH: int = 5  # first row: N, at the tip
    TORQUE: int = 6  # N m, or N of a cart: mean over the step of what the motor exerts


Command: CommandFields = CommandFields()


@inlined_kernel
def _choose_actions(
    members: FloatArray, g: int, width: int, actions: FloatArray, past: FloatArray,
    commands: FloatArray,
) -> None:  # fmt: skip
    """Write which actions act on the lanes of group `g` in a step, and keep theirs for later."""
    older, newer = commands[Command.OLDER], commands[Command.NEWER]
    lagged = commands[Command.LAGGED]
    motors, mask = past.shape[2], past.shape[1] - 1
    for k in range(width):
        lane = g * width + k
        step, whole = int(members[Episode.STEPS, lane]), int(members[Setting.action_delay, lane])
        squares = 0.0
        for j in range(motors):
            action = min(max(actions[j, lane], -1.0), 1.0)
            squares += action * action
            past[lane, step & mask, j] = action
            newer[j, lane] = past[lane, (step - whole) & mask, j] if step >= whole else 0.0
            older[j, lane] = past[lane, (step - whole - 1) & mask, j] if step > whole else 0.0
            lagged[j, lane] = lagged[j, lane] if step > 0 else 0.0
        members[Episode.MEAN_SQUARED_ACTION, lane] = squares / max(1, motors)


@law
def _disturb(
    members: FloatArray, g: int, width: int, dt: float, keys: Keys, motors: int,
    commands: FloatArray,
) -> None:  # fmt: skip
    """Draw the noise of the torques and the force at the tip, mostly none, of a step."""
    noise, push = commands[Command.NOISE], commands[Command.PUSH, 0]
    for k in range(width):
        lane = g * width + k
        low, high = keys[0, lane], keys[1, lane]
        step, episode = members[Episode.STEPS, lane], members[Episode.EPISODE, lane]
        scale, rate = members[Setting.torque_noise, lane], members[Setting.push_rate, lane]
        for j in range(motors):
            noise[j, lane] = 0.0  # not that of an episode before
            if scale > 0.0:
                words = philox(low, high, j, step, Purpose.MOTOR, episode)
                noise[j, lane] = scale * normal_pair(unit(words[0]), unit(words[1]))[0]
        push[lane] = 0.0
        if rate > 0.0:
            words = philox(low, high, 0, step, Purpose.PUSH, episode)
            if unit(words[0]) < rate * dt:
                push[lane] = members[Setting.push_force, lane] * (2.0 * unit(words[1]) - 1.0)


@kernel
def draw_disturbances(
    members: FloatArray, keys: Keys, dt: float, motors: int, commands: FloatArray
) -> None:
    """Write NOISE and PUSH of a step of `dt` [s] into `commands`, of all sub-environments."""
    members, keys, commands = bare(members), bare(keys), bare(commands)
    for lane in range(keys.shape[1]):
        _disturb(members, lane, 1, dt, keys, motors, commands)


@law
def older_share(numbers: Any, g: Any, piece: int, pieces: int) -> Any:
    """Part of a piece of the step, from its beginning, in which the older action acts."""
    delay = numbers[Setting.action_delay, g]
    whole = (delay + ROUND) - ROUND
    share = (delay - where(whole > delay, whole - 1.0, whole)) * pieces - piece
    return where(share > 1.0, 1.0, where(share > 0.0, share, 0.0))


@law
def lag_response(numbers: Any, g: Any, share: Any, h: float) -> tuple[Any, Any, Any]:
    """`h` seconds over the lag, and how far motors come in the share of them, and in the rest."""
    lag = numbers[Setting.motor_lag, g]
    per_lag = h / where(lag > 0.0, lag, 1.0)
    return per_lag, one_minus_exp(share * per_lag), one_minus_exp((1.0 - share) * per_lag)


@law
def followed(
    numbers: Any, g: Any, response: tuple[Any, Any, Any], older: Any, newer: Any, lagged: Any,
    action: Any,
) -> tuple[Any, Any]:  # fmt: skip
    """Mean of what a motor follows in a piece, of which `action` is the mean, and its end.

    Exact for lag y' = u - y with the command u older at first, then newer.
    """
    lag, (per_lag, first, second) = numbers[Setting.motor_lag, g], response
    turned = (older - lagged) * first
    middle = lagged + turned
    rest = (newer - middle) * second
    mean = action - (turned + rest) / per_lag
    return where(lag > 0.0, mean, action), where(lag > 0.0, middle + rest, newer)


@law
def exerted(numbers: Any, g: Any, action: Any, noise: Any) -> Any:
    """Torque of a motor [N m], without its ripple."""
    return numbers[Setting.max_torque, g] * action + noise


@law
def exerted_on_cart(numbers: Any, g: Any, action: Any) -> Any:
    """Force of the motor of a cart [N]."""
    return numbers[Setting.max_force, g] * action


@law
def ripple(numbers: Any, g: Any, phi: Any) -> Any:
    """Cogging torque of a motor [N m] at the angle `phi` of its joint [rad]."""
    sine = sincos(numbers[Setting.ripple_cycles, g] * wrapped(phi))[0]
    return numbers[Setting.torque_ripple, g] * sine


# These three are no part of their caller, where the compiler would compute most of them in advance,
# needed or not


@inner_kernel
def _follow(
    numbers: FloatArray, g: int, commands: FloatArray, motors: int, share: Any, h: float
) -> None:
    """Replace the actions of a group by the means, over `h` seconds, of what its motors follow."""
    response = lag_response(numbers, g, share, h)
    for j in range(motors):
        commands[Command.ACTION, j, g], commands[Command.LAGGED, j, g] = followed(
            numbers, g, response, commands[Command.OLDER, j, g], commands[Command.NEWER, j, g],
            commands[Command.LAGGED, j, g], commands[Command.ACTION, j, g],
        )  # fmt: skip


@inner_kernel
def _add_ripple(
    numbers: FloatArray, g: int, group: Group, joints: FloatArray, motors: int, half: float
) -> None:
    """Add the ripple of the motors, at the angles of the joints after `half` [s]."""
    for j in range(motors):
        joint = int(joints[j])
        if joint == group.velocity.size:  # a cart has none
            continue
        phi = group.theta[joint] + half * group.omega[joint]
        if joint > 0:
            phi = phi - (group.theta[joint - 1] + half * group.omega[joint - 1])
        group.torque[joint] = group.torque[joint] + ripple(numbers, g, phi)


@inner_kernel
def _push_tip(force: Any, group: Group, half: float) -> None:
    """Add the torques that a horizontal force at the tip exerts, in the pose after `half` [s]."""
    total = 0.0
    for i in range(group.velocity.size - 1, -1, -1):
        c = sincos(group.theta[i] + half * group.omega[i])[1]
        total = total + force * (group.chain.length[i] * c)
        group.torque[i] = group.torque[i] + total
    for i in range(group.velocity.size, group.torque.size):
        group.torque[i] = group.torque[i] + force  # on a base that moves


@outlined_kernel
def _begin_step(
    members: FloatArray, g: int, width: int, actions: FloatArray, past: FloatArray,
    commands: FloatArray, dt: float, keys: Keys, noisy: int,
) -> None:  # fmt: skip
    """Choose the actions of a step, and draw what disturbs it; a function of its own is quicker."""
    _choose_actions(members, g, width, actions, past, commands)
    _disturb(members, g, width, dt, keys, noisy, commands)


@inlined_kernel
def _drive_ideal(
    members: FloatArray, numbers: FloatArray, g: int, width: int, group: Group,
    actions: tuple[FloatArray, FloatArray], keys: None, past: None, commands: None,
    viewed: None, wiring: FloatArray, task: FloatArray, piece: int, h: float,
) -> None:  # fmt: skip
    squares, own = 0.0, actions[1]
    for row in range(own.shape[0]):
        action, joint = within(own[row, g], 1.0), int(wiring[Wiring.JOINT, row])
        of_cart = joint == group.velocity.size
        limit = numbers[Setting.max_force if of_cart else Setting.max_torque, g]
        group.torque[joint] = limit * action
        squares = squares + action * action
    if own.shape[0] > 1:
        squares = squares / own.shape[0]
    numbers[Episode.MEAN_SQUARED_ACTION, g] = squares


@inlined_kernel
def _drive_real(
    members: FloatArray, numbers: FloatArray, g: int, width: int, group: Group,
    actions: tuple[FloatArray, FloatArray], keys: Keys, past: FloatArray,
    commands: tuple[FloatArray], viewed: tuple[FloatArray], wiring: FloatArray, task: FloatArray,
    piece: int, h: float,
) -> None:  # fmt: skip
    pieces, motors, joints = int(task[Task.PIECES]), past.shape[2], wiring[Wiring.JOINT]
    noisy, command, n = int(task[Task.NOISY]), viewed[0], group.velocity.size
    if piece == 0:
        _begin_step(members, g, width, actions[0], past, commands[0], h * pieces, keys, noisy)
    share, action = older_share(numbers, g, piece, pieces), command[Command.ACTION]
    older, newer = command[Command.OLDER], command[Command.NEWER]
    for j in range(motors):
        action[j, g] = share * older[j, g] + (1.0 - share) * newer[j, g]
    if any_of(numbers[Setting.motor_lag, g] > 0.0):
        _follow(numbers, g, command, motors, share, h)
    for i in range(group.torque.size):
        group.torque[i] = 0.0
    for j in range(motors):
        if joints[j] == n:  # the force on a cart
            group.torque[n] = exerted_on_cart(numbers, g, action[j, g])
        else:
            noise = command[Command.NOISE, j, g]
            group.torque[int(joints[j])] = exerted(numbers, g, action[j, g], noise)
    if any_of(numbers[Setting.torque_ripple, g] > 0.0):
        _add_ripple(numbers, g, group, joints, noisy, 0.5 * h)
    for j in range(motors):
        mean = group.torque[int(joints[j])] * (1.0 / pieces)
        if piece > 0:
            mean = mean + command[Command.TORQUE, j, g]
        command[Command.TORQUE, j, g] = where(numbers[Episode.STARTING, g] > 0.0, 0.0, mean)
    if any_of(command[Command.PUSH, 0, g] != 0.0):
        _push_tip(command[Command.PUSH, 0, g], group, 0.5 * h)


@chosen_by_type("commands", {0: _drive_ideal, 1: _drive_real})
def drive(
    members: FloatArray, numbers: FloatArray, g: int, width: int, group: Group,
    actions: tuple[FloatArray, FloatArray], keys: Keys | None, past: FloatArray | None,
    commands: Commands, viewed: Commands, wiring: FloatArray, task: FloatArray, piece: int,
    h: float,
) -> None:  # fmt: skip
    """Set the torques of a group in one of the equal pieces of the step, of `h` seconds.

    `numbers` and `viewed` are views of `members` and `commands`; `actions` has raw ones and a view.
    """
    raise NotImplementedError


@inlined_kernel
def _torque_of_ideal(commands: None, group: Group, joint: int, j: int, g: int) -> Any:
    return group.torque[joint]


@inlined_kernel
def _torque_of_real(commands: tuple[FloatArray], group: Group, joint: int, j: int, g: int) -> Any:
    return commands[0][Command.TORQUE, j, g]


@chosen_by_type("commands", {0: _torque_of_ideal, 1: _torque_of_real})
def mean_torque(commands: Commands, group: Group, joint: int, j: int, g: int) -> Any:
    """Return the mean torque of motor `j`, at `joint`, in the last step."""
    raise NotImplementedError
