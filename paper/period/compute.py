"""The numbers of "The period of a released chain": this script computes them all.

They go to `numbers.json` beside this file, from which the paper is set. A key computes one alone:
`python -m paper.period.compute com-limit`; `--quick` takes shorter chains and runs.
"""

from __future__ import annotations

import json
import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from npend_gym import Chain, pseudo_periods, theory
from npend_gym.experiments import PAPER_AMPLITUDE
from npend_gym.theory import SLOWEST
from npend_gym.tools import Parser, replacing
from paper import hesitation
from paper.checks.law import growth_of_the_middle
from paper.findings import outcome
from paper.period import front_numbers, growth, limits, rope, swing_numbers
from paper.period.files import read_rows
from paper.period.registry import NUMBERS, number
from paper.readings import grid
from paper.third_order import amplitude_growth

FILE = Path(__file__).with_name("numbers.json")
ANGLES = (*(k / 20 for k in range(1, 21)), PAPER_AMPLITUDE)  # rad, up to where the law is stated
BEYOND = (1.2, 1.4)  # rad
ELSEWHERE = front_numbers, swing_numbers  # which register numbers, too


@cache
def com_period(n: int, amplitude: float, rtol: float = 1e-9) -> float:
    """Return the measured pseudo-period [s] of the centre of mass of `n` equal rods."""
    return float(pseudo_periods(Chain.uniform(n), amplitude, definition="com", rtol=rtol)[0])


@number("com-limit")
def _com_limit(_quick: bool) -> str:
    return f"{theory.com_ratio():.6f}"


@number("com-small")
def _com_small(_quick: bool) -> list[str]:
    chains = map(Chain.uniform, (2, 3, 5, 10, 100))
    return [f"{theory.com_period(c) / theory.fundamental_period(c):.5f}" for c in chains]


@number("factor")
def _factor(_quick: bool) -> str:
    return f"{theory.com_ratio() * 2.0 / SLOWEST:.4f}"


@number("slowest-factor")
def _slowest_factor(_quick: bool) -> str:
    return f"{2.0 / SLOWEST:.4f}"


@number("slowest-next-order")
def _next_order(_quick: bool) -> list[str]:
    """Relative errors of T1 to the order 1/N and to the next, at N = 10."""
    t1 = theory.fundamental_period(Chain.uniform(10))
    return [f"{abs(theory.large_n_period(10, terms=k) / t1 - 1.0):.1e}" for k in (1, 2)]


def error(n: int, amplitude: float) -> float:
    """Return the closed law over the measured period, less one [%]."""
    return 100.0 * (float(theory.large_n_com_period(n, amplitude)) / com_period(n, amplitude) - 1.0)


@number("law-errors")
def _law_errors(quick: bool) -> list[list[str]]:
    """N, and the largest errors of the closed law and of that with exact modes, up to 1 rad [%]."""
    rows: list[list[str]] = []
    for n in (1, 2, 3, 5, 10, 20) if quick else (1, 2, 3, 5, 10, 20, 50, 100, 200, 400):
        closed = [error(n, a) for a in ANGLES]
        exact = [100.0 * (float(theory.com_period(n, a)) / com_period(n, a) - 1.0) for a in ANGLES]
        rows.append([str(n), *(f"{max(map(abs, one)):.2f}" for one in (closed, exact))])
    return rows


@number("law-beyond")
def _law_beyond(quick: bool) -> list[list[str]]:
    """N, and the errors of the closed law at 1.2 and 1.4 rad [%], with their signs."""
    counts = (5, 20) if quick else (5, 20, 100, 400)
    return [[str(n), *(f"{error(n, a):+.1f}" for a in BEYOND)] for n in counts]


@number("com-growth")
def _com_growth(quick: bool) -> list[list[str]]:
    """N, and b of T(a) = T(0) (1 + b a^2) as a -> 0 [1/rad^2]: third order, and simulation."""
    counts = (1, 2, 5, 20) if quick else (1, 2, 3, 5, 10, 20, 100, 200)
    third = [amplitude_growth(Chain.uniform(n)).com for n in counts]
    found = zip(counts, third, map(simulated_growth, counts), strict=True)
    return [[str(n), f"{exact:.4f}", f"{measured:.4f}"] for n, exact, measured in found]


def simulated_growth(n: int) -> float:
    """Return b from measured periods at 0.05 and 0.1 rad, whose next order in a^2 it removes."""
    limit = float(theory.com_period(n))
    small, large = ((com_period(n, a, 1e-12) / limit - 1.0) / a**2 for a in (0.05, 0.1))
    return (4.0 * small - large) / 3.0


