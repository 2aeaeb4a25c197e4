"""The work-precision diagram of `npend bench`."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from npend_gym.bench.accuracy import DURATION, N, Point
from npend_gym.report.figures import styled


@styled
def work_precision(points: Sequence[Point]) -> Figure:
    """Draw CPU time against energy error, a line for each method."""
    figure = Figure(figsize=(7.2, 4.8))
    axes = figure.add_subplot()
    methods = list(dict.fromkeys(point.method for point in points))
    for method, marker in zip(methods, "osD^vPX*", strict=False):
        runs = [point for point in points if point.method == method]
        mine = method.startswith("npend_gym")
        axes.plot(
            [run.energy_error for run in runs], [run.seconds for run in runs], f"{marker}-",
            label=method, linewidth=2.0 if mine else 1.0,
        )  # fmt: skip
    axes.set(
        xscale="log", yscale="log", xlabel="largest error of the energy, relative",
        ylabel="CPU time [s]",
        title=f"{N} rods of 1 m released from 45°, {DURATION:g} s in 1000 frames",
    )  # fmt: skip
    axes.invert_xaxis()  # better to the right
    axes.legend()
    return figure
