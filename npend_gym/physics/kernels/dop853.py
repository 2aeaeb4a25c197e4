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
from npend_gym.physics.kernels.dynamics import Rods, copy, derivative, new_work
from npend_gym.physics.kernels.jit import kernel

STAGES = 12
_ROWS = 16  # 12 stages, the derivative at the new point, 3 more for dense output
_A = np.zeros((_ROWS, _ROWS))
_A[:STAGES, :STAGES] = DOP853.A
_A[STAGES, :STAGES] = DOP853.B
_A[STAGES + 1 :] = DOP853.A_EXTRA
_E5, _E3, _D = np.array(DOP853.E5), np.array(DOP853.E3), np.array(DOP853.D)
_SAFETY, _MIN_FACTOR, _MAX_FACTOR = 0.9, 0.2, 10.0
_POWERS = 7  # rows of the interpolation polynomial
_RESOLUTION = 10.0 * float(np.finfo(float).eps)  # a step below this part of t is none


class Solver(NamedTuple):
    """An integration in progress: state, step and scratch, all arrays, written in place."""

    clock: FloatArray  # t_old, t, size of the next step
    y_old: FloatArray  # state before the last step (2n,)
    y: FloatArray  # state (2n,)
    k: FloatArray  # derivatives at the stages (16, 2n)
    poly: FloatArray  # dense output of the last step (7, 2n)
    work: FloatArray  # for `accelerations`


