"""The paper's tables of T0, its uncertainty and T0 +- Delta T, digit by digit.

Printed numbers stand as text, for their digits are what is judged.
"""

from __future__ import annotations

import math
from decimal import ROUND_DOWN, ROUND_HALF_UP, Decimal
from typing import Any

import numpy as np

from npend_gym import Chain, theory
from npend_gym._checks import FloatArray
from npend_gym.chain import STANDARD_GRAVITY
from npend_gym.experiments.release import PAPER_AMPLITUDE, PAPER_N, PAPER_SPREAD
from npend_gym.paper.checks.series import MAX_TERMS, printed_sums
from npend_gym.paper.measured import PAPER_GRAVITY, ideal_periods
from npend_gym.paper.readings import AMPLITUDES
from npend_gym.paper.registry import Outcome, Verdict, check, holds_if, table

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
    return "either" if rounded and cut else "rounded" if rounded else "cut" if cut else "neither"


def digits_of(printed: tuple[str, ...], values: FloatArray) -> list[str]:
    """Return `digits` of each of several numbers."""
    return [digits(text, float(value)) for text, value in zip(printed, values, strict=True)]


def ideal(gravity: float = PAPER_GRAVITY) -> FloatArray:
    """Return T0 = 2 pi sqrt(N/g) [s] for each N of the tables."""
    return np.array([theory.ideal_period(Chain.uniform(n, gravity=gravity)) for n in PAPER_N])


def uncertainty(table: int) -> FloatArray:
    """Return Delta T = f T0 [s] of a table, 1 to 3, with f as printed and T0 in full."""
    return float(FRACTIONS[table - 1]) * ideal()


def _shown(values: FloatArray, hows: list[str]) -> list[str]:
    return [f"{value:.4f} ({how})" for value, how in zip(values, hows, strict=True)]


@table("digits", "t0-digits")
def digit_rows() -> list[dict[str, Any]]:
    """Return the tidy table of all digits compared."""
    columns = [(1, "T0", IDEAL, ideal())]
    columns += [(k, "Delta T", UNCERTAINTY[k - 1], uncertainty(k)) for k in (1, 2, 3)]
    return [
        {"table": number, "n": n, "quantity": quantity, "printed_s": text,
         "formula_s": value, "digits": digits(text, value)}
        for number, quantity, printed, values in columns
        for n, text, value in zip(PAPER_N, printed, values.tolist(), strict=True)
    ]  # fmt: skip


@check("t0-formula")
def _t0_formula() -> Outcome:
    bare = math.sqrt(PAPER_N[0] / PAPER_GRAVITY)
    holds = abs(bare - float(IDEAL[0])) < 1e-3
    return holds_if(holds, Verdict.CORRECTED, bare=bare, ideal=ideal()[0])


@check("t0-digits")
def _t0_digits() -> Outcome:
    hows = digits_of(IDEAL, ideal())
    otherwise = Verdict.FAILS if "neither" in hows else Verdict.CORRECTED
    other = sum(how != "neither" for how in digits_of(IDEAL, ideal(STANDARD_GRAVITY)))
    holds = {*hows} <= {"rounded", "either"}
    return holds_if(holds, otherwise, digits=_shown(ideal(), hows), other=other)


def fraction_bounds(table: int) -> FloatArray:
    """Return the least and greatest Delta T / T0 behind each printed Delta T, shape (4, 2).

    A printed number comes, rounded or cut, from at most half a last digit less to one more.
    """
    printed = np.array(UNCERTAINTY[table - 1], float)
    ideal = ideal_periods(PAPER_N[-1])[list(PAPER_N)]
    return np.stack([(printed - 0.5e-3) / ideal, (printed + 1e-3) / ideal], axis=1)


@check("dt-table-1", "dt-table-2", "dt-table-3")
def _uncertainty(key: str) -> Outcome:
    table = int(key[-1])
    printed, values = UNCERTAINTY[table - 1], uncertainty(table)
    hows = digits_of(printed, values)
    bounds = fraction_bounds(table)[np.array(hows) != "neither"]
    wrong = [
        f" N = {n}: no rounding of {value:.4f} gives {text}."
        for n, value, text, how in zip(PAPER_N, values, printed, hows, strict=True)
        if how == "neither"
    ]
    return holds_if(
        {*hows} <= {"rounded", "either"}, Verdict.CORRECTED, fraction=FRACTIONS[table - 1],
        printed=[*printed], digits=_shown(values, hows), low=bounds[:, 0].max(),
        high=bounds[:, 1].min(), wrong="".join(wrong),
    )  # fmt: skip


@check("t-digits")
def _real() -> Outcome:
    joined = [[f"{t}+-{dt}" for t, dt in zip(IDEAL, row, strict=True)] for row in UNCERTAINTY]
    same = int((np.array(joined) == np.array(REAL)).sum())
    return holds_if(same == 12, same=same)


def listing_bars(terms: int = 7, start: float = 0.0025) -> float:
    """Return the relative error bar of the last listing, 0.0025 + sum_{k<=7} 2k/135."""
    return start + sum(2 * k / 135 for k in range(1, terms + 1))


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
        found[f"sum of 2k/135, k = 1..{terms}"] = listing_bars(terms, 0.0)
        found[f"0.0025 + sum of 2k/135, k = 1..{terms}"] = listing_bars(terms)
    return found


def origins(table: int) -> list[str]:
    """Return the names of the candidates that give the printed fraction of a table."""
    printed, values = FRACTIONS[table - 1], candidates(table)
    return [name for name, value in values.items() if digits(printed, value) != "neither"]


@check("dt-fraction-1", "dt-fraction-2", "dt-fraction-3")
def _fraction(key: str) -> Outcome:
    fraction = FRACTIONS[int(key[-1]) - 1]
    correct = float(theory.amplitude_correction(PAPER_AMPLITUDE, 6))
    as_printed = printed_sums(PAPER_AMPLITUDE)[5]
    found = "; ".join(origins(int(key[-1])))
    origin = f"The printed value is {found}." if found else (
        f"No form of the paper's series, with up to {MAX_TERMS} terms and at any printed angle, "
        "gives the printed value."
    )  # fmt: skip
    holds = digits(fraction, correct) != "neither"
    return holds_if(holds, fraction=fraction, correct=correct, as_printed=as_printed, origin=origin)


def amplitude_uncertainty(theta0: float = PAPER_AMPLITUDE, spread: float = PAPER_SPREAD) -> float:
    """Return Delta T / T that the uncertainty `spread` [rad] of the angle propagates to."""
    low, high = 1.0 + theory.amplitude_correction([theta0, theta0 + spread])
    return float(high / low - 1.0)


@check("dt-random")
def _propagation() -> Outcome:
    spread = amplitude_uncertainty()
    return holds_if(digits(FRACTIONS[0], spread) != "neither", spread=spread)


@check("error-bars")
def _bars() -> Outcome:
    correct = float(theory.amplitude_correction(PAPER_AMPLITUDE))
    return holds_if(abs(listing_bars() - correct) < 5e-4, bars=listing_bars(), correct=correct)
