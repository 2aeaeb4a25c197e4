"""What the paper claims about the law of the pseudo-period, judged by the measured one."""

from typing import Any

import numpy as np

from npend_gym import Chain, pseudo_periods, theory
from npend_gym.experiments import LAW_FROM, LAW_UP_TO, PAPER_AMPLITUDE, PAPER_SPREAD
from npend_gym.theory import SLOWEST
from paper import law
from paper.hesitation import heights
from paper.law import Law, Scan, fit_law, scan
from paper.law_figures import law_against_angle, law_against_n
from paper.registry import Outcome, check, figure, holds_if, table

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
    mode = 2.0 / SLOWEST
    numbers = {"mode": mode, "release": mode * float(theory.release_profile(0.5)), "n": n}
    measured = over_ideal(n, LEAST)
    return holds_if(abs(measured - 1.0) < 0.01, measured=measured, **numbers)


def growth_of_the_middle(n: int, amplitude: float = 0.1) -> float:
    """Return b of T(a) = T(0) (1 + b a^2) as a -> 0, for bobs around the middle of `n` [1/rad^2].

    The middle bob is the median one. Neighbours differ, for discrete bobs make ripples: their mean.
    """
    least = 0.1 * amplitude
    first, second = (pseudo_periods(Chain.uniform(n), a, rtol=1e-11) for a in (least, amplitude))
    growth = (second / first - 1.0) / (amplitude**2 - least**2)
    return float(growth[np.abs(heights(n) - 0.5) < 0.02].mean())


@check("period-law")
def _law(n_values: tuple[int, ...] = LONG, amplitudes: tuple[float, ...] = SMALL) -> Outcome:
    fitted, growth = fit_law(scan(n_values, amplitudes)), growth_of_the_middle(n_values[-1])
    return holds_if(abs(16.0 * growth - 1.0) < 0.1, limit=fitted.limit, growth=growth,
                    b=fitted.b.value, d=fitted.d.value, last=n_values[-1],
                    worst=float(np.abs(fitted.residuals).max()), times=16.0 * growth)  # fmt: skip


@check("coincidence")
def _coincidence(n_values: Any = LONG, amplitudes: Any = SMALL) -> Outcome:
    angles = np.array([LEAST, PAPER_AMPLITUDE, LAW_UP_TO])
    measured = scan(n_values, tuple(angles.tolist())).median.mean(axis=1)
    off = theory.pendulum_factor(angles) / measured - 1.0
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
    for definition in ("bob", "link", "height"):
        data = scan((10, 50), (0.01, PAPER_AMPLITUDE), definition, 3.0)
        numbers |= {
            definition: data.median.ravel(),
            f"{definition}_completed": data.completed.min(),
        }
    return holds_if(bool(np.abs(numbers["link"] / numbers["bob"] - 1.0).max() < 0.05), **numbers)


@check("trial-equation")
def _trial_equation() -> Outcome:
    angles = np.array([PAPER_AMPLITUDE, PAPER_AMPLITUDE + PAPER_SPREAD])
    factor = theory.pendulum_factor(angles)
    median = [float(np.median(pseudo_periods(Chain.uniform(20), a))) for a in angles]
    model, measured = factor[1] / factor[0] - 1.0, median[1] / median[0] - 1.0
    whole = over_ideal(20, PAPER_AMPLITUDE) / factor[0] - 1.0
    numbers = {"model": model, "measured": measured, "whole": whole}
    return holds_if(abs(whole) < 0.01 and abs(measured / model - 1.0) < 0.2, **numbers)


@check("verified", "abstract")
def _verified() -> Outcome:
    data = scan((1, 2, 3, 5, 100), (PAPER_AMPLITUDE,))
    ideal = np.array([theory.ideal_period(Chain.uniform(n)) for n in data.n_values.tolist()])
    errors = np.abs(ideal / (data.mean[0] * data.fundamental) - 1.0)
    numbers = dict(zip(("n_1", "n_2", "n_3", "n_5", "n_100"), errors, strict=True))
    return holds_if(bool(errors[:-1].max() < 0.04), **numbers)


table("law", "period-law")(lambda: law.scan_rows(scan()))


def scan_and_law() -> tuple[Scan, Law]:
    """Return the pseudo-periods over N and amplitude, and the law fitted to them."""
    data = scan()
    return data, fit_law(data)


figure(
    "law_against_n", "sqrt-scaling", "Pseudo-periods over T1 against the number of bobs.",
    (7.2, 5.6), scan_and_law,
)(law_against_n)  # fmt: skip
figure(
    "law_against_angle", "period-law", "The median pseudo-period over T1 against the angle.",
    (7.2, 6.2), scan_and_law,
)(law_against_angle)  # fmt: skip