@number("growth-over-pendulum")
def _growth_over_pendulum(quick: bool) -> str:
    """Return 16 b of long chains: their growth over a pendulum's."""
    return f"{16.0 * amplitude_growth(Chain.uniform(50 if quick else 200)).com:.3f}"


@number("rope-growth")
def _rope_growth(quick: bool) -> list[list[str]]:
    """Modes of the rope, b by Bessel integrals [1/rad^2], and 16 b."""
    found = {modes: rope.growth(modes) for modes in ((10, 20) if quick else (10, 20, 40, 80))}
    return [[str(modes), f"{b:.5f}", f"{16.0 * b:.3f}"] for modes, b in found.items()]


@number("tip-growth")
def _tip_growth(_quick: bool) -> list[list[str]]:
    """Mass at the tip over that of the rope, and 16 b: 100 equal rods and bobs, third order."""
    tips = (0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0)
    return [[f"{tip:g}", f"{16.0 * limits.tip_growth(100, tip):.2f}"] for tip in tips]


@number("other-starts")
def _other_starts(_quick: bool) -> list[list[str]]:
    """Start of 20 rods, and the error of the pendulum's factor at pi/4 and at 1 rad [%]."""
    return [
        [name, *(f"{error:+.1f}" for error in limits.start_errors(shape))]
        for name, shape in limits.starts().items()
    ]


@number("links")
def _links(quick: bool) -> list[list[str]]:
    """N uniform links, T_com / (2 pi sqrt(L/g)) at small angles, largest error up to 1 rad [%]."""
    rows: list[list[str]] = []
    for n in (1, 2, 3, 5, 10, 20) if quick else (1, 2, 3, 5, 10, 20, 50, 100):
        error = limits.links_error(n, ANGLES)
        rows.append([str(n), f"{limits.links_constant(n):.6f}", f"{error:.2f}"])
    return rows


@number("rope")
def _rope(_quick: bool) -> str:
    return f"{theory.com_ratio() * 2.0 / SLOWEST:.6f}"


@number("heavy-tip")
def _heavy_tip(_quick: bool) -> list[str]:
    """Errors of 20 rods with a last bob of ten times the mass, at 0.5, pi/4 and 1 rad [%]."""
    return [f"{one:+.1f}" for one in limits.chain_errors(Chain([1.0] * 19 + [10.0], [1.0] * 20))]


@number("other-chains")
def _other_chains(quick: bool) -> list[list[str]]:
    """N, and median and worst error of random chains at 0.5 rad, at pi/4 and at 1 rad [%]."""
    rows: list[list[str]] = []
    for n in limits.RANDOM_N[:2] if quick else limits.RANDOM_N:
        pairs = zip(*limits.random_errors(n), strict=True)
        rows.append([str(n), *(f"{one:.1f}" for pair in pairs for one in pair)])
    return rows


@number("middle-growth")
def _middle_growth(quick: bool) -> str:
    return f"{growth_of_the_middle(100 if quick else 400):.3f}"


@number("pendulum-growth")
def _pendulum_growth(_quick: bool) -> str:
    return f"{1.0 / 16.0:.4f}"


@number("profile")
def _profile(_quick: bool) -> dict[str, str]:
    s = (np.polynomial.legendre.leggauss(40)[0] + 1.0) / 2.0
    weights = np.polynomial.legendre.leggauss(40)[1] / 2.0
    tip, middle, pivot = theory.release_profile([0.0, 0.5, 1.0])
    values = {"tip": tip, "middle": middle, "pivot": pivot}
    values["mean"] = weights @ theory.release_profile(s)
    return {name: f"{float(value):.4f}" for name, value in values.items()}


@cache
def _early(quick: bool) -> list[dict[str, Any]]:
    counts = (20, 50, 100) if quick else (20, 50, 100, 200, 400, 800, 1600, 3200)
    return hesitation.hesitation_rows(counts, (PAPER_AMPLITUDE,))


@number("early")
def _early_table(quick: bool) -> list[list[str]]:
    """N, share of early bobs, height down to which they are, mean and median over T1, at pi/4."""
    keys = {"n": "d", "share": ".3f", "lowest": ".3f", "mean": ".4f", "median": ".4f"}
    return [[format(row[key], form) for key, form in keys.items()] for row in _early(quick)]


@number("fronts")
def _fronts(_quick: bool) -> list[list[str]]:
    """Angle, and when the front is at the free end and back at the pivot, over T1: N = 50, 400."""
    rows: list[list[str]] = []
    for a in (0.1, 0.5, PAPER_AMPLITUDE, 1.0):
        times = [f"{one:.3f}" for n in (50, 400) for one in hesitation.front_times(n, a)]
        rows.append([f"{a:.3g}", *times])
    return rows


