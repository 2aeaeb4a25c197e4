"""Figures of the paper's reproduction: the paper's own, and those that judge it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import (
    FixedLocator,
    NullLocator,
    StrMethodFormatter,
)

from npend_gym._checks import FloatArray
from npend_gym._palette import AMBER, BLACK, BLUE, FAINT, GREEN, ORANGE, SKY
from npend_gym.experiments.paper.chaos import Growth
from npend_gym.experiments.paper.figure_data import Figure2, Series
from npend_gym.experiments.paper.grid import Grid
from npend_gym.experiments.paper.readings import AS_WRITTEN
from npend_gym.report.law_figures import law_against_angle, law_against_n
from npend_gym.report.outputs import write_figure
from npend_gym.report.style import TRIALS, panels, shade, styled


def write_figures(results: Mapping[str, Any], folder: Path) -> list[Path]:
    """Draw each of `results` that has a figure, and write it to `folder` as PDF and as PNG.

    Parameters
    ----------
    results : mapping
        Data by the name of the figure, a key of `FIGURES`; other keys are left alone.
    folder : Path
        Must exist.

    Returns
    -------
    list of Path
        What was written.
    """
    written: list[Path] = []
    for name, data in results.items():
        if name not in FIGURES:
            continue
        figure = FIGURES[name](data)
        written += [write_figure(folder / f"{name}.{kind}", figure) for kind in ("pdf", "png")]
    return written


@styled
def trajectory(data: Figure2) -> Figure:
    """Draw the paper's Figure 2, and how far a motion started beside it drifts away."""
    figure = Figure(figsize=(7.2, 3.0))
    left, right = panels(figure, 1, 2)
    for bob, color in enumerate((SKY, AMBER, BLUE)):
        x, y = data.motion.positions()[:, bob].T
        left.plot(x, y, color=color, linewidth=0.8)
        left.annotate(f"bob {bob + 1}", (x[0], y[0]), xytext=(5, 5), textcoords="offset points")
    left.plot(0.0, 0.0, ".", color=BLACK)
    left.annotate("pivot", (0.0, 0.0), xytext=(5, -3), textcoords="offset points")
    left.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", xlim=(-0.85, 1.1))
    left.set_title(f"Three bobs for {data.motion.times[-1]:g} s from 45°")
    right.plot(data.times, data.growth, color=BLUE, label="largest distance so far")
    line = float(np.median(data.growth / data.times)) * data.times
    right.plot(data.times, line, "--", color=BLACK, linewidth=0.9, label="proportional to time")
    right.set(xscale="log", yscale="log", xlabel="time [s]", ylabel="distance / distance at start")
    right.set_xlim(0.3, data.times[-1])
    right.set_ylim(0.5, None)
    right.set_title("A motion started beside it")
    right.legend()
    return figure


@styled
def pseudo_periods(data: Sequence[Series]) -> Figure:
    """Draw the paper's Figures 4-7: pseudo-period against n in three trials, with error bars."""
    figure = Figure(figsize=(7.2, 5.8))
    for axes, one in zip(panels(figure, 2, 2), data, strict=True):
        n = one.counts.size
        axes.fill_between(
            one.counts, one.ideal - one.bars, one.ideal + one.bars, color=ORANGE, alpha=0.15,
            linewidth=0, label=f"the paper's error bars, ±{one.bars[0] / one.ideal[0]:.0%}",
        )  # fmt: skip
        axes.plot(one.counts, one.ideal, color=ORANGE, label="the paper's $T_0$")
        axes.plot(one.counts, one.fundamental, color=GREEN, label="$T_1$, slowest normal mode")
        for trial, ((marker, color), measured) in enumerate(
            zip(TRIALS, one.measured, strict=True), start=1
        ):
            axes.plot(
                one.counts, measured, marker, color=color, markeredgewidth=0,
                markersize=(7.5 - 1.8 * trial) * (1.0 if n <= 20 else 0.6),
                label=f"trial {trial}, mean over the bobs",
            )  # fmt: skip
        axes.set(xlabel="number of pendulums n", ylabel="pseudo-period [s]", title=f"N = {n}")
        axes.set_ylim(0.0, None)
        axes.xaxis.get_major_locator().set_params(integer=True)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


