"""The results of `npend bench` on paper: lines, CSV files, the work-precision diagram."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from npend_gym import _files
from npend_gym.bench.accuracy import Point
from npend_gym.bench.timing import Row, machine
from npend_gym.report import outputs


def row_text(row: Row) -> str:
    """Return a comparison as a line."""
    text = f"{row.job:54s} {row.ours_per_s:10.3g}/s"
    if not math.isnan(row.peer_per_s):
        text += f" {row.peer_per_s:10.3g}/s {row.ratio:8.2f} x  {row.peer}"
    return f"{text}  {row.note}" if row.note else text


def point_text(point: Point) -> str:
    """Return a run of the paper's job as a line."""
    return (
        f"{point.method:30s} {point.setting:12s} {point.seconds:10.3g} s   "
        f"energy error {point.energy_error:.0e}"
    )


def table(results: Sequence[Row | Point]) -> list[dict[str, Any]]:
    """Return the tidy table: a row for every result of a suite, each with what made it."""
    made_by = machine()
    return [
        result._asdict()
        | ({"ratio": result.ratio} if isinstance(result, Row) else {})
        | {"made_by": made_by}
        for result in results
    ]


def write_rows(suite: str, rows: Sequence[Row], out: Path) -> list[Path]:
    """Write the comparisons of a suite as CSV."""
    return [outputs.write_csv(out / f"{suite}.csv", table(rows))]


def write_points(points: Sequence[Point], out: Path, *, figures: bool) -> list[Path]:
    """Write the runs of the paper's job as CSV and, if `figures`, as a diagram."""
    written = [outputs.write_csv(out / "accuracy.csv", table(points))]
    if figures:
        from npend_gym.report.bench_figure import work_precision

        drawn = work_precision(points)
        for kind in ("png", "pdf"):
            with _files.replacing(out / f"accuracy.{kind}", binary=True) as file:
                drawn.savefig(file, format=kind)
            written.append(out / f"accuracy.{kind}")
    return written
