"""The classical Runge-Kutta method of order 4 (the paper's appendix C, its Y_4 read as K_4)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import NumbersOf, aligned_zeros, bare, lane, packs
from npend_gym.compiled.jit import inlined_kernel, inner_kernel, kernel, spliced_kernel
from npend_gym.compiled.packs import WIDTH, any_of
from npend_gym.physics.kernels.driven import Torque, driven_accelerations
from npend_gym.physics.kernels.dynamics import WORK_ROWS, AnyArrays, copy
from npend_gym.physics.kernels.pairs import Pair, pair

# Rows of the work space: accelerations of K_1..K_4; velocities of K_2..K_4, which are their q';
# coordinates of the stage; then the rows of `accelerations`
K_4, OMEGA_2, _THETA, WORK = 3, 4, 7, 8
RK4_ROWS = WORK + WORK_ROWS

# As its derivatives need it: without an estimate of the error
RK4: Pair = pair(
    np.diag([0.5, 0.5, 1.0], -1), np.array([1.0, 2.0, 2.0, 1.0]) / 6.0, [0.0, 0.5, 0.5, 1.0], [], 4
)


def new_rk4_scratch(n: int, width: int = 1) -> FloatArray:
    """Return the work space of `rk4_step` for chains of `n` rods."""
    return aligned_zeros(RK4_ROWS, (n + 2) * width)


@inlined_kernel
def _next_stage(
    theta: FloatArray, omega: FloatArray, rate: FloatArray, alpha: FloatArray, h: float,
    x: FloatArray, w: FloatArray,
) -> None:  # fmt: skip
    """Write the state of a stage, theta + h rate and omega + h alpha, into `x` and `w`."""
    for i in range(theta.size):
        x[i] = theta[i] + h * rate[i]
        w[i] = omega[i] + h * alpha[i]


@inlined_kernel
def rk4_sum(first: Any, second: Any, third: Any, fourth: Any) -> Any:
    """Return six times the mean of a quantity over the step, from its values at the stages."""
    return (first + fourth) + 2.0 * (second + third)


@spliced_kernel
def rk4_step(
    t: Any, theta: FloatArray, omega: FloatArray, h: Any, torque: Torque, chain: AnyArrays,
    scratch: FloatArray,
) -> Any:  # fmt: skip
    """Advance a chain, or a pack of them, by one step of `h` seconds from `t`, in place.

    `scratch` has RK4_ROWS rows of n + 2 or more. Afterwards the accelerations at the start of the
    step are in its row 0, those of the last stage, near those at the end, in row K_4. A loop over
    the stages would be compiled sooner, and a tenth slower for short chains.

    Return the energy that drag takes in the step [J].
    """
    n = theta.size
    a1, a2, a3, a4 = scratch[0], scratch[1], scratch[2], scratch[K_4]
    w2, w3, w4 = scratch[OMEGA_2], scratch[OMEGA_2 + 1], scratch[OMEGA_2 + 2]
    x, work = scratch[_THETA][:n], scratch[WORK:]
    power_1 = driven_accelerations(t, theta, omega, torque, chain, work, a1)
    _next_stage(theta, omega, omega, a1, 0.5 * h, x, w2)
    power_2 = driven_accelerations(t + 0.5 * h, x, w2, torque, chain, work, a2)
    _next_stage(theta, omega, w2, a2, 0.5 * h, x, w3)
    power_3 = driven_accelerations(t + 0.5 * h, x, w3, torque, chain, work, a3)
    _next_stage(theta, omega, w3, a3, h, x, w4)
    power_4 = driven_accelerations(t + h, x, w4, torque, chain, work, a4)
    sixth = h / 6.0
    for i in range(n):
        theta[i] += sixth * rk4_sum(omega[i], w2[i], w3[i], w4[i])
    for i in range(n):
        omega[i] += sixth * rk4_sum(a1[i], a2[i], a3[i], a4[i])
    return sixth * rk4_sum(power_1, power_2, power_3, power_4)


# Weights of the stages in the rows of the polynomial between the ends of a step, as `interpolate`
# takes it: the continuous extension of order 3 (Hairer, Norsett, Wanner, section II.6)
DENSE = np.array([[1.0, 2.0, 2.0, 1.0], [5.0, -2.0, -2.0, -1.0], [-4.0, 4.0, 4.0, -4.0]]) / 6.0
_ENDS, _INNER, _LAST = DENSE.T[[0, 1, 3]]


@inner_kernel
def _steps(
    t: float, theta: FloatArray, omega: FloatArray, h: float, count: int, torque: Torque,
    chain: AnyArrays, scratch: FloatArray,
) -> None:  # fmt: skip
    """Take `count` steps: compiled together with what surrounds them, they would be slower."""
    for k in range(count):
        rk4_step(t + k * h, theta, omega, h, torque, chain, scratch)


@inlined_kernel
def _keep_polynomial(h: float, y: FloatArray, scratch: FloatArray, poly: FloatArray) -> None:
    """Write the polynomial of the last step, which began at `y`, into `poly` (3 rows of 2m)."""
    m = y.size // 2
    for p in range(3):
        ends, inner, last = _ENDS[p], _INNER[p], _LAST[p]
        for i in range(m):
            middle = scratch[OMEGA_2, i] + scratch[OMEGA_2 + 1, i]
            whole = ends * y[m + i] + inner * middle + last * scratch[OMEGA_2 + 2, i]
            poly[p * 2 * m + i] = h * whole
            middle = scratch[1, i] + scratch[2, i]
            poly[(2 * p + 1) * m + i] = h * (
                ends * scratch[0, i] + inner * middle + last * scratch[K_4, i]
            )


@spliced_kernel
def _frames(
    view: NumbersOf, width: int, y: FloatArray, times: FloatArray, steps: NDArray[np.int64],
    progress: NDArray[np.int64], rods: tuple[Torque, AnyArrays, FloatArray], frames: FloatArray,
    visited: FloatArray,
) -> bool:  # fmt: skip
    state, (torque, chain, scratch) = view(y), view(rods)
    size, passed = state.size // 2, 0
    theta, omega = state[:size], state[size:]
    while progress[0] < times.size and progress[2] > 0:
        k = progress[0]
        h: Any = (times[k] - times[k - 1]) / steps[k]
        count, t = min(steps[k] - progress[1], progress[2]), times[k - 1] + progress[1] * h
        if visited.shape[1] > 0:
            count = 1
            for j in range(width):
                row = visited[j, passed]
                row[0], row[1] = t, times[k] if progress[1] + 1 == steps[k] else t + h
                copy(lane(state, j), row[2:])
            passed += 1
        _steps(t, theta, omega, h, count, torque, chain, scratch)
        if visited.shape[2] > 2 + 2 * size:
            for j in range(width):
                row = visited[j, passed - 1]
                begin = row[2 : 2 + 2 * size]
                _keep_polynomial(h, begin, lane(scratch, j), row[2 + 2 * size :])
        progress[1] += count
        progress[2] -= count
        if progress[1] < steps[k]:
            continue
        total = state[0]
        for i in range(1, state.size):
            total = total + state[i]
        if any_of(total - total != 0.0):  # not finite
            return False
        for j in range(width):
            copy(lane(state, j), frames[j, k])
        progress[0] += 1
        progress[1] = 0
    return True


@kernel
def rk4_frames(
    y: FloatArray, times: FloatArray, steps: NDArray[np.int64], progress: NDArray[np.int64],
    rods: tuple[Torque, AnyArrays, FloatArray], frames: FloatArray, visited: FloatArray,
) -> bool:  # fmt: skip
    """Write the state y = (q, u) at each time into `frames` (lanes, T, 2m).

    The interval from times[k - 1] to times[k] is cut into steps[k] equal steps. `progress` holds
    the number of frames that are written, the steps taken since the last of them, and the steps
    that this call may take: it stops there, and another call continues from the state `y`. Begin
    and end of each step, and the state at its beginning, are written into a row of `visited`
    (lanes, steps, 2 + 2m), unless that is empty; in a longer row, (lanes, steps, 3 + 8m), the
    polynomial of the step follows, and one entry that is left as it is. `rods` are what drives
    them, their parameters and a work space. Return False where a state diverged, in the interval
    before the frame that was to be written next.
    """
    return _frames(
        bare, 1, y, times, steps, progress, rods, bare(frames), bare(visited)
    )  # fmt: skip


@kernel
def rk4_frames_of_packs(
    y: FloatArray, times: FloatArray, steps: NDArray[np.int64], progress: NDArray[np.int64],
    rods: tuple[Torque, AnyArrays, FloatArray], frames: FloatArray, visited: FloatArray,
) -> bool:  # fmt: skip
    """Do as `rk4_frames` for WIDTH motions side by side."""
    return _frames(
        packs, WIDTH, y, times, steps, progress, rods, bare(frames), bare(visited)
    )  # fmt: skip
