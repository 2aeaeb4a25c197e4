"""Measured motion from CSV files."""

from __future__ import annotations

import csv
import math
import re
from array import array
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.identification.motion import Motion, check_motion

_MAX_CELLS = 50_000_000
_ANGLE, _TORQUE = re.compile(r"theta(\d{1,9})", re.ASCII), re.compile(r"tau(\d{1,9})", re.ASCII)


def read_motion(
    *paths: str | PathLike[str],
    columns: Mapping[str, str] | None = None,
    degrees: bool = False,
    relative: bool = False,
) -> Motion:
    """Read measured motion from CSV files.

    The first line names the columns: ``time`` [s], ``theta0``, ``theta1``, ... [rad] from the link
    at the pivot on; if wanted ``tau0``, ... [N m] and ``piece``, the number of the recording. The
    order of the columns does not matter, and others are not read.

    Parameters
    ----------
    *paths : path-like
        One or several files of the same chain; their pieces are numbered on.
    columns : mapping of str to str, optional
        What columns are called in the files, where it is not as above: ``{"time": "t [s]",
        "theta0": "q1"}``.
    degrees : bool
        The angles are in degrees.
    relative : bool
        The angles are those of the joints: of each link relative to the one above.

    Returns
    -------
    Motion

    Raises
    ------
    ValueError
        If a column is missing, a cell is no number, or the motion breaks a rule of `identify`.
    OSError
        If a file cannot be read.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, simulate
    >>> from npend_gym.identification import read_motion
    >>> simulate(Chain.uniform(2), 0.5, 0.0, np.linspace(0.0, 1.0, 30)).to_csv("motion.csv")
    >>> read_motion("motion.csv").theta[0].tolist()
    [0.5, 0.5]
    """
    named = _check_columns(columns)
    motions = [_read_file(Path(path), named, degrees, relative) for path in paths]
    if not motions:
        raise ValueError("paths must name a file at least")
    first = motions[0]
    for path, one in zip(paths, motions, strict=True):
        if one.links != first.links or (one.torque is None) != (first.torque is None):
            raise ValueError(f"{path} must have the same columns as {paths[0]}")
    piece, count = list[NDArray[np.int64]](), 0
    for one in motions:
        numbers = np.unique(one.piece, return_inverse=True)[1]
        piece.append(numbers + count)
        count += int(numbers.max()) + 1
    torque = [one.torque for one in motions if one.torque is not None]
    return Motion(
        np.concatenate([one.times for one in motions]),
        np.concatenate([one.theta for one in motions]),
        np.concatenate(torque) if torque else None,
        motions[0].piece if len(motions) == 1 else np.concatenate(piece),
    )


def _check_columns(columns: object) -> dict[str, str]:
    """Return our names by those in the files."""
    if columns is not None and not isinstance(columns, Mapping):
        raise TypeError(
            f"columns must map names to names in the files, got {_checks.show(columns)}"
        )
    given = dict(cast("Mapping[Any, Any]", columns or {}))
    for name, column in given.items():
        if not _is_read(str(name)):
            raise ValueError(
                "columns must name time, theta0, theta1, ..., tau0, ... or piece, got "
                f"{_checks.show(name)}: what stands in the file comes after it"
            )
        if not isinstance(column, str):
            raise TypeError(f"columns[{name!r}] must be a string, got {_checks.show(column)}")
    if len(set(given.values())) < len(given):
        raise ValueError(f"columns must name each column once, got {_checks.show(given)}")
    return {column: name for name, column in given.items()}


def _is_read(name: str) -> bool:
    return name in ("time", "piece") or bool(_ANGLE.fullmatch(name) or _TORQUE.fullmatch(name))


def _read_file(path: Path, columns: dict[str, str], degrees: bool, relative: bool) -> Motion:
    names, cells = _read_cells(path, columns)
    for name in ("time", "theta0"):
        if name not in names:
            raise ValueError(
                f"{path} must have the column {name}, got {_checks.show(', '.join(names))}: the "
                "columns are time, theta0, theta1, ..., and may be tau0, ... and piece; other "
                "names are given by columns"
            )
    theta = cells[:, _numbered(_ANGLE, names, path)]
    torques = _numbered(_TORQUE, names, path)
    if len(torques) > theta.shape[1]:
        raise ValueError(f"{path} must have an angle for each torque, got {', '.join(names)}")
    torque = None
    if torques:
        torque = np.zeros_like(theta)
        torque[:, : len(torques)] = cells[:, torques]
    theta = np.radians(theta) if degrees else theta
    theta = np.cumsum(theta, axis=1) if relative else theta
    piece = cells[:, names.index("piece")] if "piece" in names else None
    try:
        return check_motion(cells[:, names.index("time")], theta, torque, piece)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _numbered(pattern: re.Pattern[str], names: list[str], path: object) -> list[int]:
    """Return the places of the columns that are numbered from 0 on, in their order."""
    found = {int(m[1]): k for k, name in enumerate(names) if (m := pattern.fullmatch(name))}
    if sorted(found) != list(range(len(found))):
        raise ValueError(
            f"{path} must number columns from 0 on without a gap, got {', '.join(names)}"
        )
    return [found[k] for k in range(len(found))]


def _renamed(names: list[str], columns: dict[str, str], path: Path) -> list[str]:
    """Return names as ours; a column whose name is taken by another is not read."""
    missing = columns.keys() - set(names)
    if missing:
        raise ValueError(
            f"{path} has no column {_checks.show(min(missing))}: it has "
            f"{_checks.show(', '.join(names))}"
        )
    taken = set(columns.values())
    return [columns.get(name, "" if name in taken else name) for name in names]


def _read_cells(path: Path, columns: dict[str, str]) -> tuple[list[str], FloatArray]:
    """Return the names of the columns and the numbers below them, those that are read."""
    if path.exists() and not path.is_file():  # a FIFO would wait for ever
        raise ValueError(f"{path} is no file")
    with path.open(encoding="utf-8-sig", newline="") as file:
        lines = csv.reader(file)
        try:
            names = [name.strip() for name in next(lines, list[str]())]
            if len(set(names)) < len(names):
                raise ValueError(f"{path} must name each column once, got {', '.join(names)}")
            names = _renamed(names, columns, path)
            wanted = [_is_read(name) for name in names]
            cells = array("d")  # eight bytes each, where a list takes forty
            for line in lines:
                if any(line):
                    cells.extend(_numbers(path, lines.line_num, names, wanted, line))
                    if len(cells) > _MAX_CELLS:
                        raise ValueError(f"{path} must have at most {_MAX_CELLS} cells")
        except (UnicodeDecodeError, csv.Error) as error:
            raise ValueError(f"{path} must be a CSV file in UTF-8: {error}") from error
    return names, np.array(cells).reshape(-1, max(1, len(names)))


def _numbers(
    path: Path, number: int, names: list[str], wanted: list[bool], line: list[str]
) -> list[float]:
    if len(line) != len(names):
        raise ValueError(f"{path}, line {number}: {len(names)} cells are needed, got {len(line)}")
    out = [0.0] * len(line)
    for k, (cell, name) in enumerate(zip(line, names, strict=True)):
        if wanted[k]:
            try:
                out[k] = float(cell)
            except ValueError:
                out[k] = math.nan
            if not math.isfinite(out[k]):
                raise ValueError(
                    f"{path}, line {number}: {name} must be a number, got {_checks.show(cell)}; "
                    "leave out rows without a value, gaps are allowed"
                )
    return out
