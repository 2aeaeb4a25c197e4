"""The law that the pseudo-period of a released chain follows, measured and fitted.

N equal rods are released straight at an angle a. The median over the bobs of the pseudo-period
(definition "bob") follows, from ten bobs and up to 1.2 rad,

    T(N, a) = c T1(N) [1 + b a^2 / (1 + d a^2)],    T1(N) -> (2/j01) 2 pi sqrt((N + 1/2) l/g),

with T1 the exact period of the slowest mode and c the exact limit of small angles, both from the
linearised equations; b and d are fitted. The mean over the bobs follows no such law: it jumps where
a bob near the pivot gains or loses a reversal.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import curve_fit

from npend_gym import Chain, pseudo_periods, theory
from npend_gym.experiments import (
    LAW_FROM,
    LAW_UP_TO,
    PAPER_AMPLITUDE,
    Estimate,
    amplitude_factor,
    estimates,
    power_law,
)
from npend_gym.tools import FloatArray

N_VALUES = (1, 2, 3, 5, 10, 20, 50, 100, 200)
AMPLITUDES = (
    0.01, 0.03, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, PAPER_AMPLITUDE, 0.9, 1.0, 1.1, 1.2, 1.4, 1.6,
    1.8, 2.0,
)  # rad  # fmt: skip
STATISTICS = ("mean", "median", "tip")
_RTOL = 1e-8


@dataclass(frozen=True, eq=False)
class Scan:
    """Pseudo-periods of equal rods over N and amplitude, divided by T1.

    Attributes
    ----------
    n_values : ndarray, shape (C,)
        Numbers of rods, the columns.
    amplitudes : ndarray, shape (A,)
        Starting angles of all rods [rad], the rows.
    mean, median, tip : ndarray, shape (A, C)
        Of the bobs that complete, over the period of the slowest mode; the tip is the last bob.
    completed : ndarray, shape (A, C)
        Fraction of the bobs that complete.
    fundamental : ndarray, shape (C,)
        T1 of rods of 1 m [s].
    """

    n_values: NDArray[np.int64]
    amplitudes: FloatArray
    mean: FloatArray
    median: FloatArray
    tip: FloatArray
    completed: FloatArray
    fundamental: FloatArray


def scan(
    n_values: tuple[int, ...] = N_VALUES,
    amplitudes: tuple[float, ...] = AMPLITUDES,
    definition: str = "bob",
    periods: float = 10.0,
) -> Scan:
    """Release chains of 1 m rods from rest at every N and amplitude, and measure all bobs.

    Each cell is measured once and kept, so that a part of a larger scan costs nothing after it.

    Parameters
    ----------
    n_values : tuple of int
        Numbers of rods.
    amplitudes : tuple of float
        Starting angles of all rods [rad].
    definition : str
        See `npend_gym.pseudo_periods`.
    periods : float
        A bob that does not complete within this many periods of the slowest mode counts as NaN.

    Returns
    -------
    Scan
        With the default grid this takes about 15 s.

    Examples
    --------
    >>> from paper.law import scan
    >>> scan((10, 100), (0.1, 1.0)).median.round(3).tolist()
    [[0.955, 0.952], [1.052, 1.052]]
    """
    fundamental = [theory.fundamental_period(Chain.uniform(n)) for n in n_values]
    cells = np.empty((4, len(amplitudes), len(n_values)))
    for column, (n, t1) in enumerate(zip(n_values, fundamental, strict=True)):
        for row, amplitude in enumerate(amplitudes):
            ratio = _periods(n, amplitude, definition, periods * t1) / t1
            done = ratio[np.isfinite(ratio)]
            some = done if done.size else np.array([np.nan])
            cells[:, row, column] = some.mean(), np.median(some), ratio[-1], done.size / n
    mean, median, tip, completed = cells
    return Scan(
        np.array(n_values), np.array(amplitudes), mean, median, tip, completed,
        np.array(fundamental),
    )  # fmt: skip


@cache
def _periods(n: int, amplitude: float, definition: str, duration: float) -> FloatArray:
    return pseudo_periods(
        Chain.uniform(n), amplitude, definition=definition, duration=duration, rtol=_RTOL
    )


def scan_rows(data: Scan) -> list[dict[str, Any]]:
    """Return the tidy table of a scan: a row for every amplitude and N.

    Examples
    --------
    >>> from paper.law import scan, scan_rows
    >>> rows = scan_rows(scan((10, 100), (0.1, 1.0)))
    >>> [(row["n"], row["angle_rad"], round(row["median"], 3)) for row in rows[:2]]
    [(10, 0.1, 0.955), (100, 0.1, 0.952)]
    """
    return [
        {
            "n": int(n),
            "angle_rad": float(amplitude),
            "fundamental_s": float(data.fundamental[column]),
            **{
                name: float(getattr(data, name)[row, column]) for name in (*STATISTICS, "completed")
            },
        }
        for row, amplitude in enumerate(data.amplitudes)
        for column, n in enumerate(data.n_values)
    ]


@dataclass(frozen=True, eq=False)
class Law:
    """The fitted law of the module's head.

    Attributes
    ----------
    limit : float
        c, from the rope; not fitted.
    b, d : Estimate
        [1/rad^2]
    residuals : ndarray, shape (A, C)
        Measured over law, minus one, where it was fitted.
    n_values, amplitudes : ndarray
        The columns and rows of `residuals`.
    """

    limit: float
    b: Estimate
    d: Estimate
    residuals: FloatArray
    n_values: NDArray[np.int64]
    amplitudes: FloatArray

    def ratio(self, amplitude: FloatArray) -> FloatArray:
        """Return T/T1 for starting angles [rad]."""
        return self.limit * amplitude_factor(amplitude, self.b.value, self.d.value)


def fit_law(data: Scan, first: int = LAW_FROM, up_to: float = LAW_UP_TO) -> Law:
    """Fit b and d of the law to the medians of a scan.

    Parameters
    ----------
    data : Scan
    first : int
        The smallest N that is fitted.
    up_to : float
        The largest amplitude that is fitted [rad].

    Returns
    -------
    Law
        Its intervals are those of least squares: the data have no noise, so they measure how well
        the form fits.

    Examples
    --------
    >>> from paper.law import fit_law, scan
    >>> law = fit_law(scan((10, 20, 50), (0.1, 0.4, 0.8, 1.2)))
    >>> round(law.limit, 4), bool(abs(law.residuals).max() < 0.01)
    (0.95, True)
    """
    rows, columns = data.amplitudes <= up_to + 1e-9, data.n_values >= first
    limit = float(theory.release_profile(0.5))  # the median, because the profile falls
    measured = data.median[np.ix_(rows, columns)] / limit
    amplitude = np.broadcast_to(data.amplitudes[rows][:, None], measured.shape)
    x, y = amplitude.ravel(), measured.ravel()
    b, d = estimates(*curve_fit(amplitude_factor, x, y, p0=(0.2, 0.9)), measured.size)
    residuals = measured / amplitude_factor(amplitude, b.value, d.value) - 1.0
    return Law(limit, b, d, residuals, data.n_values[columns], data.amplitudes[rows])


def count_exponent(data: Scan, statistic: str, row: int, first: int = LAW_FROM) -> Estimate:
    """Return the exponent of T against N + 1/2 in one `row` of a scan, from N = `first` up.

    Examples
    --------
    >>> from paper.law import count_exponent, scan
    >>> round(count_exponent(scan((10, 20, 50), (0.1,)), "median", row=0).value, 2)
    0.5
    """
    columns = data.n_values >= first
    periods = getattr(data, statistic)[row] * data.fundamental
    return power_law(data.n_values[columns] + 0.5, periods[columns])
