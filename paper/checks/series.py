"""Section 4 and the circular error: the amplitude series, as printed and corrected."""

import math

import numpy as np

from npend_gym import theory
from npend_gym.experiments import PAPER_AMPLITUDE
from npend_gym.tools import FloatArray
from paper.checks.pendulum import LENGTH, measured_period
from paper.readings import ERRORS
from paper.registry import Outcome, Verdict, check, holds_if

MAX_TERMS = 40
EXACT = float(theory.amplitude_correction(PAPER_AMPLITUDE))


def printed_sums(theta0: float, terms: int = MAX_TERMS) -> FloatArray:
    """Return the partial sums of Eq. (27) as printed, with 2^(2 pi), of 1..`terms` terms."""
    n = np.arange(1, terms + 1)
    binomial = np.array([float(math.comb(2 * k, k)) for k in n.tolist()])
    return np.cumsum((binomial / 2.0 ** (2.0 * math.pi)) ** 2 * math.sin(0.5 * theta0) ** (2 * n))


def corrected_sums(theta0: float, terms: int = MAX_TERMS) -> FloatArray:
    """Return the partial sums of Eq. (27) with 2^(2n), of 1..`terms` terms."""
    return np.array([float(theory.amplitude_correction(theta0, k)) for k in range(1, terms + 1)])


def origin(value: float, sums: FloatArray) -> str:
    """Say whether one of the partial `sums` rounds to the printed `value`."""
    found = np.any(np.round(sums, 3) == value)
    return "the printed value" if found else "the printed value is no partial sum"


@check("amplitude-series")
def _amplitude_series() -> Outcome:
    angles = [0.1, PAPER_AMPLITUDE, 1.5, 2.5]
    measured = np.array([measured_period(angle) for angle in angles])
    off = float(np.max(np.abs(measured / theory.pendulum_period(angles, LENGTH) - 1.0)))
    first = printed_sums(PAPER_AMPLITUDE)[0] / corrected_sums(PAPER_AMPLITUDE)[0]
    return holds_if(abs(first - 1.0) < 1e-9, off=off, angles=angles, first=first)


@check("series-taylor")
def _series_taylor() -> Outcome:
    # Delta T/T0 = c2 theta0^2 + c4 theta0^4 + ..., fitted to the exact period
    angles = np.linspace(0.05, 0.5, 10)
    design = angles[:, None] ** np.array([2.0, 4.0, 6.0, 8.0])
    c2, c4 = np.linalg.lstsq(design, theory.amplitude_correction(angles), rcond=None)[0][:2]
    holds = abs(16 * c2 - 1) < 1e-6 and abs(3072 * c4 / 11 - 1) < 1e-3
    return holds_if(bool(holds), second=1.0 / c2, fourth=3072 * c4)


@check("series-value")
def _series_value() -> Outcome:
    sums, holds = printed_sums(PAPER_AMPLITUDE), abs(EXACT - 0.049) < 5e-4
    return holds_if(holds, exact=EXACT, cut_off=sums[9], origin=origin(0.049, sums))


@check("series-diverges")
def _series_diverges() -> Outcome:
    printed, sums = printed_sums(PAPER_AMPLITUDE), corrected_sums(PAPER_AMPLITUDE)
    last, limit = np.diff(printed)[-2:], 2.0 * math.degrees(math.asin(0.25))
    return holds_if(abs(sums[-1] - EXACT) > 1e-12, after_5=sums[4], after_40=sums[-1],
                    growth=last[1] / last[0], tends=16 * math.sin(PAPER_AMPLITUDE / 2) ** 2,
                    limit=limit)  # fmt: skip


@check("e-hat")
def _circular_error() -> Outcome:
    corrections = np.linspace(0.0, 0.5, 6)
    e_hat = 1.0 - np.abs(corrections) / (1.0 + corrections)
    off = float(np.max(np.abs(e_hat - 1.0 / (1.0 + corrections))))
    return Outcome(Verdict.FAILS if e_hat[0] > 0.5 else Verdict.HOLDS,
                   {"off": off, "perfect": e_hat[0]})  # fmt: skip


@check("circular-bound")
def _circular_bound() -> Outcome:
    bound, errors = EXACT / (1.0 + EXACT), ERRORS.ravel().tolist()
    return holds_if(max(errors) < bound, bound=bound, least=min(errors))


@check("e-hat-value")
def _circular_error_value() -> Outcome:
    value = 1.0 - EXACT / (1.0 + EXACT)
    printed = 1.0 / (1.0 + printed_sums(PAPER_AMPLITUDE))
    return holds_if(abs(value - 0.309) < 5e-4, value=value, error=1.0 - value, cut_off=printed[14],
                    later=printed[19], origin=origin(0.309, printed))  # fmt: skip
