"""The figures of "The period of a released chain": `python -m paper.period.figures`.

Names draw some alone, `python -m paper.period.figures law`; they go beside this file.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from npend_gym import Chain, pseudo_periods, theory
from npend_gym.experiments import PAPER_AMPLITUDE
from npend_gym.report import panels, styled
from npend_gym.tools import AMBER, BLACK, BLUE, FAINT, GREEN, ORANGE, PINK, Parser, replacing
from paper.period import front, growth_map
from paper.period.compute import BEYOND, com_period
from paper.registry import DRAWINGS, call

HERE = Path(__file__).parent
COUNTS = (1, 2, 5, 20, 100)  # on the left of the figure of the law
SHOWN = (0.1, 0.2, 0.4, 0.6, PAPER_AMPLITUDE, 0.9, 1.0, *BEYOND)  # rad
ALONG = (1, 2, 3, 5, 10, 20, 50, 100, 200, 400)  # on its right


@styled
def draw_law() -> Figure:
    """Draw the measured periods of the centre of mass over the angle and over N, and the law."""
    figure = Figure(figsize=(7.2, 3.2))
    left, right = panels(figure, 1, 2)
    fine = np.linspace(0.0, max(SHOWN), 200)
    left.plot(fine, theory.pendulum_factor(fine), color=BLACK, label="the pendulum's")
    markers = zip(COUNTS, "osD^v", (BLUE, GREEN, AMBER, ORANGE, BLACK), strict=True)
    for n, marker, color in markers:
        ratio = [com_period(n, a) / float(theory.com_period(n)) for a in SHOWN]
        left.plot(SHOWN, ratio, marker, color=color, markersize=4, label=f"N = {n}")
    left.set(xlabel="starting angle a [rad]", ylabel="T(N, a) / T(N, 0)")
    left.legend(fontsize=7)
    counts = np.array(ALONG)
    measured = [com_period(n, PAPER_AMPLITUDE) for n in ALONG]
    means = [pseudo_periods(Chain.uniform(n), PAPER_AMPLITUDE, rtol=1e-8).mean() for n in ALONG]
    old = theory.pendulum_period(PAPER_AMPLITUDE) * np.sqrt(counts)
    law = [float(theory.large_n_com_period(n, PAPER_AMPLITUDE)) for n in ALONG]
    unit = theory.single_period() * np.sqrt(counts + 0.5)
    right.plot(counts, law / unit, color=BLACK, label="the law")
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


@styled
def draw_front() -> Figure:
    """Draw the front of a small release, its return at finite angles, and the scaled forerunner."""
    figure = Figure(figsize=(7.2, 2.9))
    left, middle, right = panels(figure, 1, 3)
    x = 0.6
    tau = np.linspace(0.0, 4.0, 1601)
    left.plot(tau, front.acceleration(x, tau), color=BLUE, linewidth=1.0)
    for passage, name in zip(front.passages(x), ("down", "up", "down", "up"), strict=True):
        left.axvline(passage, color=FAINT, linewidth=0.8, zorder=0)
        left.annotate(name, (passage + 0.06, 2.7), fontsize=7)
    left.set(xlabel=r"time $\tau$", ylabel=r"acceleration / $g\,a$", ylim=(-3.1, 3.1))
    left.set(title=r"small angles, $\sqrt{s}$ = 0.6")
    delta, x = np.linspace(-0.3, 0.1, 801), 0.8
    small = front.acceleration(x, 1.0 + x + delta)
    middle.plot(delta, small, color=BLACK, linewidth=1.0, label="a → 0")
    for a, color in ((0.25, BLUE), (0.4, GREEN), (0.6, ORANGE), (PAPER_AMPLITUDE, PINK)):
        found = front.kept_at(a, x)
        middle.plot(found.delta, found.values, color=color, linewidth=1.0, label=f"{a:.3g} rad")
    middle.axhline(0.0, color=BLACK, linewidth=0.6)
    middle.set(xlabel=r"$\delta$", ylabel=r"acceleration / $g\,\sin a$")
    middle.set(xlim=(-0.3, 0.1), ylim=(-0.4, 2.2), title=r"the return, $\sqrt{s}$ = 0.8")
    middle.legend(fontsize=7, loc="upper left")
    scaled, x = np.linspace(-5.0, -0.3, 200), 0.6
    right.plot(scaled, -np.log(-scaled), "--", color=BLACK, linewidth=1.0, label="logarithm")
    for a, color in ((0.25, BLUE), (0.3, AMBER), (0.4, GREEN)):
        values = front.kept_at(a, x).core(scaled)
        right.plot(scaled, values, color=color, linewidth=1.0, label=f"{a:g} rad")
    right.set(xlabel=r"$\delta / a^2$", ylabel="in the logarithm's place", ylim=(-2.0, 1.5))
    right.set(title="before the front")
    right.legend(fontsize=7, loc="upper left")
    return figure


@styled
def draw_map() -> Figure:
    """Draw 16 b over the masses of the rope and over its start, as kept."""
    figure = Figure(figsize=(7.2, 2.9))
    axes = panels(figure, 1, 3)
    names = ("straight", "slowest mode", "bent")
    along = (growth_map.POWERS, growth_map.POWERS, growth_map.BENDS)
    scale = ScalarMappable(Normalize(0.0, 2.0), "RdBu")
    for one, name, across in zip(axes, names, along, strict=True):
        values = growth_map.kept(name)
        one.contourf(across, growth_map.TIPS, values.clip(0.0, 2.0), 20, norm=scale.norm,
                     cmap=scale.cmap)  # fmt: skip
        one.contour(across, growth_map.TIPS, values, [1.0], colors=BLACK, linewidths=1.0)
        one.set(title=f"start: {name}", xlabel="power p of the mass")
        one.grid(visible=False)
    axes[2].set(xlabel="bend")
    axes[0].set(ylabel="mass at the tip / rope's")
    figure.colorbar(scale, ax=axes, label="16 b", ticks=[0.0, 0.5, 1.0, 1.5, 2.0])
    return figure


FIGURES = {"law": draw_law, "hesitation": draw_hesitation, "front": draw_front, "map": draw_map}

if __name__ == "__main__":
    parser = Parser(prog="python -m paper.period.figures", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(FIGURES)} (all)")
    names = parser.parse_args().names
    if unknown := set(names) - set(FIGURES):
        parser.error(f"no figure of the paper: {', '.join(sorted(unknown))}")
    for name in names or FIGURES:
        path = HERE / f"{name}.svg"
        with replacing(path, binary=True) as file:
            FIGURES[name]().savefig(file, format="svg", metadata={"Date": None})
        print("drawn:", path)
