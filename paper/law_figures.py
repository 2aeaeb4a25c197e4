"""Figures of the law that the pseudo-period follows, against N and against the starting angle."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from npend_gym import theory
from npend_gym.experiments import PAPER_AMPLITUDE
from npend_gym.tools import BLACK, FAINT, GREEN, ORANGE, PINK
from paper.law import Law, Scan

if TYPE_CHECKING:
    from matplotlib.figure import Figure  # an extra


def law_against_n(figure: Figure, data: tuple[Scan, Law]) -> None:
    """Draw the pseudo-period against N with the paper's model and the law, and the residuals."""
    from matplotlib.ticker import FixedLocator, NullLocator, PercentFormatter, ScalarFormatter

    from npend_gym.report import TRIALS, panels

    scan, law = data
    top, bottom = panels(figure, 2, 1, sharex=True, height_ratios=(2.2, 1.0))
    counts = np.unique(np.geomspace(1, int(scan.n_values[-1]), 60).astype(np.int64))
    ideal = theory.single_period() * np.sqrt(counts)
    top.plot(counts, ideal, color=ORANGE, label=r"the paper's $2\pi\sqrt{Nl/g}$, any angle")
    shown = [int(np.argmin(np.abs(scan.amplitudes - a))) for a in (0.01, PAPER_AMPLITUDE, 1.2)]
    for row, (marker, color) in zip(shown, TRIALS, strict=True):
        angle = scan.amplitudes[row]
        label = f"measured, median over the bobs, {angle:.3g} rad"
        top.plot(
            scan.n_values, scan.median[row] * scan.fundamental, marker, color=color, label=label
        )
        periods = [theory.large_n_period(int(n)) * law.ratio(angle) for n in counts]
        top.plot(counts, periods, color=color, linewidth=0.9)
        expected = law.ratio(angle)
        bottom.plot(scan.n_values, scan.median[row] / expected - 1.0, marker + "-", color=color,
                    linewidth=0.9, markersize=5)  # fmt: skip
    top.plot([], [], color=BLACK, linewidth=0.9, label=f"the law, from N = {law.n_values[0]}")
    exact = theory.single_period() * np.sqrt(scan.n_values) / scan.fundamental
    bottom.plot(scan.n_values, exact / law.ratio(scan.amplitudes[shown[1]]) - 1.0, "x-",
                color=ORANGE, label="the paper's, at 45°")  # fmt: skip
    bottom.legend(loc="center right")
    bottom.axhline(0.0, color=BLACK, linewidth=0.6)
    top.set(yscale="log", ylabel="pseudo-period [s]", title="Rods of 1 m, released straight")
    bottom.set(xscale="log", xlabel="number of pendulums N", ylabel="over the law, less 1")
    bottom.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    bottom.xaxis.set(
        major_locator=FixedLocator(scan.n_values.tolist()), minor_locator=NullLocator()
    )
    bottom.xaxis.set_major_formatter(ScalarFormatter())
    _plain_seconds(top)
    top.legend()


def law_against_angle(figure: Figure, data: tuple[Scan, Law]) -> None:
    """Draw the pseudo-period over T1 against the starting angle, and what the law leaves."""
    from matplotlib.ticker import PercentFormatter

    from npend_gym.report import panels, shade

    scan, law = data
    top, bottom = panels(figure, 2, 1, sharex=True, height_ratios=(2.4, 1.0))
    angle = np.linspace(0.0, float(scan.amplitudes[-1]), 300)
    pendulum = theory.pendulum_factor(angle)
    n = scan.n_values[-1]
    high = theory.single_period() * np.sqrt(n) / scan.fundamental[-1]
    top.plot(angle, high * pendulum, color=ORANGE, label=f"the paper's $T(N,a)$, N = {n}")
    top.plot(angle, pendulum, color=GREEN, label="$T_1$ with one pendulum's series")
    inside = angle[angle <= law.amplitudes[-1]]
    top.plot(inside, law.ratio(inside), color=BLACK, label="the law fitted here")
    large = np.flatnonzero(scan.n_values >= law.n_values[0])
    markers = ("o", "s", "^", "D", "v", "P", "X", "<", ">")
    for column, marker in zip(large.tolist(), markers, strict=False):
        color = shade((column - large[0]) / max(1, large.size - 1))
        label = f"measured, median, N = {scan.n_values[column]}"
        top.plot(scan.amplitudes, scan.median[:, column], marker, color=color, markersize=4.5,
                 label=label)  # fmt: skip
        bottom.plot(law.amplitudes, law.residuals[:, column - large[0]], marker, color=color,
                    markersize=4.5)  # fmt: skip
    mean = scan.mean[:, large[-1]]
    top.plot(scan.amplitudes, mean, "+", color=PINK, label=f"measured, mean, N = {n}")
    top.axvline(PAPER_AMPLITUDE, color=FAINT, linewidth=0.9, zorder=0)
    top.annotate(r"$\pi/4$", (PAPER_AMPLITUDE, 0.66), xytext=(3, 0), textcoords="offset points")
    bottom.axhline(0.0, color=BLACK, linewidth=0.6)
    top.set(ylabel="pseudo-period / $T_1$", ylim=(0.64, 1.5))
    bottom.set(xlabel="starting angle a [rad]", ylabel="over the law, less 1")
    bottom.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=1))
    handles, labels = top.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)


def _plain_seconds(axes: Any) -> None:
    from matplotlib.ticker import FixedLocator, NullLocator, ScalarFormatter

    axes.yaxis.set(major_locator=FixedLocator([2, 3, 5, 10, 20, 30]), minor_locator=NullLocator())
    axes.yaxis.set_major_formatter(ScalarFormatter())
