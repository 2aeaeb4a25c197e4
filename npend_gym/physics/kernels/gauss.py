"""Gauss-Legendre steps of a chain without friction in its canonical variables: symplectic.

With p and F of `canonical`, a step from (q, u) has the stages and the end

    Q_i = q + h sum_j a_ij U_j,   N(Q_i) U_i = N(q) u + h sum_j a_ij F(Q_j, U_j),            (1)
    q' = q + h sum_i b_i U_i,     N(q') u' = N(q) u + h sum_i b_i F(Q_i, U_i).

U is found to rounding, by iteration with the factors of N(q). Of s stages the order is 2 s. E.
Hairer, C. Lubich, G. Wanner, "Geometric Numerical Integration" (2006), chapters VI and VIII.

Between its ends a step is the polynomial of degree 5 that has the coordinates, rates and
accelerations of both. The rates are the cubic through theirs, and of more than one stage the
quartic whose integral is the change of the coordinates.
"""

# numbers are floats or packs, which pyright does not follow
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.compiled.jit import inlined_kernel, inner_kernel
from npend_gym.compiled.packs import any_of, where
from npend_gym.compiled.sincos import ROUND
from npend_gym.physics.kernels.canonical import SWEEP_ROWS, canonical
from npend_gym.physics.kernels.driven import Torque, loads_at
from npend_gym.physics.kernels.dynamics import (
    ANSWER_ROWS,
    WORK_ROWS,
    AnyArrays,
    accelerations_kept,
    copy,
    respond,
)
from npend_gym.physics.kernels.solver import Problem, Solver

MOST = 100  # iterations
LEAST = 0.5 * math.ulp(1.0)  # a change that is none
ROUNDING = 1e-9  # of rates: below it, what does not shrink any more is rounding
# Rows of the work space: of `accelerations_kept` and `respond`, `canonical`; momenta at the start,
# a right side, its answer, coordinates of a stage; then U, the momenta and F of each stage
ANSWER = WORK_ROWS + 1
SWEEP = ANSWER + ANSWER_ROWS
P, RIGHT, GAIN, X, STAGES = range(SWEEP + SWEEP_ROWS, SWEEP + SWEEP_ROWS + 5)


class Gauss(NamedTuple):
    """The coefficients of s stages."""

    tableau: FloatArray  # a, (s, s)
    ends: FloatArray  # b, (s,)
    instants: FloatArray  # of the start, the stages and the end, in steps, (s + 2,)
    last: FloatArray  # weights of U that continue it to the end, (s,)

    adaptive, conservative = False, True  # for chains that keep their energy
    end, evaluations = np.ones(1), (0, 0, 0)

    @property
    def stages(self) -> int:
        """How many instants of a step have loads."""
        return len(self.instants)

    @property
    def rows(self) -> tuple[int, int, int]:
        """As for `new_solver`."""
        return 2, 5, STAGES + 3 * len(self.ends)

    def weights(self, x: FloatArray) -> FloatArray:
        """Fractions `x` (F,) of a step as `carry_gauss` takes them, (F, 1)."""
        return x[:, None]


def gauss(stages: int) -> Gauss:
    """Return the method of this number of stages."""
    nodes, ends = np.polynomial.legendre.leggauss(stages)
    nodes, ends = 0.5 + 0.5 * nodes, 0.5 * ends
    bases = [np.poly1d(np.poly(np.delete(nodes, j))) for j in range(stages)]
    bases = [base / base(nodes[j]) for j, base in enumerate(bases)]
    tableau = np.array([[base.integ()(c) for base in bases] for c in nodes])
    last = np.array([base(1.0) for base in bases])
    return Gauss(tableau, ends, np.concatenate([[0.0], nodes, [1.0]]), last)


MIDPOINT: Gauss = gauss(1)
GAUSS4: Gauss = gauss(2)
GAUSS6: Gauss = gauss(3)


@inlined_kernel
def _larger(a: Any, b: Any) -> Any:
    return where(a > b, a, b)


@inlined_kernel
def weighted(
    weights: FloatArray, h: Any, rows: FloatArray, kind: int, start: FloatArray, out: FloatArray
) -> None:
    """Write start + h sum_j weights_j rows_j of one kind of the three that stages have."""
    for i in range(out.size):
        out[i] = 0.0 * start[i]
    for j in range(weights.size):
        for i in range(out.size):
            out[i] = out[i] + weights[j] * rows[3 * j + kind, i]
    for i in range(out.size):
        out[i] = start[i] + h * out[i]


