"""Appendix D: the listings for coordinates and for the simulated period, repaired to run.

Listing 3 runs as printed, given the imports of listing 1, but for hours: it searches, for every
pair of frames, a list that has grown by one entry for every pair before. The one repair, in
`npend_gym.period.listing_estimate`, counts the entries instead; `printed_estimate` here is the
printed loop, to compare on a few frames. Its unused parts (`theta`, `computeperiod`) are left out.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.experiments.paper.finding import Finding, Verdict
from npend_gym.experiments.paper.fits import show
from npend_gym.experiments.release import PAPER_AMPLITUDE
from npend_gym.period import (
    LISTING_DURATION,
    LISTING_FRAMES_PER_SECOND,
    listing_estimate,
    pseudo_periods,
)
from npend_gym.physics import simulate

COUNTS = (1, 2, 5, 10, 20)


def get_xy_coords(p: ArrayLike, lengths: ArrayLike | None = None) -> tuple[FloatArray, FloatArray]:
    """Return x and y [m] of pivot and bobs, shape (T, n + 1), as listing 2 prints it.

    `p` holds angles and angular velocities, shape (T, 2n); rods are 1/n m long by default.
    """
    p = np.atleast_2d(np.asarray(p, float))
    n = p.shape[1] // 2
    if lengths is None:
        lengths = np.ones(n) / n
    zeros = np.zeros(p.shape[0])[:, None]
    x = np.hstack([zeros, np.asarray(lengths) * np.sin(p[:, :n])])
    y = np.hstack([zeros, -np.asarray(lengths) * np.cos(p[:, :n])])
    return np.cumsum(x, 1), np.cumsum(y, 1)


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


@cache
def simulation(n: int, perturbation: int = 0) -> float:
    """Return what listing 3 appends for chain `n`: the mean of 1/T [1/s] over the bobs.

    Rods of 1/n m, released at 45 + `perturbation` whole degrees, 0 or 1.
    """
    chain = Chain.uniform(n, length=1.0 / n)
    start = math.radians(45 + perturbation)
    return float(np.mean(1.0 / pseudo_periods(chain, start, reading="listing")))


def findings() -> Iterator[Finding]:
    """Yield the findings about the listings."""
    yield _coordinates()
    yield _rods()
    yield _repair()
    yield _estimator()
    yield _frames()


def _coordinates() -> Finding:
    chain = Chain.uniform(5, length=0.2)
    path = simulate(chain, 1.0, 0.5, [0.0, 1.0, 2.0])
    x, y = get_xy_coords(np.hstack([path.theta, path.omega]))
    off = float(np.max(np.abs(np.stack([x, y], axis=-1)[:, 1:] - path.positions())))
    return Finding(
        "get-xy", "Listing 2", "coordinates of the bobs", "get_xy_coords",
        f"off by {off:.0e} m", Verdict.of(off < 1e-12), "With the pivot as column 0.",
    )  # fmt: skip


def _rods() -> Finding:
    n = 20
    long, short = (
        float(np.mean(pseudo_periods(Chain.uniform(n, length=l), PAPER_AMPLITUDE)))
        for l in (1.0, 1.0 / n)
    )
    return Finding(
        "rods", "Listings 1 and 3; section 2", "rods are 1 m long", "lengths = np.ones(n) / n",
        f"mean period at N = {n}: {long:.3f} s on rods of 1 m, {short:.3f} s on the listing's",
        Verdict.of(abs(short / long - 1.0) < 0.01),
        "The listing divides 1 m among the rods, and so the periods by sqrt(N): as printed its "
        "periods do not grow with N at all, while its model has rods of 1 m.",
    )  # fmt: skip


def _repair() -> Finding:
    times = np.linspace(0.0, LISTING_DURATION, 120)
    off = 0.0
    for n in (1, 2, 3):
        chain = Chain.uniform(n, length=1.0 / n)
        heights = simulate(chain, PAPER_AMPLITUDE, 0.0, times).positions()[:, :, 1]
        for height in heights.T:
            off = max(off, abs(printed_estimate(height) / listing_estimate(height.copy()) - 1.0))
    return Finding(
        "simulation", "Listing 3", "Simulation() finds the average period of each bob",
        "get_timeperiod_y",
        f"with its list counted instead of searched: the printed value to {off:.0e}; as printed "
        f"some {_printed_seconds():.0f} s a bob",
        Verdict.CORRECTED if off < 1e-12 else Verdict.FAILS,
        'So it runs, 231 bobs for N = 20, in seconds; nothing else is repaired. It is the reading '
        '"listing" of pseudo_periods. What it finds, see `estimator`.',
    )  # fmt: skip


def _printed_seconds(frames: int = 200) -> float:
    """Return the time [s] that the printed loops take for a bob, which grows as frames^4."""
    times = np.linspace(0.0, LISTING_DURATION, frames)
    height = simulate(Chain.uniform(1), PAPER_AMPLITUDE, 0.0, times).positions()[:, 0, 1]
    start = time.perf_counter()
    printed_estimate(height)
    return (time.perf_counter() - start) * (1000 / frames) ** 4


def _estimator() -> Finding:
    returned = np.array([simulation(n) for n in COUNTS])
    means = np.array([
        float(np.mean(pseudo_periods(Chain.uniform(n, length=1.0 / n), PAPER_AMPLITUDE)))
        for n in COUNTS
    ])  # fmt: skip
    ratios = 1.0 / (returned * means)
    return Finding(
        "estimator", "Listing 3 and its text", "it returns the average time period",
        "np.mean(allperiods), of 1/get_timeperiod_y",
        f"it returns {show(returned)} 1/s for N = {', '.join(map(str, COUNTS))}; inverted, that is "
        f"{show(ratios)} of the measured periods",
        Verdict.of(bool(np.all(np.abs(returned / means - 1.0) < 0.05))),
        "A mean of frequencies, not of times. A height turns four times in a full swing, so that "
        "times[i+2] - times[i] is half a period; the mean gap of frames of like height is none.",
    )  # fmt: skip


def _frames() -> Finding:
    times = np.linspace(0.0, LISTING_DURATION, 1000)
    ratio = float(times[1] - times[0]) * LISTING_FRAMES_PER_SECOND
    return Finding(
        "frames", "text before Figure 4; listing 3", "10 seconds over 1000 frames",
        "np.linspace(0, 10, 1000), counted as 1/100 s",
        f"frames are {ratio:.5f}/100 s apart",
        Verdict.of(abs(ratio - 1.0) < 1e-9, Verdict.CORRECTED),
        "1000 frames have 999 gaps; every time comes out 0.1 % short.",
    )  # fmt: skip
