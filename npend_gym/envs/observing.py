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
from npend_gym.envs.rows import MAX_CART_ENTRY, SINCOS, Pose, Task
from npend_gym.physics.kernels.layout import Scratch

ObsArray = NDArray[np.float32]

_PI, _TWO_PI, _INVERSE_TWO_PI = math.pi, 2.0 * math.pi, 0.5 / math.pi
_PI_32 = float(np.float32(np.pi))
# angles above it would become _PI_32 as float32, which is more than pi
_BELOW_PI_32 = 0.5 * (_PI_32 + float(np.nextafter(np.float32(np.pi), np.float32(0.0))))


@inlined_kernel
def wrapped(theta: Any) -> Any:
    """Return an angle without whole turns, in [-pi, pi)."""
    turns = (theta + _PI) * _INVERSE_TWO_PI
    whole = (turns + ROUND) - ROUND
    whole = where(whole > turns, whole - 1.0, whole)
    return theta - _TWO_PI * whole


@inlined_kernel
def within(x: Any, limit: float) -> Any:
    """Return a number clipped to +-limit."""
    return where(x > limit, limit, where(x < -limit, -limit, x))


@inlined_kernel
def _write_columns(numbers: FloatArray, width: int, columns: ObsArray) -> None:
    """Write numbers, the lane innermost, into some columns of the observations of a group."""
    for i in range(columns.shape[1]):
        for k in range(width):
            columns[k, i] = numbers[i * width + k]


@spliced_kernel
def observe(
    view: NumbersOf, width: int, rods: FloatArray, g: int, theta: FloatArray, omega: FloatArray,
    scratch: FloatArray, observation: ObsArray, task: FloatArray, per_speed: FloatArray,
) -> None:  # fmt: skip
    """Write the observations of group `g`.

    Where sines are observed, they and the cosines are in the work space. `theta` and `omega` have
    n + 1 numbers for each sub-environment: that of a cart is the last.
    """
    n, shown = omega.size // width - 1, scratch[Scratch.OBSERVED]
    rows, column = observation[g * width : (g + 1) * width], n
    angles, speeds, numbers = view(theta), view(omega), view(shown)
    sines, velocities = task[Task.FORM] == SINCOS, task[Task.VELOCITIES] > 0.0
    if sines:
        column = 2 * n
        _write_columns(scratch[Scratch.SIN], width, rows[:, :n])
        _write_columns(scratch[Scratch.COS], width, rows[:, n:column])
    else:
        for i in range(n):
            angle = wrapped(angles[i])
            numbers[i] = where(angle > _BELOW_PI_32, -_PI_32, angle)
        _write_columns(shown, width, rows[:, :n])
    if velocities:
        if sines:
            for i in range(n):
                numbers[i] = within(speeds[i] * per_speed[i], task[Task.SPEED_LIMIT])
            _write_columns(shown, width, rows[:, column : column + n])
        else:
            _write_columns(omega, width, rows[:, column : column + n])
        column += n
    if task[Task.RAIL] > 0.0:
        numbers[0] = within(angles[n] / task[Task.RAIL], MAX_CART_ENTRY)
        numbers[1] = within(speeds[n] * task[Task.PER_CART_SPEED], MAX_CART_ENTRY)
        entries = 2 if velocities else 1
        _write_columns(shown, width, rows[:, column : column + entries])
        column += entries
    if task[Task.OBSERVED_GOALS] > 0.0:
        _write_columns(rods[g, Pose.GOAL], width, rows[:, column : column + n])