@inlined_kernel
def improve(
    h: Any, p: FloatArray, going: Any, factors: FloatArray, chain: AnyArrays, method: Gauss,
    work: FloatArray, m: int,
) -> tuple[Any, Any]:  # fmt: skip
    """Improve U of all stages once; return the largest change, and the largest U.

    `factors` are as `accelerations_kept` left them.
    """
    rows, right, gain = work[STAGES:], work[RIGHT][:m], work[GAIN][:m]
    size = largest = 0.0 * p[0]
    for s in range(method.ends.size):
        weighted(method.tableau[s], h, rows, 2, p, right)
        momenta, rates = rows[3 * s + 1], rows[3 * s]
        for i in range(m):
            right[i] = right[i] - momenta[i]
        respond(right, chain, factors, work[ANSWER:], gain)
        for i in range(m):
            rates[i] = rates[i] + where(going > 0.0, gain[i], 0.0)
            size, largest = _larger(abs(gain[i]), size), _larger(abs(rates[i]), largest)
            size = where(gain[i] - gain[i] == 0.0, size, gain[i])  # NaN stays
    return size, largest


@inlined_kernel
def gauss_step(
    t: Any, h: Any, q: FloatArray, u: FloatArray, torque: Torque, chain: AnyArrays,
    method: Gauss, reached: FloatArray, gained: FloatArray, work: FloatArray,
) -> Any:  # fmt: skip
    """Write the state after a step into `reached` (2m,), and the accelerations there.

    The factors at the start are in `work`, with a guess of U; those at the end are left there.
    Return the largest change in the last iteration: NaN or large, where U was not found.
    """
    m, rows, ends = q.size, work[STAGES:], method.ends
    p, x, sweep, force = work[P][:m], work[X][:m], work[SWEEP:], rows[2][:m]
    loads = loads_at(t, q, u, torque, chain, 0)
    canonical(q, u, loads, chain, None, sweep, p, force)
    going = where(h > 0.0, 1.0, 0.0)
    size = last = 0.0 * p[0] + 1e300
    for _ in range(MOST):
        for s in range(ends.size):
            weighted(method.tableau[s], h, rows, 0, q, x)
            rates = rows[3 * s][:m]
            loads = loads_at(t + method.instants[s + 1] * h, x, rates, torque, chain, s + 1)
            canonical(x, rates, loads, chain, None, sweep, rows[3 * s + 1], rows[3 * s + 2])
        if not any_of(going > 0.0):  # F is that of the last U, also in lanes that waited
            break
        size, largest = improve(h, p, going, work, chain, method, work, m)
        over = (size <= LEAST * largest) | ((size >= last) & (size <= ROUNDING * largest))
        over = over | (size - size != 0.0)
        going = where(over, 0.0, going)
        last = size
    size = where(going > 0.0, 1e300, size)
    q_end, u_end = reached[:m], reached[m:]
    weighted(ends, h, rows, 0, q, q_end)
    weighted(ends, h, rows, 2, p, work[RIGHT][:m])
    weighted(method.last, 1.0, rows, 0, p, u_end)
    for i in range(m):
        u_end[i] = u_end[i] - p[i]
        p[i] = work[RIGHT][i]
    loads = loads_at(t + h, q_end, u_end, torque, chain, ends.size + 1)
    accelerations_kept(q_end, u_end, loads, chain, work, gained)
    canonical(q_end, u_end, loads, chain, None, sweep, x, force)
    right, gain = work[RIGHT][:m], work[GAIN][:m]
    for i in range(m):
        right[i] = p[i] - x[i]
    respond(right, chain, work, work[ANSWER:], gain)
    for i in range(m):
        u_end[i] = u_end[i] + gain[i]
    loads = loads_at(t + h, q_end, u_end, torque, chain, ends.size + 1)
    accelerations_kept(q_end, u_end, loads, chain, work, gained)
    return size


