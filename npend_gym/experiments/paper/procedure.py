"""What the paper says about its procedure and its figures."""

from __future__ import annotations

import ast
import math
from collections.abc import Iterator, Sequence

import numpy as np

from npend_gym import theory
from npend_gym.chain import Chain
from npend_gym.experiments.paper.figure_data import Series, figure2, series
from npend_gym.experiments.paper.finding import Finding, Verdict
from npend_gym.experiments.paper.measured import bob_periods, ideal_periods
from npend_gym.experiments.paper.periods import FRACTIONS, listing_bars
from npend_gym.experiments.release import PAPER_AMPLITUDE, PAPER_N, PAPER_TRIALS
from npend_gym.period import LISTING_DURATION, pseudo_periods


def completed_within(n: int, duration: float = LISTING_DURATION) -> int:
    """Return how many of `n` bobs complete within `duration` [s], rods of 1 m, from pi/4."""
    periods = bob_periods(n, PAPER_AMPLITUDE, "bob", "1 m")
    return int((periods <= duration).sum())


def definitions(n: int, theta0: float) -> dict[str, float]:
    """Return the mean pseudo-period [s] by each definition of the paper's procedure (iv)."""
    chain = Chain.uniform(n)
    return {
        reading: float(np.nanmean(pseudo_periods(chain, theta0, reading=reading)))
        for reading in ("link", "bob", "height")
    }


def findings(n_values: Sequence[int] = PAPER_N) -> Iterator[Finding]:
    """Yield what the audit says about Figure 2, the procedure and Figures 4-7."""
    yield _trajectory()
    yield _definition()
    yield _sigma()
    yield _window()
    drawn = {n: series(n) for n in n_values}
    for k, n in enumerate(n_values, start=4):
        yield _figure(k, drawn[n])
    yield _threshold(list(drawn.values()))
    yield _central(drawn[n_values[-1]])
    yield _stochastic()
    yield _listing()


def _trajectory() -> Finding:
    data = figure2()
    at = {t: data.growth[np.searchsorted(data.times, t)] for t in (10.0, 100.0)}
    return Finding(
        "figure-2", "Figure 2", "The trajectory of N = 3 is chaotic", "chaotic",
        f"a neighbour's distance grows {at[10.0]:.1f}-fold in 10 s, {at[100.0]:.0f}-fold in 100 s, "
        f"as t^{data.exponent:.2f} up to {data.times[-1]:.0f} s",
        Verdict.of(data.exponent > 2.0),
        "Released from pi/4, as in the paper. Neighbours of a chaotic motion part exponentially, "
        "of a regular one linearly: the figure shows no chaos. Over longer times see chaos-n. And "
        "(x, y) is the plane of motion, not phase space.",
    )  # fmt: skip


def _definition() -> Finding:
    values = definitions(5, 0.01)
    spread = max(values.values()) / min(values.values()) - 1.0
    shown = ", ".join(f"{name} {value:.3f}" for name, value in values.items())
    return Finding(
        "pseudo-complete", "procedure (iv)",
        "The rod turns, the bob turns twice, the bob is back at its height: one and the same",
        "for small angles", f"{shown} s (N = 5, 0.01 rad)", Verdict.of(spread < 0.01),
        "Means over the bobs that complete. The three differ at any angle; a single pendulum is "
        "back at its height after half a period.",
    )  # fmt: skip


def _sigma(draws: int = 20_000) -> Finding:
    rng = np.random.default_rng(0)
    means = rng.random((draws, PAPER_TRIALS)).mean(axis=1)
    ratio = math.sqrt(1.0 / 12.0) / means.std()
    return Finding(
        "sigma", "procedure (vi)", "Trials reduce the systematic error e; sigma = e sqrt(t)",
        f"sqrt(3) = {math.sqrt(PAPER_TRIALS):.3f}",
        f"sigma/e = {ratio:.3f} with e the standard error of a mean of three",
        Verdict.CORRECTED if abs(ratio / math.sqrt(PAPER_TRIALS) - 1.0) < 0.02 else Verdict.FAILS,
        "Right for the random error of the mean. A systematic error is the same in every trial and "
        "stays.",
    )  # fmt: skip


