"""The grid of readings: every way in which the paper's error e(N) might have been computed.

The paper says e = (1/N) sum_i |S_i - T_i| / S_i, "cumulative", and leaves open what S_i and T_i
are. A `Reading` fixes it; `errors` evaluates many of them on measured pseudo-periods.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from npend_gym import theory
from npend_gym._checks import FloatArray
from npend_gym.experiments.paper.measured import (
    RODS,
    bob_periods,
    fundamental_periods,
    ideal_periods,
)
from npend_gym.period import LISTING_DURATION, READINGS

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
    """One way to compute e(N).

    Attributes
    ----------
    estimator, rods, window : str
        What completes a pseudo-period; length of the rods; time in which it must.
    statistic : str
        Of the bobs of a chain, or "each bob".
    model, model_rods : str
        T, and the length of rods that it is computed for (the paper's is for 1 m).
    terms : str
        What the sum over i runs over.
    divisor, average : str
        Of each term, |S - T| / divisor, and over the terms.
    """

    estimator: str = "bob"
    rods: str = "1 m"
    window: str = "sufficient"
    statistic: str = "mean"
    model: str = "T0"
    model_rods: str = "1 m"
    terms: str = "chains 1..N"
    divisor: str = "S"
    average: str = "mean"

    def __str__(self) -> str:
        statistic = self.statistic + " of the bobs" * (self.statistic in STATISTICS)
        return (
            f'"{self.estimator}", rods {self.rods}, window {self.window}, {statistic}, '
            f"{self.model} for rods of {self.model_rods}, {self.terms}, "
            f"|S - T|/{self.divisor}, {self.average}"
        )


AS_WRITTEN = Reading()  # the text taken at its word, with the window that the bobs need
AS_PRINTED = Reading("listing", "1/n m", "10 s", "mean of 1/T", terms="as drawn")  # the listings


def all_readings(estimators: Sequence[str] = READINGS) -> Iterator[Reading]:
    """Yield every reading that differs from the others."""
    sums = [
        *itertools.product(STATISTICS, CHAIN_SUMS),
        *(("each bob", terms) for terms in BOB_SUMS),
    ]
    for estimator, rods, window in itertools.product(estimators, RODS, WINDOWS):
        if window == "sufficient" and (estimator == "listing" or rods == "1/n m"):
            continue  # the listing has no other window; on short rods 10 s are sufficient
        for (statistic, terms), model, model_rods in itertools.product(
            sums, MODELS, dict.fromkeys(("1 m", rods))
        ):
            for divisor, average in itertools.product(DIVISORS, AVERAGES):
                yield Reading(
                    estimator, rods, window, statistic, model, model_rods, terms, divisor, average
                )


def error(reading: Reading, n: int, theta0: float) -> float:
    """Return e(n) for a release at `theta0` [rad]; NaN where no bob completes."""
    simulated, index = _simulated(reading, n, theta0)
    predicted = _model(reading, n, theta0)[index]
    divisor = simulated if reading.divisor == "S" else predicted
    done = np.isfinite(simulated) & (divisor > 0.0)  # T(0) = 0 divides nothing
    if not done.any():
        return np.nan
    return AVERAGES[reading.average]((simulated - predicted)[done] / divisor[done])


def errors(
    readings: Sequence[Reading], n_values: Sequence[int], amplitudes: FloatArray
) -> FloatArray:
    """Return e of every reading, shape (R, trials, N), for `amplitudes` [rad], (trials, N)."""
    return np.array(
        [
            [
                [error(r, n, float(a)) for n, a in zip(n_values, row, strict=True)]
                for row in amplitudes
            ]
            for r in readings
        ]
    )


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
def _statistic(
    statistic: str, estimator: str, rods: str, window: str, n: int, theta0: float
) -> FloatArray:
    periods = _periods(estimator, rods, window, n, theta0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return STATISTICS[statistic](periods)


@cache
def _model_factor(model: str, theta0: float) -> float:
    if model == "T0 corrected":
        return 1.0 + float(theory.amplitude_correction(theta0))
    return {"T0 x 1.049": 1.049, "T0 x 1.311": 1.311}.get(model, 1.0)


@cache
def _model_periods(model: str, model_rods: str, terms: str, n: int, theta0: float) -> FloatArray:
    """Return T(0), ..., T(n) [s]."""
    lengths = np.ones(n + 1)
    if model_rods == "1/n m":
        lengths = 1.0 / (
            np.full(n + 1, n) if terms in BOB_SUMS else np.maximum(1, np.arange(n + 1))
        )
    periods = fundamental_periods(n) if model == "T1" else ideal_periods(n)
    return periods * np.sqrt(lengths) * _model_factor(model, theta0)


def _model(reading: Reading, n: int, theta0: float) -> FloatArray:
    return _model_periods(reading.model, reading.model_rods, reading.terms, n, theta0)
