"""The figures of "The period of a released chain": `python -m paper.period.figures`.

Names draw some alone, `python -m paper.period.figures law`; they go beside this file.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from npend_gym import Chain, pseudo_periods, theory
from npend_gym._palette import AMBER, BLACK, BLUE, GREEN, ORANGE
from npend_gym.report import panels, styled
from paper.period.compute import BEYOND, QUARTER, com_period, law
from paper.registry import DRAWINGS, call

HERE = Path(__file__).parent
COUNTS = (1, 2, 5, 20, 100)  # on the left of the figure of the law
SHOWN = (0.1, 0.2, 0.4, 0.6, QUARTER, 0.9, 1.0, *BEYOND)  # rad
ALONG = (1, 2, 3, 5, 10, 20, 50, 100, 200, 400)  # on its right


@styled
def draw_law() -> Figure:
    """Draw the measured periods of the centre of mass over the angle and over N, and the law."""
    figure = Figure(figsize=(7.2, 3.2))
    left, right = panels(figure, 1, 2)
    fine = np.linspace(0.0, max(SHOWN), 200)
    left.plot(fine, 1.0 + theory.amplitude_correction(fine), color=BLACK, label="the pendulum's")
    markers = zip(COUNTS, "osD^v", (BLUE, GREEN, AMBER, ORANGE, BLACK), strict=True)
    for n, marker, color in markers:
        ratio = [com_period(n, a) / float(theory.com_period(n)) for a in SHOWN]
        left.plot(SHOWN, ratio, marker, color=color, markersize=4, label=f"N = {n}")
    left.set(xlabel="starting angle a [rad]", ylabel="T(N, a) / T(N, 0)")
    left.legend(fontsize=7)
    counts = np.array(ALONG)
    measured = [com_period(n, QUARTER) for n in ALONG]
    means = [pseudo_periods(Chain.uniform(n), QUARTER, rtol=1e-8).mean() for n in ALONG]
    grown = 1.0 + float(theory.amplitude_correction(QUARTER))
    old = theory.single_period() * np.sqrt(counts) * grown
    unit = theory.single_period() * np.sqrt(counts + 0.5)
    right.plot(counts, [law(n, QUARTER) for n in ALONG] / unit, color=BLACK, label="the law")
    right.plot(counts, measured / unit, "o", color=BLUE, markersize=4, label="centre of mass")
    right.plot(counts, means / unit, "s", color=ORANGE, markersize=4, label="mean over the bobs")
    right.plot(counts, old / unit, "--", color=GREEN, label="the source paper's model")
    right.set(xscale="log", xlabel="number of rods N", title="from 45°")
    right.set(ylabel=r"T / $2\pi\sqrt{(N + 1/2)\,l/g}$")
    right.legend(fontsize=7)
    return figure


def draw_hesitation() -> Figure:
    """Draw the hesitation as the audit does."""
    drawing = DRAWINGS["hesitation"]
    return drawing.draw(call(drawing.data))


FIGURES = {"law": draw_law, "hesitation": draw_hesitation}

if __name__ == "__main__":
    for name in sys.argv[1:] or FIGURES:
        path = HERE / f"{name}.svg"
        FIGURES[name]().savefig(path, metadata={"Date": None})
        print("drawn:", path)
