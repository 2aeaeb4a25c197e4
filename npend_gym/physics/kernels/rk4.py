"""The classical Runge-Kutta method of order 4 (the paper's appendix C, its Y_4 read as K_4)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.compiled.aligned import aligned_zeros
from npend_gym.compiled.jit import inlined_kernel, kernel, spliced_kernel
from npend_gym.physics.kernels.dynamics import WORK_ROWS, AnyArrays, accelerations, copy

# Rows of the work space: angular accelerations of K_1..K_4; omega of K_1..K_4, which is their
# theta', and the next; theta of the stage; then the rows of `accelerations`
K_4, OMEGAS, _THETA, WORK = 3, 4, 9, 10
RK4_ROWS = WORK + WORK_ROWS


def new_rk4_scratch(n: int, width: int = 1) -> FloatArray:
    """Return the work space of `rk4_step` for chains of `n` rods."""
    return aligned_zeros(RK4_ROWS, (n + 2) * width)


@inlined_kernel
def _stage(
    k: int, theta: FloatArray, omega: FloatArray, h: float, torque: FloatArray,
    chain: AnyArrays, scratch: FloatArray,
) -> Any:  # fmt: skip
    """Evaluate stage `k` and set the state of the next; return the power of drag [W]."""
    n = theta.size
    x, w, alpha = scratch[_THETA][:n], scratch[OMEGAS + k], scratch[k]
    next_w = scratch[OMEGAS + k + 1]
    power = accelerations(x, w, torque, chain, scratch[WORK:], alpha)
    if k < 3:
        stage_h = h if k == 2 else 0.5 * h
        for i in range(n):
            x[i] = theta[i] + stage_h * w[i]
            next_w[i] = omega[i] + stage_h * alpha[i]
    return power


@inlined_kernel
def _combine(theta: FloatArray, omega: FloatArray, h: float, scratch: FloatArray) -> None:
    """Take the step, Y + h (K_1 + 2 K_2 + 2 K_3 + K_4) / 6, in place; copy it for a stage."""
    a1, a2, a3, a4 = scratch[0], scratch[1], scratch[2], scratch[3]
    w2, w3, w4 = scratch[OMEGAS + 1], scratch[OMEGAS + 2], scratch[OMEGAS + 3]
    sixth = h / 6.0
    for i in range(theta.size):
        theta[i] += sixth * ((omega[i] + w4[i]) + 2.0 * (w2[i] + w3[i]))
    for i in range(theta.size):
        omega[i] += sixth * ((a1[i] + a4[i]) + 2.0 * (a2[i] + a3[i]))


@inlined_kernel
def _begin(theta: FloatArray, omega: FloatArray, scratch: FloatArray) -> None:
    """Let the first stage be evaluated at this state."""
    copy(theta, scratch[_THETA])
    copy(omega, scratch[OMEGAS])


@spliced_kernel
def rk4_step(
    theta: FloatArray, omega: FloatArray, h: float, torque: FloatArray, chain: AnyArrays,
    scratch: FloatArray,
) -> Any:  # fmt: skip
    """Advance a chain, or a pack of them, by one step of `h` seconds, in place.

    `scratch` has RK4_ROWS rows of n + 2 or more. Afterwards the accelerations at the start of the
    step are in its row 0, those of the last stage, near those at the end, in row K_4. One loop over
    the stages, so that Numba compiles the long text of `accelerations` once.

    Return the energy that drag takes in the step [J].
    """
    drag_ends = drag_middle = 0.0 * h
    _begin(theta, omega, scratch)
    for k in range(4):
        power = _stage(k, theta, omega, h, torque, chain, scratch)
        if k == 0 or k == 3:
            drag_ends = drag_ends + power
        else:
            drag_middle = drag_middle + power
    _combine(theta, omega, h, scratch)
    return (h / 6.0) * (drag_ends + 2.0 * drag_middle)


@kernel
def rk4_frames(
    y: FloatArray, times: FloatArray, steps: NDArray[np.int64], progress: NDArray[np.int64],
    torque: FloatArray, chain: AnyArrays, scratch: FloatArray, frames: FloatArray,
) -> bool:  # fmt: skip
    """Write the state (theta, omega) at each time into `frames` (T, 2n).

    The interval from times[k - 1] to times[k] is cut into steps[k] equal steps. `progress` holds
    the number of frames that are written, the steps taken since the last of them, and the steps
    that this call may take: it stops there, and another call continues from the state `y`. Return
    False where the state diverged, in the interval before the frame that was to be written next.
    """
    n = y.size // 2
    theta, omega = y[:n], y[n:]
    while progress[0] < times.size and progress[2] > 0:
        k = progress[0]
        h: Any = (times[k] - times[k - 1]) / steps[k]
        count = min(steps[k] - progress[1], progress[2])
        for _ in range(count):
            rk4_step(theta, omega, h, torque, chain, scratch)
        progress[1] += count
        progress[2] -= count
        if progress[1] < steps[k]:
            return True
        total = 0.0
        for i in range(y.size):
            total += y[i]
        if not math.isfinite(total):
            return False
        copy(y, frames[k])
        progress[0] += 1
        progress[1] = 0
    return True
