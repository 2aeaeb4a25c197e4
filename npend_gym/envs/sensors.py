"""Sensors that are not ideal: from the true state to what is observed of it.

Called after the step kernel where a keyword asks for it. What acts, in this order: the state is
that of `observation_delay` steps ago; noise is added; angles and angular velocities are rounded to
multiples of their resolution. The true state, the info and the reward know nothing of it.
"""

# ruff: noqa: ARG001  all kernels have the parameters that `Memory.run` hands them
from __future__ import annotations

import math
from typing import Any

from npend_gym._checks import FloatArray
from npend_gym._streams import Purpose
from npend_gym.compiled.arrays import NumbersOf, bare, packs
from npend_gym.compiled.jit import inlined_kernel, kernel, spliced_kernel
from npend_gym.compiled.normal import make_normal
from npend_gym.compiled.packs import WIDTH, any_of, where
from npend_gym.compiled.philox import Keys, philox, unit
from npend_gym.compiled.sincos import ROUND, sincos
from npend_gym.envs.laws import law
from npend_gym.envs.observing import ObsArray, observe, within, wrapped
from npend_gym.envs.rows import Episode, Setting, Task
from npend_gym.physics.kernels.dynamics import copy
from npend_gym.physics.kernels.layout import MAX_SPEED, Model, Rod, Scratch, Timing

_MOST = 2.0**51  # multiples: up to here adding ROUND rounds

# Rows of the scratch space: what is measured, and the noise before it is scaled
_THETA, _OMEGA = Scratch.THETA, Scratch.OMEGA
_FIRST_NOISE, _SECOND_NOISE = Scratch.STEP_THETA, Scratch.STEP_OMEGA


@law
def interpolate(
    older: tuple[Any, Any], newer: tuple[Any, Any], fraction: Any, dt: float
) -> tuple[Any, Any]:
    """Return angle and angular velocity a `fraction` of a step before `newer`.

    The cubic that has the angles and angular velocities of both states, and its derivative.
    """
    s = 1.0 - fraction
    turned = newer[0] - older[0]
    first, last = dt * older[1], dt * newer[1]
    # theta = older + s (first + s (bend + s twist)), s from 0 at `older` to 1 at `newer`
    bend, twist = 3.0 * turned - 2.0 * first - last, first + last - 2.0 * turned
    theta = older[0] + s * (first + s * (bend + s * twist))
    return theta, (first + s * (2.0 * bend + s * (3.0 * twist))) / dt


@law
def age_shown(numbers: Any, g: Any, step: Any) -> Any:
    """Age of what is observed in this step of the episode [steps]."""
    delay = numbers[Setting.observation_delay, g]
    return where(delay > step, step, delay)


@inlined_kernel
def _look_back(
    members: FloatArray, rows: FloatArray, g: int, width: int, dt: float, history: FloatArray,
    scratch: FloatArray,
) -> None:  # fmt: skip
    """Write the states that the sensors of group `g` show, and keep the present ones for later.

    Before the start of an episode the state was that of the start; before a state that was set,
    where the history is NaN, it was that state.
    """
    size, mask = history.shape[3], history.shape[1] - 1
    theta, omega = scratch[_THETA], scratch[_OMEGA]
    for k in range(width):
        past, step = history[g * width + k], int(members[Episode.STEPS, g * width + k])
        for i in range(size):
            past[step & mask, Rod.THETA, i] = rows[Rod.THETA, i * width + k]
            past[step & mask, Rod.OMEGA, i] = rows[Rod.OMEGA, i * width + k]
        delay = age_shown(members, g * width + k, members[Episode.STEPS, g * width + k])
        while delay > 0.0 and math.isnan(past[(step - math.ceil(delay)) & mask, Rod.THETA, 0]):
            delay = math.ceil(delay) - 1.0
        whole = int(delay)
        newer, older = past[(step - whole) & mask], past[(step - whole - 1) & mask]
        for i in range(size):
            angle, speed = newer[Rod.THETA, i], newer[Rod.OMEGA, i]
            if delay > whole:
                before, now = (older[Rod.THETA, i], older[Rod.OMEGA, i]), (angle, speed)
                angle, speed = interpolate(before, now, delay - whole, dt)
            theta[i * width + k], omega[i * width + k] = angle, speed


