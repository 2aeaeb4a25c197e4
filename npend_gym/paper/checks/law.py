"""What the paper claims about the law of the pseudo-period, judged by the measured one."""

from typing import Any

import numpy as np
from scipy.special import jn_zeros

from npend_gym import Chain, pseudo_periods, theory
from npend_gym.experiments import law
from npend_gym.experiments.law import LAW_FROM, LAW_UP_TO, Law, Scan, fit_law, scan
from npend_gym.experiments.release import PAPER_AMPLITUDE, PAPER_SPREAD
from npend_gym.paper.registry import Outcome, Verdict, check, figure, holds_if, table
from npend_gym.report.law_figures import law_against_angle, law_against_n

# The part of the scan to which the law is fitted; each check measures only the cells it needs
LONG = tuple(n for n in law.N_VALUES if n >= LAW_FROM)
SMALL = tuple(a for a in law.AMPLITUDES if a <= LAW_UP_TO)
LEAST = SMALL[0]  # rad


def over_ideal(n: int, amplitude: float) -> float:
    """Return the median pseudo-period over the paper's T0, of `n` rods at `amplitude` [rad]."""
    cell = scan((n,), (amplitude,))
    ideal = theory.ideal_period(Chain.uniform(n))
    return float(cell.median[0, 0] * cell.fundamental[0] / ideal)


check("small-angles")(
    lambda: holds_if(abs((ratio := over_ideal(LAW_FROM, LEAST)) - 1.0) < 0.02, ratio=ratio)
)


@check("sqrt-scaling")
def _scaling(n_values: tuple[int, ...] = LONG, amplitudes: tuple[float, ...] = SMALL) -> Outcome:
    data = scan(n_values, amplitudes)
    found = [law.count_exponent(data, "median", row) for row in range(len(amplitudes))]
    least, greatest = (f(one.value for one in found) for f in (min, max))
    widest = max(one.error for one in found)
    holds = max(abs(least - 0.5), abs(greatest - 0.5)) < 0.005
    return holds_if(holds, least=least, greatest=greatest, widest=widest, last=n_values[-1])


@check("factor")
def _factor(n: int = LONG[-1]) -> Outcome:
    mode = 2.0 / float(jn_zeros(0, 1)[0])
    numbers = {"mode": mode, "release": mode * float(theory.release_profile(0.5)), "n": n}
    measured = over_ideal(n, LEAST)
    return holds_if(abs(measured - 1.0) < 0.01, Verdict.CORRECTED, measured=measured, **numbers)


@check("period-law")
def _law(n_values: tuple[int, ...] = LONG, amplitudes: tuple[float, ...] = SMALL) -> Outcome:
    fitted = fit_law(scan(n_values, amplitudes))
    return holds_if(abs(fitted.b.value - 1.0 / 16.0) <= fitted.b.error, limit=fitted.limit,
                    b=fitted.b, d=fitted.d, worst=float(np.abs(fitted.residuals).max()),
                    last=n_values[-1], times=16.0 * fitted.b.value)  # fmt: skip


@check("coincidence")
def _coincidence(n_values: Any = LONG, amplitudes: Any = SMALL) -> Outcome:
    angles = np.array([LEAST, PAPER_AMPLITUDE, LAW_UP_TO])
    measured = scan(n_values, tuple(angles.tolist())).median.mean(axis=1)
    off = (1.0 + theory.amplitude_correction(angles)) / measured - 1.0
    fine = np.linspace(0.0, LAW_UP_TO, 1201)
    law_there = fit_law(scan(n_values, amplitudes)).ratio(fine)
    return holds_if(bool(np.abs(off).max() < 0.01), crossing=float(np.interp(1.0, law_there, fine)),
                    shown=[f"{o:+.1%} at {a:.3g} rad" for o, a in zip(off, angles, strict=True)],
                    pendulum=float(theory.amplitude_correction(PAPER_AMPLITUDE)))  # fmt: skip


@check("which-average")
def _statistics(n_values: tuple[int, ...] = LONG) -> Outcome:
    data = scan(n_values, (PAPER_AMPLITUDE,))
    ranges = {name: float(np.ptp(getattr(data, name))) for name in law.STATISTICS}
    return holds_if(ranges["mean"] <= 2.0 * ranges["median"], last=n_values[-1], **ranges)


@check("readings")
def _readings() -> Outcome:
    numbers: dict[str, Any] = {}
    for reading in ("bob", "link", "height"):
        data = scan((10, 50), (0.01, PAPER_AMPLITUDE), reading, 3.0)
        numbers |= {reading: data.median.ravel(), f"{reading}_completed": data.completed.min()}
    return holds_if(bool(np.abs(numbers["link"] / numbers["bob"] - 1.0).max() < 0.05), **numbers)


@check("trial-equation")
def _trial_equation() -> Outcome:
    angles = np.array([PAPER_AMPLITUDE, PAPER_AMPLITUDE + PAPER_SPREAD])
    factor = 1.0 + theory.amplitude_correction(angles)
    median = [float(np.median(pseudo_periods(Chain.uniform(20), a))) for a in angles]
    model, measured = factor[1] / factor[0] - 1.0, median[1] / median[0] - 1.0
    verdict = Verdict.CORRECTED if abs(measured / model - 1.0) < 0.2 else Verdict.FAILS
    return Outcome(verdict, {"model": model, "measured": measured})


@check("verified")
def _verified() -> Outcome:
    data = scan((1, 2, 3, 5, 100), (PAPER_AMPLITUDE,))
    ideal = np.array([theory.ideal_period(Chain.uniform(n)) for n in data.n_values.tolist()])
    errors = np.abs(ideal / (data.mean[0] * data.fundamental) - 1.0)
    numbers = dict(zip(("n_1", "n_2", "n_3", "n_5", "n_100"), errors, strict=True))
    return holds_if(bool(errors[:-1].max() < 0.04), Verdict.CORRECTED, **numbers)


table("law", "period-law")(lambda: law.scan_rows(scan()))


def scan_and_law() -> tuple[Scan, Law]:
    """Return the pseudo-periods over N and amplitude, and the law fitted to them."""
    data = scan()
    return data, fit_law(data)


figure("law_against_n", "sqrt-scaling", (7.2, 5.6), scan_and_law)(law_against_n)
figure("law_against_angle", "period-law", (7.2, 6.2), scan_and_law)(law_against_angle)
