"""The release experiment on paper: a table for the terminal, CSV files, a manifest, figures."""

from __future__ import annotations

import csv
import hashlib
import json
import math
import platform
from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from npend_gym import _files
from npend_gym._version import __version__
from npend_gym.experiments.release import Release, Run, bob_rows, summary_rows

_COLUMNS = (
    ("N", 4), ("measured", 9), ("over bobs", 10), ("over trials", 12), ("completed", 11),
    ("T0", 9), ("T0 + ampl.", 11), ("T1", 9), ("e(T0)", 8), ("e(T0+a)", 8), ("e(T1)", 8),
)  # fmt: skip


_LEGEND = """\
measured: mean pseudo-period [s] over bobs and trials, reading "{reading}", seed {seed}
T0: the paper's 2 pi N / sum sqrt(g m/(l M)); + ampl.: times its amplitude series, corrected
T1: period of the slowest normal mode; e: |measured - model| / measured"""


def summary_text(release: Release, runs: Sequence[Run]) -> str:
    """Return the table of `summary_rows` as text, with a legend."""
    lines = ["".join(f"{name:>{width}}" for name, width in _COLUMNS)]
    for row in summary_rows(release, runs):
        cells = (
            f"{row['n']}",
            _seconds(row["measured_s"]),
            _spread(row["bob_spread_s"]),
            _spread(row["trial_spread_s"]),
            f"{row['completed']}/{row['bobs']}",
            _seconds(row["ideal_s"]),
            _seconds(row["corrected_s"]),
            _seconds(row["fundamental_s"]),
            *(_percent(row[f"{key}_error"]) for key in ("ideal", "corrected", "fundamental")),
        )
        lines.append("".join(f"{c:>{w}}" for c, (_, w) in zip(cells, _COLUMNS, strict=True)))
    lines += ["", _LEGEND.format(reading=release.reading, seed=release.seed)]
    return "\n".join(lines)


def _seconds(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.4f}"


def _spread(value: float) -> str:
    return "-" if math.isnan(value) else f"+- {value:.4f}"


def _percent(value: float) -> str:
    return "-" if math.isnan(value) else f"{100 * value:.1f}%"


def prepare_folder(out: Path) -> None:
    """Make the folder `out` if need be, and see that it can be written to.

    Raises
    ------
    ValueError
        If `out` is no folder, or cannot be made or written to.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        with _files.replacing(out / ".writable"):
            pass
        (out / ".writable").unlink()
    except OSError as error:
        reason = error.strerror or str(error)
        raise ValueError(
            f"out must be a folder that can be written to, got {out}: {reason}"
        ) from error


def write(release: Release, runs: Sequence[Run], out: Path, *, figures: bool) -> list[Path]:
    """Write tables, manifest and (with `figures`) pictures into `out`; return what was written.

    Each file appears whole, by rename; the manifest, with the digests of the others, comes last.
    """
    prepare_folder(out)
    written = [
        _write_csv(out / "periods.csv", bob_rows(runs)),
        _write_csv(out / "summary.csv", summary_rows(release, runs)),
    ]
    if figures:
        from npend_gym.report import figures as draw  # matplotlib, an extra

        for name, figure in (
            ("period_against_n.png", draw.period_against_n(release, runs)),
            ("period_of_each_bob.png", draw.period_of_each_bob(release, runs)),
        ):
            with _files.replacing(out / name, binary=True) as file:
                figure.savefig(
                    file, format="png", metadata={"Software": f"npend_gym {__version__}"}
                )
            written.append(out / name)
    with _files.replacing(out / "manifest.json") as file:
        json.dump(_manifest(release, runs, written), file, indent=2)
        file.write("\n")
    return [*written, out / "manifest.json"]


def _write_csv(path: Path, rows: Sequence[dict[str, Any]]) -> Path:
    with _files.replacing(path) as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)  # floats as repr: read back to the same bits
    return path


def _manifest(release: Release, runs: Sequence[Run], written: Sequence[Path]) -> dict[str, Any]:
    arguments = {
        name: np.asarray(value).tolist() if name in ("n_values", "masses", "lengths") else value
        for name, value in asdict(release).items()
    }
    return {
        "package": "npend_gym",
        "version": __version__,
        "experiment": "release",
        "arguments": arguments,
        "complete": len(runs) == len(release.runs()),
        "libraries": {name: version(name) for name in ("numpy", "scipy", "numba")},
        "python": platform.python_version(),
        "platform": platform.platform(),
        "sha256": {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in written},
    }