@inlined_kernel
def _draw_noise(
    members: FloatArray, g: int, width: int, n: int, keys: Keys, first: FloatArray,
    second: FloatArray,
) -> None:  # fmt: skip
    """Write the two random numbers in [0, 1) of every rod of group `g`."""
    for k in range(width):
        lane = g * width + k
        step, episode = members[Episode.STEPS, lane], members[Episode.EPISODE, lane]
        for i in range(0, n, 2):
            words = philox(keys[0, lane], keys[1, lane], i // 2, step, Purpose.SENSOR, episode)
            first[i * width + k], second[i * width + k] = unit(words[0]), unit(words[1])
            if i + 1 < n:
                j = (i + 1) * width + k
                first[j], second[j] = unit(words[2]), unit(words[3])


@kernel
def draw_sensor_noise(
    members: FloatArray, keys: Keys, first: FloatArray, second: FloatArray
) -> None:
    """Write the noise of a step over its deviations: of angles and of velocities, (lanes, n)."""
    members, keys, first, second = bare(members), bare(keys), bare(first), bare(second)
    for k in range(first.shape[0]):
        _draw_noise(members, k, 1, first.shape[1], keys, first[k], second[k])
        make_normal(first[k], second[k])


@law
def rounded(x: Any, resolution: Any) -> Any:
    """Return the nearest multiple of the resolution, of two the even one; x where it is 0."""
    steps = x / where(resolution > 0.0, resolution, 1.0)
    whole = (steps + ROUND) - ROUND
    return where((resolution > 0.0) & (abs(steps) < _MOST), whole * resolution, x)


@law
def rounds(numbers: Any, g: Any) -> bool:
    """Return whether any sensor rounds."""
    resolutions = numbers[Setting.angle_resolution, g], numbers[Setting.velocity_resolution, g]
    return any_of((resolutions[0] > 0.0) | (resolutions[1] > 0.0))


@law
def reading(
    numbers: Any, g: Any, theta: Any, omega: Any, noise: tuple[Any, Any], rounding: bool
) -> tuple[Any, Any]:
    """Angle and angular velocity of a rod as the sensors show them; `noise` of deviation 1 each."""
    spread, step = numbers[Setting.angle_noise, g], numbers[Setting.angle_resolution, g]
    angle = wrapped(theta + spread * noise[0])
    speed = omega + numbers[Setting.velocity_noise, g] * noise[1]
    if rounding:
        angle = where(step > 0.0, wrapped(rounded(angle, step)), angle)
        speed = rounded(speed, numbers[Setting.velocity_resolution, g])
    angle = where((spread == 0.0) & (step == 0.0), theta, angle)
    return angle, within(speed, MAX_SPEED)


@spliced_kernel
def _sense(
    view: NumbersOf, width: int, members: FloatArray, rods: FloatArray, keys: Keys,
    history: FloatArray, observation: ObsArray, task: FloatArray, wiring: FloatArray, dt: float,
    timing: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    members, rods, keys, history = bare(members), bare(rods), bare(keys), bare(history)
    observation, task, wiring = bare(observation), bare(task), bare(wiring)
    timing, scratch = bare(timing), bare(scratch)
    numbers, work = view(members), view(scratch)
    n, observes = rods.shape[2] // width - 1, task[Task.OBSERVES] > 0.0
    first, second = scratch[_FIRST_NOISE, : n * width], scratch[_SECOND_NOISE, : n * width]
    if timing[Timing.LAST_SUBSTEP] < timing[Timing.SUBSTEPS]:
        return
    for g in range(int(timing[Timing.FIRST_GROUP]), int(timing[Timing.LAST_GROUP])):
        if observes and not any_of(numbers[Episode.OBSERVED, g] > 0.0):
            continue
        if any_of(numbers[Setting.observation_delay, g] > 0.0):
            _look_back(members, rods[g], g, width, dt, history, scratch)
        else:
            copy(rods[g, Rod.THETA], scratch[_THETA])
            copy(rods[g, Rod.OMEGA], scratch[_OMEGA])
        noisy = (numbers[Setting.angle_noise, g] > 0.0) | (numbers[Setting.velocity_noise, g] > 0.0)
        if any_of(noisy):
            _draw_noise(members, g, width, n, keys, first, second)
            make_normal(first, second)
        rounding = rounds(numbers, g)
        for i in range(n):
            noise = work[_FIRST_NOISE, i], work[_SECOND_NOISE, i]
            work[_THETA, i], work[_OMEGA, i] = reading(
                numbers, g, work[_THETA, i], work[_OMEGA, i], noise, rounding
            )
        s, c = work[Scratch.SIN], work[Scratch.COS]
        if task[Task.AFTER_SINES] > 0.0:
            for i in range(n):
                s[i], c[i] = sincos(work[_THETA, i])
        theta, omega = scratch[_THETA, : (n + 1) * width], scratch[_OMEGA, : (n + 1) * width]
        observe(
            view, width, rods, g, theta, omega, scratch, observation, task, wiring
        )  # fmt: skip


@kernel
def sense_one(
    members: FloatArray, rods: FloatArray, model: Model, keys: Keys, history: FloatArray,
    observation: ObsArray, task: FloatArray, wiring: FloatArray, dt: float, timing: FloatArray,
    scratch: FloatArray,
) -> None:  # fmt: skip
    """Observe one environment through its sensors; see `sense_many`."""
    _sense(
        bare, 1, members, rods, keys, history, observation, task, wiring, dt, timing, scratch
    )  # fmt: skip


@kernel
def sense_many(
    members: FloatArray, rods: FloatArray, model: Model, keys: Keys, history: FloatArray,
    observation: ObsArray, task: FloatArray, wiring: FloatArray, dt: float, timing: FloatArray,
    scratch: FloatArray,
) -> None:  # fmt: skip
    """Write the observations of every sub-environment as its sensors show it.

    A second call in the same step writes the same again.

    Parameters
    ----------
    members, rods, model, observation, task, wiring, timing, scratch
        As for `npend_gym.envs.kernels.step_many`.
    keys : ndarray, uint64, shape (2, lanes)
    history : ndarray, shape (lanes, slots, 2, size)
        The states of the last steps, kept here: THETA and OMEGA, the first rows of `Rod`, of `size`
        coordinates, those of carts too. slots is a power of two; environments without a delay need
        none.
    dt : float
        Time of a step [s].
    """
    _sense(
        packs, WIDTH, members, rods, keys, history, observation, task, wiring, dt, timing, scratch
    )  # fmt: skip
