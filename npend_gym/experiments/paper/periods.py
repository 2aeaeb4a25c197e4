"""The paper's tables of T0, its uncertainty and T0 +- Delta T, digit by digit.

Printed numbers stand as text, for their digits are what is judged.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from decimal import ROUND_DOWN, ROUND_HALF_UP, Decimal
from typing import Any

import numpy as np

from npend_gym import theory
from npend_gym._checks import FloatArray
from npend_gym.chain import STANDARD_GRAVITY, Chain
from npend_gym.experiments.paper.finding import Finding, Verdict
from npend_gym.experiments.paper.grid import AMPLITUDES
from npend_gym.experiments.paper.measured import PAPER_GRAVITY, ideal_periods
from npend_gym.experiments.paper.series import MAX_TERMS, printed_sums
from npend_gym.experiments.release import PAPER_AMPLITUDE, PAPER_N, PAPER_SPREAD

IDEAL = ("4.487", "6.347", "8.976", "20.071")  # s; the same in all three tables
FRACTIONS = ("0.311", "0.427", "0.293")  # Delta T / T0, a table each
UNCERTAINTY = (
    ("1.385", "1.973", "2.792", "6.242"),
    ("1.916", "2.710", "3.832", "8.570"),
    ("1.315", "1.860", "2.630", "5.880"),
)  # s
REAL = (
    ("4.487+-1.385", "6.347+-1.973", "8.976+-2.792", "20.071+-6.242"),
    ("4.487+-1.916", "6.347+-2.710", "8.976+-3.832", "20.071+-8.570"),
    ("4.487+-1.315", "6.347+-1.860", "8.976+-2.630", "20.071+-5.880"),
)  # s


def digits(printed: str, value: float) -> str:
    """Say how `printed` comes from `value`: "rounded", "cut", "either" or "neither"."""
    unit = Decimal(1).scaleb(Decimal(printed).as_tuple().exponent)  # pyright: ignore[reportArgumentType]
    rounded = Decimal(value).quantize(unit, ROUND_HALF_UP) == Decimal(printed)
    cut = Decimal(value).quantize(unit, ROUND_DOWN) == Decimal(printed)
    return {(True, True): "either", (True, False): "rounded", (False, True): "cut"}.get(
        (rounded, cut), "neither"
    )


@dataclass(frozen=True)
class Digits:
    """A printed number beside the value of the formula printed for it.

    `how` says how the digits come from the value, see `digits`.
    """

    table: int
    n: int
    quantity: str
    printed: str
    value: float

    @property
    def how(self) -> str:
        """How the printed digits come from the value."""
        return digits(self.printed, self.value)


def ideal_digits(gravity: float = PAPER_GRAVITY) -> list[Digits]:
    """Return T0 = 2 pi sqrt(N/g) [s] beside what is printed."""
    return [
        Digits(1, n, "T0", printed, theory.ideal_period(Chain.uniform(n, gravity=gravity)))
        for n, printed in zip(PAPER_N, IDEAL, strict=True)
    ]


def uncertainty_digits() -> list[Digits]:
    """Return Delta T = f T0 [s] beside what is printed, f as printed and T0 in full."""
    return [
        Digits(table, row.n, "Delta T", printed, float(fraction) * row.value)
        for table, (fraction, column) in enumerate(zip(FRACTIONS, UNCERTAINTY, strict=True), 1)
        for row, printed in zip(ideal_digits(), column, strict=True)
    ]


def digit_rows() -> list[dict[str, Any]]:
    """Return the tidy table of all digits compared."""
    return [
        {"table": d.table, "n": d.n, "quantity": d.quantity, "printed_s": d.printed,
         "formula_s": d.value, "digits": d.how}
        for d in (*ideal_digits(), *uncertainty_digits())
    ]  # fmt: skip


def fraction_bounds(table: int) -> FloatArray:
    """Return the least and greatest Delta T / T0 behind each printed Delta T, shape (4, 2).

    A printed number comes, rounded or cut, from at most half a last digit less to one more.
    """
    printed = np.array(UNCERTAINTY[table - 1], float)
    ideal = ideal_periods(PAPER_N[-1])[list(PAPER_N)]
    return np.stack([(printed - 0.5e-3) / ideal, (printed + 1e-3) / ideal], axis=1)


def listing_bars(terms: int = 7) -> float:
    """Return the relative error bar of the last listing, 0.0025 + sum_{k<=7} 2k/135."""
    return 0.0025 + bar_series(terms)


def bar_series(terms: int) -> float:
    """Return sum_{k<=terms} 2k/135, the terms from which the last listing builds its error bars."""
    return sum(2 * k / 135 for k in range(1, terms + 1))


def candidates(table: int) -> dict[str, float]:
    """Return what Delta T / T0 of a table might be: the paper's series in every form it has."""
    angles = {"pi/4": PAPER_AMPLITUDE}
    angles |= {f"{a:.5f} rad": float(a) for a in AMPLITUDES[table - 1]}
    found = {"the limit of the correct series": float(theory.amplitude_correction(PAPER_AMPLITUDE))}
    for name, angle in angles.items():
        for terms, printed in enumerate(printed_sums(angle).tolist(), start=1):
            found[f"the printed series at {name}, {terms} terms"] = printed
            found[f"its e-hat at {name}, {terms} terms"] = 1.0 / (1.0 + printed)
        found[f"theta^2/16 + 11 theta^4/3072 at {name}"] = angle**2 / 16 + 11 * angle**4 / 3072
    for terms in range(1, 8):
        found[f"sum of 2k/135, k = 1..{terms}"] = bar_series(terms)
        found[f"0.0025 + sum of 2k/135, k = 1..{terms}"] = listing_bars(terms)
    return found


