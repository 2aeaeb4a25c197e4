"""What the paper says of chaos: Lyapunov exponents, eigenvalues at rest, volume in phase space."""

import math
from functools import cache
from typing import Any

import numpy as np

from npend_gym import Chain, theory
from npend_gym.chaos import Growth, neighbour_distance, tangent_growth, volume_change
from npend_gym.experiments import PAPER_AMPLITUDE, power_law
from npend_gym.physics import linearise
from npend_gym.tools import ORANGE
from paper.motions import samples
from paper.registry import Figure, Outcome, check, figure, holds_if, table

# Number of rods -> seconds for which their motion is followed
FROM_QUARTER = {2: 60_000, 3: 30_000, 4: 30_000, 5: 20_000, 6: 10_000, 10: 8_000, 20: 3_000}
FROM_TWO = {2: 1_000, 3: 600, 5: 250, 10: 80, 20: 80}


@cache
def growth(n: int, theta0: float, duration: float, length: float = 1.0) -> Growth:
    """Return the growth along a release from `theta0` [rad], followed for `duration` [s]."""
    return tangent_growth(Chain.uniform(n, length=length), theta0, duration=duration)


def runs() -> dict[str, dict[int, Growth]]:
    """Return the growth along releases from the paper's angle and a larger one, by angle and N."""
    quarter = {n: growth(n, PAPER_AMPLITUDE, span) for n, span in FROM_QUARTER.items()}
    return {"45°": quarter, "2 rad": {n: growth(n, 2.0, span) for n, span in FROM_TWO.items()}}


@check("chaos-energy")
def _with_energy() -> Outcome:
    angles, span = [0.1, PAPER_AMPLITUDE, 1.2, 1.5, 2.0], 500.0
    found = [growth(2, angle, span) for angle in angles]
    chaotic, rates = [run.chaotic for run in found], [run.rate for run in found]
    holds = chaotic == sorted(chaotic) and not chaotic[0] and chaotic[-1]
    return holds_if(holds, angles=angles, rates=rates, bound=found[0].bound, span=span,
                    periods=span / theory.fundamental_period(Chain.uniform(2)))  # fmt: skip


@check("no-solution")
def _no_solution() -> Outcome:
    run = growth(2, 2.0, FROM_TWO[2])
    return holds_if(run.rate > run.bound, rate=run.rate)


@check("chaos-n")
def _with_n() -> Outcome:
    quarter, two = runs().values()
    rates = np.array([run.rate for run in two.values()])
    least = min(quarter)
    late = {n: run.rate for n, run in quarter.items()}
    holds = bool(np.all(np.diff([*late.values()]) > 0.0)) and quarter[least].chaotic
    return holds_if(
        holds, rates=rates, power=power_law(list(two), rates).value, least=least,
        bound=quarter[least].bound, span=quarter[least].times[-1],
        late=[f"{_second_quarter(run):.2g} and {run.rate:.2g} (N = {n}, {run.times[-1]:.0f} s)"
              for n, run in quarter.items() if n > least],
    )  # fmt: skip


def _second_quarter(run: Growth) -> float:
    """Return the mean rate of growth [1/s] over the second quarter of a run."""
    first, last = run.times.size // 4 - 1, run.times.size // 2 - 1
    grown = run.logarithm[last] - run.logarithm[first]
    return float(grown / (run.times[last] - run.times[first]))


def _spread(run: Growth, points: int) -> list[int]:
    """Return the indices of about `points` instants, evenly spaced in the logarithm of time."""
    return (np.unique(np.geomspace(1, run.times.size, points).astype(np.int64)) - 1).tolist()


@table("lyapunov", "chaos-n")
def growth_rows(points: int = 200) -> list[dict[str, float]]:
    """Return the tidy table of the estimates, at about `points` instants of every run."""
    return [
        {"angle_rad": angle, "n": n, "time_s": float(run.times[k]),
         "exponent_so_far_per_s": float(run.logarithm[k] / run.times[k])}
        for angle, of_angle in zip((PAPER_AMPLITUDE, 2.0), runs().values(), strict=True)
        for n, run in of_angle.items()
        for k in _spread(run, points)
    ]  # fmt: skip


@figure(
    "lyapunov", "chaos-n",
    "The mean rate of growth from the start up to each time. A regular motion follows the dashed "
    "line. A Lyapunov exponent is the limit of long times; from 45 degrees the runs of six and "
    "more rods have not reached it.",
    size=(7.2, 3.8), data=runs,
)  # fmt: skip
def _draw_growth(figure: Figure, data: dict[str, dict[int, Growth]]) -> None:
    from npend_gym.report import panels, shade

    box: dict[str, Any] = {"facecolor": "white", "edgecolor": "none", "pad": 0.5}
    for axes, (angle, of_angle) in zip(panels(figure, 1, len(data)), data.items(), strict=True):
        for k, run in enumerate(of_angle.values()):
            kept = _spread(run, 400)
            estimates = np.abs(run.logarithm[kept]) / run.times[kept]
            color = shade(k / max(1, len(of_angle) - 1))
            axes.plot(run.times[kept], estimates, color=color, linewidth=1.0)
        last = max(float(run.times[-1]) for run in of_angle.values())
        time = np.geomspace(10.0, last, 100)
        label = "ln t / t: a regular motion"
        axes.plot(time, np.log(time) / time, "--", color=ORANGE, linewidth=0.9, label=label)
        axes.set(xscale="log", yscale="log", xlabel="time [s]", title=f"Released from {angle}")
        axes.set(ylabel="mean rate of growth, so far [1/s]", xlim=(2.0, 4.0 * last))
        (low, high), height = axes.get_ylim(), math.inf  # height of the label above
        for n, run in sorted(of_angle.items(), key=lambda one: -one[1].exponent()):
            height = min(run.exponent(), height * (low / high) ** 0.043)
            axes.annotate(f"N = {n}", (run.times[-1], height), xytext=(4, -3), fontsize=8,
                          textcoords="offset points", bbox=box)  # fmt: skip
        axes.legend(loc="lower left")


@check("attracting-point")
def _attraction() -> Outcome:
    chain = samples(4)[0].chain
    real = float(np.max(np.abs(np.linalg.eigvals(linearise(chain, 0.0).A).real)))
    volume = abs(volume_change(chain))
    return holds_if(real > 1e-6 or volume > 1e-6, real=real, volume=volume)


def neighbour_growth(n: int, length: float = 1.0, *, uniform: bool = False) -> float:
    """Return how much a change of the paper's start, random or uniform, grows within its 10 s."""
    chain, times = Chain.uniform(n, length=length), np.linspace(0.0, 10.0, 201)
    change = np.random.default_rng(n).uniform(-1e-8, 1e-8, n)
    if uniform:  # as the paper's trials differ
        change = np.full(n, 1e-8)
    distance = neighbour_distance(chain, PAPER_AMPLITUDE, change, times)
    return float(distance.max() / np.max(np.abs(change)))


@check("chaos-errors")
def _within_the_window() -> Outcome:
    factors = [neighbour_growth(n) for n in (5, 20, 100)]
    uniform = [neighbour_growth(n, uniform=True) for n in (5, 20, 100)]
    return holds_if(max(factors + uniform) > 1e6, factors=factors, uniform=uniform,
                    largest=max(factors + uniform))  # fmt: skip
