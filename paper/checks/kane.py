"""What the paper says of Kane's method, and what its derivation costs."""

import time
from functools import cache
from typing import Any

import numpy as np

from npend_gym import Chain
from npend_gym.experiments import power_law
from npend_gym.physics import accelerations
from npend_gym.tools import BLACK, BLUE, ORANGE, FloatArray
from paper.kane import derive, kane_accelerations, sympy_and_mechanics
from paper.motions import Array, Motion, largest_error
from paper.registry import Figure, Outcome, Verdict, check, figure, holds_if, table

KANE_N = 6  # the largest chain that Kane's method is tried on by default: some seconds
OUR_COUNTS = (10, 30, 100, 300, 1000, 3000, 10000)


@cache
def kane_error() -> float:
    """Return how far Kane's accelerations of unequal rods are off ours, relatively."""
    by_kane = {n: kane_accelerations(n) for n in range(1, 7)}

    def kanes(at: Motion) -> Array:
        return by_kane[at.n](at.theta, at.omega, at.m, at.l, at.g)

    return max(largest_error(lambda at: at.alpha, kanes, n) for n in by_kane)


check("kane-order")(lambda: holds_if(kane_error() > 1e-12, off=kane_error()))
check("kane-listing")(lambda: holds_if(kane_error() < 1e-12, off=kane_error(),
                                       sympy=sympy_and_mechanics()[0].__version__))  # fmt: skip


@cache
def kane_costs(largest: int = KANE_N) -> list[dict[str, Any]]:
    """Return the cost of Kane's method for 1..`largest` rods: seconds, and size of the equations.

    The time is the least of up to three runs, the size the operations in mass matrix and forcing.
    """
    sympy, _ = sympy_and_mechanics()
    equations = derive(1)  # what is done once for all is no cost of n rods
    rows: list[dict[str, Any]] = []
    for n in range(1, largest + 1):
        seconds: list[float] = []
        for _ in range(3 if n < KANE_N else 1):
            sympy.core.cache.clear_cache()
            start = time.perf_counter()
            equations = derive(n)
            seconds.append(time.perf_counter() - start)
        size = sympy.count_ops(equations.mass_matrix) + sympy.count_ops(equations.forcing)
        row = {"what": "Kane's derivation", "n": n, "seconds": min(seconds)}
        rows.append(row | {"operations": int(size)})
    return rows


def exponential_misfit(x: FloatArray, y: FloatArray) -> float:
    """Return the root mean square residual of log y about its best straight line in x."""
    line = np.polyval(np.polyfit(x, np.log(y), 1), x)
    return float(np.sqrt(np.mean((np.log(y) - line) ** 2)))


@check("run-time")
def _run_time(kane_n: int = KANE_N) -> Outcome:
    costs = kane_costs(kane_n)[1:]
    names = ("n", "seconds", "operations")
    counts, seconds, operations = (np.array([cost[x] for cost in costs], float) for x in names)
    by_power = exponential_misfit(np.log(counts), operations)
    by_exponential = exponential_misfit(counts, operations)
    return holds_if(by_exponential < by_power, by_power=by_power, by_exponential=by_exponential,
                    last=kane_n, seconds=seconds[[0, -1]],
                    seconds_power=power_law(counts, seconds).value, operations=operations[[0, -1]],
                    power=power_law(counts, operations).value,
                    steps=operations[1:] / operations[:-1])  # fmt: skip


@cache
def our_seconds(n: int, repeats: int = 20) -> float:
    """Return the processor time [s] of an evaluation of our dynamics of `n` rods, least of many."""
    chain, states = Chain.uniform(n), max(1, 100_000 // n)  # arrays that the caches hold
    theta, omega = np.broadcast_to(np.linspace(0.1, 1.0, 2 * n).reshape(2, 1, n), (2, states, n))
    seconds: list[float] = []
    for _ in range(repeats):
        start = time.process_time()  # other processes on the machine do not count
        accelerations(chain, theta, omega)  # in one call: a call takes longer than few rods do
        seconds.append((time.process_time() - start) / states)
    return min(seconds)


@check("log-time")
def _logarithmic_time() -> Outcome:
    counts = OUR_COUNTS[-3:]
    microseconds = [1e6 * our_seconds(n) for n in counts]
    power = power_law(counts, microseconds).value
    verdict = Verdict.FAILS if power > 0.5 else Verdict.UNDECIDABLE
    return Outcome(verdict, {"first": microseconds[0], "last": microseconds[-1], "power": power})


@table("kane_cost", "run-time")
def cost_rows(kane_n: int = KANE_N) -> list[dict[str, Any]]:
    """Return the tidy table of costs: Kane's derivations, then evaluations of our dynamics."""
    ours = {"what": "our evaluation", "operations": ""}
    return kane_costs(kane_n) + [ours | {"n": n, "seconds": our_seconds(n)} for n in OUR_COUNTS]


@figure(
    "kane_cost", "run-time", "What Kane's method costs, and one evaluation of the accelerations.",
    size=(5.6, 3.8), data=cost_rows,
)  # fmt: skip
def _draw_costs(figure: Figure, data: list[dict[str, Any]]) -> None:
    axes = figure.subplots()
    for what, style, color, label in (
        ("Kane's derivation", "s-", ORANGE, "Kane's method, one derivation"),
        ("our evaluation", "o-", BLUE, "here, one evaluation"),
    ):
        some = [(row["n"], row["seconds"]) for row in data if row["what"] == what]
        n, seconds = np.array(some, float).T
        axes.plot(n, seconds, style, color=color, label=label)
        if what == "our evaluation":
            guide = seconds[-1] * n / n[-1]
            axes.plot(n, guide, "--", color=BLACK, linewidth=0.9, label="proportional to N")
    axes.set(xscale="log", yscale="log", xlabel="number of pendulums N", ylabel="time [s]")
    axes.legend()
