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
    PercentFormatter,
    ScalarFormatter,
    StrMethodFormatter,
)

from npend_gym import _files, theory
from npend_gym._checks import FloatArray
from npend_gym._version import __version__
from npend_gym.experiments.paper.chaos import Growth
from npend_gym.experiments.paper.figure_data import Figure2, Series
from npend_gym.experiments.paper.grid import Grid
from npend_gym.experiments.paper.readings import AS_WRITTEN
from npend_gym.experiments.paper.scan import Law, Scan
from npend_gym.report.figures import _styled as styled

_BLUE, _ORANGE, _GREEN, _PINK, _AMBER, _SKY, _BLACK = (
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"
)  # fmt: skip
_FAINT = "#BBBBBB"
_TRIALS = (("o", _SKY), ("s", _BLUE), ("^", _BLACK))


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
        for suffix, metadata in (
            ("pdf", {"Creator": f"npend_gym {__version__}", "CreationDate": None}),
            ("png", {"Software": f"npend_gym {__version__}"}),
        ):
            path = folder / f"{name}.{suffix}"
            with _files.replacing(path, binary=True) as file:
                figure.savefig(file, format=suffix, metadata=metadata)
            written.append(path)
    return written


@styled
def trajectory(data: Figure2) -> Figure:
    """Draw the paper's Figure 2, and how far a motion started beside it drifts away."""
    figure = Figure(figsize=(7.2, 3.0))
    left, right = _panels(figure, 1, 2)
    for bob, color in enumerate((_SKY, _AMBER, _BLUE)):
        x, y = data.motion.positions()[:, bob].T
        left.plot(x, y, color=color, linewidth=0.8)
        left.annotate(f"bob {bob + 1}", (x[0], y[0]), xytext=(5, 5), textcoords="offset points")
    left.plot(0.0, 0.0, ".", color=_BLACK)
    left.annotate("pivot", (0.0, 0.0), xytext=(5, -3), textcoords="offset points")
    left.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", xlim=(-0.85, 1.1))
    left.set_title(f"Three bobs for {data.motion.times[-1]:g} s from 45°")
    right.plot(data.times, data.growth, color=_BLUE, label="largest distance so far")
    line = float(np.median(data.growth / data.times)) * data.times
    right.plot(data.times, line, "--", color=_BLACK, linewidth=0.9, label="proportional to time")
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
    for axes, one in zip(_panels(figure, 2, 2), data, strict=True):
        n = one.counts.size
        axes.fill_between(
            one.counts, one.ideal - one.bars, one.ideal + one.bars, color=_ORANGE, alpha=0.15,
            linewidth=0, label=f"the paper's error bars, ±{one.bars[0] / one.ideal[0]:.0%}",
        )  # fmt: skip
        axes.plot(one.counts, one.ideal, color=_ORANGE, label="the paper's $T_0$")
        axes.plot(one.counts, one.fundamental, color=_GREEN, label="$T_1$, slowest normal mode")
        for trial, ((marker, color), measured) in enumerate(
            zip(_TRIALS, one.measured, strict=True), start=1
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
    left, right = _panels(figure, 1, 2)
    shift = np.random.default_rng(0).uniform(-0.3, 0.3, len(data.readings))
    columns = np.arange(len(data.n_values))
    written = data.readings.index(AS_WRITTEN)
    for axes, cloud in ((left, data.errors.mean(axis=1)), (right, data.scatter)):
        for column in columns:
            axes.plot(
                column + shift, cloud[:, column], ",", color=_FAINT, rasterized=True, zorder=1
            )
        axes.plot(columns, cloud[written], "D--", color=_GREEN, markersize=5)
        axes.plot(columns, cloud[data.nearest], "v--", color=_AMBER, markersize=6)
        axes.set(xlabel="number of pendulums N", yscale="log")
        axes.set_xticks(columns, [str(n) for n in data.n_values])
    for trial, ((marker, color), e) in enumerate(zip(_TRIALS, data.printed, strict=True), start=1):
        left.plot(columns, e, marker, color=color, markersize=7, label=f"printed, trial {trial}")
    right.plot(columns, data.printed_scatter, "*", color=_BLACK, markersize=11, label="printed")
    left.set(ylabel="e(N)", ylim=(0.02, 2.0), title="Cumulative average error")
    right.set(ylabel="range of e(N)", ylim=(1e-5, 1.0), title="Its range over the three trials")
    left.plot([], [], "o", color=_FAINT, markersize=3, label=f"{len(data.readings)} readings")
    left.plot([], [], "D--", color=_GREEN, markersize=5, label="the text taken at its word")
    left.plot([], [], "v--", color=_AMBER, markersize=6, label="nearest to all printed")
    handles, labels = left.get_legend_handles_labels()
    more = right.get_legend_handles_labels()
    labels = [*labels, "printed, range over the trials"]
    figure.legend([*handles, *more[0]], labels, loc="outside lower center", ncols=3)
    return figure


@styled
def law_against_n(data: tuple[Scan, Law]) -> Figure:
    """Draw the pseudo-period against N with the paper's model and the law, and the residuals."""
    scan, law = data
    figure = Figure(figsize=(7.2, 5.6))
    top, bottom = _panels(figure, 2, 1, sharex=True, height_ratios=(2.2, 1.0))
    counts = np.unique(np.geomspace(1, int(scan.counts[-1]), 60).astype(np.int64))
    ideal = theory.single_period() * np.sqrt(counts)
    top.plot(counts, ideal, color=_ORANGE, label=r"the paper's $2\pi\sqrt{Nl/g}$, any angle")
    shown = [int(np.argmin(np.abs(scan.angles - a))) for a in (0.01, np.pi / 4, 1.2)]
    for row, (marker, color) in zip(shown, _TRIALS, strict=True):
        angle = scan.angles[row]
        label = f"measured, median over the bobs, {angle:.3g} rad"
        top.plot(scan.counts, scan.median[row] * scan.fundamental, marker, color=color, label=label)
        periods = [theory.large_n_period(int(n)) * law.ratio(angle) for n in counts]
        top.plot(counts, periods, color=color, linewidth=0.9)
        expected = law.ratio(angle)
        bottom.plot(scan.counts, scan.median[row] / expected - 1.0, marker + "-", color=color,
                    linewidth=0.9, markersize=5)  # fmt: skip
    top.plot([], [], color=_BLACK, linewidth=0.9, label=f"the law, from N = {law.counts[0]}")
    exact = theory.single_period() * np.sqrt(scan.counts) / scan.fundamental
    bottom.plot(scan.counts, exact / law.ratio(scan.angles[shown[1]]) - 1.0, "x-", color=_ORANGE,
                label="the paper's, at 45°")  # fmt: skip
    bottom.legend(loc="center right")
    bottom.axhline(0.0, color=_BLACK, linewidth=0.6)
    top.set(yscale="log", ylabel="pseudo-period [s]", title="Rods of 1 m, released straight")
    bottom.set(xscale="log", xlabel="number of pendulums N", ylabel="over the law, less 1")
    bottom.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    bottom.xaxis.set(major_locator=FixedLocator(scan.counts.tolist()), minor_locator=NullLocator())
    bottom.xaxis.set_major_formatter(ScalarFormatter())
    _plain_seconds(top)
    top.legend()
    return figure


@styled
def law_against_angle(data: tuple[Scan, Law]) -> Figure:
    """Draw the pseudo-period over T1 against the starting angle, and what the law leaves."""
    scan, law = data
    figure = Figure(figsize=(7.2, 6.2))
    top, bottom = _panels(figure, 2, 1, sharex=True, height_ratios=(2.4, 1.0))
    angle = np.linspace(0.0, float(scan.angles[-1]), 300)
    pendulum = 1.0 + theory.amplitude_correction(angle)
    n = scan.counts[-1]
    high = theory.single_period() * np.sqrt(n) / scan.fundamental[-1]
    top.plot(angle, high * pendulum, color=_ORANGE, label=f"the paper's $T(N,a)$, N = {n}")
    top.plot(angle, pendulum, color=_GREEN, label="$T_1$ with one pendulum's series")
    inside = angle[angle <= law.angles[-1]]
    top.plot(inside, law.ratio(inside), color=_BLACK, label="the law fitted here")
    large = np.flatnonzero(scan.counts >= law.counts[0])
    markers = ("o", "s", "^", "D", "v", "P", "X", "<", ">")
    for column, marker in zip(large.tolist(), markers, strict=False):
        color = _shade((column - large[0]) / max(1, large.size - 1))
        label = f"measured, median, N = {scan.counts[column]}"
        top.plot(scan.angles, scan.median[:, column], marker, color=color, markersize=4.5,
                 label=label)  # fmt: skip
        bottom.plot(law.angles, law.residuals[:, column - large[0]], marker, color=color,
                    markersize=4.5)  # fmt: skip
    mean = scan.mean[:, large[-1]]
    top.plot(scan.angles, mean, "+", color=_PINK, label=f"measured, mean, N = {n}")
    top.axvline(np.pi / 4, color=_FAINT, linewidth=0.9, zorder=0)
    top.annotate(r"$\pi/4$", (np.pi / 4, 0.66), xytext=(3, 0), textcoords="offset points")
    bottom.axhline(0.0, color=_BLACK, linewidth=0.6)
    top.set(ylabel="pseudo-period / $T_1$", ylim=(0.64, 1.5))
    bottom.set(xlabel="starting angle a [rad]", ylabel="over the law, less 1")
    bottom.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=1))
    handles, labels = top.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


