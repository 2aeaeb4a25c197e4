"""Measured motion from files: our own CSV files, strictly, and those of other programs."""

from __future__ import annotations

import csv
import math
import re
from array import array
from collections.abc import Iterable, Iterator, Mapping
from itertools import combinations
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.identification.columns import NUMBERED, is_read
from npend_gym.identification.conversion import Reading, understood
from npend_gym.identification.motion import Motion, check_motion, pieces_in_turn
from npend_gym.identification.moving_pivot import with_position
from npend_gym.identification.tables import COMMENT, read_table
from npend_gym.identification.units import is_unit
from npend_gym.physics.arguments import warn_caller

_MAX_CELLS = 50_000_000
_QUOTES = "quotation marks must begin and end a cell within its line"
# what `Trajectory.to_csv` writes of chains that no fit takes
_NOT_HUNG = "position_x", "stretch0"
_POSITIONS = re.compile(r"(x|y|omega)\d{1,9}", re.ASCII)


class FileMotions(NamedTuple):
    """Motions from files, the lengths of links [unit of the file] that positions show, and words.

    `said` says how files of other programs were understood.
    """

    motion: Motion
    lengths: FloatArray | None
    said: list[str]


def read_motion(
    *paths: str | PathLike[str],
    columns: Mapping[str, str] | None = None,
    degrees: bool = False,
    relative: bool = False,
    fps: float | None = None,
) -> Motion:
    """Read measured motion from CSV files, and from exports of programs for measurements.

    The first line names the columns: ``time`` [s], ``theta0``, ``theta1``, ... [rad] from the link
    at the pivot on; if wanted ``tau0``, ... [N m], ``piece``, the number of the recording, and
    ``position`` [m] of a pivot, or a cart, that moved sideways. The order of the columns does not
    matter, and others are not read. Comments after ``#`` or ``%`` are left out.

    Exports of other programs are recognised by their content; see the notes.

    Parameters
    ----------
    *paths : path-like
        One or several files of the same chain; their pieces are numbered consecutively.
    columns : mapping of str to str, optional
        Names of columns in the files, where they differ from these, such as "q1" for "theta0". They
        override the recognised format: columns are then read as they are. Positions of bobs are
        "x0", "y0", ..., rates "omega0", ....
    degrees : bool
        The angles are in degrees.
    relative : bool
        Angles are relative: each link's from the direction of the link above. They become absolute
        angles, and fitted offsets refer to these.
    fps : float, optional
        Frames per second, for a file that has frame numbers, or only rows, in place of times.

    Returns
    -------
    Motion

    Raises
    ------
    ValueError
        If a column is missing, a cell is no number, or the motion breaks a rule of `identify`. If
        two files have the same angles.
    OSError
        If a file cannot be read.

    Notes
    -----
    Files in these other layouts are read without an argument:

    - Tracker: one or several tracks; x and y, or theta from the x axis, in degrees;
    - phyphox, Sensor Logger: CSV or zip of the gyroscope; rates about the axis of the swing;
    - Capstone: a time column for each run; rows of photogates are left out;
    - Logger Pro, Graphical Analysis: ``.cmbl``, ``.gambl``, CSV;
    - RealAIGym, joints of ROS: torques, and angles relative to the link above;
    - ROS 2 bags in the format MCAP, or their folders (extra "ros"): positions of
      ``sensor_msgs/JointState`` by the stamps of their headers, relative to the link above, in the
      order of the first message;
    - a cart: angle, and position of the cart;
    - tables with names after ``%`` or ``#``, below other lines, or above a line of units;
    - tables without names: time and angle, or time, x and y of a bob on an arc;
    - pixels of markers, x and y of each without names, y down; they need `fps`.

    Tabs, commas, semicolons or blanks separate columns; decimals may have commas. Units stand in
    brackets or after an underscore, as in "time_us" and "angle (deg)". Times may be dates, clock
    times, or counted from 1970. Where they begin again, another recording does. Rows with empty
    cells, few rows that are none or come too late, and columns of text are left out.

    Positions become angles: the pivot is the first marker if it rests, or the origin, or the centre
    of the circle of the first bob. Rates are integrated; a steady rate and the mean angle count as
    zero. What may mean two things is an error. `npend identify` prints how it understood a file,
    how many rows it left out, and the lengths that positions show. Columns without names are called
    "1", "2", .... Those of a bag are "elbow", "elbow.velocity" and "elbow.effort" of each joint:
    ``columns={"theta0": "shoulder", "theta1": "elbow"}, relative=True`` chooses two of them.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, simulate
    >>> from npend_gym.identification import read_motion
    >>> simulate(Chain.uniform(2), 0.5, 0.0, np.linspace(0.0, 1.0, 30)).to_csv("motion.csv")
    >>> read_motion("motion.csv").theta[0].tolist()
    [0.5, 0.5]
    """
    return read_recording(
        *paths, columns=columns, degrees=degrees, relative=relative, fps=fps
    ).motion


