"""The results of `npend bench` on paper: lines, CSV files, the work-precision diagram."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from npend_gym.bench.accuracy import Point
from npend_gym.bench.timing import Row, machine
from npend_gym.report.outputs import write_csv, write_figure


def line(result: Row | Point) -> str:
    """Return a result as a line."""
    if isinstance(result, Point):
        return (
            f"{result.method:30s} {result.setting:12s} {result.seconds:10.3g} s   "
            f"energy error {result.energy_error:.0e}"
        )
    text = f"{result.job:54s} {result.ours_per_s:10.3g}/s"
    if not math.isnan(result.peer_per_s):
        text += f" {result.peer_per_s:10.3g}/s {result.ratio:8.2f} x  {result.peer}"
    return f"{text}  {result.note}" if result.note else text


def table(results: Sequence[Row | Point]) -> list[dict[str, Any]]:
    """Return the tidy table: a row for every result of a suite, each with what made it."""
    made_by = machine()
    return [
        result._asdict()
        | ({"ratio": result.ratio} if isinstance(result, Row) else {})
        | {"made_by": made_by}
        for result in results
    ]


def write(suite: str, results: Sequence[Row | Point], out: Path, *, figures: bool) -> list[Path]:
    """Write the results of a suite as CSV; points, if `figures`, as a diagram too."""
    written = [write_csv(out / f"{suite}.csv", table(results))]
    points = [result for result in results if isinstance(result, Point)]
    if figures and points:
        from npend_gym.report.bench_figure import work_precision  # matplotlib, an extra

        drawn = work_precision(points)
        written += [write_figure(out / f"{suite}.{kind}", drawn) for kind in ("png", "pdf")]
    return written
