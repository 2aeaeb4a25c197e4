"""The classical Runge-Kutta method of order 4 (the paper's appendix C, its Y_4 read as K_4)."""

from __future__ import annotations

import math

from npend_gym._checks import FloatArray
from npend_gym.physics.kernels.dynamics import Rods, copy, derivative
from npend_gym.physics.kernels.jit import kernel

STAGE_ROWS = 5  # K_1..K_4 and the state at which the next is taken


@kernel
def rk4_step(
    y: FloatArray,
    h: float,
    torque: FloatArray,
    rods: Rods,
    work: FloatArray,
    stages: FloatArray,
) -> None:
    """Advance the state y = (theta, omega) by one step of `h` seconds, in place."""
    k1, k2, k3, k4, x = stages[0], stages[1], stages[2], stages[3], stages[4]
    derivative(y, torque, rods, work, k1)
    for i in range(y.size):
        x[i] = y[i] + (0.5 * h) * k1[i]
    derivative(x, torque, rods, work, k2)
    for i in range(y.size):
        x[i] = y[i] + (0.5 * h) * k2[i]
    derivative(x, torque, rods, work, k3)
    for i in range(y.size):
        x[i] = y[i] + h * k3[i]
    derivative(x, torque, rods, work, k4)
    for i in range(y.size):
        y[i] += (h / 6.0) * ((k1[i] + k4[i]) + 2.0 * (k2[i] + k3[i]))


@kernel
def rk4_frames(
    y: FloatArray,
    times: FloatArray,
    dt: float,
    torque: FloatArray,
    rods: Rods,
    work: FloatArray,
    stages: FloatArray,
    frames: FloatArray,
) -> int:
    """Write the state at each time into `frames` (T, 2n); return how many are finite.

    Each interval between times is cut into equal steps, the fewest that are no longer than `dt`.
    """
    copy(y, frames[0])
    for k in range(1, times.size):
        interval = times[k] - times[k - 1]
        steps = max(1, int(math.ceil(interval / dt - 1e-9)))
        for _ in range(steps):
            rk4_step(y, interval / steps, torque, rods, work, stages)
        total = 0.0
        for i in range(y.size):
            total += y[i]
        if not math.isfinite(total):
            return k
        copy(y, frames[k])
    return times.size