@styled
def readings(data: Grid) -> Figure:
    """Draw e(N) and its range over the trials, by every reading and as printed in Tables 1-3."""
    figure = Figure(figsize=(7.2, 4.2))
    left, right = panels(figure, 1, 2)
    shift = np.random.default_rng(0).uniform(-0.3, 0.3, len(data.readings))
    columns = np.arange(len(data.n_values))
    written = data.readings.index(AS_WRITTEN)
    for axes, cloud in ((left, data.errors.mean(axis=1)), (right, data.scatter)):
        for column in columns:
            axes.plot(column + shift, cloud[:, column], ",", color=FAINT, rasterized=True, zorder=1)
        axes.plot(columns, cloud[written], "D--", color=GREEN, markersize=5)
        axes.plot(columns, cloud[data.nearest], "v--", color=AMBER, markersize=6)
        axes.set(xlabel="number of pendulums N", yscale="log")
        axes.set_xticks(columns, [str(n) for n in data.n_values])
    for trial, ((marker, color), e) in enumerate(zip(TRIALS, data.printed, strict=True), start=1):
        left.plot(columns, e, marker, color=color, markersize=7, label=f"printed, trial {trial}")
    right.plot(columns, data.printed_scatter, "*", color=BLACK, markersize=11, label="printed")
    left.set(ylabel="e(N)", ylim=(0.02, 2.0), title="Cumulative average error")
    right.set(ylabel="range of e(N)", ylim=(1e-5, 1.0), title="Its range over the three trials")
    left.plot([], [], "o", color=FAINT, markersize=3, label=f"{len(data.readings)} readings")
    left.plot([], [], "D--", color=GREEN, markersize=5, label="the text taken at its word")
    left.plot([], [], "v--", color=AMBER, markersize=6, label="nearest to all printed")
    handles, labels = left.get_legend_handles_labels()
    more = right.get_legend_handles_labels()
    labels = [*labels, "printed, range over the trials"]
    figure.legend([*handles, *more[0]], labels, loc="outside lower center", ncols=3)
    return figure


@styled
def runge_kutta(data: tuple[FloatArray, FloatArray, FloatArray]) -> Figure:
    """Draw RK4's errors; `data` is the steps [s], the errors of one step, those after 1 s."""
    steps, local, after = data
    figure = Figure(figsize=(5.0, 3.6))
    (axes,) = panels(figure, 1, 1)
    for errors, order, (marker, color), label in (
        (local, 5, ("o", BLUE), "after one step"),
        (after, 4, ("s", ORANGE), "after 1 s"),
    ):
        axes.plot(1e3 * steps, errors, marker, color=color, label=label)
        guide = errors[0] * (steps / steps[0]) ** order
        axes.plot(1e3 * steps, guide, "--", color=color, linewidth=0.9, label=f"slope {order}")
    axes.set(
        xscale="log", yscale="log", xlabel="step [ms]", ylabel="error of the state [rad, rad/s]"
    )
    axes.xaxis.set(major_locator=FixedLocator((1e3 * steps).tolist()), minor_locator=NullLocator())
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.set_title("Runge-Kutta, three unequal rods")
    axes.legend()
    return figure


@styled
def kane_cost(data: tuple[FloatArray, FloatArray, FloatArray, FloatArray]) -> Figure:
    """Draw the cost of Kane's method beside ours.

    `data` is the numbers of rods and the seconds of a derivation, then those of one evaluation of
    our dynamics.
    """
    kane_n, kane_s, our_n, our_s = data
    figure = Figure(figsize=(5.6, 3.8))
    (axes,) = panels(figure, 1, 1)
    for n, seconds, (marker, color), label in (
        (kane_n, kane_s, ("s", ORANGE), "Kane's method, one derivation"),
        (our_n, our_s, ("o", BLUE), "here, one evaluation"),
    ):
        axes.plot(n, seconds, marker + "-", color=color, label=label)
    guide = np.asarray(our_n, float)
    axes.plot(guide, our_s[-1] * guide / guide[-1], "--", color=BLACK, linewidth=0.9,
              label="proportional to N")  # fmt: skip
    axes.set(xscale="log", yscale="log", xlabel="number of pendulums N", ylabel="time [s]")
    axes.legend()
    return figure


@styled
def lyapunov(data: Mapping[str, Mapping[int, Growth]]) -> Figure:
    """Draw how the largest Lyapunov exponent converges; `data` has runs by angle and by N."""
    figure = Figure(figsize=(7.2, 3.8))
    for axes, (angle, runs) in zip(panels(figure, 1, len(data)), data.items(), strict=True):
        for k, (n, run) in enumerate(runs.items()):
            kept = np.unique(np.geomspace(1, run.times.size, 400).astype(np.int64)) - 1
            axes.plot(run.times[kept], np.abs(run.logarithm[kept]) / run.times[kept],
                      color=shade(k / max(1, len(runs) - 1)), linewidth=1.0)  # fmt: skip
            axes.annotate(f"N = {n}", (run.times[-1], run.exponent()), xytext=(4, -3),
                          textcoords="offset points", fontsize=8,
                          bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5})  # fmt: skip
        last = max(float(run.times[-1]) for run in runs.values())
        time = np.geomspace(10.0, last, 100)
        axes.plot(time, np.log(time) / time, "--", color=ORANGE, linewidth=0.9,
                  label="ln t / t: a regular motion")  # fmt: skip
        axes.set(xscale="log", yscale="log", xlabel="time [s]", title=f"Released from {angle}")
        axes.set(ylabel="largest exponent, so far [1/s]", xlim=(2.0, 4.0 * last))
        axes.legend(loc="lower left")
    return figure


FIGURES: dict[str, Callable[[Any], Figure]] = {
    "trajectory": trajectory,
    "pseudo_periods": pseudo_periods,
    "readings": readings,
    "law_against_n": law_against_n,
    "law_against_angle": law_against_angle,
    "runge_kutta": runge_kutta,
    "kane_cost": kane_cost,
    "lyapunov": lyapunov,
}