def _window() -> Finding:
    counts = {n: completed_within(n) for n in PAPER_N}
    shown = ", ".join(f"{done} of {n}" for n, done in counts.items())
    return Finding(
        "window", "text before Figure 4", "10 s suffice to find the period of every bob", "10 s",
        f"completed within 10 s: {shown}", Verdict.of(all(n == c for n, c in counts.items())),
        "On the text's rods of 1 m. On the listing's rods of 1/n m a period takes 2 s for any n, "
        "and the model T0 then has no square root of N.",
    )  # fmt: skip


def _figure(number: int, data: Series) -> Finding:
    n = int(data.counts[-1])
    ratio = data.measured / data.ideal
    return Finding(
        f"figure-{number}", f"Figure {number}", f"Pseudo-period against n up to {n}, three trials",
        "a drawing, no numbers",
        f"S/T0 between {ratio.min():.3f} and {ratio.max():.3f}; trials differ by at most "
        f"{np.ptp(ratio, axis=0).max():.4f} T0",
        Verdict.UNDECIDABLE, "Drawn anew by this command, with the paper's error bars.",
    )  # fmt: skip


def _threshold(drawn: list[Series]) -> Finding:
    points = sum(data.measured.size for data in drawn)
    bars = listing_bars()
    least, correct = float(min(FRACTIONS)), float(theory.amplitude_correction(PAPER_AMPLITUDE))
    outside = {f: sum(data.outside(f) for data in drawn) for f in (bars, least, correct)}
    slow = sum(int((np.abs(d.fundamental - d.ideal) > bars * d.ideal).sum()) for d in drawn)
    return Finding(
        "one-point", "text after Figures 4-7", "All data but one point lie within the uncertainty",
        "1 outside",
        f"outside T0 (1 +- {bars:.3f}): {outside[bars]} of {points}; 1 +- {least}: "
        f"{outside[least]}; 1 +- {correct:.3f}: {outside[correct]}",
        Verdict.of(outside[correct] <= 1, Verdict.CORRECTED if outside[bars] <= 1 else None),
        f"With the bars drawn, which confirm nothing: T1, which T0 misses by 20 %, is outside "
        f"{slow} times. With the correction that the amplitude really makes it does not hold.",
    )  # fmt: skip


def _central(data: Series) -> Finding:
    below = int((data.measured < data.ideal).all(axis=0).sum())
    return Finding(
        "central-mean", "text after Figures 4-7", "The data scatter about the model",
        "the model is the central mean",
        f"below T0 in every trial for {below} of {data.counts.size} chains, "
        f"S/T0 = {np.mean(data.measured / data.ideal):.3f} on average",
        Verdict.of(0.25 < below / data.counts.size < 0.75),
        "Only the single pendulum is above.",
    )  # fmt: skip


def _stochastic() -> Finding:
    chain = Chain.uniform(100)
    first, again = (pseudo_periods(chain, PAPER_AMPLITUDE) for _ in range(2))
    near = pseudo_periods(chain, PAPER_AMPLITUDE + 1e-6)
    slope = abs(near.mean() - first.mean()) / first.mean() / 1e-6
    return Finding(
        "stochastic", "text after Figures 4-7", "The pseudo-period varies stochastically",
        "stochastically",
        f"repeated: {'same to the last bit' if np.array_equal(first, again) else 'different'}; "
        f"d ln S/d theta0 = {slope:.2f}/rad at N = 100",
        Verdict.of(slope > 100.0),
        "A smooth function of the starting angle, up to the first period.",
    )  # fmt: skip


def _listing() -> Finding:
    lines = (
        "x_1 = [sequence_of_periods_0[i] for i in range(0,n+1)]",
        "x_3 = [sequence_of_periods_3[i] for i in range(0,n+!)]",
    )
    broken = sum(not _parses(line) for line in lines)
    ideal = ideal_periods(PAPER_N[0] + 1)
    shift = float(np.mean(ideal[2:] / ideal[1:-1] - 1.0))
    return Finding(
        "listing-4", "Listing 4", "The figures come from this listing", "plt.errorbar(x, y, ...)",
        f"{broken} of its lines is no Python; it draws chain n + 1 at n, whose T0 is {shift:.0%} "
        "longer on average up to n = 5",
        Verdict.of(broken == 0),
        "sequence_of_periods_0 and n are defined nowhere; the first period belongs to chain 1 and "
        "is drawn at n = 0, where the model is 0.",
    )  # fmt: skip


def _parses(line: str) -> bool:
    try:
        ast.parse(line)
    except SyntaxError:
        return False
    return True
