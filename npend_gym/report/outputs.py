"""What every report writes the same way: a folder, tidy tables as CSV, a manifest."""

from __future__ import annotations

import csv
import json
import math
import platform
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from npend_gym import _checks, _files
from npend_gym._provenance import provenance
from npend_gym._version import __version__

if TYPE_CHECKING:
    from matplotlib.figure import Figure  # an extra

MANIFEST = "manifest.json"
_MADE_BY = f"npend_gym {__version__}"
# The formats of figures by suffix, with what their files say of themselves
FIGURES: dict[str, dict[str, Any]] = {
    ".png": {"Software": _MADE_BY},
    ".pdf": {"Creator": _MADE_BY, "CreationDate": None},
}


def prepare_folder(out: Path, rule: str = "out must be") -> None:
    """Make the folder `out` if needed; raise an error with the `rule` if it is not writable."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=out):
            pass
    except OSError as error:
        reason = error.strerror or str(error)
        raise ValueError(f"{rule} a folder that can be written to, got {out}: {reason}") from error


def prepare_file(out: Path, suffixes: Sequence[str], name: str = "out") -> None:
    """Check that a file can be written, before work begins; make its folder if need be.

    Parameters
    ----------
    out : Path
    suffixes : sequence of str
        Allowed endings of the file, such as ".csv".
    name : str
        Name of the option for the file, for the error.

    Raises
    ------
    ValueError
        If the ending is not allowed, the path is a folder, or its folder cannot be written to.
    """
    if out.suffix not in suffixes or out.is_dir():
        raise ValueError(f"{name} must be a file that ends in {' or '.join(suffixes)}, got {out}")
    prepare_folder(out.parent, f"{name} must be in")


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> Path:
    """Write `rows`, whose keys are the columns, to `path`, whole or not at all.

    Raises
    ------
    ValueError
        If there are no rows.
    """
    if not rows:
        raise ValueError(
            "rows must hold at least one row, because its keys name the columns; "
            f"got {_checks.show(rows)}"
        )
    with _files.replacing(path) as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)  # floats as repr: read back to the same bits
    return path


def json_text(arguments: Mapping[str, Any], **tables: Sequence[Mapping[str, Any]]) -> str:
    """Return `tables` and their provenance as JSON; NaN becomes null."""
    about = {"provenance": provenance(arguments, arguments.get("seed"))}
    plain = {name: [_nulled(row) for row in rows] for name, rows in tables.items()}
    return json.dumps(about | plain, indent=2, allow_nan=False)


def _nulled(row: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: None if isinstance(value, float) and math.isnan(value) else value
        for name, value in row.items()
    }


def write_json(path: Path, value: Mapping[str, Any]) -> Path:
    """Write `value` to `path` as JSON, whole or not at all."""
    with _files.replacing(path) as file:
        json.dump(value, file, indent=2)
        file.write("\n")
    return path


def write_figure(path: Path, figure: Figure) -> Path:
    """Write `figure` to `path`, .png or .pdf, whole or not at all; equal figures as equal bytes."""
    with _files.replacing(path, binary=True) as file:
        figure.savefig(file, format=path.suffix[1:], metadata=FIGURES[path.suffix])
    return path


def write_all(out: Path, *parts: Iterable[Path]) -> list[Path]:
    """Return the paths that `parts` yield as they write files into `out`, in place of older ones.

    The first file ends the older results, so that the older manifest is removed with it.
    """
    written: list[Path] = []
    for path in chain.from_iterable(parts):
        _files.remove(out / MANIFEST)
        written.append(path)
    return written


def write_results(
    out: Path,
    experiment: str,
    arguments: Mapping[str, Any],
    *,
    complete: bool,
    records: Mapping[str, Mapping[str, Any]] | None = None,
    tables: Mapping[str, Sequence[Mapping[str, Any]]] | None = None,
    figures: Mapping[str, Callable[[], Figure]] | None = None,
) -> list[Path]:
    """Write results into the folder `out`; return what was written.

    Each file is written completely and then renamed. The manifest, with the digests of the others,
    comes last. Figures are drawn after the tables are written, so that an error there loses no
    results.

    Parameters
    ----------
    out : Path
    experiment : str
        What was done, for the manifest, with its `arguments`.
    complete : bool
        Whether it was done to its end.
    records, tables, figures : mapping
        Contents of NAME.json, NAME.csv and NAME.png, by name; functions draw the figures.
    """
    prepare_folder(out)
    written = write_all(
        out,
        (write_json(out / f"{name}.json", value) for name, value in (records or {}).items()),
        (write_csv(out / f"{name}.csv", rows) for name, rows in (tables or {}).items()),
    )
    try:
        for name, draw in (figures or {}).items():
            written.append(write_figure(out / f"{name}.png", draw()))
    finally:
        manifest = write_manifest(out, experiment, arguments, written, complete=complete)
    return [*written, manifest]


def write_manifest(
    out: Path,
    experiment: str,
    arguments: Mapping[str, Any],
    written: Sequence[Path],
    *,
    complete: bool,
) -> Path:
    """Write `manifest.json`: what made the files `written`, and their digests."""
    digests = {path.relative_to(out).as_posix(): _files.sha256(path) for path in written}
    return write_json(out / MANIFEST, manifest(experiment, arguments, digests, complete=complete))


def manifest(
    experiment: str,
    arguments: Mapping[str, Any],
    digests: Mapping[str, str | None],
    *,
    complete: bool,
) -> dict[str, Any]:
    """Return a manifest: what made the files that have these digests."""
    return {
        "experiment": experiment,
        "complete": complete,
        "provenance": provenance(arguments, arguments.get("seed"))
        | {"platform": platform.platform()},
        "sha256": dict(digests),
    }
