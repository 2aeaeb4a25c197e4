"""Statistics of a campaign's releases by cell, and its outliers; one part in memory at a time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.experiments.campaign.folder import Folder
from npend_gym.experiments.campaign.status import parts_of
from npend_gym.experiments.studies.release_plan import RELEASES, CampaignPlan
from npend_gym.experiments.studies.release_tables import read_releases

FAR = 6.0  # standard deviations, beyond which a release is an outlier
EDGES = np.linspace(-8.0, 8.0, 65)  # of the histogram of residuals, in standard deviations
_ENOUGH = 20  # releases that a cell must have, so that one of them can be called an outlier
_NOISE = 1e-8  # of the period: error that the integration's tolerance allows
_LISTED = 100
_COLUMNS = ("start_rad", "mean_s", "median_s", "tip_s")


@dataclass(frozen=True)
class Outlier:
    """A release whose median over the bobs is far from those of its cell.

    `expected_s` is the value, at its starting angle, of the parabola fitted to the cell's releases;
    `deviations` is the distance from it in standard deviations of these releases.
    """

    cell: int
    trial: int
    start_rad: float
    median_s: float
    expected_s: float
    deviations: float


@dataclass(frozen=True, eq=False)
class Statistics:
    """Statistics of the releases of each cell; arrays of shape (C,) have an entry for each cell.

    Attributes
    ----------
    releases : ndarray of int, shape (C,)
        Releases measured.
    completed : ndarray of int, shape (C,)
        Bobs that completed in them.
    unknown : ndarray of int, shape (C,)
        Releases without a median, because half of the bobs or fewer completed.
    start : ndarray, shape (C,)
        Mean starting angle [rad] of the releases that have a median; NaN where there are none.
    mean, median, tip : ndarray, shape (C,)
        Means over the releases of the mean and median over the bobs and of the last bob [s].
    parabola : ndarray, shape (C, 3)
        Coefficients [s] of 1, u, u^2 of the median, u from 0 to 1 being the place of the starting
        angle within the spread.
    scatter : ndarray, shape (C,)
        Standard deviation about the parabola [s].
    outliers : list of Outlier
        At most a hundred, the farthest first.
    outlier_count : int
        Number of outliers, also of those not listed.
    histogram : ndarray of int
        Number of residuals, in units of the scatter, between `EDGES`.
    """

    releases: NDArray[np.int64]
    completed: NDArray[np.int64]
    unknown: NDArray[np.int64]
    start: FloatArray
    mean: FloatArray
    median: FloatArray
    tip: FloatArray
    parabola: FloatArray
    scatter: FloatArray
    outliers: list[Outlier]
    outlier_count: int
    histogram: NDArray[np.int64]


@dataclass(frozen=True)
class _CellRows:
    """The releases of one cell that lie in one part."""

    cell: int
    trial: NDArray[np.int64]
    completed: NDArray[np.int64]
    columns: dict[str, FloatArray]
    place: FloatArray  # of the start within the spread

    def median(self) -> tuple[FloatArray, FloatArray]:
        """Return 1, u, u^2 of the place, shape (R, 3), and the median [s], where there is one."""
        some = np.isfinite(self.columns["median_s"])
        return np.vander(self.place[some], 3, increasing=True), self.columns["median_s"][some]


def _cell_rows(plan: CampaignPlan, folder: Folder, done: BoolArray) -> Iterator[_CellRows]:
    for task, name in parts_of(plan, folder, RELEASES, done):
        part = read_releases(plan, folder, name, task)
        cells = part["cell"]
        columns = {name: part[name] for name in _COLUMNS}
        present, firsts = np.unique(cells, return_index=True)
        for cell, first, last in zip(present, firsts, [*firsts[1:], len(cells)], strict=True):
            span = slice(int(first), int(last))
            values = plan.cell(int(cell))
            own = {name: column[span] for name, column in columns.items()}
            place = (own["start_rad"] - values["amplitude"]) / (values["spread"] or 1.0)
            trial, bobs = (part[name][span] for name in ("trial", "completed"))
            yield _CellRows(int(cell), trial, bobs, own, place)


def statistics(plan: CampaignPlan, folder: Folder, done: BoolArray) -> Statistics:
    """Return the statistics of the releases of tasks that are done, in three passes over them."""
    releases, completed = np.zeros((2, plan.cells), np.int64)
    sums, counts = np.zeros((2, plan.cells, len(_COLUMNS)))
    normal, right = np.zeros((plan.cells, 3, 3)), np.zeros((plan.cells, 3))
    for rows in _cell_rows(plan, folder, done):
        k = rows.cell
        releases[k] += len(rows.trial)
        completed[k] += int(rows.completed.sum())
        for j, values in enumerate(rows.columns.values()):
            some = np.isfinite(values) & np.isfinite(rows.columns["median_s"])
            sums[k, j] += values[some].sum()
            counts[k, j] += some.sum()
        powers, median = rows.median()
        normal[k] += powers.T @ powers
        right[k] += powers.T @ median
    means = sums / np.where(counts, counts, np.nan)
    # by the pseudo-inverse: without a spread, or with few releases, there is no parabola to find
    parabola = np.einsum("kij,kj->ki", np.linalg.pinv(normal, hermitian=True), right)
    squares = np.zeros(plan.cells)
    for rows in _cell_rows(plan, folder, done):
        powers, median = rows.median()
        squares[rows.cell] += np.sum((median - powers @ parabola[rows.cell]) ** 2)
    count = counts[:, _COLUMNS.index("median_s")]
    scatter = np.sqrt(squares / np.where(count > 3, count - 3, np.nan))
    far = _far(_cell_rows(plan, folder, done), parabola, scatter, count)
    unknown = releases - count.astype(np.int64)
    start, mean, median, tip = means.T
    return Statistics(
        releases, completed, unknown, start, mean, median, tip, parabola, scatter, *far
    )  # fmt: skip


def _far(
    cell_rows: Iterator[_CellRows], parabola: FloatArray, scatter: FloatArray, count: FloatArray
) -> tuple[list[Outlier], int, NDArray[np.int64]]:
    """Return the outliers, how many there are, and the histogram of all residuals."""
    outliers: list[Outlier] = []
    total = 0
    histogram = np.zeros(len(EDGES) - 1, np.int64)
    for rows in cell_rows:
        powers, median = rows.median()
        if count[rows.cell] < _ENOUGH or median.size == 0:
            continue
        expected = powers @ parabola[rows.cell]
        residual = (median - expected) / max(scatter[rows.cell], _NOISE * expected.mean())
        histogram += np.histogram(np.clip(residual, EDGES[0], EDGES[-1]), EDGES)[0]
        some = np.flatnonzero(np.isfinite(rows.columns["median_s"]))
        beyond = np.flatnonzero(np.abs(residual) > FAR)
        total += beyond.size
        outliers += [
            Outlier(
                rows.cell, int(rows.trial[some[k]]), float(rows.columns["start_rad"][some[k]]),
                float(median[k]), float(expected[k]), float(residual[k]),
            )
            for k in beyond
        ]  # fmt: skip
        outliers.sort(key=lambda outlier: -abs(outlier.deviations))
        del outliers[_LISTED:]
    return outliers, total, histogram
