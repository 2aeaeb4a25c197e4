"""What the paper says of Kane's method, and what its derivation costs."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.experiments.paper import KANE_N
from npend_gym.experiments.paper.finding import Finding, Verdict
from npend_gym.experiments.paper.fits import exponent, show
from npend_gym.experiments.paper.formula import samples
from npend_gym.physics.kane import derive, kane_accelerations, sympy_and_mechanics
from npend_gym.physics.kernels.dynamics import derivative, new_work, pack_rods

CHECKED_N = 6  # accelerations are compared for up to so many rods
OUR_COUNTS = (10, 30, 100, 300, 1000, 3000, 10000)


@dataclass(frozen=True)
class KaneCost:
    """Cost of deriving the equations of `n` rods by Kane's method."""

    n: int
    seconds: float
    operations: int  # in the mass matrix and the forcing


@cache
def kane_costs(largest: int = KANE_N) -> tuple[KaneCost, ...]:
    """Return the cost of Kane's method for 1..`largest` rods, the fastest of up to three runs."""
    sympy, _ = sympy_and_mechanics()
    derive(1)  # what is done once for all is no cost of n rods
    return tuple(_cost(sympy, n) for n in range(1, largest + 1))


def _cost(sympy: Any, n: int) -> KaneCost:
    seconds: list[float] = []
    for _ in range(3 if n < KANE_N else 1):
        sympy.core.cache.clear_cache()
        start = time.perf_counter()
        derive(n)
        seconds.append(time.perf_counter() - start)
    equations = derive(n)
    size = sympy.count_ops(equations.mass_matrix) + sympy.count_ops(equations.forcing)
    return KaneCost(n, min(seconds), int(size))


@cache
def our_seconds(counts: tuple[int, ...] = OUR_COUNTS) -> FloatArray:
    """Return the time [s] of one evaluation of our dynamics of `counts` rods, fastest of many.

    With the call from Python, which takes some microseconds and hides what few rods cost.
    """
    return np.array([_seconds_of(Chain.uniform(n)) for n in counts])


def _seconds_of(chain: Chain, repeats: int = 20, calls: int = 50) -> float:
    state = np.linspace(0.1, 1.0, 2 * chain.n)
    arguments = state, np.zeros(chain.n), pack_rods(chain), new_work(chain.n), state.copy()
    derivative(*arguments)
    best = np.inf
    for _ in range(repeats):
        start = time.perf_counter()
        for _ in range(calls):
            derivative(*arguments)
        best = min(best, (time.perf_counter() - start) / calls)
    return float(best)


def cost_rows(largest: int = KANE_N) -> list[dict[str, Any]]:
    """Return the tidy table of costs: Kane's derivations, then evaluations of our dynamics."""
    kane = [
        {"what": "Kane's derivation", "n": c.n, "seconds": c.seconds, "operations": c.operations}
        for c in kane_costs(largest)
    ]
    ours = zip(OUR_COUNTS, our_seconds().tolist(), strict=True)
    return kane + [
        {"what": "our evaluation", "n": n, "seconds": seconds, "operations": ""}
        for n, seconds in ours
    ]


@cache
def kane_error(n: int) -> float:
    """Return how far Kane's accelerations of `n` unequal rods are off ours, relatively."""
    by_kane = kane_accelerations(n)
    return max(
        float(np.max(np.abs(by_kane(s.theta, s.omega, s.m, s.l, s.g) - s.alpha))
              / np.max(np.abs(s.alpha)))
        for s in samples(n)
    )  # fmt: skip


def exponential_misfit(x: FloatArray, y: FloatArray) -> float:
    """Return the root mean square residual of log y about its best straight line in x."""
    line = np.polyval(np.polyfit(x, np.log(y), 1), x)
    return float(np.sqrt(np.mean((np.log(y) - line) ** 2)))


def findings(kane_n: int = KANE_N) -> Iterator[Finding]:
    """Yield the findings about Kane's method, derived for up to `kane_n` rods."""
    errors = [kane_error(n) for n in range(1, CHECKED_N + 1)]
    yield Finding(
        "kane-listing", "Listing 1", "Kane's method gives the equations of motion",
        "integrate_pendulum",
        f"with SymPy {sympy_and_mechanics()[0].__version__}: accelerations of 1..{CHECKED_N} "
        f"unequal rods equal ours to {max(errors):.0e}",
        Verdict.of(max(errors) < 1e-12), "It runs as printed.",
    )  # fmt: skip
    yield Finding(
        "kane-order", "text", "Kane's method is an integrator of low order with truncation errors",
        '"first-order numerical scheme", later "2nd order", similar to RK4',
        f"its equations are exact: off by {max(errors):.0e}, rounding",
        Verdict.of(max(errors) > 1e-12),
        "It derives equations, as Lagrange's does, and has no step and no truncation error; "
        "those of the simulation come from odeint, of variable order and error-controlled.",
    )  # fmt: skip
    yield _run_time(kane_costs(kane_n))
    seconds = our_seconds()
    power = exponent(np.array(OUR_COUNTS[-3:], float), seconds[-3:])
    yield Finding(
        "log-time", "text", "the algorithm can be optimised to logarithmic run time",
        "O(m log N)",
        f"our evaluation, N = {OUR_COUNTS[-3]} to {OUR_COUNTS[-1]}: {seconds[-3] * 1e6:.2f} to "
        f"{seconds[-1] * 1e6:.1f} us, as N^{power:.2f}",
        Verdict.FAILS if power > 0.5 else Verdict.UNDECIDABLE,
        "N accelerations cannot be written in fewer than N operations: O(N) is the best there is "
        "on one processor, and the tensions reach it.",
    )  # fmt: skip


def _run_time(costs: tuple[KaneCost, ...]) -> Finding:
    counts = np.array([cost.n for cost in costs[1:]], float)
    seconds = np.array([cost.seconds for cost in costs[1:]])
    operations = np.array([cost.operations for cost in costs[1:]], float)
    by_power = exponential_misfit(np.log(counts), operations)
    by_exponential = exponential_misfit(counts, operations)
    return Finding(
        "run-time", "text", "run time of the simulation", "exponential, O(m^N)",
        f"Kane's derivation, N = 2 to {costs[-1].n}: {show(seconds[[0, -1]], 2)} s, as "
        f"N^{exponent(counts, seconds):.1f}; its equations have {show(operations[[0, -1]], 5)} "
        f"operations, as N^{exponent(counts, operations):.2f} (log residual {by_power:.3f}; "
        f"exponential {by_exponential:.3f})",
        Verdict.of(by_exponential < by_power),
        "A power of N. The ratio of successive sizes falls towards 1: "
        f"{show(operations[1:] / operations[:-1])}.",
    )  # fmt: skip
