"""Figures of a campaign: the fitted law against N and the amplitude, and the residuals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter, ScalarFormatter

from npend_gym._palette import BLACK, BLUE, ORANGE
from npend_gym.experiments import AmplitudeLaw, CellGroup
from npend_gym.experiments.studies.release_statistics import EDGES, FAR, Statistics
from npend_gym.report.style import legend_below, mark_numbers, panels, shade, styled

_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">")
_CURVES = 9  # drawn in one figure; the rest is in the tables


@styled
def law_against_n(group: CellGroup) -> Figure:
    """Draw the period against N with the fitted power at each amplitude, and what it leaves."""
    figure = Figure(figsize=(7.2, 5.6))
    top, bottom = panels(figure, 2, 1, sharex=True, height_ratios=(2.2, 1.0))
    chosen = _spaced(group.powers)
    for k, fit in enumerate(chosen):
        n_values = np.array([point.n for point in fit.points])
        periods = np.array([point.period for point in fit.points])
        color, marker = shade(k / max(1, len(chosen) - 1)), _MARKERS[k % len(_MARKERS)]
        label = f"{np.degrees(fit.amplitude):.4g} degrees: exponent {fit.p}"
        top.plot(n_values, periods, marker, color=color, label=label)
        top.plot(n_values, periods / (1.0 + fit.residuals), color=color, linewidth=0.9)
        bottom.plot(n_values, fit.residuals, marker + "-", color=color, linewidth=0.9, markersize=5)
    slowest = {point.n: point.fundamental for point in group.points}
    n_values = sorted(slowest)
    top.plot(
        n_values, [slowest[n] for n in n_values], color=ORANGE, label="$T_1$, slowest normal mode"
    )
    bottom.axhline(0.0, color=BLACK, linewidth=0.6)
    top.set(xscale="log", yscale="log", ylabel="pseudo-period [s]",
            title=_title(group, chosen, group.powers))  # fmt: skip
    bottom.set(xlabel="number of pendulums N", ylabel="over the power, less 1")
    bottom.yaxis.set_major_formatter(PercentFormatter(1.0))
    mark_numbers(bottom.xaxis, n_values)
    top.yaxis.set_major_formatter(ScalarFormatter())
    top.yaxis.set_minor_formatter(ScalarFormatter())
    legend_below(figure, top, 2)
    return figure


@styled
def law_against_amplitude(group: CellGroup) -> Figure:
    """Draw the period over T1 against the starting angle with the fitted laws, and residuals."""
    figure = Figure(figsize=(7.2, 5.9))
    top, bottom = panels(figure, 2, 1, sharex=True, height_ratios=(2.2, 1.0))
    for law in (law for law in group.laws if len(law.n_values) > 1):
        largest = max(abs(point.start) for point in law.points)
        start = np.linspace(0.0, largest, 200)
        top.plot(start, law.ratio(start), color=ORANGE, linewidth=2.2, label=_law_label(law))
    single = [law for law in group.laws if len(law.n_values) == 1]
    chosen = _spaced(single)
    for k, law in enumerate(chosen):
        starts = np.array([abs(point.start) for point in law.points])
        ratios = [point.ratio for point in law.points]
        color, marker = shade(k / max(1, len(chosen) - 1)), _MARKERS[k % len(_MARKERS)]
        start = np.linspace(0.0, float(starts.max()), 200)
        top.plot(starts, ratios, marker, color=color, markersize=5, label=_law_label(law))
        top.plot(start, law.ratio(start), color=color, linewidth=0.9)
        order = np.argsort(starts)
        bottom.plot(starts[order], law.residuals[order], marker + "-", color=color, linewidth=0.7,
                    markersize=4.5)  # fmt: skip
    bottom.axhline(0.0, color=BLACK, linewidth=0.6)
    top.set(ylabel="pseudo-period / $T_1$", title=_title(group, chosen, single))
    bottom.set(xlabel="starting angle a [rad]", ylabel="over the law, less 1")
    bottom.yaxis.set_major_formatter(PercentFormatter(1.0))
    legend_below(figure, top, 2)
    return figure


@styled
def residuals(stats: Statistics) -> Figure:
    """Draw how far the releases lie from the parabola of their cell."""
    figure = Figure(figsize=(7.2, 3.2))
    axes: Any = figure.add_subplot()
    axes.stairs(stats.histogram, EDGES, fill=True, color=BLUE)
    for far in (-FAR, FAR):
        axes.axvline(far, color=ORANGE, linewidth=1.0)
    axes.set(
        yscale="symlog", ylim=(0, None), ylabel="releases",
        xlabel="median over the bobs, less the parabola of its cell, over its scatter",
        title=f"{int(stats.histogram.sum())} releases, {stats.outlier_count} beyond the lines",
    )  # fmt: skip
    return figure


def _title(group: CellGroup, chosen: Sequence[Any], fits: Sequence[Any]) -> str:
    title = group.label if len(group.label) < 90 else group.label[:87] + "..."
    few = len(chosen) < len(fits)
    return title + f"\n{len(chosen)} of {len(fits)} fits drawn" * few


def _law_label(law: AmplitudeLaw) -> str:
    shown = f"N = {law.n_values[0]}" + (f" to {law.n_values[-1]}" if len(law.n_values) > 1 else "")
    return f"{shown}: c {law.c.value:.4f}, b {law.b.value:.4f}, d {law.d.value:.3f}"


def _spaced(items: Any) -> Any:
    """Return at most nine of `items`, spaced evenly, with the first and the last."""
    places = np.unique(np.linspace(0, len(items) - 1, min(_CURVES, len(items))).astype(int))
    return [items[k] for k in places]
