"""Motors that are not ideal: from the actions of a step to torques at the joints.

Called before the step kernel where a keyword asks for it. What acts, in this order: the action is
clipped; it waits for `action_delay` steps; the motor follows it with `motor_lag`; the limit makes a
torque of it; noise and ripple are added. A push at the tip adds the torques that it exerts.
"""

# ruff: noqa: ARG001  all kernels have the parameters that `Memory.run` hands them
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym._streams import Purpose
from npend_gym.compiled.arrays import NumbersOf, bare, packs
from npend_gym.compiled.exponential import one_minus_exp
from npend_gym.compiled.jit import inlined_kernel, inner_kernel, kernel, spliced_kernel
from npend_gym.compiled.normal import normal_pair
from npend_gym.compiled.packs import WIDTH, any_of, where
from npend_gym.compiled.philox import Keys, philox, unit
from npend_gym.compiled.sincos import ROUND, sincos
from npend_gym.envs.laws import law
from npend_gym.envs.observing import wrapped
from npend_gym.envs.rows import Episode, Setting
from npend_gym.physics.kernels.layout import Group, Model, Timing, group_of

Joints = NDArray[np.int64]


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
        for j in range(motors if scale > 0.0 else 0):
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
def _add_ripple(numbers: FloatArray, g: int, group: Group, joints: Joints, half: float) -> None:
    """Add the ripple of the motors, at the angles of the joints after `half` [s]."""
    for j in range(joints.size):
        joint = joints[j]
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


@inlined_kernel
def _drive(
    numbers: FloatArray, g: int, group: Group, joints: Joints, noisy: int, commands: FloatArray,
    piece: int, pieces: int, h: float,
) -> None:  # fmt: skip
    """Set the torques of a group in one of the equal pieces of the step, of `h` seconds."""
    share, action = older_share(numbers, g, piece, pieces), commands[Command.ACTION]
    older, newer = commands[Command.OLDER], commands[Command.NEWER]
    for j in range(joints.size):
        action[j, g] = share * older[j, g] + (1.0 - share) * newer[j, g]
    if any_of(numbers[Setting.motor_lag, g] > 0.0):
        _follow(numbers, g, commands, joints.size, share, h)
    for i in range(group.torque.size):
        group.torque[i] = 0.0
    for j in range(joints.size):
        if joints[j] == group.velocity.size:  # the force on a cart
            group.torque[joints[j]] = exerted_on_cart(numbers, g, action[j, g])
        else:
            noise = commands[Command.NOISE, j, g]
            group.torque[joints[j]] = exerted(numbers, g, action[j, g], noise)
    if any_of(numbers[Setting.torque_ripple, g] > 0.0):
        _add_ripple(numbers, g, group, joints[:noisy], 0.5 * h)
    for j in range(joints.size):
        mean = group.torque[joints[j]] * (1.0 / pieces)
        if piece > 0:
            mean = mean + commands[Command.TORQUE, j, g]
        commands[Command.TORQUE, j, g] = where(numbers[Episode.STARTING, g] > 0.0, 0.0, mean)
    if any_of(commands[Command.PUSH, 0, g] != 0.0):
        _push_tip(commands[Command.PUSH, 0, g], group, 0.5 * h)


@spliced_kernel
def _apply(
    view: NumbersOf, width: int, members: FloatArray, rods: FloatArray, model: Model,
    keys: Keys, actions: FloatArray, joints: Joints, noisy: int, past: FloatArray,
    commands: FloatArray, piece: int, pieces: int, timing: FloatArray,
) -> None:  # fmt: skip
    h = timing[Timing.DT]
    if timing[Timing.FIRST_SUBSTEP] > 0.0:
        return
    for g in range(int(timing[Timing.FIRST_GROUP]), int(timing[Timing.LAST_GROUP])):
        if piece == 0:
            _choose_actions(members, g, width, actions, past, commands)
            _disturb(members, g, width, h * pieces, keys, noisy, commands)
        group = group_of(view(members), view(rods), view(model), None, g)
        _drive(view(members), g, group, joints, noisy, view(commands), piece, pieces, h)


@kernel
def apply_one(
    members: FloatArray, rods: FloatArray, model: Model, keys: Keys, actions: FloatArray,
    joints: Joints, noisy: int, past: FloatArray, commands: FloatArray, piece: int, pieces: int,
    timing: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Set the torques of one environment; see `apply_many`."""
    _apply(
        bare, 1, bare(members), bare(rods), bare(model), bare(keys), bare(actions), bare(joints),
        noisy, bare(past), bare(commands), piece, pieces, timing,
    )  # fmt: skip


@kernel
def apply_many(
    members: FloatArray, rods: FloatArray, model: Model, keys: Keys, actions: FloatArray,
    joints: Joints, noisy: int, past: FloatArray, commands: FloatArray, piece: int, pieces: int,
    timing: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Set the torques of every sub-environment for one of the equal pieces of a step.

    Parameters
    ----------
    members, rods, model, timing, scratch
        As for `npend_gym.envs.kernels.step_many`; DT is the time of the piece.
    keys : ndarray, uint64, shape (2, lanes)
    actions : ndarray, shape (m, lanes)
        Raw actions of the m motors.
    joints : ndarray, int64, shape (m,)
        Where the motors are.
    noisy : int
        How many of them, the first, have noise and ripple.
    past : ndarray, shape (lanes, slots, m)
        Clipped actions of the last steps, kept here; slots is a power of two.
    commands : ndarray, shape (len(Command), max(m, 1), lanes)
        Written; LAGGED is kept from step to step, TORQUE from piece to piece.
    piece, pieces : int
    """
    _apply(
        packs, WIDTH, bare(members), bare(rods), bare(model), bare(keys), bare(actions),
        bare(joints), noisy, bare(past), bare(commands), piece, pieces, timing,
    )  # fmt: skip
