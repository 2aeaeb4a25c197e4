"""The adaptive method of Dormand and Prince, order 8(5,3), with dense output of order 7.

E. Hairer, S. P. Norsett, G. Wanner, "Solving Ordinary Differential Equations I", section II.5 and
II.10; the coefficients are read from scipy.integrate.DOP853, the step control is the same.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.integrate import DOP853

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import aligned_zeros
from npend_gym.compiled.jit import inlined_kernel, inner_kernel
from npend_gym.compiled.packs import any_of, where
from npend_gym.physics.kernels.driven import Torque, slope
from npend_gym.physics.kernels.dynamics import AnyArrays, copy, new_work

STAGES = 12
_ROWS = 16  # 12 stages, the derivative at the new point, 3 more for dense output
TABLEAU = _A = np.zeros((_ROWS, _ROWS))  # in its row STAGES the end of the step
_A[:STAGES, :STAGES] = DOP853.A
_A[STAGES, :STAGES] = DOP853.B
_A[STAGES + 1 :] = DOP853.A_EXTRA
INSTANTS = _C = np.concatenate([DOP853.C, [1.0], DOP853.C_EXTRA])  # of the stages, in steps
_E5, _E3, _D = np.array(DOP853.E5), np.array(DOP853.E3), np.array(DOP853.D)
_SAFETY, _MIN_FACTOR, _MAX_FACTOR = 0.9, 0.2, 10.0
POWERS = 7  # rows of the interpolation polynomial
# Of lanes: whether they go on (`STUCK`: no step is small enough), and whether a step was taken
STATUS, TAKEN = range(2)
RUNNING, DONE, STUCK = 0.0, 1.0, -1.0
_RESOLUTION = 10.0 * math.ulp(1.0)  # a step below this fraction of t is treated as zero


class Solver(NamedTuple):
    """An integration in progress, or a pack of them: all arrays, written in place."""

    clock: FloatArray  # t_old, t, size of the next step, the most it may grow after, (4,)
    y_old: FloatArray  # state before the last step (2n,)
    y: FloatArray  # state (2n,)
    k: FloatArray  # derivatives at the stages; row 12: that at y (16, 2n)
    poly: FloatArray  # dense output of the last step (7, 2n)
    work: FloatArray  # for `accelerations`
    counts: FloatArray  # steps taken, steps refused, steps with dense output, (3,)


class Problem(NamedTuple):
    """What is integrated, and how exactly."""

    chain: AnyArrays
    torque: Torque  # N m at joints 0..n-1, (n,)
    rtol: float
    atol: float


def new_solver(t: float, y: FloatArray, width: int = 1) -> Solver:
    """Return a solver that stands at time `t` in state `y` = (theta, omega), lanes innermost."""
    rows = aligned_zeros(2 + _ROWS + POWERS, y.size)
    rows[:2] = y
    clock = np.repeat([t, t, 0.0, _MAX_FACTOR], width)
    work = new_work(y.size // width // 2, width)
    count = np.zeros(3 * width)
    return Solver(clock, rows[0], rows[1], rows[2 : 2 + _ROWS], rows[2 + _ROWS :], work, count)


@inlined_kernel
def _larger(a: float, b: float) -> float:
    return where(a > b, a, b)


@inlined_kernel
def _eighth_root(x: float) -> float:
    """Return the eighth root by square roots, the same on every machine; pow is not."""
    return math.sqrt(math.sqrt(math.sqrt(x)))


@inlined_kernel
def _scaled_norm(x: FloatArray, y: FloatArray, problem: Problem) -> float:
    total = 0.0
    for i in range(x.size):
        r = x[i] / (problem.atol + problem.rtol * abs(y[i]))
        total = total + r * r
    return math.sqrt(total / x.size)


@inner_kernel
def start(solver: Solver, problem: Problem, longest: float) -> None:
    """Take the first derivative and choose the first step (Hairer et al., section II.4).

    No function is called later than `longest` [s] after the start.
    """
    y, k, poly, work = solver.y, solver.k, solver.poly, solver.work
    chain, torque, t = problem.chain, problem.torque, solver.clock[1]
    slope(t, y, torque, chain, work, k[STAGES])
    d0 = _scaled_norm(y, y, problem)
    d1 = _scaled_norm(k[STAGES], y, problem)
    small = (d0 < 1e-5) | (d1 < 1e-5)
    h0 = where(small, 1e-6, 0.01 * d0 / where(small, 1.0, d1))
    h0 = where(h0 < longest, h0, longest)
    for i in range(y.size):
        poly[0, i] = y[i] + h0 * k[STAGES, i]
    slope(t + h0, poly[0], torque, chain, work, k[0])
    for i in range(y.size):
        poly[0, i] = k[0, i] - k[STAGES, i]
    steepest = _larger(d1, _scaled_norm(poly[0], y, problem) / h0)
    flat = steepest <= 1e-15
    steady = _larger(h0 * 1e-3, 1e-6)
    h1 = where(flat, steady, _eighth_root(0.01 / where(flat, 1.0, steepest)))
    solver.clock[2] = where(h1 < 100.0 * h0, h1, 100.0 * h0)


@inlined_kernel
def _stage(s: int, h: float, k: FloatArray, y: FloatArray, x: FloatArray) -> None:
    """Write the state at which stage `s` is taken into `x`: y + h sum_j a_sj k_j."""
    for i in range(x.size):
        x[i] = _A[s, 0] * k[0, i]
    for j in range(1, s):
        a = _A[s, j]
        if a != 0.0:
            for i in range(x.size):
                x[i] += a * k[j, i]
    for i in range(x.size):
        x[i] = y[i] + h * x[i]


@inlined_kernel
def _error(h: float, k: FloatArray, y: FloatArray, y_new: FloatArray, problem: Problem) -> float:
    """Return the error of the step over its tolerance, from the estimates of order 5 and 3."""
    sum5 = sum3 = 0.0
    for i in range(y.size):
        e5 = e3 = 0.0
        for s in range(STAGES):
            e5 = e5 + _E5[s] * k[s, i]
            e3 = e3 + _E3[s] * k[s, i]
        scale = problem.atol + problem.rtol * _larger(abs(y_new[i]), abs(y[i]))
        sum5 = sum5 + (e5 / scale) * (e5 / scale)
        sum3 = sum3 + (e3 / scale) * (e3 / scale)
    none = sum5 == 0.0
    both = where(none, 1.0, (sum5 + 0.01 * sum3) * y.size)
    return where(none, 0.0, h * sum5 / math.sqrt(both))


@inner_kernel
def attempt(solver: Solver, t_end: float, problem: Problem) -> float:
    """Try one step, not beyond `t_end`. Where the error is small enough, take it.

    Return 1.0 where it was taken, 0.0 where a smaller one is to be tried, -1.0 where no step is
    small enough.
    """
    clock, y_old, y, k, work = solver.clock, solver.y_old, solver.y, solver.k, solver.work
    chain, torque, count = problem.chain, problem.torque, solver.counts
    x, y_new = solver.poly[0], solver.poly[1]
    t, wanted, largest = clock[1], clock[2], clock[3]
    rest = t_end - t
    # a remainder below 1 % of the step is taken with it
    h = where(wanted < 0.99 * rest, wanted, rest)
    copy(k[STAGES], k[0])
    for s in range(1, STAGES):
        _stage(s, h, k, y, x)
        slope(t + _C[s] * h, x, torque, chain, work, k[s])
    _stage(STAGES, h, k, y, y_new)
    error = _error(h, k, y, y_new, problem)
    root = _eighth_root(error)
    factor = where(root * largest <= _SAFETY, largest, _larger(_SAFETY / root, _MIN_FACTOR))
    factor = where(error >= 0.0, factor, _MIN_FACTOR)  # the error may be NaN
    # two ends, such as instants of two signals, may be as near as rounding
    enough = (h > _RESOLUTION * abs(t)) | ((h == rest) & (rest > 0.0))
    taken = enough & (error < 1.0)
    if any_of(taken):
        slope(t + h, y_new, torque, chain, work, k[STAGES])
        for i in range(y.size):
            y_old[i] = where(taken, y[i], y_old[i])
            y[i] = where(taken, y_new[i], y[i])
            k[STAGES, i] = where(taken, k[STAGES, i], k[0, i])
    grown = where(h < wanted, _larger(h * factor, wanted), h * factor)
    clock[0] = where(taken, t, clock[0])
    clock[1] = where(taken, where(h == rest, t_end, t + h), t)
    clock[2] = where(taken, grown, h * factor)
    clock[3] = where(taken, _MAX_FACTOR, 1.0)
    count[0] = count[0] + where(taken, 1.0, 0.0)
    count[1] = count[1] + where(enough & (error >= 1.0), 1.0, 0.0)
    return where(taken, 1.0, where(enough, 0.0, -1.0))


@inner_kernel
def prepare_dense(solver: Solver, problem: Problem) -> None:
    """Fit the interpolation polynomial to the last step: three more stages."""
    y_old, y, k, poly, work = solver.y_old, solver.y, solver.k, solver.poly, solver.work
    chain, torque, t = problem.chain, problem.torque, solver.clock[0]
    h = solver.clock[1] - t
    for s in range(STAGES + 1, _ROWS):
        _stage(s, h, k, y_old, poly[0])
        slope(t + _C[s] * h, poly[0], torque, chain, work, k[s])
    for p in range(3, POWERS):
        for i in range(y.size):
            poly[p, i] = (h * _D[p - 3, 0]) * k[0, i]
        for s in range(1, _ROWS):
            d = _D[p - 3, s]
            if d != 0.0:
                for i in range(y.size):
                    poly[p, i] += (h * d) * k[s, i]
    for i in range(y.size):
        delta = y[i] - y_old[i]
        poly[0, i] = delta
        poly[1, i] = h * k[0, i] - delta
        poly[2, i] = 2.0 * delta - h * (k[STAGES, i] + k[0, i])


def dense_weights(x: FloatArray) -> FloatArray:
    """Return the weights of the stages at fractions `x` (F,) of a step, (F, stages).

    The state there is y_old + h sum_s weights_s k_s, as `interpolate` has it.
    """
    ends, last = np.eye(_ROWS)[[0, STAGES]], _A[STAGES]
    rows = [last, ends[0] - last, 2.0 * last - ends[0] - ends[1], *_D]
    u = 1.0 - x
    powers = np.cumprod(np.array([x, u, x, u, x, u, x]), axis=0)
    return np.asarray(powers.T @ np.array(rows), np.float64)


@inlined_kernel
def state_at(solver: Solver, x: float, j: int) -> tuple[float, float]:
    """Return component `j` of the state at the fraction `x` of the last step, and its slope."""
    poly, u = solver.poly, 1.0 - x
    p = poly[6, j]
    d = 0.0 * p
    for row in range(5, -1, -1):  # multiplied by x and by 1 - x in turn
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
