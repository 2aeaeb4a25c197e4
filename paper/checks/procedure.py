"""What the paper says about its procedure and its figures 2 and 4-7."""

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from npend_gym import Chain, Trajectory, pseudo_periods, simulate, theory
from npend_gym.chaos import neighbour_distance
from npend_gym.experiments import PAPER_AMPLITUDE, PAPER_N, PAPER_TRIALS, power_law
from npend_gym.tools import AMBER, BLACK, BLUE, GREEN, ORANGE, SKY, FloatArray
from paper.checks.periods import FRACTIONS, listing_bars
from paper.estimator import LISTING_DURATION
from paper.measured import bob_periods, fundamental_periods, ideal_periods
from paper.readings import AMPLITUDES
from paper.registry import Figure, Outcome, Verdict, check, figure, holds_if


class Figure2(NamedTuple):
    """Ten seconds of the motion of three pendulums, and how starts beside it drift away."""

    motion: Trajectory
    times: FloatArray
    growth: FloatArray  # greatest distance so far over that at the start, at each of the times [s]
    exponent: float  # of growth as a power of time, without the start: 1 for a regular motion
    wide: FloatArray  # the same growth from 135 degrees, at times up to 5 s


WIDE = math.radians(135.0)  # the start of the code that listing 1 descends from
_WIDE_DURATION = 5.0  # s


@cache
def figure2(duration: float = 200.0, nudge: float = 1e-8) -> Figure2:
    """Return the data of Figure 2: the listing's three rods of 1/3 m released at pi/4."""
    chain = Chain.uniform(3, length=1.0 / 3.0)
    shown = simulate(chain, PAPER_AMPLITUDE, 0.0, np.linspace(0.0, LISTING_DURATION, 1001))
    times = np.linspace(0.0, duration, max(2, round(20 * duration)))
    change = [nudge, 0.0, 0.0]
    growth = neighbour_distance(chain, PAPER_AMPLITUDE, change, times)[1:] / nudge
    times, growth = times[1:], np.maximum.accumulate(growth)
    late, early = times > 0.05 * times[-1], times[times <= _WIDE_DURATION]
    wide = neighbour_distance(chain, WIDE, change, np.append(0.0, early))[1:] / nudge
    exponent = power_law(times[late], growth[late]).value
    return Figure2(shown, times, growth, exponent, np.maximum.accumulate(wide))


@check("figure-2")
def _trajectory() -> Outcome:
    data = figure2()
    after_10, after_100 = data.growth[np.searchsorted(data.times, (10.0, 100.0))]
    numbers = {"after_10": after_10, "after_100": after_100, "until": data.times[-1],
               "power": data.exponent, "wide": data.wide[-1]}  # fmt: skip
    return Outcome(Verdict.UNDECIDABLE, numbers)


@figure(
    "trajectory", "figure-2",
    "Three bobs on rods of 1/3 m released from 45 degrees, and how fast a neighbouring start "
    "drifts away from there and from 135 degrees.",
    size=(7.2, 3.0), data=figure2,
)  # fmt: skip
def _draw_trajectory(figure: Figure, data: Figure2) -> None:
    left, right = figure.subplots(1, 2)
    for bob, color in enumerate((SKY, AMBER, BLUE)):
        x, y = data.motion.positions()[:, bob].T
        left.plot(x, y, color=color, linewidth=0.8)
        left.annotate(f"bob {bob + 1}", (x[0], y[0]), xytext=(5, 5), textcoords="offset points")
    left.plot(0.0, 0.0, ".", color=BLACK)
    left.annotate("pivot", (0.0, 0.0), xytext=(5, -3), textcoords="offset points")
    left.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", xlim=(-0.85, 1.1))
    left.set_title(f"Rods of 1/3 m for {data.motion.times[-1]:g} s from 45°")
    right.plot(data.times[: data.wide.size], data.wide, color=ORANGE, label="from 135°")
    right.plot(data.times, data.growth, color=BLUE, label="from 45°")
    line = float(np.median(data.growth / data.times)) * data.times
    right.plot(data.times, line, "--", color=BLACK, linewidth=0.9, label="proportional to time")
    right.set(xscale="log", yscale="log", xlabel="time [s]", ylabel="distance / distance at start")
    right.set(xlim=(0.3, data.times[-1]), ylim=(0.5, None), title="A motion started beside it")
    right.legend()


@check("pseudo-complete")
def _definition(n: int = 5, theta0: float = 0.01) -> Outcome:
    means = {
        definition: float(
            np.nanmean(pseudo_periods(Chain.uniform(n), theta0, definition=definition))
        )
        for definition in ("link", "bob", "height")
    }
    return holds_if(max(means.values()) / min(means.values()) - 1.0 < 0.01, **means)


@check("sigma")
def _sigma(draws: int = 20_000) -> Outcome:
    means = np.random.default_rng(0).random((draws, PAPER_TRIALS)).mean(axis=1)
    ratio = math.sqrt(1.0 / 12.0) / float(means.std())
    right = abs(ratio / math.sqrt(PAPER_TRIALS) - 1.0) < 0.02  # of the random error alone
    return Outcome(Verdict.FAILS if right else Verdict.UNDECIDABLE, {"ratio": ratio})


