"""Appendix D: the listings for coordinates and for the simulated period, repaired to run.

Listing 3 runs as printed, given the imports of listing 1, but for hours: it searches, for every
pair of frames, a list that has grown by one entry for every pair before. The one repair, in
`npend_gym.listing.listing_estimate`, counts the entries instead; `printed_estimate` here is the
printed loop, to compare on a few frames. Its unused parts (`theta`, `computeperiod`) are left out.
"""

import ast
import math
import time
from contextlib import suppress

import numpy as np

from npend_gym import Chain, pseudo_periods, simulate
from npend_gym._checks import FloatArray
from npend_gym.experiments.release import PAPER_AMPLITUDE, PAPER_N
from npend_gym.listing import LISTING_DURATION, LISTING_FRAMES_PER_SECOND, listing_estimate
from npend_gym.paper.measured import ideal_periods
from npend_gym.paper.registry import Outcome, Verdict, check, corrected_if, holds_if


def get_xy_coords(p: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return x and y [m] of pivot and bobs, (T, n + 1), as listing 2 does from states (T, 2n)."""
    n = p.shape[1] // 2
    lengths = np.ones(n) / n
    zeros = np.zeros(p.shape[0])[:, None]
    x = np.hstack([zeros, lengths * np.sin(p[:, :n])])
    y = np.hstack([zeros, -lengths * np.cos(p[:, :n])])
    return np.cumsum(x, 1), np.cumsum(y, 1)


@check("get-xy")
def _coordinates() -> Outcome:
    path = simulate(Chain.uniform(5, length=0.2), 1.0, 0.5, [0.0, 1.0, 2.0])
    x, y = get_xy_coords(np.hstack([path.theta, path.omega]))
    off = float(np.max(np.abs(np.stack([x, y], axis=-1)[:, 1:] - path.positions())))
    return holds_if(off < 1e-12, off=off)


def mean_period(n: int, length: float) -> float:
    """Return the mean pseudo-period [s] over the bobs of `n` rods of `length` [m], from pi/4."""
    return float(np.mean(pseudo_periods(Chain.uniform(n, length=length), PAPER_AMPLITUDE)))


@check("rods")
def _rods() -> Outcome:
    long, short = mean_period(20, 1.0), mean_period(20, 1.0 / 20)
    return holds_if(abs(short / long - 1.0) < 0.01, long=long, short=short)


def printed_estimate(height: FloatArray) -> float:
    """Return listing 3's get_timeperiod_y of a bob's heights [m], by the printed loops."""
    y = height.tolist()
    z = np.gradient(height)
    times: list[float] = []
    for k in range(len(y)):
        if np.sign(z[k]) != np.sign(z[k - 1]) and k - 1 not in times:
            times.append(k * 1 / 100)
    gaps: list[float] = []
    held: list[int] = []
    for p in range(len(y)):
        for q in range(len(y)):
            if abs(y[p] - y[q]) < 0.01 and p < q:
                held.extend((p, q))
                least = min(held)
                held.remove(least)
                gaps.append(abs(min(held) - least) * 1 / 100)
    averages = [abs(float(np.mean(gaps)))]
    averages += [times[i + 2] - times[i] for i in range(len(times) - 2)]
    return abs(float(np.mean(averages)))


@check("simulation")
def _repair(frames: int = 200) -> Outcome:
    def heights(n: int, frames: int) -> FloatArray:
        times, chain = np.linspace(0.0, LISTING_DURATION, frames), Chain.uniform(n, length=1.0 / n)
        return simulate(chain, PAPER_AMPLITUDE, 0.0, times).positions()[:, :, 1].T

    some = [height for n in (1, 2, 3) for height in heights(n, 120)]
    off = max(abs(printed_estimate(one) / listing_estimate(one.copy()) - 1.0) for one in some)
    start = time.perf_counter()
    printed_estimate(heights(1, frames)[0])
    seconds = (time.perf_counter() - start) * (1000 / frames) ** 4  # the loops grow as frames^4
    return corrected_if(off < 1e-12, off=off, seconds=seconds)


@check("estimator")
def _estimator() -> Outcome:
    counts = (1, 2, 5, 10, 20)
    chains = [Chain.uniform(n, length=1.0 / n) for n in counts]
    found = [pseudo_periods(chain, math.radians(45), reading="listing") for chain in chains]
    returned = np.array([float(np.mean(1.0 / periods)) for periods in found])
    means = np.array([mean_period(n, 1.0 / n) for n in counts])
    holds = bool(np.all(np.abs(returned / means - 1.0) < 0.05))
    return holds_if(holds, returned=returned, ratios=1.0 / (returned * means))


@check("frames")
def _frames() -> Outcome:
    times = np.linspace(0.0, LISTING_DURATION, 1000)
    ratio = float(times[1] - times[0]) * LISTING_FRAMES_PER_SECOND
    return holds_if(abs(ratio - 1.0) < 1e-9, Verdict.CORRECTED, ratio=ratio)


@check("listing-4")
def _figures_listing() -> Outcome:
    def parses(line: str) -> bool:
        with suppress(SyntaxError):
            return bool(ast.parse(line))
        return False

    first = "x_1 = [sequence_of_periods_0[i] for i in range(0,n+1)]"
    third = "x_3 = [sequence_of_periods_3[i] for i in range(0,n+!)]"
    broken = sum(not parses(line) for line in (first, third))
    ideal = ideal_periods(PAPER_N[0] + 1)
    shift = float(np.mean(ideal[2:] / ideal[1:-1] - 1.0))
    return holds_if(broken == 0, broken=broken, shift=shift)
