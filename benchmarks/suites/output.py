"""The results of the suites as lines, CSV files and the work-precision diagram."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from npend_gym.report import write_csv, write_figure
from suites.accuracy import DURATION, FRAMES, Measurement, N
from suites.timing import Row, machine

if TYPE_CHECKING:
    from matplotlib.figure import Figure  # an extra


def line(result: Row | Measurement) -> str:
    """Return a result as a line."""
    if isinstance(result, Measurement):
        return (
            f"{result.method:30s} {result.setting:12s} {result.seconds:10.3g} s   "
            f"energy error {result.energy_error:.0e}"
        )
    text = f"{result.job:54s} {result.ours_per_s:10.3g}/s"
    if not math.isnan(result.peer_per_s):
        text += f" {result.peer_per_s:10.3g}/s {result.ratio:8.2f} x  {result.peer}"
    return f"{text}  {result.note}" if result.note else text


def table(results: Sequence[Row | Measurement]) -> list[dict[str, Any]]:
    """Return the results of a suite as rows of a table, each with the machine that made it."""
    made_by = machine()
    return [
        result._asdict()
        | ({"ratio": result.ratio} if isinstance(result, Row) else {})
        | {"made_by": made_by}
        for result in results
    ]


def write(
    suite: str, results: Sequence[Row | Measurement], out: Path, *, figures: bool
) -> list[Path]:
    """Write the results of a suite as CSV; if `figures`, accuracies as a diagram too."""
    written = [write_csv(out / f"{suite}.csv", table(results))]
    measured = [result for result in results if isinstance(result, Measurement)]
    if figures and measured:
        diagram = work_precision(measured)
        written += [write_figure(out / f"{suite}.{kind}", diagram) for kind in ("png", "pdf")]
    return written


def work_precision(measured: Sequence[Measurement]) -> Figure:
    """Draw CPU time against energy error, a line for each method."""
    from matplotlib.figure import Figure

    from npend_gym.report import styled

    @styled
    def draw() -> Figure:
        figure = Figure(figsize=(7.2, 4.8))
        axes = figure.add_subplot()
        methods = list(dict.fromkeys(run.method for run in measured))
        for method, marker in zip(methods, "osD^vPX*", strict=False):
            runs = [run for run in measured if run.method == method]
            axes.plot(
                [run.energy_error for run in runs], [run.seconds for run in runs], f"{marker}-",
                label=method, linewidth=2.0 if method.startswith("npend_gym") else 1.0,
            )  # fmt: skip
        axes.set(
            xscale="log", yscale="log", xlabel="largest error of the energy, relative",
            ylabel="CPU time [s]",
            title=f"{N} rods of 1 m released from 45°, {DURATION:g} s in {FRAMES} frames",
        )  # fmt: skip
        axes.invert_xaxis()  # better to the right
        axes.legend()
        return figure

    return draw()