def origins(table: int) -> list[str]:
    """Return the names of the candidates that give the printed fraction of a table."""
    printed = FRACTIONS[table - 1]
    return [
        name for name, value in candidates(table).items() if digits(printed, value) != "neither"
    ]


def amplitude_uncertainty(theta0: float = PAPER_AMPLITUDE, spread: float = PAPER_SPREAD) -> float:
    """Return Delta T / T that the uncertainty `spread` [rad] of the angle propagates to."""
    low, high = 1.0 + theory.amplitude_correction([theta0, theta0 + spread])
    return float(high / low - 1.0)


def findings() -> Iterator[Finding]:
    """Yield what the audit says about the tables of T0 and its uncertainty."""
    yield _t0_formula()
    yield _t0_digits()
    for table in (1, 2, 3):
        yield _uncertainty(table)
    yield _real()
    for table in (1, 2, 3):
        yield _fraction(table)
    yield _propagation()
    yield _bars()


def _hows(rows: list[Digits]) -> str:
    return ", ".join(f"{row.value:.4f} ({row.how})" for row in rows)


def _t0_formula() -> Finding:
    bare = math.sqrt(PAPER_N[0] / PAPER_GRAVITY)
    ideal = ideal_digits()[0].value
    return Finding(
        "t0-formula", "text before Table 4", "T0 = sqrt(l N/g)", f"{IDEAL[0]} s at N = 5",
        f"sqrt(5/g) = {bare:.3f} s, 2 pi sqrt(5/g) = {ideal:.3f} s",
        Verdict.of(abs(bare - float(IDEAL[0])) < 1e-3, Verdict.CORRECTED),
        "The factor 2 pi is missing in the text and present in the tables' heads and numbers.",
    )  # fmt: skip