@styled
def runge_kutta(data: tuple[FloatArray, FloatArray, FloatArray]) -> Figure:
    """Draw RK4's errors; `data` is the steps [s], the errors of one step, those after 1 s."""
    steps, local, after = data
    figure = Figure(figsize=(5.0, 3.6))
    (axes,) = _panels(figure, 1, 1)
    for errors, order, (marker, color), label in (
        (local, 5, ("o", _BLUE), "after one step"),
        (after, 4, ("s", _ORANGE), "after 1 s"),
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
    (axes,) = _panels(figure, 1, 1)
    for n, seconds, (marker, color), label in (
        (kane_n, kane_s, ("s", _ORANGE), "Kane's method, one derivation"),
        (our_n, our_s, ("o", _BLUE), "here, one evaluation"),
    ):
        axes.plot(n, seconds, marker + "-", color=color, label=label)
    guide = np.asarray(our_n, float)
    axes.plot(guide, our_s[-1] * guide / guide[-1], "--", color=_BLACK, linewidth=0.9,
              label="proportional to N")  # fmt: skip
    axes.set(xscale="log", yscale="log", xlabel="number of pendulums N", ylabel="time [s]")
    axes.legend()
    return figure


@styled
def lyapunov(data: Mapping[str, Mapping[int, Growth]]) -> Figure:
    """Draw how the largest Lyapunov exponent converges; `data` has runs by angle and by N."""
    figure = Figure(figsize=(7.2, 3.8))
    for axes, (angle, runs) in zip(_panels(figure, 1, len(data)), data.items(), strict=True):
        for k, (n, run) in enumerate(runs.items()):
            kept = np.unique(np.geomspace(1, run.times.size, 400).astype(np.int64)) - 1
            axes.plot(run.times[kept], np.abs(run.logarithm[kept]) / run.times[kept],
                      color=_shade(k / max(1, len(runs) - 1)), linewidth=1.0)  # fmt: skip
            axes.annotate(f"N = {n}", (run.times[-1], run.exponent()), xytext=(4, -3),
                          textcoords="offset points", fontsize=8,
                          bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5})  # fmt: skip
        last = max(float(run.times[-1]) for run in runs.values())
        time = np.geomspace(10.0, last, 100)
        axes.plot(time, np.log(time) / time, "--", color=_ORANGE, linewidth=0.9,
                  label="ln t / t: a regular motion")  # fmt: skip
        axes.set(xscale="log", yscale="log", xlabel="time [s]", title=f"Released from {angle}")
        axes.set(ylabel="largest exponent, so far [1/s]", xlim=(2.0, 4.0 * last))
        axes.legend(loc="lower left")
    return figure


def _panels(
    figure: Figure, rows: int, columns: int, *, sharex: bool = False,
    height_ratios: Sequence[float] | None = None,
) -> list[Any]:  # fmt: skip
    axes = figure.subplots(rows, columns, sharex=sharex, squeeze=False, height_ratios=height_ratios)
    return list(axes.flat)


def _shade(share: float) -> tuple[float, float, float]:
    """Return a blue, the darker the larger `share` (0 to 1)."""
    return 0.65 * (1.0 - share), 0.25 + 0.55 * (1.0 - share), 0.45 + 0.5 * (1.0 - share)


def _plain_seconds(axes: Any) -> None:
    axes.yaxis.set(major_locator=FixedLocator([2, 3, 5, 10, 20, 30]), minor_locator=NullLocator())
    axes.yaxis.set_major_formatter(ScalarFormatter())


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
