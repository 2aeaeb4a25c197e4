"""Observations in compiled code: from states, true or as the sensors show them, to float32."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import NumbersOf
from npend_gym.compiled.jit import inlined_kernel, spliced_kernel
from npend_gym.compiled.packs import where
from npend_gym.compiled.sincos import ROUND
from npend_gym.envs.laws import law
from npend_gym.envs.rows import MAX_CART_ENTRY, Pose, Task, Wiring
from npend_gym.physics.kernels.layout import Scratch

ObsArray = NDArray[np.float32]

_PI, _TWO_PI, _INVERSE_TWO_PI = math.pi, 2.0 * math.pi, 0.5 / math.pi
# angles above it would become more than pi as float32
_BELOW_PI_32 = 0.5 * float(np.float32(np.pi) + np.nextafter(np.float32(np.pi), np.float32(0.0)))


@law
def wrapped(theta: Any) -> Any:
    """Return an angle without whole turns, in [-pi, pi)."""
    turns = (theta + _PI) * _INVERSE_TWO_PI
    whole = (turns + ROUND) - ROUND
    whole = where(whole > turns, whole - 1.0, whole)
    return theta - _TWO_PI * whole


@law
def within(x: Any, limit: float) -> Any:
    """Return a number clipped to +-limit."""
    return where(x > limit, limit, where(x < -limit, -limit, x))


@law
def angle_entry(theta: Any) -> Any:
    """Entry of an angle, which float32 keeps within +-pi."""
    angle = wrapped(theta)
    return where(angle > _BELOW_PI_32, angle - _TWO_PI, angle)


@law
def speed_entry(omega: Any, per_speed: Any, task: Any) -> Any:
    """Entry of an angular velocity beside sines and cosines."""
    return within(omega * per_speed, task[Task.SPEED_LIMIT])


@law
def cart_entries(place: Any, velocity: Any, task: Any) -> tuple[Any, Any]:
    """Entries of the position and the velocity of a cart."""
    place, velocity = place / task[Task.RAIL], velocity * task[Task.PER_CART_SPEED]
    return within(place, MAX_CART_ENTRY), within(velocity, MAX_CART_ENTRY)


@inlined_kernel
def _write_columns(numbers: FloatArray, width: int, columns: ObsArray) -> None:
    """Write numbers, the lane innermost, into some columns of the observations of a group."""
    for i in range(columns.shape[1]):
        for k in range(width):
            columns[k, i] = numbers[i * width + k]


@spliced_kernel
def observe(
    view: NumbersOf, width: int, rods: FloatArray, g: int, theta: FloatArray, omega: FloatArray,
    scratch: FloatArray, observation: ObsArray, task: FloatArray, wiring: FloatArray,
) -> None:  # fmt: skip
    """Write the observations of group `g`.

    Where sines are observed, they and the cosines are in the work space. `theta` and `omega` have
    n + 1 numbers for each sub-environment: that of a cart is the last.
    """
    n, shown = omega.size // width - 1, scratch[Scratch.OBSERVED]
    rows = observation[g * width : (g + 1) * width]
    angles, speeds, numbers = view(theta), view(omega), view(shown)
    last = int(task[Task.AFTER_SINES])
    if last > 0:
        _write_columns(scratch[Scratch.SIN], width, rows[:, last - n : last])
        last = int(task[Task.AFTER_COSINES])
        _write_columns(scratch[Scratch.COS], width, rows[:, last - n : last])
    last = int(task[Task.AFTER_ANGLES])
    if last > 0:
        for i in range(n):
            numbers[i] = angle_entry(angles[i])
        _write_columns(shown, width, rows[:, last - n : last])
    last = int(task[Task.AFTER_SPEEDS])
    if last > 0 and task[Task.AFTER_SINES] > 0.0:
        for i in range(n):
            numbers[i] = speed_entry(speeds[i], wiring[Wiring.PER_SPEED, i], task)
        _write_columns(shown, width, rows[:, last - n : last])
    elif last > 0:
        _write_columns(omega, width, rows[:, last - n : last])
    entries, last = 2 if last > 0 else 1, int(task[Task.AFTER_CART])
    if last > 0:
        numbers[0], numbers[1] = cart_entries(angles[n], speeds[n], task)
        _write_columns(shown, width, rows[:, last - entries : last])
    last = int(task[Task.AFTER_GOALS])
    if last > 0:
        _write_columns(rods[g, Pose.GOAL], width, rows[:, last - n : last])