@number("front-passes")
def _front_passes(_quick: bool) -> list[list[str]]:
    """Height of bobs of 400 rods, when the front from pi/4 is back there, and they turn, over T1.

    They turn for the third time, and so swing back, with the front.
    """
    found = hesitation.velocities(400, PAPER_AMPLITUDE, (0.9, 0.8), frames=12_000)
    rows: list[list[str]] = []
    for height, passes, values in zip(found.heights, found.passes, found.values, strict=True):
        turns = np.flatnonzero((values[:-1] < 0.0) & (values[1:] > 0.0))
        rows.append([f"{height:.1f}", f"{passes:.3f}", f"{found.times[turns[1]]:.3f}"])
    return rows


@number("front-small")
def _front_small(_quick: bool) -> list[str]:
    """When a small front is at the free end, and back at the pivot, over T1: exact for the rope."""
    return [f"{share * SLOWEST / math.pi:.3f}" for share in (0.5, 1.0)]


@number("early-times")
def _early_times(quick: bool) -> list[str]:
    """Between which times early bobs complete from pi/4, over T1."""
    chain = Chain.uniform(100 if quick else 400)
    ratio = pseudo_periods(chain, PAPER_AMPLITUDE, rtol=1e-8) / theory.fundamental_period(chain)
    early = ratio[ratio < hesitation.EARLY]
    return [f"{early.min():.2f}", f"{early.max():.2f}"]


@number("onset")
def _onset(quick: bool) -> dict[str, str]:
    """Angle [rad] from which the bob at 0.9 of the height is early, by the number of rods."""
    return {
        str(n): f"{hesitation.onset(n):.3f}" for n in ((50, 100) if quick else (100, 200, 400, 800))
    }


@number("growth")
def _growth(_quick: bool) -> list[list[str]]:
    """N, window [s], mean rate of growth [1/s], its standard error, and the range of the starts.

    From the table that `python -m paper.period.growth` makes, with that of linear growth last.
    """
    return [list(row.values()) for row in read_rows(growth.FILE)]


@number("source-error")
def _source_error(_quick: bool) -> list[str]:
    """T0/T1 - 1 of the source paper's model at N = 2, 5, 20, 100, 500 [%]."""
    chains = [Chain.uniform(n) for n in (2, 5, 20, 100, 500)]
    ratios = [theory.ideal_period(one) / theory.fundamental_period(one) for one in chains]
    return [f"{100.0 * (ratio - 1.0):.1f}" for ratio in ratios]


@number("series")
def _series(_quick: bool) -> dict[str, str]:
    numbers = outcome("series-value").numbers | outcome("e-hat-value").numbers
    return {
        "right": f"{outcome('series-value').numbers['exact']:.4f}",
        "ten": f"{outcome('series-value').numbers['cut_off']:.3f}",
        "fifteen": f"{numbers['cut_off']:.3f}",
    }


@number("tables")
def _tables(quick: bool) -> dict[str, str]:
    """How many readings of the source paper's error were tried, and how far off the nearest is."""
    found = grid((5, 10)) if quick else grid()
    return {
        "readings": str(len(found.readings)), "nearest": f"{found.distances[found.nearest]:.3f}",
        "scatter": f"{found.printed_scatter.max():.3f}",
    }  # fmt: skip


def main() -> None:
    """Compute what is asked for, print it, and keep all that the paper needs."""
    parser = Parser(prog="python -m paper.period.compute", description=__doc__)
    parser.add_argument("keys", nargs="*", metavar="KEY", help=f"of {', '.join(NUMBERS)} (all)")
    parser.add_argument("--quick", action="store_true", help="short: a test, not the paper")
    arguments = parser.parse_args()
    if unknown := set(arguments.keys) - set(NUMBERS):
        parser.error(f"no number of the paper: {', '.join(sorted(unknown))}")
    kept: dict[str, Any] = json.loads(FILE.read_text("utf-8"))
    for key in arguments.keys or NUMBERS:
        value = NUMBERS[key](arguments.quick)
        print(f"{key}: {json.dumps(value, ensure_ascii=False)}", flush=True)
        if not arguments.quick:
            kept[key] = value
            text = json.dumps(dict(sorted(kept.items())), indent=1, ensure_ascii=False)
            with replacing(FILE) as file:
                file.write(text + "\n")


if __name__ == "__main__":
    main()
