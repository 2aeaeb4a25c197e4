"""The paper's tables of T0, its uncertainty and T0 +- Delta T, digit by digit.

Printed numbers stand as text, for their digits are what is judged.
"""

import math
from decimal import ROUND_DOWN, ROUND_HALF_UP, Decimal
from typing import Any

import numpy as np

from npend_gym import Chain, theory
from npend_gym.chain import STANDARD_GRAVITY
from npend_gym.experiments import PAPER_AMPLITUDE, PAPER_N, PAPER_SPREAD
from npend_gym.tools import FloatArray
from paper.checks.series import MAX_TERMS, printed_sums
from paper.claims import printed
from paper.measured import PAPER_GRAVITY, bob_periods
from paper.readings import AMPLITUDES
from paper.registry import Outcome, Verdict, check, holds_if, table

CORRECT = float(theory.amplitude_correction(PAPER_AMPLITUDE))
IDEAL = printed("t0-digits")  # s; the same in all three tables
FRACTIONS = tuple(printed(f"dt-fraction-{table}")[0] for table in (1, 2, 3))  # Delta T / T0
UNCERTAINTY = tuple(printed(f"dt-table-{table}") for table in (1, 2, 3))  # Delta T [s]


def digits(text: str, value: float) -> str:
    """Say how a printed number comes from `value`: "rounded", "cut", "either" or "neither"."""
    unit = Decimal(1).scaleb(Decimal(text).as_tuple().exponent)  # pyright: ignore[reportArgumentType]
    rounded = Decimal(value).quantize(unit, ROUND_HALF_UP) == Decimal(text)
    cut = Decimal(value).quantize(unit, ROUND_DOWN) == Decimal(text)
    return "either" if rounded and cut else "rounded" if rounded else "cut" if cut else "neither"


def digits_of(texts: tuple[str, ...], values: FloatArray) -> list[str]:
    """Return `digits` of each of several numbers."""
    return [digits(text, float(value)) for text, value in zip(texts, values, strict=True)]


def ideal(gravity: float = PAPER_GRAVITY) -> FloatArray:
    """Return T0 = 2 pi sqrt(N/g) [s] for each N of the tables."""
    return np.array([theory.ideal_period(Chain.uniform(n, gravity=gravity)) for n in PAPER_N])


def shown(values: FloatArray, hows: list[str]) -> list[str]:
    """Return values with what is said about their digits."""
    return [f"{value:.4f} ({how})" for value, how in zip(values, hows, strict=True)]


@table("digits", "t0-digits")
def digit_rows() -> list[dict[str, Any]]:
    """Return the tidy table of all digits compared."""
    columns = [(1, "T0", IDEAL, ideal())]
    for k, (fraction, texts) in enumerate(zip(FRACTIONS, UNCERTAINTY, strict=True), start=1):
        columns.append((k, "Delta T", texts, float(fraction) * ideal()))
    return [
        {"table": number, "n": n, "quantity": quantity, "printed_s": text,
         "formula_s": value, "digits": digits(text, value)}
        for number, quantity, texts, values in columns
        for n, text, value in zip(PAPER_N, texts, values.tolist(), strict=True)
    ]  # fmt: skip


@check("t0-formula")
def _t0_formula() -> Outcome:
    bare = math.sqrt(PAPER_N[0] / PAPER_GRAVITY)
    holds = abs(bare - float(IDEAL[0])) < 1e-3
    return holds_if(holds, Verdict.SLIP, bare=bare, ideal=ideal()[0])


@check("t0-digits")
def _t0_digits() -> Outcome:
    hows = digits_of(IDEAL, ideal())
    otherwise = Verdict.FAILS if "neither" in hows else Verdict.SLIP
    other = sum(how != "neither" for how in digits_of(IDEAL, ideal(STANDARD_GRAVITY)))
    holds = {*hows} <= {"rounded", "either"}
    return holds_if(holds, otherwise, digits=shown(ideal(), hows), other=other)


@check("dt-table-1", "dt-table-2", "dt-table-3")
def _uncertainty(key: str) -> Outcome:
    fraction, texts = FRACTIONS[int(key[-1]) - 1], printed(key)
    values = float(fraction) * ideal()
    hows = digits_of(texts, values)
    traced = np.array(hows) != "neither"
    # A printed number comes, rounded or cut, from at most half a last digit less to one more
    low, high = ((np.array(texts, float) + d) / ideal() for d in (-0.5e-3, 1e-3))
    wrong = [
        f" N = {PAPER_N[k]}: no rounding of {values[k]:.4f} gives {texts[k]}."
        for k in np.flatnonzero(~traced)
    ]
    return holds_if({*hows} <= {"rounded", "either"}, Verdict.SLIP, digits=shown(values, hows),
                    fraction=fraction, low=low[traced].max(), high=high[traced].min(),
                    wrong="".join(wrong))  # fmt: skip


