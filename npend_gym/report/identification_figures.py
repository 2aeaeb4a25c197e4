"""Figures of an identification: motions that were held out, errors of all segments, the values."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter

from npend_gym._palette import BLACK, BLUE, ORANGE, SKY
from npend_gym.identification import Identification, Motion
from npend_gym.report.style import legend_below, panels, shade, styled

_DOTS = 45  # measured angles of a link in a panel


@styled
def motions(result: Identification, motion: Motion) -> Figure:
    """Draw measured and simulated angles of some segments, and their difference below.

    They are held-out segments, if there are any: the one with the largest error, the median one
    and the one with the smallest.
    """
    held = [one for one in result.segments if one["held_out"]] or list(result.segments)
    held.sort(key=lambda one: -one["rmse"])
    places = sorted({0, (len(held) - 1) // 2, len(held) - 1})
    figure = Figure(figsize=(1.2 + 2.9 * len(places), 4.6))
    axes = panels(figure, 2, len(places), height_ratios=(2.0, 1.0))
    for column, place in enumerate(places):
        upper, lower = axes[column], axes[column + len(places)]
        _draw_segment(upper, lower, result, motion, held[place])
    axes[0].set_ylabel("angle [rad]")
    axes[len(places)].set_ylabel("error [mrad]")
    legend_below(figure, axes[0], 4)
    return figure


def _draw_segment(
    upper: Any, lower: Any, result: Identification, motion: Motion, segment: dict[str, Any]
) -> None:
    inside = (motion.times >= segment["start"]) & (motion.times <= segment["end"])
    rows = np.flatnonzero(inside & (motion.piece == segment["piece"]))
    times = motion.times[rows] - segment["start"]
    dots = slice(None, None, max(1, rows.size // _DOTS))
    for link in range(motion.links):
        color = shade(link / max(1, motion.links - 1)) if motion.links > 1 else BLUE
        measured, residual = motion.theta[rows, link], result.residuals[rows, link]
        upper.plot(times, measured + residual, color=color, label=f"theta{link} simulated")
        upper.plot(
            times[dots], measured[dots], "o", color=ORANGE, markersize=2.0,
            label="measured" if link == motion.links - 1 else None,
        )  # fmt: skip
        lower.plot(times, 1e3 * residual, color=color, linewidth=0.9)
    lower.axhline(0.0, color=BLACK, linewidth=0.6)
    kind = "held out" if segment["held_out"] else "fitted"
    upper.set_title(
        f"piece {segment['piece']} from {segment['start']:.2f} s, {kind}:\n"
        f"RMSE {1e3 * segment['rmse']:.2f} mrad"
    )
    lower.set_xlabel("time [s]")


@styled
def errors(result: Identification) -> Figure:
    """Draw the error of each segment: of the fitted chain, and of the given one if held out."""
    figure = Figure(figsize=(7.2, 3.4))
    axes: Any = figure.add_subplot()
    segments = sorted(result.segments, key=lambda one: (one["piece"], one["start"]))
    for held, color, text in ((False, SKY, "segments fitted"), (True, BLUE, "held out")):
        places = [k for k, one in enumerate(segments) if one["held_out"] is held]
        rmse = [1e3 * segments[k]["rmse"] for k in places]
        if places:
            axes.plot(places, rmse, "o", color=color, markersize=5, label=f"{text}, fitted chain")
    places = [k for k, one in enumerate(segments) if one["held_out"]]
    given = [1e3 * segments[k]["given_rmse"] for k in places]
    if places:
        axes.plot(places, given, "_", color=ORANGE, markersize=9, markeredgewidth=2,
                  label="held out, given chain")  # fmt: skip
    axes.set(yscale="log", xlabel="segment, in the order of the data", ylabel="RMSE [mrad]",
             xlim=(-0.5, len(segments) - 0.5))  # fmt: skip
    axes.xaxis.get_major_locator().set_params(integer=True, min_n_ticks=1)
    axes.yaxis.set_major_formatter(ScalarFormatter())
    axes.yaxis.set_minor_formatter(ScalarFormatter())
    legend_below(figure, axes, 3)
    return figure


@styled
def parameters(result: Identification) -> Figure:
    """Draw the relative standard errors of the fitted values, and the correlation of the errors."""
    figure = Figure(figsize=(8.4, 2.0 + 0.26 * len(result.names)))
    left, right = panels(figure, 1, 2)
    k = np.arange(len(result.names))
    known = np.isfinite(result.standard_errors) & (result.standard_errors > 0.0)
    known &= result.values != 0.0  # the relative error of zero has no meaning
    size = np.where(known, np.abs(result.values), 1.0)
    relative = 100.0 * result.standard_errors[known] / size[known]
    left.plot(relative, k[known], "o", color=BLUE)
    for place in k[~known]:
        text = "not determined" if np.isinf(result.standard_errors[place]) else "at its bound"
        left.annotate(text, (0.03, place), xycoords=("axes fraction", "data"), va="center")
    left.set(xscale="log", xlabel="standard error [% of the value]", ylim=(k[-1] + 0.6, -0.6))
    left.set_yticks(k, result.names)
    image = right.imshow(result.correlation, cmap="RdBu_r", vmin=-1.0, vmax=1.0, aspect="auto")
    right.set_xticks(k, result.names, rotation=60, ha="right")
    right.set_yticks(k, [])
    right.grid(visible=False)
    right.set_title("correlation of the errors")
    figure.colorbar(image, ax=right, shrink=0.8)
    return figure
