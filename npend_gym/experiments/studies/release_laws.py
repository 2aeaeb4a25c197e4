"""The law that the releases of a campaign follow, fitted against N and the amplitude.

The period T of a cell is the mean, over its releases, of the median over the bobs. A bob that does
not complete is slower than those that do. Fits leave out a cell if a median of it is unknown. Cells
differing only in n, amplitude and spread make a group. Two laws are fitted to a group:

    T ~ (N + 1/2)^p                          at each amplitude with at least three N,
    T = c T1(N) [1 + b a^2 / (1 + d a^2)]    for each N, and for all N from ten up together.

T1 is the exact period of the slowest mode, a the mean starting angle, up to 1.2 rad. The intervals
are those of least squares. The releases have no noise, so they measure how well the formula fits.
"""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias, cast

import numpy as np
from scipy.optimize import OptimizeWarning, curve_fit

from npend_gym import theory
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain, preset_name
from npend_gym.experiments.campaign.folder import open_folder
from npend_gym.experiments.campaign.merge import Summary, summary
from npend_gym.experiments.campaign.status import FolderStatus, check_folder, read_plan
from npend_gym.experiments.campaign.sweep import SweepPlan
from npend_gym.experiments.fits import (
    LAW_FROM,
    LAW_UP_TO,
    Estimate,
    amplitude_factor,
    estimates,
    power_law,
)
from npend_gym.experiments.studies.release_plan import OF_CHAIN, CampaignPlan
from npend_gym.experiments.studies.release_statistics import Statistics, statistics

_COUNTS, _AMPLITUDES = 3, 4  # different ones, below which no law is fitted
_EXACT_UP_TO = 300  # bobs; beyond them the rope's limit stands for the chain's
_Fit: TypeAlias = tuple[FloatArray, FloatArray]
_GROUPED = (*OF_CHAIN[1:], "definition")


@dataclass(frozen=True)
class CellResult:
    """What was measured in a cell: mean `start` [rad], `period` and `fundamental` [s]."""

    cell: int
    n: int
    amplitude: float
    spread: float
    start: float
    period: float
    fundamental: float

    @property
    def ratio(self) -> float:
        """The period over that of the slowest mode."""
        return self.period / self.fundamental


@dataclass(frozen=True)
class PowerFit:
    """The fitted power of N + 1/2 at one amplitude and spread."""

    amplitude: float
    spread: float
    points: tuple[CellResult, ...]
    p: Estimate
    residuals: FloatArray


@dataclass(frozen=True)
class AmplitudeLaw:
    """The fitted law against the amplitude.

    Attributes
    ----------
    n_values : tuple of int
        The chains that it was fitted to.
    c, b, d : Estimate
        b and d in 1/rad^2.
    exact : float, optional
        The exact c, from the linearised equations, the mean of several chains: known for equal rods
        and masses without damping and the definitions "bob", "horizontal" and "com".
    points : tuple of CellResult
    residuals : ndarray
        Measured over law, minus one, of each point.
    """

    n_values: tuple[int, ...]
    c: Estimate
    b: Estimate
    d: Estimate
    exact: float | None
    points: tuple[CellResult, ...]
    residuals: FloatArray

    def ratio(self, start: FloatArray) -> FloatArray:
        """Return T/T1 for starting angles [rad]."""
        return self.c.value * amplitude_factor(start, self.b.value, self.d.value)


@dataclass(frozen=True)
class CellGroup:
    """Cells that share `values`, and the laws that were fitted to them."""

    values: Mapping[str, Any]
    points: tuple[CellResult, ...]
    powers: tuple[PowerFit, ...]
    laws: tuple[AmplitudeLaw, ...]

    @property
    def label(self) -> str:
        """The shared values as text."""
        return ", ".join(f"{name} {value}" for name, value in self.values.items())


@dataclass(frozen=True)
class Analysis:
    """The state of a campaign's folder, statistics of its cells, and the fitted laws."""

    plan: CampaignPlan
    out: Path
    status: FolderStatus
    statistics: Statistics
    groups: tuple[CellGroup, ...]


def analyse(out: Path | str) -> Any:
    """Analyse the finished tasks of the campaign in `out`, which need not be all.

    Returns
    -------
    Analysis or Summary
        Of releases the statistics and the laws, of another study the statistics of its numbers.

    Raises
    ------
    ValueError
        If there is no campaign in `out`, nothing of it is done, or a part is none of its.

    Examples
    --------
    >>> from npend_gym.experiments import Campaign, CampaignPlan, analyse
    >>> with Campaign(CampaignPlan(n=2, amplitude=[0.1, 0.3], trials=10), "results") as campaign:
    ...     results = list(campaign.run())
    >>> analyse("results").statistics.median.round(3).tolist()
    [2.542, 2.569]
    """
    folder = open_folder(out)
    plan = read_plan(folder)
    if plan is None:
        raise ValueError(f"there is no campaign in {out}: npend campaign --out {out} makes one")
    status = check_folder(plan, folder)
    if not status.count:
        raise ValueError(f"nothing is done yet in {out}: npend campaign --out {out} continues it")
    where = Path(str(folder))
    if isinstance(plan, SweepPlan):
        return Summary(plan, where, status, summary(plan, folder, status.done))
    plan = cast("CampaignPlan", plan)
    with np.errstate(all="ignore"):  # what is not finite is left out of the fits
        stats = statistics(plan, folder, status.done)
        groups = tuple(_groups(plan, stats))
    return Analysis(plan, where, status, stats, groups)


