"""The law of the centre of mass, and the exact profile of small releases, against simulation.

Of N equal rods released straight at an angle a, the centre of mass reverses for the second time at

    T(N, a) = 0.8223 * 2 pi sqrt((N + 1/2) l/g) * (2/pi) K(sin(a/2)),

`theory.large_n_com_period`, with no fitted number. Here it is measured how far that holds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import Chain, pseudo_periods, theory
from npend_gym.experiments import PAPER_AMPLITUDE
from npend_gym.tools import FloatArray, array, in_radians, listed, positive
from paper.hesitation import EARLY, heights
from paper.third_order import MAX_THIRD_ORDER, AmplitudeGrowth, amplitude_growth

TEST_N = (1, 2, 3, 5, 10, 20)
FULL_N = (*TEST_N, 50, 100, 200, 400, 800, 1600)
TEST_AMPLITUDES = (0.01, 0.25, 0.5, PAPER_AMPLITUDE, 1.0, 1.2)  # rad
FULL_AMPLITUDES = (
    0.01, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.75, PAPER_AMPLITUDE, 0.85, 0.9, 0.95, 1.0, 1.1, 1.2,
)  # fmt: skip
_RTOL = 1e-9


@dataclass(frozen=True)
class LawCell:
    """What was measured of `n` equal rods of 1 m, released from `amplitude`, and the theory of it.

    Attributes
    ----------
    n : int
    amplitude : float
        [rad]
    fundamental : float
        T1, exact [s].
    com, law, small_angle : float
        Pseudo-period of the centre of mass: measured; `theory.large_n_com_period`; and
        `theory.com_period`, whose limit of small angles is exact [s].
    early : float
        Fraction of the bobs that complete before 0.8 T1, `hesitation.EARLY`.
    mean, median : float
        Of the bobs' pseudo-periods, over T1.
    profile_rms, profile_worst : float
        Difference between the bobs' pseudo-periods over T1 and `theory.release_profile`, of those
        that are not early: root mean square and largest.
    """

    n: int
    amplitude: float
    fundamental: float
    com: float
    law: float
    small_angle: float
    early: float
    mean: float
    median: float
    profile_rms: float
    profile_worst: float

    @property
    def law_error(self) -> float:
        """Law over measured, minus one."""
        return self.law / self.com - 1.0

    @property
    def small_angle_error(self) -> float:
        """`small_angle` over measured, minus one."""
        return self.small_angle / self.com - 1.0


@dataclass(frozen=True, eq=False)
class LawGrid:
    """What is released: every number of rods from every amplitude [rad].

    Raises
    ------
    ValueError, TypeError
        If a number is no count, or an amplitude not between 0 and pi/2, beyond which another
        reversal may be the second one.

    Examples
    --------
    >>> from paper.com_law import LawGrid
    >>> cells = LawGrid(n_values=[20], amplitudes=[0.1, 0.5]).measure(20)
    >>> [round(cell.com, 3) for cell in cells]  # s
    [7.474, 7.597]
    """

    n_values: Sequence[int] = TEST_N
    amplitudes: ArrayLike = TEST_AMPLITUDES

    def __post_init__(self) -> None:
        counts = [Chain.uniform(n).n for n in listed("n_values", self.n_values, "[2, 5]")]
        angles = np.ravel(positive("amplitudes", array("amplitudes", self.amplitudes)))
        for name, values in (("n_values", counts), ("amplitudes", angles)):
            if len(values) == 0:
                raise ValueError(f"{name} must hold at least one number, got none")
        largest = float(angles.max())
        if largest > np.pi / 2:
            raise ValueError(f"amplitudes must lie {in_radians('pi/2', largest)}")
        vars(self).update(n_values=tuple(counts), amplitudes=angles)

    @classmethod
    def full(cls) -> LawGrid:
        """Return that of N = 1 to 1600 and sixteen angles up to 1.2 rad; it takes half an hour."""
        return cls(FULL_N, FULL_AMPLITUDES)

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain numbers and lists, for a manifest."""
        return {"n_values": list(self.n_values), "amplitudes": np.asarray(self.amplitudes).tolist()}

    def measure(self, n: int, threads: int = 1) -> list[LawCell]:
        """Release `n` rods from every amplitude; `threads` share the releases."""
        chain, angles = Chain.uniform(n), np.ravel(self.amplitudes)
        theta = np.repeat(angles[:, None], n, axis=1)
        bobs, com = (
            pseudo_periods(chain, theta, definition=definition, rtol=_RTOL, threads=threads)
            for definition in ("bob", "com")
        )
        t1 = theory.fundamental_period(chain)
        law, small = theory.large_n_com_period(n, angles), theory.com_period(chain, angles)
        cells: list[LawCell] = []
        for k, angle in enumerate(angles.tolist()):
            periods = t1, float(com[k, 0]), float(law[k]), float(small[k])
            cells.append(LawCell(n, angle, *periods, *_of_bobs(bobs[k] / t1)))
        return cells


def _of_bobs(ratio: FloatArray) -> tuple[float, float, float, float, float]:
    """Return the last five fields of a cell, from the bobs' pseudo-periods over T1."""
    late = ~(ratio < EARLY)
    profile = theory.release_profile(heights(ratio.size))
    off = np.abs(ratio - profile)[late] if late.any() else np.array([math.nan])
    rms, worst = float(np.sqrt(np.mean(off**2))), float(off.max())
    return 1.0 - float(late.mean()), float(ratio.mean()), float(np.median(ratio)), rms, worst


def law_rows(cells: Sequence[LawCell]) -> list[dict[str, Any]]:
    """Return the tidy table: a row for every cell.

    Examples
    --------
    >>> from paper.com_law import LawGrid, law_rows
    >>> (row,) = law_rows(LawGrid([20], [0.5]).measure(20))
    >>> round(row["com_s"], 3), abs(row["law_error"]) < 0.002
    (7.597, True)
    """
    return [
        {
            "n": cell.n,
            "amplitude_rad": cell.amplitude,
            "fundamental_s": cell.fundamental,
            "com_s": cell.com,
            "law_s": cell.law,
            "law_error": cell.law_error,
            "small_angle_s": cell.small_angle,
            "small_angle_error": cell.small_angle_error,
            "early": cell.early,
            "mean_over_t1": cell.mean,
            "median_over_t1": cell.median,
            "profile_rms": cell.profile_rms,
            "profile_worst": cell.profile_worst,
        }
        for cell in cells
    ]


def limit_rows(n_values: Sequence[int]) -> list[dict[str, Any]]:
    """Return what small angles have at each N, without simulation: a row for every N.

    Errors of T1 to one and two terms, T_com over T1, and the a^2 coefficients of
    `amplitude_growth` where the chain is not too long for it, else NaN.

    Examples
    --------
    >>> from paper.com_law import limit_rows
    >>> (row,) = limit_rows([100])
    >>> round(row["com_over_t1"], 4)
    0.9887
    """
    rows: list[dict[str, Any]] = []
    for n in n_values:
        chain = Chain.uniform(n)
        t1 = theory.fundamental_period(chain)
        growth = (
            amplitude_growth(chain)
            if n <= MAX_THIRD_ORDER
            else AmplitudeGrowth(math.nan, math.nan, math.nan)
        )
        rows.append({
            "n": n,
            "t1_error": theory.large_n_period(n) / t1 - 1.0,
            "t1_error_two_terms": theory.large_n_period(n, terms=2) / t1 - 1.0,
            "com_over_t1": float(theory.com_period(chain)) / t1,
            "com_growth": growth.com,
            "mode_growth": growth.shape - growth.inertia,
        })  # fmt: skip
    return rows