def read_recording(
    *paths: str | PathLike[str],
    columns: Mapping[str, str] | None = None,
    degrees: bool = False,
    relative: bool = False,
    fps: float | None = None,
) -> FileMotions:
    """Read the same with how files were understood; see `read_motion`."""
    named = _check_columns(columns)
    degrees, relative = _checks.truth("degrees", degrees), _checks.truth("relative", relative)
    fps = None if fps is None else _checks.positive_number("fps", fps)
    files = [_checks.path("each of paths", path) for path in paths]
    recordings = [_read_any(path, named, degrees, relative, fps) for path in files]
    motions = [one.motion for one in recordings]
    if not motions:
        raise ValueError("paths must name a file at least")
    first = motions[0]
    for path, one in zip(paths, motions, strict=True):
        given = [(m.links, m.torque is None, m.acceleration is None) for m in (one, first)]
        if given[0] != given[1]:
            raise ValueError(f"{path} must have the same columns as {paths[0]}")
    for (path, one), (other_path, other) in combinations(zip(paths, motions, strict=True), 2):
        if np.array_equal(one.theta, other.theta):
            raise ValueError(
                f"paths must name each recording once, but {path} and {other_path} have the same "
                "angles"
            )

    def joined(name: str) -> Any:
        parts = [part for one in motions if (part := getattr(one, name)) is not None]
        return np.concatenate(parts) if parts else None

    pieces = pieces_in_turn([one.piece for one in motions])
    of_pivot = joined("position"), joined("acceleration")
    motion = Motion(joined("times"), joined("theta"), joined("torque"), pieces, *of_pivot)
    said = [sentence for one in recordings for sentence in one.said]
    return FileMotions(motion, recordings[0].lengths, said)


def _check_columns(columns: object) -> dict[str, str]:
    """Return our names by those in the files."""
    if columns is not None and not isinstance(columns, Mapping):
        raise TypeError(
            f"columns must map names to names in the files, got {_checks.show(columns)}"
        )
    given = dict(cast("Mapping[Any, Any]", columns or {}))
    for name, column in given.items():
        if not is_read(str(name)) and not _POSITIONS.fullmatch(str(name)):
            raise ValueError(
                "columns must name time, theta0, theta1, ..., tau0, ..., piece or position, or x0, "
                "y0, ... or omega0, ..., got "
                f"{_checks.show(name)}: what stands in the file comes after it"
            )
        if not isinstance(column, str):
            raise TypeError(f"columns[{name!r}] must be a string, got {_checks.show(column)}")
    if len(set(given.values())) < len(given):
        raise ValueError(f"columns must name each column once, got {_checks.show(given)}")
    return {column: name for name, column in given.items()}


def _read_any(
    path: Path, columns: dict[str, str], degrees: bool, relative: bool, fps: float | None
) -> FileMotions:
    """Read a file of our own layout strictly, and another one by what stands in it."""
    try:
        if fps is None and _is_ours(path, columns):
            read = _read_file(path, columns, degrees, relative)
        else:
            given = {ours: name for name, ours in columns.items()}
            how: Any = {"degrees": degrees, "relative": relative, "fps": fps}
            read = understood(read_table(path), given, **how)
        motion = check_motion(read.times, read.theta, read.torque, read.piece)
        motion = with_position(motion, read.position)
    except ValueError as error:
        text = str(error)
        raise ValueError(text if str(path) in text else f"{path}: {text}") from error
    said = [f"{path.name}: {'; '.join(read.said)}"] if read.said else []
    return FileMotions(motion, read.lengths, said)


def _is_ours(path: Path, columns: dict[str, str]) -> bool:
    """Return whether the first line has our names, or those given, and no units stand below."""
    if path.exists() and not path.is_file():  # `read_table` says what it is
        return False
    with path.open("rb") as file:
        lines = [file.readline(100_000).decode("utf-8-sig", "replace") for _ in range(2)]
    given, below = ([one.strip() for one in line.replace('"', "").split(",")] for line in lines)
    has_units = any(below) and all(map(is_unit, below))
    return not has_units and {"time", "theta0"} <= {columns.get(name, name) for name in given}


