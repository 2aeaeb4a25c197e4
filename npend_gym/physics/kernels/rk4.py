"""The classical Runge-Kutta method of order 4 (the paper's appendix C, its Y_4 read as K_4)."""

from __future__ import annotations

import math

from npend_gym._checks import FloatArray
from npend_gym.compiled.jit import inlined_kernel, inner_kernel, kernel
from npend_gym.physics.kernels.dynamics import Rods, accelerations, copy

STAGE_ROWS = 8


@inner_kernel
def _stage(
    theta: FloatArray, omega: FloatArray, rate: FloatArray, alpha: FloatArray, h: float,
    x: FloatArray, w: FloatArray,
) -> None:  # fmt: skip
    """Write the stage state theta + h rate, omega + h alpha into `x` and `w`."""
    for i in range(x.size):
        x[i] = theta[i] + h * rate[i]
        w[i] = omega[i] + h * alpha[i]


@inlined_kernel
def rk4_step(
    theta: FloatArray, omega: FloatArray, h: float, torque: FloatArray, rods: Rods,
    work: FloatArray, stages: FloatArray,
) -> float:  # fmt: skip
    """Advance a chain, or a pack of them, by one step of `h` seconds, in place.

    Return the energy that drag takes [J].

    Arrays are as in `accelerations`, `stages` has STAGE_ROWS rows of n or more. A stage's theta'
    is its own omega: rows 0 to 3 keep the angular accelerations of K_1..K_4, rows 4 to 6 the omega
    of K_2..K_4.
    """
    n = theta.size
    a1, a2, a3, a4 = stages[0][:n], stages[1][:n], stages[2][:n], stages[3][:n]
    w2, w3, w4, x = stages[4][:n], stages[5][:n], stages[6][:n], stages[7][:n]
    power_1 = accelerations(theta, omega, torque, rods, work, a1)
    _stage(theta, omega, omega, a1, 0.5 * h, x, w2)
    power_2 = accelerations(x, w2, torque, rods, work, a2)
    _stage(theta, omega, w2, a2, 0.5 * h, x, w3)
    power_3 = accelerations(x, w3, torque, rods, work, a3)
    _stage(theta, omega, w3, a3, h, x, w4)
    power_4 = accelerations(x, w4, torque, rods, work, a4)
    sixth = h / 6.0
    for i in range(n):
        theta[i] += sixth * ((omega[i] + w4[i]) + 2.0 * (w2[i] + w3[i]))
    for i in range(n):
        omega[i] += sixth * ((a1[i] + a4[i]) + 2.0 * (a2[i] + a3[i]))
    return sixth * ((power_1 + power_4) + 2.0 * (power_2 + power_3))


@kernel
def rk4_frames(
    y: FloatArray,
    times: FloatArray,
    dt: float,
    done: int,
    step: int,
    max_steps: int,
    torque: FloatArray,
    rods: Rods,
    work: FloatArray,
    stages: FloatArray,
    frames: FloatArray,
) -> tuple[int, int]:
    """Write the state at each time from index `done` on into `frames` (T, 2n).

    Each interval between times is cut into equal steps, the fewest that are no longer than `dt`;
    `step` of the first one have been taken. Return the number of frames written, and of steps
    beyond, after at most `max_steps` steps; minus that number of frames where the state diverged.
    """
    n = y.size // 2
    theta, omega = y[:n], y[n:]
    for k in range(done, times.size):
        interval: float = times[k] - times[k - 1]
        steps = max(1, math.ceil(interval / dt - 1e-9))
        last = min(steps, step + max_steps)
        max_steps -= last - step
        for _ in range(step, last):
            rk4_step(theta, omega, interval / steps, torque, rods, work, stages)
        if last < steps:
            return k, last
        step = 0
        total = 0.0
        for i in range(y.size):
            total += y[i]
        if not math.isfinite(total):
            return -k, 0
        copy(y, frames[k])
    return times.size, 0