def _t0_digits() -> Finding:
    rows = ideal_digits()
    other = sum(row.how != "neither" for row in ideal_digits(STANDARD_GRAVITY))
    rounded = all(row.how in ("rounded", "either") for row in rows)
    traced = all(row.how != "neither" for row in rows)
    return Finding(
        "t0-digits", "Tables 4-6, column 1", "T0 at N = 5, 10, 20, 100", ", ".join(IDEAL),
        _hows(rows), Verdict.of(rounded, Verdict.CORRECTED if traced else None),
        f"With g = 9.8; the simulation has 9.81, which gives {other} of the four. N = 5 is cut "
        "where the others are rounded.",
    )  # fmt: skip


def _uncertainty(table: int) -> Finding:
    rows = [row for row in uncertainty_digits() if row.table == table]
    wrong = [row for row in rows if row.how == "neither"]
    cut = [row for row in rows if row.how == "cut"]
    bounds = fraction_bounds(table)
    good = [i for i, row in enumerate(rows) if row.how != "neither"]
    low, high = bounds[good, 0].max(), bounds[good, 1].min()
    note = f"The digits fix Delta T/T0 between {low:.5f} and {high:.5f}: used as printed."
    for row in wrong:
        note += f" N = {row.n}: no rounding of {row.value:.4f} gives {row.printed}."
    return Finding(
        f"dt-table-{table}", f"Table {table + 3}, column 2",
        f"Delta T = {FRACTIONS[table - 1]} T0", ", ".join(UNCERTAINTY[table - 1]), _hows(rows),
        Verdict.of(not wrong and not cut, Verdict.CORRECTED), note,
    )  # fmt: skip


def _real() -> Finding:
    joined = tuple(
        tuple(f"{t}+-{d}" for t, d in zip(IDEAL, column, strict=True)) for column in UNCERTAINTY
    )
    same = sum(a == b for x, y in zip(joined, REAL, strict=True) for a, b in zip(x, y, strict=True))
    return Finding(
        "t-digits", "Tables 4-6, column 3", "T = T0 +- Delta T repeats columns 1 and 2",
        "12 entries", f"{same} of 12 agree", Verdict.of(same == 12),
        "As a formula it does not hold: the amplitude only lengthens a pendulum's period, by "
        "T0 times 0.0400, and is no scatter to either side.",
    )  # fmt: skip


def _fraction(table: int) -> Finding:
    found = origins(table)
    correct = float(theory.amplitude_correction(PAPER_AMPLITUDE, 6))
    return Finding(
        f"dt-fraction-{table}", f"Table {table + 3}, head of column 2",
        "Delta T/T0 is the amplitude series near pi/4 to sixth order", FRACTIONS[table - 1],
        f"{correct:.4f}; as printed {printed_sums(PAPER_AMPLITUDE)[5]:.4f}",
        Verdict.of(digits(FRACTIONS[table - 1], correct) != "neither"),
        f"The printed value is {'; '.join(found)}." if found else "No form of the paper's series, "
        f"at up to {MAX_TERMS} terms and no printed angle, gives the printed value.",
    )  # fmt: skip


def _propagation() -> Finding:
    spread = amplitude_uncertainty()
    return Finding(
        "dt-random", "Tables 4-6", "Delta T/T0 is the random uncertainty of T",
        f"{min(FRACTIONS)} to {max(FRACTIONS)}", f"{spread:.4f}",
        Verdict.of(digits(FRACTIONS[0], spread) != "neither"),
        "The uncertainty of 0.017 rad, propagated through T(theta0). Delta T/T0 of Eq. (27) "
        "is a systematic lengthening, the same in every trial.",
    )  # fmt: skip


def _bars() -> Finding:
    correct = float(theory.amplitude_correction(PAPER_AMPLITUDE))
    return Finding(
        "error-bars", "Listing 4, yerr_val", "The error bars are the higher-order corrections",
        f"(0.0025 + 2/135 + ... + 14/135) T0 = {listing_bars():.4f} T0",
        f"{correct:.4f} T0, upwards only", Verdict.of(abs(listing_bars() - correct) < 5e-4),
        "Sums 2k/135 of six terms give the 0.311 of trial 1; of seven, with 0.0025, the bars.",
    )  # fmt: skip
