"""The results of `npend bench` on paper: lines, CSV files, the work-precision diagram."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

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


def write_rows(suite: str, rows: Sequence[Row], out: Path) -> list[Path]:
    """Write the comparisons of a suite as CSV, each with what made it."""
    made_by = machine()
    columns = [{**row._asdict(), "ratio": row.ratio, "made_by": made_by} for row in rows]
    return [outputs.write_csv(out / f"{suite}.csv", columns)]


def write_points(points: Sequence[Point], out: Path, *, figures: bool) -> list[Path]:
    """Write the runs of the paper's job as CSV and, if `figures`, as a diagram."""
    made_by = machine()
    columns = [{**point._asdict(), "made_by": made_by} for point in points]
    written = [outputs.write_csv(out / "accuracy.csv", columns)]
    if figures:
        from npend_gym.report.bench_figure import work_precision

        drawn = work_precision(points)
        for kind in ("png", "pdf"):
            with _files.replacing(out / f"accuracy.{kind}", binary=True) as file:
                drawn.savefig(file, format=kind)
            written.append(out / f"accuracy.{kind}")
    return written
