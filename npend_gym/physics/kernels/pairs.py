"""Embedded pairs of explicit Runge-Kutta methods: steps of adaptive length, with dense output.

A pair is data, see `Pair`. E. Hairer, S. P. Norsett, G. Wanner, "Solving Ordinary Differential
Equations I", section II.4 has the control of steps, and II.10 that of DOP853, as in SciPy.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from npend_gym._checks import FloatArray
from npend_gym.compiled.jit import inlined_kernel, inner_kernel
from npend_gym.compiled.packs import any_of, where
from npend_gym.physics.kernels.driven import slope
from npend_gym.physics.kernels.dynamics import WORK_ROWS, copy
from npend_gym.physics.kernels.solver import MAX_FACTOR, RESOLUTION, Problem, Solver

_SAFETY, _MIN_FACTOR = 0.9, 0.2
_CLOCK = 1e-9  # of a step: by more the rounding of the clock counts


class Pair(NamedTuple):
    """The coefficients of a pair, as kernels take them.

    Its rows are the stages, the slope at the end of the step, and more stages for dense output.
    """

    tableau: FloatArray  # a, (rows, rows); the row behind the stages has the weights of the end
    instants: FloatArray  # c, in steps, (rows,)
    # Weights of the estimates of the error, (1 or 2, stages), or of a stage more where they need
    # the slope at the end; the second damps the first, as in DOP853
    errors: FloatArray
    dense: FloatArray  # weights of what the polynomial has beyond a cubic, (powers - 3, rows)
    stages: int
    exponent: float  # a step shrinks with this root of the error; a multiple of 2^-8

    conservative = False  # for chains of any kind

    @property
    def adaptive(self) -> bool:
        """Whether steps follow from tolerances, and not from their length."""
        return self.errors.size > 0

    @property
    def end(self) -> FloatArray:
        """Weights of the rows at the end of a step."""
        return self.tableau[self.stages].copy()

    @property
    def rows(self) -> tuple[int, int, int]:
        """As for `new_solver`."""
        return len(self.tableau), 3 + len(self.dense), WORK_ROWS

    @property
    def evaluations(self) -> tuple[int, int, int]:
        """Evaluations of the equations in a step, in one that is tried in vain, in dense output."""
        early = self.errors.shape[1] > self.stages
        return self.stages, self.stages - (not early), len(self.tableau) - self.stages - 1

    def weights(self, x: FloatArray) -> FloatArray:
        """Return the weights of the rows at fractions `x` (F,) of a step, (F, rows).

        The state there is y_old + h sum_s weights_s k_s, as `interpolate` has it.
        """
        ends, last = np.eye(len(self.tableau))[[0, self.stages]], self.tableau[self.stages]
        rows = [last, ends[0] - last, 2.0 * last - ends[0] - ends[1], *self.dense]
        powers = np.cumprod([(1.0 - x) if row % 2 else x for row in range(len(rows))], axis=0)
        return np.asarray(powers.T @ np.array(rows), np.float64)


def pair(
    stages: ArrayLike,
    weights: ArrayLike,
    instants: ArrayLike,
    errors: ArrayLike,
    order: int,
    more: tuple[ArrayLike, ArrayLike] = ((), ()),
    dense: ArrayLike = (),
) -> Pair:
    """Return a pair by its coefficients.

    Parameters
    ----------
    stages : array_like, shape (s, s)
    weights, instants : array_like, shape (s,)
    errors : array_like, shape (s,) or (s + 1,), or two rows of these
        See `Pair`.
    order : int
        Of the estimate of the error.
    more : tuple
        Rows of the tableau (k, s + 1 + k), and instants (k,), of stages for dense output alone.
    dense : array_like, shape (powers - 3, s + 1 + k)
        Weights of x^2 (1 - x)^2, x^3 (1 - x)^2, x^3 (1 - x)^3 and so on, beside the cubic that has
        the states and slopes at both ends.
    """
    tableau, more_stages = np.array(stages, float), np.array(more[0], float)
    count, extra = len(tableau), len(more_stages)
    whole = np.zeros((count + 1 + extra, count + 1 + extra))
    whole[:count, :count], whole[count, :count] = tableau, weights
    whole[count + 1 :, : more_stages.shape[-1] if extra else 0] = more_stages
    return Pair(
        whole, np.concatenate([np.array(instants, float), [1.0], more[1]]),
        np.atleast_2d(np.array(errors, float)), np.array(dense, float).reshape(-1, len(whole)),
        count, round(256 / (order + 1)) / 256,
    )  # fmt: skip


@inlined_kernel
def _larger(a: float, b: float) -> float:
    return where(a > b, a, b)


@inlined_kernel
def _root(x: Any, exponent: float) -> Any:
    """Return x to a power below 1 by square roots, the same on every machine; pow is not."""
    root: Any = where(x > 0.0, 1.0, 1.0)
    while exponent > 0.0:
        x, exponent = math.sqrt(x), 2.0 * exponent
        if exponent >= 1.0:
            root, exponent = root * x, exponent - 1.0
    return root


@inlined_kernel
def _scaled_norm(x: FloatArray, y: FloatArray, problem: Problem) -> float:
    total = 0.0
    for i in range(x.size):
        r = x[i] / (problem.atol + problem.rtol * abs(y[i]))
        total = total + r * r
    return math.sqrt(total / x.size)


@inner_kernel
def start(solver: Solver, problem: Problem, method: Pair, rest: float, longest: float) -> None:
    """Take the first derivative and choose the first step (Hairer et al., section II.4).

    No function is called later than `rest` or `longest` [s] after the start.
    """
    y, k, poly, work = solver.y, solver.k, solver.poly, solver.work
    chain, torque, t, end = problem.chain, problem.torque, solver.clock[1], method.stages
    longest = where(rest < longest, rest, longest)
    solver.clock[3] = where(rest > 0.0, MAX_FACTOR, MAX_FACTOR)
    slope(t, y, torque, chain, work, k[end])
    d0 = _scaled_norm(y, y, problem)
    d1 = _scaled_norm(k[end], y, problem)
    small = (d0 < 1e-5) | (d1 < 1e-5)
    h0 = where(small, 1e-6, 0.01 * d0 / where(small, 1.0, d1))
    h0 = where(h0 < longest, h0, longest)
    for i in range(y.size):
        poly[0, i] = y[i] + h0 * k[end, i]
    slope(t + h0, poly[0], torque, chain, work, k[0])
    for i in range(y.size):
        poly[0, i] = k[0, i] - k[end, i]
    steepest = _larger(d1, _scaled_norm(poly[0], y, problem) / h0)
    flat = steepest <= 1e-15
    steady = _larger(h0 * 1e-3, 1e-6)
    h1 = where(flat, steady, _root(0.01 / where(flat, 1.0, steepest), method.exponent))
    solver.clock[2] = where(h1 < 100.0 * h0, h1, 100.0 * h0)


@inlined_kernel
def _stage(s: int, h: float, k: FloatArray, y: FloatArray, method: Pair, x: FloatArray) -> None:
    """Write the state at which stage `s` is taken into `x`: y + h sum_j a_sj k_j."""
    first = method.tableau[s, 0]
    for i in range(x.size):
        x[i] = first * k[0, i]
    for j in range(1, s):
        a = method.tableau[s, j]
        if a != 0.0:
            for i in range(x.size):
                x[i] += a * k[j, i]
    for i in range(x.size):
        x[i] = y[i] + h * x[i]


@inlined_kernel
def _error(
    h: float, k: FloatArray, y: FloatArray, y_new: FloatArray, problem: Problem, method: Pair
) -> float:
    """Return the error of the step over its tolerance, from one estimate or two."""
    errors, first, second = method.errors, 0.0, 0.0
    for i in range(y.size):
        e = damping = 0.0
        for s in range(errors.shape[1]):
            e = e + errors[0, s] * k[s, i]
            damping = damping + errors[errors.shape[0] - 1, s] * k[s, i]
        scale = problem.atol + problem.rtol * _larger(abs(y_new[i]), abs(y[i]))
        first = first + (e / scale) * (e / scale)
        second = second + (damping / scale) * (damping / scale)
    none = first == 0.0
    if errors.shape[0] > 1:
        both = first + 0.01 * second
    else:
        both = first
    both = where(none, 1.0, both * y.size)
    return where(none, 0.0, h * first / math.sqrt(both))


@inlined_kernel
def _on_clock(t: Any, h: Any) -> Any:
    """Return a step, or where its digits are lost in large `t`, that by which the clock advances.

    Seconds since 1970 have no digits behind 1e-7 s.
    """
    advance = (t + h) - t
    return where(abs(advance - h) > _CLOCK * h, advance, h)


@inner_kernel
def attempt(solver: Solver, t_end: float, problem: Problem, method: Pair) -> float:
    """Try one step, not beyond `t_end`. Where the error is small enough, take it.

    Return 1.0 where it was taken, 0.0 where a smaller one is to be tried, -1.0 where no step is
    small enough.
    """
    clock, y_old, y, k, work = solver.clock, solver.y_old, solver.y, solver.k, solver.work
    chain, torque, count = problem.chain, problem.torque, solver.counts
    x, y_new = solver.poly[0], solver.poly[1]
    t, wanted, largest, end = clock[1], clock[2], clock[3], method.stages
    early = method.errors.shape[1] > end  # the estimate needs the slope at the end of the step
    rest = t_end - t
    # a remainder below 1 % of the step is taken with it
    h = where(wanted < 0.99 * rest, _on_clock(t, wanted), rest)
    copy(k[end], k[0])
    for s in range(1, end):
        _stage(s, h, k, y, method, x)
        slope(t + method.instants[s] * h, x, torque, chain, work, k[s])
    _stage(end, h, k, y, method, y_new)
    if early:
        slope(t + h, y_new, torque, chain, work, k[end])
    error = _error(h, k, y, y_new, problem, method)
    root = _root(error, method.exponent)
    factor = where(root * largest <= _SAFETY, largest, _larger(_SAFETY / root, _MIN_FACTOR))
    factor = where(error >= 0.0, factor, _MIN_FACTOR)  # the error may be NaN
    # two ends, such as instants of two signals, may be as near as rounding
    enough = (h > RESOLUTION * abs(t)) | ((h == rest) & (rest > 0.0))
    taken = enough & (error < 1.0)
    if any_of(taken):
        if not early:
            slope(t + h, y_new, torque, chain, work, k[end])
        for i in range(y.size):
            y_old[i] = where(taken, y[i], y_old[i])
            y[i] = where(taken, y_new[i], y[i])
            k[end, i] = where(taken, k[end, i], k[0, i])
    else:
        copy(k[0], k[end])
    grown = where(h < wanted, _larger(h * factor, wanted), h * factor)
    clock[0] = where(taken, t, clock[0])
    clock[1] = where(taken, where(h == rest, t_end, t + h), t)
    clock[2] = where(taken, grown, h * factor)
    clock[3] = where(taken, MAX_FACTOR, 1.0)
    count[0] = count[0] + where(taken, 1.0, 0.0)
    count[1] = count[1] + where(enough & (error >= 1.0), 1.0, 0.0)
    return where(taken, 1.0, where(enough, 0.0, -1.0))


@inner_kernel
def prepare_dense(solver: Solver, problem: Problem, method: Pair) -> None:
    """Fit the polynomial of dense output to the last step, by the stages that it needs more."""
    y_old, y, k, poly, work = solver.y_old, solver.y, solver.k, solver.poly, solver.work
    chain, torque, t, end, dense = (
        problem.chain, problem.torque, solver.clock[0], method.stages, method.dense
    )  # fmt: skip
    h = solver.clock[1] - t
    for s in range(end + 1, k.shape[0]):
        _stage(s, h, k, y_old, method, poly[0])
        slope(t + method.instants[s] * h, poly[0], torque, chain, work, k[s])
    for p in range(3, poly.shape[0]):
        first = h * dense[p - 3, 0]
        for i in range(y.size):
            poly[p, i] = first * k[0, i]
        for s in range(1, k.shape[0]):
            d = dense[p - 3, s]
            if d != 0.0:
                for i in range(y.size):
                    poly[p, i] += (h * d) * k[s, i]
    for i in range(y.size):
        delta = y[i] - y_old[i]
        poly[0, i] = delta
        poly[1, i] = h * k[0, i] - delta
        poly[2, i] = 2.0 * delta - h * (k[end, i] + k[0, i])