def new_solver(t: float, y: FloatArray) -> Solver:
    """Return a solver that stands at time `t` in state `y` = (theta, omega)."""
    k, poly = np.zeros((_ROWS, y.size)), np.zeros((_POWERS, y.size))
    return Solver(np.array([t, t, 0.0]), y.copy(), y.copy(), k, poly, new_work(y.size // 2))


@kernel
def _scaled_norm(x: FloatArray, y: FloatArray, rtol: float, atol: float) -> float:
    total = 0.0
    for i in range(x.size):
        r = x[i] / (atol + rtol * abs(y[i]))
        total += r * r
    return math.sqrt(total / x.size)


@kernel
def start(solver: Solver, rods: Rods, torque: FloatArray, rtol: float, atol: float) -> None:
    """Take the first derivative and choose the first step (Hairer et al., section II.4)."""
    y, k, poly = solver.y, solver.k, solver.poly
    derivative(y, torque, rods, solver.work, k[STAGES])
    d0 = _scaled_norm(y, y, rtol, atol)
    d1 = _scaled_norm(k[STAGES], y, rtol, atol)
    h0 = 1e-6 if d0 < 1e-5 or d1 < 1e-5 else 0.01 * d0 / d1
    for i in range(y.size):
        poly[0, i] = y[i] + h0 * k[STAGES, i]
    derivative(poly[0], torque, rods, solver.work, k[0])
    for i in range(y.size):
        poly[0, i] = k[0, i] - k[STAGES, i]
    d2 = _scaled_norm(poly[0], y, rtol, atol) / h0
    steepest = max(d1, d2)
    # the eighth root by square roots, which are the same on every machine; pow is not
    h1 = max(1e-6, h0 * 1e-3)
    if steepest > 1e-15:
        h1 = math.sqrt(math.sqrt(math.sqrt(0.01 / steepest)))
    solver.clock[2] = min(100.0 * h0, h1)


@kernel
def _stage(s: int, h: float, solver: Solver, x: FloatArray) -> None:
    """Write the state at which stage `s` is taken into `x`: y_old + h sum_j a_sj k_j."""
    k, y_old = solver.k, solver.y_old
    for i in range(x.size):
        x[i] = _A[s, 0] * k[0, i]
    for j in range(1, s):
        a = _A[s, j]
        if a != 0.0:
            for i in range(x.size):
                x[i] += a * k[j, i]
    for i in range(x.size):
        x[i] = y_old[i] + h * x[i]


@kernel
def _error(h: float, solver: Solver, rtol: float, atol: float) -> float:
    """Return the error of the step over its tolerance, from the estimates of order 5 and 3."""
    y_old, y, k = solver.y_old, solver.y, solver.k
    sum5 = 0.0
    sum3 = 0.0
    for i in range(y.size):
        e5 = 0.0
        e3 = 0.0
        for s in range(STAGES):
            e5 += _E5[s] * k[s, i]
            e3 += _E3[s] * k[s, i]
        scale = atol + rtol * max(abs(y_old[i]), abs(y[i]))
        sum5 += (e5 / scale) * (e5 / scale)
        sum3 += (e3 / scale) * (e3 / scale)
    if sum5 == 0.0:
        return 0.0
    return h * sum5 / math.sqrt((sum5 + 0.01 * sum3) * y.size)


@kernel
def step(
    solver: Solver, t_end: float, rods: Rods, torque: FloatArray, rtol: float, atol: float
) -> bool:
    """Take one step, not beyond `t_end`; return False where no step is small enough."""
    clock, y_old, y, k, x = solver.clock, solver.y_old, solver.y, solver.k, solver.poly[0]
    t = clock[1]
    wanted = clock[2]
    copy(y, y_old)
    copy(k[STAGES], k[0])
    largest = _MAX_FACTOR
    while True:
        h = t_end - t
        if wanted < 0.99 * h:  # no sliver is left for a last step of its own
            h = wanted
        if not h > _RESOLUTION * abs(t):  # also where h is not a number
            copy(y_old, y)
            return False
        for s in range(1, STAGES):
            _stage(s, h, solver, x)
            derivative(x, torque, rods, solver.work, k[s])
        _stage(STAGES, h, solver, y)
        error = _error(h, solver, rtol, atol)
        factor = _MIN_FACTOR  # also where the error is not a number
        if error >= 0.0:
            root = math.sqrt(math.sqrt(math.sqrt(error)))
            factor = largest if root * largest <= _SAFETY else max(_MIN_FACTOR, _SAFETY / root)
        if error < 1.0:
            break
        wanted = h * factor
        largest = 1.0
    derivative(y, torque, rods, solver.work, k[STAGES])
    clock[0] = t
    clock[1] = t_end if h == t_end - t else t + h
    clock[2] = max(wanted, h * factor) if h < wanted else h * factor
    return True


@kernel
def prepare_dense(solver: Solver, rods: Rods, torque: FloatArray) -> None:
    """Fit the interpolation polynomial to the last step: three more stages."""
    y_old, y, k, poly = solver.y_old, solver.y, solver.k, solver.poly
    h = solver.clock[1] - solver.clock[0]
    for s in range(STAGES + 1, _ROWS):
        _stage(s, h, solver, poly[0])
        derivative(poly[0], torque, rods, solver.work, k[s])
    for p in range(3, _POWERS):
        for i in range(y.size):
            poly[p, i] = (h * _D[p - 3, 0]) * k[0, i]
        for s in range(1, _ROWS):
            d = h * _D[p - 3, s]
            if d != 0.0:
                for i in range(y.size):
                    poly[p, i] += d * k[s, i]
    for i in range(y.size):
        delta = y[i] - y_old[i]
        poly[0, i] = delta
        poly[1, i] = h * k[0, i] - delta
        poly[2, i] = 2.0 * delta - h * (k[STAGES, i] + k[0, i])


@kernel
def interpolate(solver: Solver, x: float, out: FloatArray) -> None:
    """Write the state at the fraction `x` of the last step into `out` (2n,)."""
    y_old, poly = solver.y_old, solver.poly
    u = 1.0 - x
    for i in range(out.size):
        p = poly[6, i] * x
        p = (p + poly[5, i]) * u
        p = (p + poly[4, i]) * x
        p = (p + poly[3, i]) * u
        p = (p + poly[2, i]) * x
        p = (p + poly[1, i]) * u
        out[i] = y_old[i] + (p + poly[0, i]) * x


@kernel
def dop853_frames(
    solver: Solver,
    times: FloatArray,
    done: int,
    max_steps: int,
    rods: Rods,
    torque: FloatArray,
    rtol: float,
    atol: float,
    frames: FloatArray,
) -> int:
    """Write the state at each time from index `done` on into `frames` (T, 2n).

    Return the number of frames written after at most `max_steps` steps, or minus that number where
    the integration cannot go on.
    """
    clock = solver.clock
    for _ in range(max_steps):
        if done == times.size:
            break
        if not step(solver, times[-1], rods, torque, rtol, atol):
            return -done
        dense = False
        while done < times.size and times[done] <= clock[1]:
            if times[done] == clock[1]:
                copy(solver.y, frames[done])
            else:
                if not dense:
                    prepare_dense(solver, rods, torque)
                    dense = True
                x = (times[done] - clock[0]) / (clock[1] - clock[0])
                interpolate(solver, x, frames[done])
            done += 1
    return done