def _groups(plan: CampaignPlan, stats: Statistics) -> Iterator[CellGroup]:
    grouped: dict[tuple[Any, ...], list[CellResult]] = {}
    for index in range(plan.cells):
        cell = plan.cell(index)
        chain = plan.chain_of(cell)
        fundamental = theory.fundamental_period(chain) if chain.is_hung else np.nan
        known = np.isfinite(stats.median[index]) and not stats.unknown[index]
        if known and np.isfinite(fundamental):
            key = tuple((name, cell[name]) for name in _GROUPED if name in cell)
            point = CellResult(
                index, cell["n"], cell["amplitude"], cell["spread"], float(stats.start[index]),
                float(stats.median[index]), fundamental,
            )  # fmt: skip
            grouped.setdefault(key, []).append(point)
    chain = plan.chain if isinstance(plan.chain, Chain) else None
    named = {} if chain is None else {"chain": preset_name(chain) or repr(chain)}
    for key, points in grouped.items():
        values: dict[str, Any] = named | dict(key)
        yield CellGroup(
            values, tuple(points), tuple(_power_fits(points)), tuple(_laws(values, points))
        )


def _power_fits(points: Sequence[CellResult]) -> Iterator[PowerFit]:
    def key(point: CellResult) -> tuple[float, float]:
        return point.amplitude, point.spread

    for (amplitude, spread), some in itertools.groupby(sorted(points, key=key), key):
        own = tuple(sorted(some, key=lambda point: point.n))
        if len(own) >= _COUNTS:
            x, y = np.array([(p.n + 0.5, p.period) for p in own]).T
            power = power_law(x, y)
            line = power.value * np.log(x)
            over: FloatArray = np.log(y) - line
            residuals = np.exp(over - over.mean()) - 1.0
            yield PowerFit(amplitude, spread, own, power, residuals)


def _laws(values: Mapping[str, Any], points: Sequence[CellResult]) -> Iterator[AmplitudeLaw]:
    known = all(isinstance(values.get(name), float) for name in ("masses", "lengths"))
    known = known and values["damping"] == 0.0 and values["definition"] in _EXACT
    small = [point for point in points if abs(point.start) <= LAW_UP_TO]
    many = sorted({point.n for point in small if point.n >= LAW_FROM})
    together = [tuple(many)] if len(many) > 1 else []
    for n_values in together + [(n,) for n in sorted({point.n for point in small})]:
        law = _law(n_values, tuple(point for point in small if point.n in n_values))
        if law is not None:
            exact = _EXACT[values["definition"]] if known else None
            # of equally many cells for each n, the fit is a mean of their values
            yield replace(law, exact=exact and float(np.mean([exact(n) for n in n_values])))


def _law(n_values: tuple[int, ...], points: tuple[CellResult, ...]) -> AmplitudeLaw | None:
    if len({abs(point.amplitude) for point in points}) < _AMPLITUDES:
        return None

    def ratio(start: FloatArray, c: float, b: float, d: float) -> FloatArray:
        return c * amplitude_factor(start, b, d)

    x, y = np.array([(point.start, point.ratio) for point in points]).T
    with warnings.catch_warnings():
        warnings.simplefilter("error", OptimizeWarning)
        try:
            values, covariance = cast("_Fit", curve_fit(ratio, x, y, p0=(1.0, 0.2, 0.5)))
        except (RuntimeError, OptimizeWarning):  # these points determine no such law
            return None
    if not np.all(np.isfinite(covariance)):
        return None
    c, b, d = estimates(values, covariance, len(points))
    residuals = y / ratio(x, *values.tolist()) - 1.0
    return AmplitudeLaw(n_values, c, b, d, None, points, residuals)


def _exact_median(n: int) -> float:
    """Return the median over the bobs in the limit of small angles, over T1."""
    if n > _EXACT_UP_TO:
        return float(theory.release_profile(0.5))
    chain = Chain.uniform(n)
    return float(np.median(theory.small_angle_periods(chain))) / theory.fundamental_period(chain)


def _exact_com(n: int) -> float:
    """Return the period of the centre of mass in the limit of small angles, over T1."""
    chain = Chain.uniform(n)
    return float(theory.com_period(chain)) / theory.fundamental_period(chain)


_EXACT = {  # by definition
    "bob": _exact_median, "horizontal": _exact_median, "com": _exact_com,
}  # fmt: skip
