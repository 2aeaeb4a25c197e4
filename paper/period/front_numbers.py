"""The numbers of the paper on the front and its forerunner."""

from __future__ import annotations

import numpy as np

from npend_gym.experiments import PAPER_AMPLITUDE
from paper.period import front
from paper.period.registry import number

DELTAS = (1e-1, 1e-2, 1e-3, 1e-4)  # in units of 2 sqrt(L/g)
SCALED = (-4.0, -2.0, -1.0, -0.5, -0.3)  # in units of a^2: before the front
CORE = -0.3  # what is in the logarithm's place there, nearest to the front, at the least angles
LAST = 0.03  # before the front: nearer to it the waves of single rods hide it


@number("front-passages")
def _front_passages(_quick: bool) -> list[list[str]]:
    """Delta, and accelerations of small releases at x = 0.6, before and after four passages."""
    rows: list[list[str]] = []
    for delta in DELTAS:
        found = front.beside_the_front(0.6, delta).ravel()
        rows.append([f"{delta:g}", *(f"{one:+.3f}" for one in found)])
    return rows


@number("front-core")
def _front_core(_quick: bool) -> list[list[str]]:
    """Angle, and what is in the logarithm's place at `SCALED` before the front, at x = 0.6.

    The logarithm itself is last. From the table that `python -m paper.period.front` makes.
    """
    rows = {f"{a:g}": front.kept_at(a, 0.6).core(SCALED) for a in (0.25, 0.3, 0.4)}
    rows["log"] = 0.0 - np.log(np.abs(SCALED))
    return [
        [name, *(f"{one:+.2f}".replace("+nan", "") for one in values)]
        for name, values in rows.items()
    ]


@number("front-tip")
def _front_tip(_quick: bool) -> list[list[str]]:
    """Angle of a release, number of rods, and the greatest angle of the last one [rad]."""
    found = [one for one in front.kept() if abs(one.x - 0.6) < 0.01]
    return [[f"{one.amplitude:.3g}", str(one.n), f"{one.tip:.2f}"] for one in found]


@number("front-before")
def _front_before(_quick: bool) -> list[list[str]]:
    """Angle, and the acceleration just before the front at x = 0.8, by formula and simulated.

    Last, that simulated at x = 0.9.
    """
    rows: list[list[str]] = []
    for a in (0.3, 0.4, 0.5, 0.6, 0.7, PAPER_AMPLITUDE):
        found = [front.kept_at(a, x) for x in (0.8, 0.9)]
        values = [float(np.interp(-LAST, one.delta, one.values)) for one in found]
        formula = front.before_the_front(0.8, a, CORE)
        rows.append([f"{a:.3g}", *(f"{one:+.2f}" for one in (formula, *values))])
    return rows


@number("front-smooth")
def _front_smooth(_quick: bool) -> str:
    """Return the smooth part of the acceleration where the front comes back to x = 0.8."""
    return f"{front.smooth_part(0.8):.2f}"
