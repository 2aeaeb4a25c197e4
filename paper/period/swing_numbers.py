"""The numbers of the paper on the swings after the first, and on the map of the growth."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import jn_zeros

from npend_gym import Chain, theory
from npend_gym.experiments import PAPER_AMPLITUDE
from npend_gym.tools import FloatArray
from paper.period import growth_map, modes
from paper.period.files import read_rows
from paper.period.registry import number
from paper.swings import measured_swings, small_swings

COUNT, MANY = 10, 200  # swings: simulated, and of small angles


@number("swings")
def _swings(quick: bool) -> list[list[str]]:
    """N; first, mean, shortest and longest swing over T1: small angles, and from pi/4."""
    rows: list[list[str]] = []
    for n in (2, 5) if quick else (2, 5, 20, 100):
        chain = Chain.uniform(n)
        t1 = theory.fundamental_period(chain)
        found = small_swings(chain, MANY) / t1, measured_swings(chain, PAPER_AMPLITUDE, COUNT) / t1
        rows.append([str(n), *(text for one in found for text in _range(one))])
    return rows


def _range(swings: FloatArray) -> list[str]:
    return [f"{one:.4f}" for one in (swings[0], swings.mean(), swings.min(), swings.max())]


@number("swing-bound")
def _swing_bound(_quick: bool) -> list[str]:
    """Strength of all other modes in the momentum over the slowest's, and the most that they shift.

    The shift is that of a reversal, over T1.
    """
    zeros = jn_zeros(0, 20_000)
    others = float(np.sum(zeros[1:] ** -3.0) * zeros[0] ** 3)
    return [f"{others:.3f}", f"{math.asin(others) / (2.0 * math.pi):.3f}"]


@number("modes")
def _modes(_quick: bool) -> list[list[str]]:
    """N, duration, mean share of the slowest mode in five windows, when it is below one half [s].

    From the table that `python -m paper.period.modes` makes.
    """
    rows: list[list[str]] = []
    for n, starts in _followed().items():
        shares = [
            f"{np.mean([float(row[f'share_{k}']) for row in starts]):.3f}" for k in range(1, 6)
        ]
        below = sorted(float(row["below_half_s"] or math.inf) for row in starts)
        times = "-" if math.isinf(below[0]) else f"{below[0]:.0f} to {below[-1]:.0f}"
        rows.append([n, starts[0]["seconds"], *shares, times.replace("inf", "later")])
    return rows


@number("modes-last")
def _modes_last(_quick: bool) -> list[str]:
    """Return the lowest and highest share of a mode of ten rods in the last eighth, of all runs."""
    starts = _followed()["10"]
    lowest = min(float(row["lowest_last"]) for row in starts)
    return [f"{one:.2f}" for one in (lowest, max(float(row["highest_last"]) for row in starts))]


def _followed() -> dict[str, list[dict[str, str]]]:
    """Return the rows of the table of `modes`, by the number of rods."""
    table: dict[str, list[dict[str, str]]] = {}
    for row in read_rows(modes.FILE):
        table.setdefault(row["n"], []).append(row)
    return table


@number("growth-starts")
def _growth_starts(_quick: bool) -> dict[str, str]:
    """16 b of equal bobs by the start: straight, the slowest mode, bent outwards and inwards."""
    chain = growth_map.profile(0.0, 0.0, 100)
    shapes = {
        "straight": 1.0, "slowest": growth_map.slowest(chain),
        "outwards": growth_map.bent(100, 0.5), "inwards": growth_map.bent(100, -0.5),
    }  # fmt: skip
    return {name: f"{growth_map.growth(chain, shape):.2f}" for name, shape in shapes.items()}


@number("growth-range")
def _growth_range(_quick: bool) -> dict[str, list[str]]:
    """Lowest and highest 16 b on the maps: `python -m paper.period.growth_map` makes them."""
    found = {name: growth_map.kept(name) for name in ("straight", "slowest mode", "bent")}
    return {name: [f"{one.min():.1f}", f"{one.max():.1f}"] for name, one in found.items()}