@check("window")
def _window() -> Outcome:
    periods = {n: bob_periods(n, PAPER_AMPLITUDE) for n in PAPER_N}
    counts = {n: int((times <= LISTING_DURATION).sum()) for n, times in periods.items()}
    shown = [f"{done} of {n}" for n, done in counts.items()]
    return holds_if(all(n == done for n, done in counts.items()), completed=shown)


class Series(NamedTuple):
    """One of Figures 4-7: pseudo-periods of chains 1..N in three trials, with the models."""

    counts: NDArray[np.int64]  # numbers of pendulums, (N,)
    starts: FloatArray  # angle of each trial [rad], (3,)
    measured: FloatArray  # means over the bobs [s], (3, N)
    ideal: FloatArray  # the paper's T0 [s], T1 and the paper's error bars around T0, (N,) each
    fundamental: FloatArray
    bars: FloatArray

    def outside(self, fraction: float) -> int:
        """Return how many points are further from T0 than `fraction` of it."""
        return int((np.abs(self.measured - self.ideal) > fraction * self.ideal).sum())


def series(n: int) -> Series:
    """Return the data of the figure for `n`, one of 5, 10, 20, 100."""
    starts, counts = AMPLITUDES[:, PAPER_N.index(n)], np.arange(1, n + 1)
    measured = [[bob_periods(k, a).mean() for k in counts.tolist()] for a in starts.tolist()]
    ideal, fundamental = ideal_periods(n)[1:], fundamental_periods(n)[1:]
    return Series(counts, starts, np.array(measured), ideal, fundamental, listing_bars() * ideal)


@check("figure-4", "figure-5", "figure-6", "figure-7")
def _figure(key: str) -> Outcome:
    data = series(PAPER_N[int(key[-1]) - 4])
    ratio = data.measured / data.ideal
    numbers = {"n": data.counts[-1], "least": ratio.min(), "greatest": ratio.max()}
    return Outcome(Verdict.UNDECIDABLE, numbers | {"scatter": np.ptp(ratio, axis=0).max()})


@figure(
    "pseudo_periods", "figure-4",
    "The paper's Figures 4 to 7 drawn again: the mean pseudo-period of chains of n rods.",
    size=(7.2, 5.8), data=lambda: [*map(series, PAPER_N)],
)  # fmt: skip
def _draw_pseudo_periods(figure: Figure, data: list[Series]) -> None:
    from npend_gym.report import TRIALS, panels

    for axes, one in zip(panels(figure, 2, 2), data, strict=True):
        n, width = one.counts.size, one.bars[0] / one.ideal[0]
        axes.fill_between(
            one.counts, one.ideal - one.bars, one.ideal + one.bars, color=ORANGE, alpha=0.15,
            linewidth=0, label=f"the paper's error bars, ±{width:.0%}",
        )  # fmt: skip
        axes.plot(one.counts, one.ideal, color=ORANGE, label="the paper's $T_0$")
        axes.plot(one.counts, one.fundamental, color=GREEN, label="$T_1$, slowest normal mode")
        for trial, (marker, color) in enumerate(TRIALS, start=1):
            axes.plot(
                one.counts, one.measured[trial - 1], marker, color=color, markeredgewidth=0,
                markersize=(7.5 - 1.8 * trial) * (1.0 if n <= 20 else 0.6),
                label=f"trial {trial}, mean over the bobs",
            )  # fmt: skip
        axes.set(xlabel="number of pendulums n", ylabel="pseudo-period [s]", title=f"N = {n}")
        axes.set_ylim(0.0, None)
        axes.xaxis.get_major_locator().set_params(integer=True)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)


@check("one-point")
def _threshold(n_values: tuple[int, ...] = PAPER_N) -> Outcome:
    drawn = [series(n) for n in n_values]
    slow = [one._replace(measured=one.fundamental) for one in drawn]
    bars, least = listing_bars(), float(min(FRACTIONS))
    correct = float(theory.amplitude_correction(PAPER_AMPLITUDE))
    outside = [sum(one.outside(f) for one in drawn) for f in (bars, least, correct)]
    return holds_if(outside[2] <= 1, bars=bars, outside_bars=outside[0],
                    points=sum(one.measured.size for one in drawn), least=least,
                    outside_least=outside[1], correct=correct, outside_correct=outside[2],
                    slow=sum(one.outside(bars) for one in slow))  # fmt: skip


@check("central-mean")
def _central(n: int = PAPER_N[-1]) -> Outcome:
    data = series(n)
    below = int((data.measured < data.ideal).all(axis=0).sum())
    ratio = float(np.mean(data.measured / data.ideal))
    return holds_if(0.25 < below / n < 0.75, below=below, chains=n, ratio=ratio)


@check("stochastic")
def _stochastic() -> Outcome:
    chain = Chain.uniform(100)
    first, again = (pseudo_periods(chain, PAPER_AMPLITUDE) for _ in range(2))
    near = pseudo_periods(chain, PAPER_AMPLITUDE + 1e-6)
    slope = abs(near.mean() - first.mean()) / first.mean() / 1e-6
    repeated = "same to the last bit" if np.array_equal(first, again) else "different"
    return holds_if(bool(slope > 100.0), repeated=repeated, slope=slope)
