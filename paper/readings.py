"""The grid of readings: every way in which the paper's error e(N) might have been computed.

The paper says e = (1/N) sum_i |S_i - T_i| / S_i, "cumulative", and leaves open what S_i and T_i
are. A `Reading` fixes it; `grid` evaluates many of them on measured pseudo-periods.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym import theory
from npend_gym.experiments import PAPER_N
from npend_gym.tools import FloatArray
from paper.claims import printed
from paper.estimator import LISTING_DURATION
from paper.measured import RODS, bob_periods, fundamental_periods, ideal_periods

AMPLITUDES = np.array(
    [[0.77578, 0.797476, 0.78477, 0.777],
     [0.77253, 0.77720, 0.79765, 0.77676],
     [0.77419, 0.77749, 0.78107, 0.78599]]
)  # rad; a row for each of Tables 1-3, a column for each N of PAPER_N  # fmt: skip
ERRORS = np.array([printed(f"table-{trial}") for trial in (1, 2, 3)], float)  # the printed e
HALF_DIGIT = 0.5e-3  # of a printed e

ESTIMATORS = ("bob", "link", "height", "listing")  # what "changes its direction twice" may mean
WINDOWS = ("10 s", "sufficient")
STATISTICS: dict[str, Callable[[FloatArray], FloatArray]] = {  # of the bobs of a chain, a row each
    "mean": lambda p: np.nanmean(p, axis=1),
    "median": lambda p: np.nanmedian(p, axis=1),
    "harmonic mean": lambda p: 1.0 / np.nanmean(1.0 / p, axis=1),
    "mean of 1/T": lambda p: np.nanmean(1.0 / p, axis=1),  # what the listing returns
    "last": lambda p: np.diagonal(p),  # noqa: PLW0108 - np.diagonal has no one type
}
MODELS = ("T0", "T0 x 1.049", "T0 x 1.311", "T0 corrected", "T1")
CHAIN_SUMS = ("chains 1..N", "chain N", "as drawn")  # as drawn: chain i + 1 against T(i), i = 0..N
BOB_SUMS = ("bobs of chain N", "bob i against T(i)")
DIVISORS = ("S", "T")
AVERAGES: dict[str, Callable[[FloatArray], float]] = {
    "mean": lambda e: float(np.mean(np.abs(e))),
    "root mean square": lambda e: float(np.sqrt(np.mean(e**2))),
    "signed mean": lambda e: abs(float(np.mean(e))),
}


@dataclass(frozen=True)
class Reading:
    """One way to compute e(N)."""

    estimator: str = "bob"  # what completes a pseudo-period
    rods: str = "1 m"  # their length
    window: str = "sufficient"  # the time in which bobs must complete
    statistic: str = "mean"  # of the bobs of a chain, or "each bob"
    model: str = "T0"  # T
    model_rods: str = "1 m"  # length of rods that T is computed for: the paper's is for 1 m
    terms: str = "chains 1..N"  # what the sum over i runs over
    divisor: str = "S"  # of each term, |S - T| / divisor
    average: str = "mean"  # over the terms

    def __str__(self) -> str:
        statistic = self.statistic + " of the bobs" * (self.statistic in STATISTICS)
        measured = f'"{self.estimator}", rods {self.rods}, window {self.window}, {statistic}'
        model = f"{self.model} for rods of {self.model_rods}, {self.terms}"
        return f"{measured}, {model}, |S - T|/{self.divisor}, {self.average}"


AS_WRITTEN = Reading()  # the text read literally, with the window that the bobs need
AS_PRINTED = Reading("listing", "1/n m", "10 s", "mean of 1/T", terms="as drawn")  # the listings


def all_readings(estimators: Sequence[str] = ESTIMATORS) -> Iterator[Reading]:
    """Yield every reading that differs from the others."""
    sums = [*itertools.product(STATISTICS, CHAIN_SUMS), *itertools.product(["each bob"], BOB_SUMS)]
    for estimator, rods, window in itertools.product(estimators, RODS, WINDOWS):
        if window == "sufficient" and (estimator == "listing" or rods == "1/n m"):
            continue  # the listing has no other window; on short rods 10 s are sufficient
        model_rods = dict.fromkeys(("1 m", rods))
        for (statistic, terms), model, of, divisor, average in itertools.product(
            sums, MODELS, model_rods, DIVISORS, AVERAGES
        ):
            yield Reading(estimator, rods, window, statistic, model, of, terms, divisor, average)


def error(reading: Reading, n: int, theta0: float) -> float:
    """Return e(n) for a release at `theta0` [rad]; NaN where no bob completes."""
    simulated, index = _simulated(reading, n, theta0)
    predicted = _model(reading.model, reading.model_rods, reading.terms, n, theta0)[index]
    divisor = simulated if reading.divisor == "S" else predicted
    done = np.isfinite(simulated) & (divisor > 0.0)  # T(0) = 0 divides nothing
    if not done.any():
        return np.nan
    return AVERAGES[reading.average]((simulated - predicted)[done] / divisor[done])


def _simulated(reading: Reading, n: int, theta0: float) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return the S_i, and for each the number of pendulums of the model it is compared with."""
    source = (reading.estimator, reading.rods, reading.window)
    if reading.terms in BOB_SUMS:
        bobs = _periods(*source, n, theta0)[n - 1, :n]
        return bobs, np.arange(1, n + 1) if reading.terms == BOB_SUMS[1] else np.full(n, n)
    chains = _statistic(reading.statistic, *source, n, theta0)
    if reading.terms == "chain N":
        return chains[n - 1 : n], np.array([n])
    if reading.terms == "as drawn":
        return chains, np.arange(n + 1)
    return chains[:n], np.arange(1, n + 1)


