"""Figures of the release experiment, by matplotlib (extra "plot"), without any window."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from npend_gym import theory
from npend_gym._checks import FloatArray
from npend_gym._palette import AMBER, BLACK, BLUE, GREEN, ORANGE, PINK
from npend_gym.experiments import ReleaseExperiment, Run
from npend_gym.report.style import legend_below, mark_numbers, shade, styled

_IDEAL, _CORRECTED, _FUNDAMENTAL, _LAW = ORANGE, AMBER, GREEN, PINK
_MEASURED, _BOB = BLUE, shade(0.3)
_BESIDE = 0.94  # times N: where the bobs stand, so that means do not hide them
_TRIALS = (shade(0.15), BLUE, BLACK)
_NAMED = 12  # trials in the legend; of more, all have one entry


@styled
def period_against_n(experiment: ReleaseExperiment, runs: Sequence[Run]) -> Figure:
    """Draw the pseudo-period against the number of pendulums, with the models."""
    figure = Figure(figsize=(6.4, 4.4))
    axes: Any = figure.add_subplot()
    n_values = sorted({run.n for run in runs})
    _draw_models(axes, experiment, n_values)
    for run in runs:
        bobs = np.full(run.n, run.n * _BESIDE)
        axes.plot(bobs, run.periods, "_", color=_BOB, markersize=7, markeredgewidth=0.6)
        axes.plot(run.n, run.mean, "o", color=_MEASURED, markersize=6)
        axes.plot(run.n, run.com, "D", color=BLACK, markersize=3.5)
    axes.plot([], [], "o", color=_MEASURED, markersize=6, label="measured, mean of a trial")
    axes.plot([], [], "_", color=_BOB, markersize=7, label="measured, each bob")
    axes.plot([], [], "D", color=BLACK, markersize=3.5, label="measured, centre of mass")
    axes.set(xscale="log", yscale="log", xlabel="number of pendulums N", ylabel="pseudo-period [s]")
    start = math.degrees(experiment.amplitude)
    axes.set_title(f'Release from {start:.4g} degrees, definition "{experiment.definition}"')
    mark_numbers(axes.xaxis, n_values)
    _plain_log_ticks(axes)
    axes.legend()
    return figure


def _draw_models(axes: Any, experiment: ReleaseExperiment, n_values: Sequence[int]) -> None:
    per_rod = not experiment.has_any_n
    low, high = n_values[0], n_values[-1]
    grid = list(n_values) if per_rod else np.unique(np.geomspace(low, high, 60, dtype=int))
    chains = [experiment.chain_of(int(n)) for n in grid]
    models = [theory.models(chain, experiment.amplitude) for chain in chains]
    ideal, corrected, fundamental, law = np.array(models).T
    marker = "_" if len(grid) == 1 else None
    for values, style, color, label in (
        (corrected, "--", _CORRECTED, "$T_0$+a, $T_0$ times the corrected series"),
        (ideal, "-", _IDEAL, r"the paper's $T_0 = 2\pi\sqrt{N l/g}$" if not per_rod else "$T_0$"),
        (fundamental, "-", _FUNDAMENTAL, "$T_1$, slowest normal mode"),
        (law, "-", _LAW, "$T(N,a)$, law of the centre of mass"),
    ):
        if np.isfinite(values).any():  # the paper's model knows point masses alone
            axes.plot(grid, values, style, color=color, label=label, marker=marker, markersize=16)


def _plain_log_ticks(axes: Any) -> None:
    low, high = axes.get_ylim()
    ticks = [t for t in (0.5, 1, 2, 3, 4, 5, 7, 10, 15, 20, 30, 50, 100, 200) if low <= t <= high]
    few = MaxNLocator(5).tick_values(low, high)
    mark_numbers(axes.yaxis, ticks if len(ticks) > 2 else [t for t in few if low <= t <= high])


@styled
def period_of_each_bob(experiment: ReleaseExperiment, runs: Sequence[Run]) -> Figure:
    """Draw the pseudo-period of every bob along the chain, a panel for each N."""
    n_values = sorted({run.n for run in runs})
    names = {1: "every trial"}
    if experiment.trials <= _NAMED:
        names = {trial: f"trial {trial}" for trial in range(1, experiment.trials + 1)}
    columns = min(2, len(n_values))
    rows = -(-len(n_values) // columns)
    figure = Figure(figsize=(1.2 + 3.2 * columns, 0.8 + 2.4 * rows))
    for k, n in enumerate(n_values, start=1):
        axes: Any = figure.add_subplot(rows, columns, k)
        chain = experiment.chain_of(n)
        bobs = np.arange(1, n + 1)
        for run in (run for run in runs if run.n == n):
            # smaller and smaller, because trials may lie on top of each other
            shrink = 1.0 - 0.7 * (run.trial - 1) / max(1, experiment.trials - 1)
            color = _TRIALS[(run.trial - 1) % len(_TRIALS)]
            size = min(7.0, max(3.5, 60.0 / n)) * shrink
            axes.plot(
                bobs, run.periods, "o", color=color, markersize=size, markeredgewidth=0,
                label=names.get(run.trial),
            )  # fmt: skip
        models = theory.models(chain, experiment.amplitude)
        if np.isfinite(models.ideal):
            axes.axhline(models.ideal, color=_IDEAL, label="the paper's $T_0$")
        if np.isfinite(models.fundamental):
            axes.axhline(models.fundamental, color=_FUNDAMENTAL, label="$T_1$, slowest normal mode")
        highest = float(axes.dataLim.y1)  # not finite where nothing has completed
        axes.set_ylim(0.0, 1.05 * highest if 0.0 < highest < np.inf else None)
        axes.set_title(f"N = {n}: {_completed(runs, n)}")
        axes.set(xlabel="bob, counted from the pivot", ylabel="pseudo-period [s]")
        axes.xaxis.get_major_locator().set_params(integer=True, min_n_ticks=1)
        axes.set_xlim(1 - 0.04 * n, n + 0.04 * n)
    legend_below(figure, figure.axes[0], 5 if columns > 1 else 2)
    return figure


def _completed(runs: Sequence[Run], n: int) -> str:
    periods: FloatArray = np.concatenate([run.periods for run in runs if run.n == n])
    return f"{np.isfinite(periods).sum()} of {periods.size} completed"
