"""Measure one pendulum: period against amplitude, g or length, damping and Q, with errors.

It reads what `npend identify` reads: our CSV files, and exports of Tracker, phyphox, Capstone,
Logger Pro and other programs. See docs/howto/measure_g.md.

Examples
--------
  npend measure tracker.txt --length 0.523 --length-error 0.001 --radius 0.015
  npend measure phyphox.zip --length 0.80 --out results
  npend measure swing.csv --degrees --gravity 9.81 --json
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from npend_gym.cli.common import OK, can_draw, finishing, prepare_results, show_written
from npend_gym.cli.identify import read_files

FILLS = {
    "npend_gym.identification.swings:measure_swings": (
        "length", "length_error", "radius", "gravity",
    ),
    "npend_gym.identification.recordings:read_motion": ("columns", "degrees", "fps"),
}  # fmt: skip


def run(
    files: Sequence[Path],
    *,
    columns: Mapping[str, str] | None = None,
    degrees: bool = False,
    fps: float | None = None,
    as_json: bool = False,
    out: Path | None = None,
    **chosen: Any,
) -> int:
    """Read, measure and report; return the exit code.

    Parameters
    ----------
    files : file
        Recordings of one pendulum.
    as_json : bool
        Print everything as JSON.
    out : folder, optional
        Write measure.json, swings.csv and a figure there.
    """
    from npend_gym.identification import measure_swings
    from npend_gym.report import outputs

    motion, _ = read_files("npend measure", files, columns=columns, degrees=degrees, fps=fps)
    if out is not None:
        prepare_results(out, "npend measure")
    found = measure_swings(motion, **chosen)
    with finishing():
        print(json.dumps(found.as_dict(), indent=2) if as_json else _text(found))
        if out is not None:
            figures: dict[str, Any] = {}
            if can_draw():
                from npend_gym.report.swings_figure import swings_figure

                figures["swings"] = lambda: swings_figure(found)
            columns_of = found.times.tolist(), found.amplitudes.tolist(), found.periods.tolist()
            rows = [{"time": time, "amplitude": size, "period": period}
                    for time, size, period in zip(*columns_of, strict=True)]  # fmt: skip
            arguments = {k: v for k, v in chosen.items() if v is not None}
            written = outputs.write_results(
                out, "measure", arguments, complete=True, records={"measure": found.as_dict()},
                tables={"swings": rows}, figures=figures,
            )  # fmt: skip
            if not as_json:
                show_written(written)
    return OK


def _text(found: Any) -> str:
    most, least = (math.degrees(size) for size in (found.amplitudes.max(), found.amplitudes.min()))
    lines = [
        f"{found.periods.size} swings, amplitudes from {most:.3g} to {least:.3g} degrees",
        "",
        _line("period of small swings", found.small_period, found.small_period_error, "s"),
        _line("decay of the amplitude", found.decay, found.decay_error, "1/s"),
        _line("Q", found.quality, found.quality_error, ""),
    ]
    if math.isfinite(found.gravity):
        lines.append(_line("acceleration of gravity", found.gravity, found.gravity_error, "m/s^2"))
        lines.append(_line("length to the bob's centre", found.length, found.length_error, "m"))
    return "\n".join(lines)


def _line(name: str, value: float, error: float, unit: str) -> str:
    return f"{name:<27}{value:>11.6g} +- {error:<8.2g} {unit}".rstrip()