def _read_file(path: Path, columns: dict[str, str], degrees: bool, relative: bool) -> Reading:
    table = _read_table(path, columns)
    theta, torques = (_numbered(kind, table, path) for kind in ("theta", "tau"))
    if len(torques) > len(theta):
        raise ValueError(f"{path} must have an angle for each torque, got {', '.join(table)}")
    at_rest = [np.zeros_like(table["time"])] * (len(theta) - len(torques))
    torque = np.column_stack([*torques, *at_rest]) if torques else None
    angles = np.column_stack(theta)
    angles = np.radians(angles) if degrees else angles
    angles = np.cumsum(angles, axis=1) if relative else angles
    times, position = table["time"], table.get("position")
    piece = table.get("piece", np.zeros_like(times))
    return Reading(times, angles, torque, piece, None, [], position)


def _numbered(kind: str, table: dict[str, FloatArray], path: Path) -> list[FloatArray]:
    """Return the columns of a kind, which are numbered from 0 on, in their order."""
    names = {name for name in table if (m := NUMBERED.fullmatch(name)) and m[1] == kind}
    expected = [f"{kind}{k}" for k in range(len(names))]
    if names != set(expected):
        raise ValueError(
            f"{path} must number columns from 0 on without a gap, got {', '.join(table)}"
        )
    return [table[name] for name in expected]


def _read_table(path: Path, columns: dict[str, str]) -> dict[str, FloatArray]:
    """Return the columns by our names; those that are not read are empty."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        rows = _rows(file, path)
        try:
            header = [name.strip() for name in next(rows, (1, list[str]()))[1]]
            names = _names(header, columns, path)
            for name in ("time", "theta0"):
                if name not in names:
                    given = (f"{k} as {columns[k]}" if k in columns else k for k in header)
                    raise ValueError(
                        f"{path} must have the column {name}, got "
                        f"{_checks.show(', '.join(given))}: its first line must name time, theta0, "
                        "theta1, ..., and may name tau0, ... and piece; other names are given by "
                        "columns"
                    )
            for name in filter(names.__contains__, _NOT_HUNG):
                warn_caller(
                    f"{path} has the column {name}, which is not read: identify takes the motion "
                    "of rigid chains whose pivot rests, or moves sideways with the column position"
                )
            cells = {k: array("d") for k, name in enumerate(names) if is_read(name)}
            for number, row in rows:
                again = [cell.strip() for cell in row] == header
                if again or not any(row) or row[0].lstrip().startswith(COMMENT):
                    continue
                where = f"{path}, line {number}"
                if len(row) != len(names):
                    raise ValueError(f"{where}: {len(names)} cells are needed, got {len(row)}")
                for k, column in cells.items():  # eight bytes each, where a list takes forty
                    column.append(_number(row[k], names[k], where))
                if number * len(names) > _MAX_CELLS:
                    raise ValueError(f"{path} must have at most {_MAX_CELLS} cells")
        except UnicodeDecodeError as error:
            raise ValueError(f"{path} must be a CSV file in UTF-8: {error}") from error
    return {name: np.array(cells.get(k, ())) for k, name in enumerate(names)}


def _rows(file: Iterable[str], path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield the numbers of the lines, from 1 on, and their cells."""
    number, lines = 0, csv.reader(file, strict=True)
    try:
        for number, row in enumerate(lines, 1):
            if lines.line_num > number:
                raise ValueError(f"{path}, line {number}: {_QUOTES}")
            yield number, row
    except csv.Error as error:
        raise ValueError(f"{path}, line {number + 1}: {_QUOTES} ({error})") from error


def _names(given: list[str], columns: dict[str, str], path: Path) -> list[str]:
    """Return names of columns as ours; a column whose name is taken by another is not read."""
    if len(set(filled := [*filter(None, given)])) < len(filled):
        raise ValueError(f"{path} must name each column once, got {', '.join(given)}")
    missing, taken = columns.keys() - set(given), set(columns.values())
    if missing:
        raise ValueError(
            f"{path} has no column {_checks.show(min(missing))}: it has "
            f"{_checks.show(', '.join(given))}"
        )
    return [columns.get(name, f"({name})" if name in taken else name) for name in given]


def _number(cell: str, name: str, where: str) -> float:
    try:
        value = math.nan if "_" in cell else float(cell)  # Python reads 1_0 as 10
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(
            f"{where}: {name} must be a number, got {_checks.show(cell)}; "
            "leave out rows without a value, gaps are allowed"
        )
    return value