@cache
def _periods(estimator: str, rods: str, window: str, n: int, theta0: float) -> FloatArray:
    """Return the pseudo-periods [s] of chains 1..n + 1, a row each, filled up with NaN."""
    table = np.full((n + 1, n + 1), np.nan)
    for row, count in enumerate(range(1, n + 2)):
        table[row, :count] = bob_periods(count, theta0, estimator, rods)
    if window == "10 s" and estimator != "listing":
        table[table > LISTING_DURATION] = np.nan
    return table


@cache
def _statistic(statistic: str, *source: Any) -> FloatArray:
    with np.errstate(invalid="ignore", divide="ignore"):
        return STATISTICS[statistic](_periods(*source))


@cache
def _model(model: str, model_rods: str, terms: str, n: int, theta0: float) -> FloatArray:
    """Return T(0), ..., T(n) [s]."""
    counts = np.full(n + 1, n) if terms in BOB_SUMS else np.maximum(1, np.arange(n + 1))
    lengths = 1.0 / counts if model_rods == "1/n m" else np.ones(n + 1)
    periods = fundamental_periods(n) if model == "T1" else ideal_periods(n)
    factors = {"T0 x 1.049": 1.049, "T0 x 1.311": 1.311}
    if model == "T0 corrected":
        factors[model] = 1.0 + float(theory.amplitude_correction(theta0))
    return periods * np.sqrt(lengths) * factors.get(model, 1.0)


class Grid:
    """e(N) by many readings beside the printed one, in the columns `n_values`.

    `errors` has shape (R, 3, C): reading, trial, column.
    """

    def __init__(
        self, n_values: tuple[int, ...], readings: Sequence[Reading], errors: FloatArray
    ) -> None:
        columns = [PAPER_N.index(n) for n in n_values]
        self.n_values, self.readings, self.errors = n_values, readings, errors
        self.printed, self.amplitudes = ERRORS[:, columns], AMPLITUDES[:, columns]  # (3, C)
        off = np.abs(errors - self.printed)
        worst = off.max(axis=(1, 2))
        self.distances = np.where(np.isnan(worst), np.inf, worst)  # infinite without an e
        self.nearest = int(np.argmin(self.distances))
        self.cells_met = (off <= HALF_DIGIT).sum(axis=(1, 2))  # where the printed digits are met
        # Range of e over the trials, (R, C) and (C,)
        self.scatter, self.printed_scatter = np.ptp(errors, axis=1), np.ptp(self.printed, axis=0)

    def of(self, reading: Reading) -> FloatArray:
        """Return e of one reading, shape (3, C)."""
        return self.errors[self.readings.index(reading)]

    def sensitivity(self, reading: Reading) -> FloatArray:
        """Return abs(de/dtheta0) [1/rad] of a reading in each column, from its extreme angles."""
        e, columns = self.of(reading), range(len(self.n_values))
        low, high = self.amplitudes.argmin(axis=0), self.amplitudes.argmax(axis=0)
        return np.abs(e[high, columns] - e[low, columns]) / np.ptp(self.amplitudes, axis=0)

    def rows(self) -> list[dict[str, Any]]:
        """Return the tidy table: a row for every reading, the nearest first."""
        names = [f"e_{trial}_{n}" for trial in (1, 2, 3) for n in self.n_values]
        return [
            asdict(self.readings[k])
            | {"worst_distance": float(self.distances[k])}
            | dict(zip(names, self.errors[k].ravel().tolist(), strict=True))
            for k in map(int, np.argsort(self.distances, kind="stable"))
        ]


@cache
def grid(n_values: tuple[int, ...] = PAPER_N, estimators: tuple[str, ...] = ESTIMATORS) -> Grid:
    """Return the grid of readings for the columns `n_values`, at the printed starting angles.

    The whole grid takes more than a minute, nearly all of it for N = 100; it is kept.
    """
    readings = tuple(all_readings(estimators))
    return Grid(n_values, readings, np.array([errors(one, n_values) for one in readings]))


def errors(reading: Reading, n_values: tuple[int, ...] = PAPER_N) -> FloatArray:
    """Return e of a reading in every trial and column, shape (3, C)."""
    columns = {n: AMPLITUDES[:, PAPER_N.index(n)].tolist() for n in n_values}
    return np.array([[error(reading, n, a) for a in angles] for n, angles in columns.items()]).T
