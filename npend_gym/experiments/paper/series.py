"""Section 4 and the circular error: the amplitude series, as printed and corrected."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from npend_gym import theory
from npend_gym._checks import FloatArray
from npend_gym.experiments.paper.finding import Finding, Verdict
from npend_gym.experiments.paper.fits import show
from npend_gym.experiments.paper.grid import ERRORS
from npend_gym.experiments.paper.pendulum import PENDULUM, QUARTER, measured_period

MAX_TERMS = 40


def printed_sums(theta0: float, terms: int = MAX_TERMS) -> FloatArray:
    """Return the partial sums of Eq. (27) as printed, with 2^(2 pi), of 1..`terms` terms."""
    n = np.arange(1, terms + 1)
    binomial = np.array([float(math.comb(2 * k, k)) for k in n.tolist()])
    return np.cumsum((binomial / 2.0 ** (2.0 * math.pi)) ** 2 * math.sin(0.5 * theta0) ** (2 * n))


def corrected_sums(theta0: float, terms: int = MAX_TERMS) -> FloatArray:
    """Return the partial sums of Eq. (27) with 2^(2n), of 1..`terms` terms."""
    counts = range(1, terms + 1)
    return np.array([float(theory.amplitude_correction(theta0, k)) for k in counts])


def terms_for(value: float, digits: int, sums: FloatArray) -> int | None:
    """Return how many terms make a sum that rounds to `value` at `digits` digits, if any do."""
    hits = np.flatnonzero(np.round(sums, digits) == value)
    return int(hits[0]) + 1 if hits.size else None


def taylor_coefficients() -> tuple[float, float]:
    """Return c2 and c4 of Delta T/T0 = c2 theta0^2 + c4 theta0^4 + ..., from the exact period."""
    angles = np.linspace(0.05, 0.5, 10)
    design = angles[:, None] ** np.array([2.0, 4.0, 6.0, 8.0])
    fit = np.linalg.lstsq(design, theory.amplitude_correction(angles), rcond=None)[0]
    return float(fit[0]), float(fit[1])


def circular_error(correction: float) -> float:
    """Return e-hat = 1 - |T - T0| / T of Eq. (36), for T = T0 (1 + correction)."""
    return 1.0 - abs(correction) / (1.0 + correction)


def findings() -> Iterator[Finding]:
    """Yield the findings about the amplitude series."""
    yield from _about_the_series()
    yield from _about_the_circular_error()


def _about_the_series() -> Iterator[Finding]:
    length = float(PENDULUM.lengths[0])
    angles = (0.1, QUARTER, 1.5, 2.5)
    off = max(
        abs(measured_period(a) / float(theory.pendulum_period(a, length)) - 1) for a in angles
    )
    yield Finding(
        "amplitude-series", "Eq. (27), first line", "amplitude correction of the period",
        "sum ((2n)!/(2^(2 pi) (n!)^2))^2 sin^(2n)(theta0/2)",
        f"with 2^(2n): measured periods at {show(angles)} rad to {off:.0e}; first term as printed "
        f"{printed_sums(QUARTER)[0] / corrected_sums(QUARTER)[0]:.1e} of the right one",
        Verdict.CORRECTED if off < 1e-9 else Verdict.FAILS,
        "For one pendulum, 2^(2 pi) being 2^(2n). For N >= 2 no derivation is given, and the "
        "chain obeys another law, see `period-law`.",
    )  # fmt: skip
    c2, c4 = taylor_coefficients()
    yield Finding(
        "series-taylor", "Eq. (27), second line", "its Taylor series",
        "theta0^2/16 + 11 theta0^4/3072", f"theta0^2/{1 / c2:.4f} + {3072 * c4:.3f} theta0^4/3072",
        Verdict.of(abs(16 * c2 - 1) < 1e-6 and abs(3072 * c4 / 11 - 1) < 1e-3),
        "Fitted to the elliptic integral. It is the series with 2^(2n), not of the printed one.",
    )  # fmt: skip
    exact, printed = float(theory.amplitude_correction(QUARTER)), printed_sums(QUARTER)
    terms = terms_for(0.049, 3, printed)
    yield Finding(
        "series-value", "Eq. (28)", "its value at pi/4", "0.049", f"{exact:.5f}",
        Verdict.of(abs(exact - 0.049) < 5e-4),
        f"The printed series, with 2^(2 pi), gives {printed[9]:.5f} when cut off after 10 terms, "
        f"{_origin(terms)}. So the exponent is more than a misprint: it was computed with.",
    )  # fmt: skip
    growth = float(printed[-1] - printed[-2]) / float(printed[-2] - printed[-3])
    sums = corrected_sums(QUARTER)
    limit = 2.0 * math.degrees(math.asin(0.25))
    yield Finding(
        "series-diverges", "text after Eq. (37)", "the whole series diverges, so that e-hat is 0",
        "diverges",
        f"with 2^(2n) it converges: {sums[4]:.6f} after 5 terms, {sums[-1]:.6f} after {MAX_TERMS}",
        Verdict.of(abs(sums[-1] - exact) > 1e-12),
        f"With 2^(2 pi) its terms grow {growth:.2f}-fold, tending to 16 sin^2(pi/8) = "
        f"{16 * math.sin(QUARTER / 2) ** 2:.2f}: it diverges beyond {limit:.1f} degrees. A sum "
        "whose value depends on where it is cut off has none.",
    )  # fmt: skip


def _about_the_circular_error() -> Iterator[Finding]:
    corrections = np.linspace(0.0, 0.5, 6)
    off = max(abs(circular_error(c) - 1.0 / (1.0 + c)) for c in corrections.tolist())
    yield Finding(
        "e-hat", "Eq. (36)", "the circular error", "e-hat = 1 - |T - T0|/T = 1/(1 + sum)",
        f"both forms agree to {off:.0e}; e-hat -> {circular_error(0.0):.0f} for a perfect model",
        Verdict.CORRECTED if off < 1e-12 else Verdict.FAILS,
        "It is T0/T: independent of N, if the model were true, but no error (that would be 1 - "
        "e-hat), so that it bounds nothing from above.",
    )  # fmt: skip
    value = circular_error(float(theory.amplitude_correction(QUARTER)))
    printed = 1.0 / (1.0 + printed_sums(QUARTER))
    terms = terms_for(0.309, 3, printed)
    yield Finding(
        "e-hat-value", "Eq. (37)", "its value at pi/4", '0.309 "up to order 20"',
        f"{value:.4f}; the error it stands for is {1 - value:.4f}",
        Verdict.of(abs(value - 0.309) < 5e-4),
        f"The printed series cut off after 15 terms gives {printed[14]:.4f}: {_origin(terms)} "
        f"(20 terms: {printed[19]:.4f}).",
    )  # fmt: skip

    correction = float(theory.amplitude_correction(QUARTER))
    bound, least = correction / (1.0 + correction), float(ERRORS.min())
    yield Finding(
        "circular-bound", "text before Eq. (36)",
        "the truncation errors in Tables 1-3 are bounded by the circular error",
        "T = T0 +- 0.049 T0",
        f"circular error {bound:.4f}; the least error printed there is {least}",
        Verdict.of(float(ERRORS.max()) < bound),
        "The circular error is the model's, from the amplitude of one pendulum; it bounds neither "
        "the truncation of an integrator nor what Tables 1-3 hold, see `e-truncation`.",
    )  # fmt: skip


def _origin(terms: int | None) -> str:
    return "the printed value is no partial sum" if terms is None else "the printed value"
