"""Tables 1-3 of the paper beside the whole grid of readings."""

from __future__ import annotations

import dataclasses
from dataclasses import astuple, dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from tqdm import tqdm

from npend_gym._checks import FloatArray
from npend_gym.experiments.paper.measured import RODS, bob_periods
from npend_gym.experiments.paper.readings import Reading, all_readings, errors
from npend_gym.experiments.release import PAPER_N
from npend_gym.period import READINGS

AMPLITUDES = np.array(
    [
        [0.77578, 0.797476, 0.78477, 0.777],
        [0.77253, 0.77720, 0.79765, 0.77676],
        [0.77419, 0.77749, 0.78107, 0.78599],
    ]
)  # rad; a row for each table, a column for each N of PAPER_N
ERRORS = np.array(
    [[0.142, 0.108, 0.147, 0.376], [0.194, 0.137, 0.158, 0.207], [0.222, 0.149, 0.161, 0.382]]
)
HALF_DIGIT = 0.5e-3  # of a printed e


@dataclass(frozen=True, eq=False)
class Grid:
    """Many readings of e(N) beside the printed one.

    Attributes
    ----------
    n_values : tuple of int
        The columns.
    readings : tuple of Reading
    errors : ndarray, shape (R, 3, C)
        e of each reading, trial and column.
    printed, amplitudes : ndarray, shape (3, C)
        The paper's e and starting angles [rad].
    """

    n_values: tuple[int, ...]
    readings: tuple[Reading, ...]
    errors: FloatArray
    printed: FloatArray
    amplitudes: FloatArray

    @cached_property
    def distances(self) -> FloatArray:
        """How far each reading is off where it is off most, shape (R,); infinite without an e."""
        off = np.abs(self.errors - self.printed).max(axis=(1, 2))
        return np.where(np.isnan(off), np.inf, off)

    @cached_property
    def nearest(self) -> int:
        """Number of the reading whose worst cell is off least."""
        return int(np.argmin(self.distances))

    @cached_property
    def cells_met(self) -> FloatArray:
        """In how many cells each reading gives the printed digits, shape (R,)."""
        return (np.abs(self.errors - self.printed) <= HALF_DIGIT).sum(axis=(1, 2))

    @cached_property
    def scatter(self) -> FloatArray:
        """Range of e over the trials, shape (R, C)."""
        return np.ptp(self.errors, axis=1)

    @cached_property
    def printed_scatter(self) -> FloatArray:
        """Range of the printed e over the trials, shape (C,)."""
        return np.ptp(self.printed, axis=0)

    def of(self, reading: Reading) -> FloatArray:
        """Return e of one reading, shape (3, C)."""
        return self.errors[self.readings.index(reading)]


def grid(n_values: tuple[int, ...] = PAPER_N, estimators: tuple[str, ...] = READINGS) -> Grid:
    """Return the grid of readings for the columns `n_values`, at the printed starting angles.

    The whole grid takes more than a minute, nearly all of it for N = 100; it is kept.
    """
    return _grid(n_values, estimators)


@cache
def _grid(n_values: tuple[int, ...], estimators: tuple[str, ...]) -> Grid:
    columns = [PAPER_N.index(n) for n in n_values]
    readings = tuple(all_readings(estimators))
    amplitudes = AMPLITUDES[:, columns]
    _measure(n_values, amplitudes, estimators)
    measured = errors(readings, n_values, amplitudes)
    return Grid(n_values, readings, measured, ERRORS[:, columns], amplitudes)


def _measure(
    n_values: tuple[int, ...], amplitudes: FloatArray, estimators: tuple[str, ...]
) -> None:
    """Measure what the readings need; `bob_periods` keeps it."""
    jobs = [
        (n, float(theta0), estimator, rods)
        for estimator in estimators
        for rods in RODS
        for n, column in zip(n_values, amplitudes.T, strict=True)
        for theta0 in column
    ]
    for n, *release in tqdm(jobs, unit="column", disable=None, leave=False):
        for count in range(1, n + 2):
            bob_periods(count, *release)


def grid_rows(result: Grid) -> list[dict[str, Any]]:
    """Return the tidy table: a row for every reading, the nearest first."""
    names = [field.name for field in dataclasses.fields(Reading)]
    rows: list[dict[str, Any]] = []
    for k in map(int, np.argsort(result.distances, kind="stable")):
        row: dict[str, Any] = dict(zip(names, astuple(result.readings[k]), strict=True))
        row["worst_distance"] = float(result.distances[k])
        for trial, values in enumerate(result.errors[k], start=1):
            row |= {
                f"e_{trial}_{n}": float(e) for n, e in zip(result.n_values, values, strict=True)
            }
        rows.append(row)
    return rows


def sensitivity(result: Grid, reading: Reading) -> FloatArray:
    """Return |de/dtheta0| [1/rad] of a reading in each column, between its extreme angles."""
    e, columns = result.of(reading), range(len(result.n_values))
    low, high = result.amplitudes.argmin(axis=0), result.amplitudes.argmax(axis=0)
    return np.abs(e[high, columns] - e[low, columns]) / np.ptp(result.amplitudes, axis=0)
