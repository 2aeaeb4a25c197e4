"""Tables 1-3 of the paper: starting angles and cumulative average decimal errors e(N)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from npend_gym import theory
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.experiments.paper.finding import Finding, Verdict
from npend_gym.experiments.paper.grid import (
    AMPLITUDES,
    ERRORS,
    HALF_DIGIT,
    Grid,
    grid,
    sensitivity,
)
from npend_gym.experiments.paper.readings import AS_PRINTED, AS_WRITTEN
from npend_gym.experiments.release import PAPER_AMPLITUDE, PAPER_N, PAPER_SPREAD
from npend_gym.period import pseudo_periods

THRESHOLD = 0.309  # the paper's circular error e-hat


def truncation_share(n: int, theta0: float = PAPER_AMPLITUDE) -> float:
    """Return how much the integration contributes to e of chain n, relative to e itself.

    The same release with a tolerance near the odeint default and with a hundred times tighter one.
    """
    ideal = theory.ideal_period(Chain.uniform(n))
    mean = [pseudo_periods(Chain.uniform(n), theta0, rtol=r).mean() for r in (1.5e-8, 1.5e-10)]
    loose, tight = (abs(s - ideal) / s for s in mean)
    return float(abs(loose - tight) / tight)


def growth(counts: Sequence[int], e: FloatArray) -> tuple[float, float]:
    """Return d ln e/dN between the first and between the last two: equal for an exponential."""
    slopes = np.diff(np.log(e)) / np.diff(np.asarray(counts, float))
    return float(slopes[0]), float(slopes[-1])


def findings(n_values: tuple[int, ...] = PAPER_N) -> Iterator[Finding]:
    """Yield what the audit says about Tables 1-3, from the grid with the columns `n_values`."""
    yield _amplitudes()
    yield _trials()
    result = grid(n_values)
    for trial in range(3):
        yield _table(result, trial)
    yield _nearest(result)
    yield _scatter(result)
    yield _below()
    yield _exponential(result)
    yield _truncation(n_values[-1])
    yield _threshold()


def _list(values: Any, digits: int = 3) -> str:
    return ", ".join(f"{value:.{digits}f}" for value in np.asarray(values).tolist())


def _amplitudes() -> Finding:
    offsets = AMPLITUDES - PAPER_AMPLITUDE
    inside = int(((offsets >= 0.0) & (offsets <= PAPER_SPREAD)).sum())
    either = int((np.abs(offsets) <= PAPER_SPREAD).sum())
    degrees = np.deg2rad([45.0, 46.0])
    by_listing = int(np.isclose(AMPLITUDES[..., None], degrees, atol=5e-6).any(axis=-1).sum())
    return Finding(
        "amplitudes", "Tables 1-3, first row", "Starting angles are pi/4 plus [0, 0.017] rad",
        f"{AMPLITUDES.min()} to {AMPLITUDES.max()} rad",
        f"{inside} of 12 lie there, {either} of 12 within pi/4 +- 0.017; {by_listing} of 12 is "
        f"45 or 46 degrees",
        Verdict.of(
            inside == AMPLITUDES.size, Verdict.CORRECTED if either == AMPLITUDES.size else None
        ),
        "Most lie below pi/4, and none can come from the listing, which adds 0 or 1 whole degree.",
    )  # fmt: skip


def _trials() -> Finding:
    outcomes = 2  # of random.randint(0, 1)
    draws = np.stack(np.meshgrid(*[range(outcomes)] * 3), axis=-1).reshape(-1, 3)
    alike = np.mean([len(set(draw)) < 3 for draw in draws.tolist()])
    return Finding(
        "trials", "text before Figure 4; listing 3", "Two trials never start alike",
        "probability effectively zero",
        f"probability {alike:.0f} that two of three trials start alike, as listed",
        Verdict.of(float(alike) == 0.0, Verdict.CORRECTED),
        "True of a draw from an interval; the listing draws from {0, 1} degrees.",
    )  # fmt: skip


def _table(result: Grid, trial: int) -> Finding:
    off = np.abs(result.errors[:, trial] - result.printed[trial]).max(axis=1)
    best = int(np.nanargmin(off))
    return Finding(
        f"table-{trial + 1}", f"Table {trial + 1}", "Cumulative average decimal errors e(N)",
        _list(result.printed[trial]),
        f"{_list(result.of(AS_WRITTEN)[trial])} as the text has it; nearest of "
        f"{len(result.readings)} readings {_list(result.errors[best, trial])}",
        Verdict.of(bool(off[best] <= HALF_DIGIT)),
        f"The nearest, off by {off[best]:.3f} in its worst column: {result.readings[best]}.",
    )  # fmt: skip


def _nearest(result: Grid) -> Finding:
    k = result.nearest
    bound = result.printed_scatter.max() / 2.0
    listing = result.of(AS_PRINTED).mean(axis=0)
    return Finding(
        "tables-together", "Tables 1-3", "Some reading of e gives all printed errors",
        f"{result.printed.size} errors",
        f"none of {len(result.readings)}: the nearest is off by {result.distances[k]:.3f}, none "
        f"meets more than {int(result.cells_met.max())} cell(s)",
        Verdict.of(bool(result.distances[k] <= HALF_DIGIT)),
        f"Nearest: {result.readings[k]}. The printed trials differ by up to {2.0 * bound:.3f}, so "
        f"that nothing that is the same for all trials can come nearer than {bound:.4f}. The "
        f"listings as printed give {_list(listing, 1)}.",
    )  # fmt: skip


def _scatter(result: Grid) -> Finding:
    ours = result.scatter[result.readings.index(AS_WRITTEN)]
    median = np.nanmedian(result.scatter, axis=0)
    widest = float(np.nanmax(result.scatter[:, 0]))
    able = int(np.all(result.scatter >= result.printed_scatter, axis=1).sum())
    needed = result.printed_scatter / sensitivity(result, AS_WRITTEN)
    available = np.ptp(result.amplitudes, axis=0)
    return Finding(
        "tables-scatter", "Tables 1-3", "Trials differ because their starting angles do",
        f"range over trials {_list(result.printed_scatter)}",
        f"{_list(ours, 4)} as the text has it, {_list(median, 4)} in the median of all readings",
        Verdict.of(able > 0),
        f"The angles would have to differ by {_list(needed, 2)} rad and differ by "
        f"{_list(available, 3)}; {able} of {len(result.readings)} readings reach the printed range "
        f"in every column; at N = {result.n_values[0]} none comes beyond {widest:.3f}.",
    )  # fmt: skip


def _below() -> Finding:
    worst = ERRORS[:, 0].max()
    return Finding(
        "e-at-5", "text after Table 3", "e is under 0.23 for N = 5 in every trial", "< 0.23",
        f"largest printed {worst}", Verdict.of(bool(worst < 0.23)),
        "True of the printed numbers; it says nothing of truncation, see e-truncation.",
    )  # fmt: skip


def _exponential(result: Grid) -> Finding:
    printed = [growth(PAPER_N, row) for row in ERRORS]
    counts = result.n_values
    first, last = growth(counts, result.of(AS_WRITTEN).mean(axis=0))
    falls = sum(a < 0.0 for a, _ in printed)
    return Finding(
        "e-exponential", "text after Table 3", "e grows exponentially with N",
        f"e(5) = {ERRORS[0, 0]}, e(100) = {ERRORS[0, 3]} (trial 1)",
        f"d ln e/dN falls from {first:.4f} to {last:.4f} between N = {counts[0]} and {counts[-1]}",
        Verdict.of(last >= first and falls == 0),
        f"An exponential has one rate. Of the printed trials {falls} of 3 fall from N = 5 to 10; "
        f"measured, e levels off, for S and T grow alike with the square root of N.",
    )  # fmt: skip


def _truncation(n: int) -> Finding:
    share = truncation_share(n)
    return Finding(
        "e-truncation", "text before and after Tables 1-3",
        "e is a truncation error of the integration and grows with N through chaos",
        "the global truncation error increases as N grows",
        f"tightening the tolerance 100-fold changes e at N = {n} by {share:.0e} of itself",
        Verdict.of(share > 0.01),
        "e is the distance between a motion and a model that leaves out how bobs pull on each "
        "other; the integration has no part in it.",
    )  # fmt: skip


def _threshold() -> Finding:
    within = int((ERRORS < THRESHOLD).sum())
    correction = float(theory.amplitude_correction(PAPER_AMPLITUDE))
    circular = correction / (1.0 + correction)
    met = int((circular > ERRORS).sum())
    return Finding(
        "e-threshold", "text after the circular error",
        "Most e lie within e-hat = 0.309: the model is accurate",
        f"{within} of 12 below 0.309",
        f"{met} of 12 below the circular error {circular:.4f}",
        Verdict.of(2 * met > ERRORS.size),
        "e-hat is one minus an error and is compared with errors; computed correctly the error "
        "that the amplitude explains is smaller than any printed one.",
    )  # fmt: skip