@check("t-digits")
def _real() -> Outcome:
    joined = [f"{t}+-{dt}" for row in UNCERTAINTY for t, dt in zip(IDEAL, row, strict=True)]
    same = sum(ours == real for ours, real in zip(joined, printed("t-digits"), strict=True))
    return holds_if(same == 12, same=same)


def listing_bars(terms: int = 7, start: float = 0.0025) -> float:
    """Return the relative error bar of the last listing, 0.0025 + sum_{k<=7} 2k/135."""
    return start + sum(2 * k / 135 for k in range(1, terms + 1))


def candidates(table: int) -> dict[str, float]:
    """Return what Delta T / T0 of a table might be: the paper's series in every form it has."""
    angles = {"pi/4": PAPER_AMPLITUDE}
    angles |= {f"{a:.5f} rad": float(a) for a in AMPLITUDES[table - 1]}
    found = {"the limit of the correct series": CORRECT}
    for name, angle in angles.items():
        for terms, value in enumerate(printed_sums(angle).tolist(), start=1):
            found[f"the printed series at {name}, {terms} terms"] = value
            found[f"its e-hat at {name}, {terms} terms"] = 1.0 / (1.0 + value)
        found[f"theta^2/16 + 11 theta^4/3072 at {name}"] = angle**2 / 16 + 11 * angle**4 / 3072
    for terms in range(1, 8):
        found[f"sum of 2k/135, k = 1..{terms}"] = listing_bars(terms, 0.0)
        found[f"0.0025 + sum of 2k/135, k = 1..{terms}"] = listing_bars(terms)
    return found


@check("dt-fraction-1", "dt-fraction-2", "dt-fraction-3")
def _fraction(key: str) -> Outcome:
    (fraction,), table = printed(key), int(key[-1])
    correct = float(theory.amplitude_correction(PAPER_AMPLITUDE, 6))
    values = candidates(table).items()
    found = "; ".join(name for name, value in values if digits(fraction, value) != "neither")
    origin = f"The printed value is {found}." if found else (
        f"No form of the paper's series, with up to {MAX_TERMS} terms and at any printed angle, "
        "gives the printed value."
    )  # fmt: skip
    numbers = {"correct": correct, "as_printed": printed_sums(PAPER_AMPLITUDE)[5]}
    return holds_if(digits(fraction, correct) != "neither", origin=origin, **numbers)


@check("five-values")
def _one_quantity(theta0: float = PAPER_AMPLITUDE) -> Outcome:
    implied = 1.0 / float(printed("e-hat-value")[0].split()[0]) - 1.0  # e-hat = 1/(1 + Delta T/T0)
    series_value = float(printed("series-value")[0])
    stated = sorted({series_value, *map(float, FRACTIONS), listing_bars(), implied})
    exact = float(theory.amplitude_correction(theta0))
    return holds_if(np.ptp(stated) < 1e-3, stated=stated, implied=implied, exact=exact)


@check("maximum")
def _maximum() -> Outcome:
    slowest = [[float(bob_periods(n, a).max()) for n, a in zip(PAPER_N, trial, strict=True)]
               for trial in AMPLITUDES.tolist()]  # fmt: skip
    largest, off = np.max(slowest, axis=0), np.abs(ideal() / slowest - 1.0)
    holds = bool(np.all(ideal() >= largest) and off.max() < 0.001)  # printed: three to five digits
    return holds_if(holds, largest=largest, ideal=ideal())


@check("dt-random")
def _propagation(theta0: float = PAPER_AMPLITUDE, error: float = PAPER_SPREAD) -> Outcome:
    low, high = theory.pendulum_factor([theta0, theta0 + error])
    spread = float(high / low - 1.0)  # Delta T / T that the error of the angle propagates to
    return holds_if(digits(FRACTIONS[0], spread) != "neither", spread=spread)


@check("error-bars")
def _bars() -> Outcome:
    bars = listing_bars()
    return holds_if(abs(bars - CORRECT) < 5e-4, bars=bars, correct=CORRECT)
