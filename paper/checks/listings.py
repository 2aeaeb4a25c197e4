"""Appendix D: the listings, as the paper prints them (`paper.printed`) and mended to run.

Listing 3 searches, for every pair of frames, a list that has grown by one entry for every pair
before, and so would run for hours. `paper.estimator` counts the entries instead.
"""

import math
import time

import numpy as np

from npend_gym import Chain, pseudo_periods, simulate
from npend_gym.experiments import PAPER_AMPLITUDE, PAPER_N
from npend_gym.tools import FloatArray
from paper.estimator import (
    LISTING_DURATION,
    LISTING_FRAMES_PER_SECOND,
    listing_estimate,
    listing_periods,
)
from paper.measured import ideal_periods
from paper.printed import (
    dead_functions,
    function,
    listings,
    simulated_counts,
    undefined_names,
)
from paper.registry import Outcome, Verdict, check, holds_if, slip_if


@check("get-xy")
def _coordinates() -> Outcome:
    path = simulate(Chain.uniform(5, length=0.2), 1.0, 0.5, [0.0, 1.0, 2.0])
    x, y = function(2, "get_xy_coords")(np.hstack([path.theta, path.omega]))
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
    """Return what listing 3's get_timeperiod_y gives for a bob's heights [m], shape (T,)."""
    estimate = function(3, "get_timeperiod_y", y=height[:, None], r=height.size)
    return float(estimate(0))


def heights(n: int, frames: int) -> FloatArray:
    """Return the heights of the bobs [m] that listing 3 sees, shape (n, frames)."""
    times, chain = np.linspace(0.0, LISTING_DURATION, frames), Chain.uniform(n, length=1.0 / n)
    return simulate(chain, PAPER_AMPLITUDE, 0.0, times).positions()[:, :, 1].T


@check("simulation")
def _repair(frames: int = 200) -> Outcome:
    some = [height for n in (1, 2, 3) for height in heights(n, 120)]
    off = max(abs(printed_estimate(one) / listing_estimate(one.copy()) - 1.0) for one in some)
    start = time.perf_counter()
    printed_estimate(heights(1, frames)[0])
    seconds = (time.perf_counter() - start) * (1000 / frames) ** 4  # the loops grow as frames^4
    return slip_if(off < 1e-12, off=off, seconds=seconds, why="; ".join(listings()[2].mends),
                   dead=", ".join(sorted(dead_functions(3))))  # fmt: skip


@check("index-seconds")
def _index_against_seconds(counts: tuple[int, ...] = (1, 2, 3, 5, 10)) -> Outcome:
    turns = repeated = dropped = 0
    for height in np.concatenate([heights(n, 1000) for n in counts]):
        sign, times = np.sign(np.gradient(height)), list[float]()
        frames = np.flatnonzero(sign != np.roll(sign, 1))
        turns, repeated = turns + frames.size, repeated + int((np.diff(frames) == 1).sum())
        for k in frames.tolist():
            if k - 1 in times:  # as printed: a frame, and seconds
                dropped += 1
            else:
                times.append(k / LISTING_FRAMES_PER_SECOND)
    return slip_if(repeated == dropped == 0, turns=turns, repeated=repeated, dropped=dropped)


@check("calls")
def _calls() -> Outcome:
    counts = simulated_counts()
    return holds_if(set(counts) == set(PAPER_N), first=counts[0], last=counts[-1])


@check("estimator")
def _estimator() -> Outcome:
    counts = (1, 2, 5, 10, 20)
    chains = [Chain.uniform(n, length=1.0 / n) for n in counts]
    found = [listing_periods(chain, math.radians(45)) for chain in chains]
    returned = np.array([float(np.mean(1.0 / periods)) for periods in found])
    means = np.array([mean_period(n, 1.0 / n) for n in counts])
    holds = bool(np.all(np.abs(returned / means - 1.0) < 0.05))
    return holds_if(holds, returned=returned, ratios=1.0 / (returned * means))


@check("frames")
def _frames() -> Outcome:
    times = np.linspace(0.0, LISTING_DURATION, 1000)
    ratio = float(times[1] - times[0]) * LISTING_FRAMES_PER_SECOND
    return holds_if(abs(ratio - 1.0) < 1e-9, Verdict.SLIP, ratio=ratio)


@check("listing-4")
def _figures_listing() -> Outcome:
    mends, missing = listings()[3].mends, undefined_names(4)
    ideal = ideal_periods(PAPER_N[0] + 1)
    shift = float(np.mean(ideal[2:] / ideal[1:-1] - 1.0))
    return holds_if(not mends and not missing, broken=len(mends), why="; ".join(mends),
                    missing=" and ".join(sorted(missing, reverse=True)), shift=shift)  # fmt: skip