@inner_kernel
def start(solver: Solver, problem: Problem, method: Gauss, rest: float, longest: float) -> None:  # noqa: ARG001
    """Take the first slope, and choose equal steps."""
    y, k, m, clock = solver.y, solver.k[1], solver.y.size // 2, solver.clock
    steps = rest / longest - 1e-9
    whole = (steps + ROUND) - ROUND
    whole = where(whole < steps, whole + 1.0, whole)
    clock[3] = where(whole > 1.0, whole, 1.0)
    clock[2] = rest / clock[3]
    copy(y[m:], k)
    loads = loads_at(clock[1], y[:m], y[m:], problem.torque, problem.chain, 0)
    accelerations_kept(y[:m], y[m:], loads, problem.chain, solver.work, k[m:])
    for i in range(m):  # as if the acceleration had been constant
        solver.k[0, m + i], solver.y_old[m + i] = k[m + i], y[m + i] - clock[2] * k[m + i]


@inner_kernel
def attempt(solver: Solver, t_end: float, problem: Problem, method: Gauss) -> float:
    """Take one step; see `methods.attempt`."""
    clock, y, k, m = solver.clock, solver.y, solver.k, solver.y.size // 2
    t, rest, reached = clock[1], t_end - clock[1], solver.poly[0]
    final = clock[3] < 1.5
    h = where(rest > 0.0, clock[2], 0.0)
    rows = solver.work[STAGES:]
    for i in range(m):  # the cubic through the step before
        u, speed, gain = y[m + i], clock[2] * k[1, m + i], clock[2] * k[0, m + i]
        changed = u - solver.y_old[m + i]
        third = (gain + speed) - 2.0 * changed
        second = third + (speed - changed)
        for s in range(method.ends.size):
            x = method.instants[s + 1]
            rows[3 * s, i] = u + x * (speed + x * (second + x * third))
    copy(k[1], k[0])
    size = gauss_step(
        t, h, y[:m], y[m:], problem.torque, problem.chain, method, reached, k[1][m:], solver.work
    )
    taken = (rest > 0.0) & (size < 1e299)
    for i in range(y.size):
        solver.y_old[i] = where(taken, y[i], solver.y_old[i])
        y[i] = where(taken, reached[i], y[i])
    for i in range(m):
        k[1, i] = y[m + i]
    left = clock[3] - 1.0
    clock[0] = where(taken, t, clock[0])
    clock[1] = where(taken, where(final, t_end, t_end - left * clock[2]), t)
    clock[3] = where(taken, left, clock[3])
    solver.counts[0] = solver.counts[0] + where(taken, 1.0, 0.0)
    return where(taken, 1.0, -1.0)


@inlined_kernel
def fit(
    h: Any, q: FloatArray, u: FloatArray, alpha: FloatArray, reached: FloatArray,
    gained: FloatArray, method: Gauss, poly: FloatArray,
) -> None:  # fmt: skip
    """Write the polynomial of a step into five rows; it is linear in all that it depends on."""
    m = q.size
    # rates of order 2 are smoother as a cubic
    inverse: Any = (30.0 if method.ends.size > 1 else 0.0) / where(h > 0.0, h, 1.0)
    for i in range(m):
        moved, turned = reached[i] - q[i], reached[m + i] - u[i]
        first = h * u[i] - moved
        second = 2.0 * moved - h * (u[i] + reached[m + i])
        third = (0.5 * h) * (h * alpha[i]) + (first - second)
        fourth = ((0.5 * h) * (h * gained[i]) + (first + 2.0 * second)) - third
        poly[0, i], poly[1, i], poly[2, i], poly[3, i], poly[4, i] = (
            moved, first, second, third, fourth
        )  # fmt: skip
        j = m + i
        poly[0, j], poly[1, j] = turned, h * alpha[i] - turned
        poly[2, j] = 2.0 * turned - h * (alpha[i] + gained[i])
        mean = 0.5 * (u[i] + reached[j]) + (h / 12.0) * (alpha[i] - gained[i])
        poly[3, j], poly[4, j] = inverse * (moved - h * mean), 0.0 * turned


@inner_kernel
def prepare_dense(solver: Solver, problem: Problem, method: Gauss) -> None:  # noqa: ARG001
    """Fit the polynomial of dense output to the last step."""
    y, m, k = solver.y_old, solver.y.size // 2, solver.k
    h = solver.clock[1] - solver.clock[0]
    fit(h, y[:m], y[m:], k[0][m:], solver.y, k[1][m:], method, solver.poly)
