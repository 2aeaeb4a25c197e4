"""An integration in progress: its state, and the polynomial of the last step."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import aligned_zeros
from npend_gym.compiled.jit import inlined_kernel, inner_kernel
from npend_gym.physics.kernels.driven import Torque
from npend_gym.physics.kernels.dynamics import AnyArrays

# Of lanes: whether they go on (`STUCK`: no step is small enough), and whether a step was taken
STATUS, TAKEN = range(2)
RUNNING, DONE, STUCK = 0.0, 1.0, -1.0
MAX_FACTOR = 10.0  # by which a step grows
RESOLUTION = 10.0 * math.ulp(1.0)  # a step below this fraction of t is treated as zero


class Solver(NamedTuple):
    """An integration in progress, or a pack of them: all arrays, written in place."""

    clock: FloatArray  # t_old, t, size of the next step, and one that the method uses, (4,)
    y_old: FloatArray  # state before the last step (2n,)
    y: FloatArray  # state (2n,)
    k: FloatArray  # derivatives, in rows of which the method has the meaning (rows, 2n)
    poly: FloatArray  # dense output of the last step (powers, 2n)
    work: FloatArray  # of the method
    counts: FloatArray  # steps taken, steps refused, steps with dense output, (3,)


class Problem(NamedTuple):
    """What is integrated, and how exactly."""

    chain: AnyArrays
    torque: Torque  # N m at joints 0..n-1, (n,)
    rtol: float
    atol: float


def new_solver(t: float, y: FloatArray, rows: tuple[int, int, int], width: int = 1) -> Solver:
    """Return a solver that stands at time `t` in state `y` = (theta, omega), lanes innermost.

    `rows` are those of `k`, of `poly` and of `work`.
    """
    slopes, powers, of_work = rows
    states = aligned_zeros(2 + slopes + powers, y.size)
    states[:2] = y
    clock = np.repeat([t, t, 0.0, 0.0], width)
    work = aligned_zeros(of_work, (y.size // width // 2 + 2) * width)
    k, poly = states[2 : 2 + slopes], states[2 + slopes :]
    return Solver(clock, states[0], states[1], k, poly, work, np.zeros(3 * width))


@inlined_kernel
def state_at(solver: Solver, x: float, j: int) -> tuple[float, float]:
    """Return component `j` of the state at the fraction `x` of the last step, and its slope."""
    poly, u = solver.poly, 1.0 - x
    p = poly[poly.shape[0] - 1, j]
    d = 0.0 * p
    for row in range(poly.shape[0] - 2, -1, -1):  # multiplied by x and by 1 - x in turn
        if row % 2 == 1:
            d = d * x + p
            p = p * x + poly[row, j]
        else:
            d = d * u - p
            p = p * u + poly[row, j]
    return solver.y_old[j] + p * x, d * x + p


@inner_kernel
def interpolate(solver: Solver, x: float, out: FloatArray) -> None:
    """Write the state at the fraction `x` of the last step into `out` (2n,)."""
    for i in range(out.size):
        out[i], _ = state_at(solver, x, i)
