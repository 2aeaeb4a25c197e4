"""Tables of numbers in the files of other programs, recognised by what stands in them.

`FORMATS` has one function for each format; it returns the table, or None where a file is another
one. A new format is a new function in that list.
"""

from __future__ import annotations

import csv
import re
import statistics
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast
from xml.etree import ElementTree as ET

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.identification.texts import MAX_BYTES, text_of
from npend_gym.identification.units import is_unit

_SEPARATORS = "\t", ";", ",", None  # None stands for any blanks
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?", re.ASCII)
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+", re.ASCII)
# cells without a value, in lower case
_EMPTY = "", "nan", "-", "z1 1:", "null", "none", "na", "n/a", "#n/a"
COMMENT = "%", "#"  # before names, and before what a program says of itself
_PREAMBLE = 200  # lines above the names, at most
_NUMBERS = 0.95  # of the cells of a column that has numbers, at least
_FEW = 0.01  # of the rows: so many lines may be none
RUN = re.compile(r"^(?:(?P<set>Latest|Run \d+|Data Set \d+):\s*)?(?P<name>.*?)"
                   r"(?:\s+Run #(?P<run>\d+))?$")  # fmt: skip


@dataclass(frozen=True, eq=False)
class Column:
    """A column of a table: its name as it stands in the file, and its numbers, NaN where empty."""

    name: str
    values: FloatArray
    run: int = 0  # which recording it is of, where a file has several side by side
    track: int = 0  # which marked point it is of
    role: str = ""  # what it is, such as "tau0", where not its name says so


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of equal length, and of which program they seem to be.

    `named` is false where the file has no names: columns are called "1", "2", ... then.
    """

    source: str
    columns: list[Column]
    named: bool = True
    lost: int = 0  # lines among the rows that are none
    text: tuple[str, ...] = ()  # names of columns that have no numbers

    @property
    def names(self) -> str:
        """The names of its columns, for messages."""
        texts = [f"{name} (text)" for name in self.text]
        return ", ".join([*(column.name for column in self.columns), *texts])


def read_table(path: Path) -> Table:
    """Return the table in a file, or in the files of a bag's folder.

    Raises
    ------
    ValueError
        If it has no table that is known.
    OSError
        If it cannot be read.
    """
    files = [path]
    if path.is_dir():  # long bags are split
        bags = [*path.glob("*.mcap")] or [*path.glob("*.db3")]
        files = sorted(bags, key=lambda bag: (len(bag.name), bag.name))
    if not files or any(one.exists() and not one.is_file() for one in files):  # a FIFO waits
        raise ValueError(f"{path} is no file, and no folder of a ROS bag in the format MCAP")
    if sum(one.stat().st_size for one in files) > MAX_BYTES:
        raise ValueError(f"{path} must have at most {MAX_BYTES} bytes")
    data, *others = (one.read_bytes() for one in files)
    if data.startswith(b"\x89MCAP0\r\n"):
        from npend_gym.identification.bags import read_bag  # it makes tables of this module

        return read_bag(data, *others)
    text, name = text_of(data, path)
    if not text.strip():
        raise ValueError(f"{path} must have the column time, but it is empty")
    for read in FORMATS:
        if (table := read(text)) is not None:
            rates = "gyro" in name.lower()  # of apps that call the axes of every sensor x, y and z
            columns = [replace(c, name=f"gyroscope {c.name}") if rates and c.name in ("x", "y", "z")
                       else c for c in table.columns]  # fmt: skip
            return replace(table, columns=columns)
    raise ValueError(
        f"{path} must be a table: lines with equally many numbers, below a line with their names; "
        f"it begins with {_checks.show(text.splitlines()[0][:80])}"
    )


def _logger_pro(text: str) -> Table | None:
    """Logger Pro (.cmbl) and Graphical Analysis (.gambl): XML, a number in each line of a cell."""
    if "<Document" not in text[:2000]:
        return None
    if "<!ENTITY" in text or "<!DOCTYPE" in text:
        raise ValueError("an XML file must have no entities of its own: export it as CSV")
    try:
        root = ET.fromstring(text)  # noqa: S314 - it has no entities
    except ET.ParseError as error:
        raise ValueError(f"the XML of the file is damaged: {error}") from error
    columns = list[Column]()
    sets = [one for one in root.iter() if one.find("DataColumn") is not None]
    for run, one in enumerate(sets):
        for column in one.iter("DataColumn"):
            cells = column.findtext("ColumnCells") or ""
            values = [_number(cell) for cell in cells.split("\n") if cell.strip()]
            unit = column.findtext("ColumnUnits") or ""
            name = (column.findtext("DataObjectName") or "").strip()
            if values and None not in values:
                name += f" ({unit.strip()})" * bool(unit.strip())
                columns.append(Column(name, np.array(values, np.float64), run))
    rows = max((c.values.size for c in columns), default=0)
    padded = [
        Column(c.name, np.r_[c.values, np.full(rows - c.values.size, np.nan)], c.run)
        for c in columns
    ]
    return Table("Logger Pro or Graphical Analysis", padded) if rows else None


def _tracker(text: str) -> Table | None:
    """Tracker: names of tracks in a line that begins with an empty cell, then names of columns."""
    lines = text.splitlines()
    several = lines[0].strip(" \t;,") == "#multi:"
    heads = lines[several : several + 2]
    separator = next((s for s in _SEPARATORS[:3] if heads and heads[0].startswith(s or "")), None)
    if len(heads) < 2 or separator is None:
        return None
    names = [name.strip() for name in heads[1].rstrip(separator).split(separator)]
    if names[0] != "t":
        return None
    tracks = [k for k, cell in enumerate(heads[0].split(separator)) if cell.strip()]
    every = range(len(names))
    cells = (_fitted(_cells(x, separator), len(names), separator) for x in lines[several + 2 :])
    values = [_values(one, every, separator != ",") for one in cells]
    if None in values or not values:
        return None
    rows = np.array(values, np.float64)
    columns = [
        Column(name, rows[:, k], track=max(0, sum(t <= k for t in tracks) - 1) if several else 0)
        for k, name in enumerate(names)
    ]
    return Table("Tracker", columns)


def _separated(text: str) -> Table | None:
    """Rows of cells below a line with their names, or without one; other lines before them."""
    lines = [line for line in text.splitlines() if line.strip()]
    return next((t for s in _SEPARATORS if (t := _split(lines, s)) is not None), None)


def _split(lines: Sequence[str], separator: str | None) -> Table | None:
    """Return the table in lines with this separator, None where they have another one.

    Columns of text are left out. So are the few lines among the rows that are none: a head that
    stands twice, or a last line that was cut.
    """
    some = lines[len(lines) // 2 :: max(1, len(lines) // 60)]
    sample = [_cells(line, separator) for line in some]
    width = statistics.mode(map(len, sample))
    typical = [list(cells) for cells in zip(*(c for c in sample if len(c) == width), strict=True)]
    while typical and not any(cell.strip() for cell in typical[-1]):
        typical.pop()  # the separator stands at the end, too
    width, commas = len(typical), [cell for cells in typical for cell in cells if "," in cell]
    points = separator == "," or any("." in cell for cells in typical for cell in cells)
    comma = not (points and all(map(_THOUSANDS.fullmatch, commas)))  # it is before decimals
    numbers = [k for k, cells in enumerate(typical) if _share(cells, comma) >= _NUMBERS]
    if width < 2 or not numbers:
        return None
    rows = [_fitted(_cells(line, separator), width, separator) for line in lines]
    values = [_values(cells, numbers, comma) for cells in rows]
    first = next((k for k, one in enumerate(values) if one is not None), len(rows))
    used = [k for k in range(first, len(rows)) if values[k] is not None]
    names, heads = _names(lines[:first], width, separator)
    lost = sum(one is None and line not in heads for line, one in zip(lines, values, strict=True))
    lost -= lines.index(heads[0]) if heads else first
    if lost > max(2.0, _FEW * len(used)) or (not heads and len(numbers) < width):
        return None
    columns = dict(zip(numbers, np.array([values[k] for k in used], np.float64).T, strict=True))
    for k in set(range(width)) - set(numbers):
        instants = _instants([rows[row][k] if k < len(rows[row]) else "" for row in used])
        columns |= {} if instants is None else {k: instants}
    if not heads:
        unnamed = [Column(str(k + 1), column) for k, column in columns.items()]
        return Table("a table without names", unnamed, named=False, lost=lost)
    source = "a table of blanks" if heads[-1].lstrip()[:1] in COMMENT else "a table"
    order = sorted(columns)
    text = tuple(name for k, name in enumerate(names) if k not in columns)
    found = _of_runs(source, [names[k] for k in order], [columns[k] for k in order])
    return replace(found, lost=lost, text=text)


def _names(lines: Sequence[str], width: int, separator: str | None) -> tuple[list[str], list[str]]:
    """Return names of columns, and which of the lines above them have them, and perhaps units."""
    heads, found = list[str](), list[list[str]]()
    for line in reversed(lines[-_PREAMBLE:]):
        comment = line.lstrip()[:1] in COMMENT
        for s in (separator, *_SEPARATORS) if comment else (separator,):
            cells = _cells(line.lstrip("%# \t") if comment else line, s)
            cells = [cell.strip().strip('"') for cell in cells]
            while len(cells) > width and cells[-1] in ("", "Comment"):  # LabVIEW's last name
                cells.pop()
            if len(cells) == 4 and width == 10:  # trial and time stand before angles
                cells = ["trial", "time", *cells, *(f"({k})" for k in range(4))]
            if len(cells) == width and not any(_NUMBER.fullmatch(cell) for cell in cells):
                heads, found = [line, *heads], [cells, *found]
                break
        if len(found) == 1 and not all(map(is_unit, found[0])):
            return found[0], heads
        if len(found) == 2:
            names = [f"{name} ({unit.strip('()[] ')})" for name, unit in zip(*found, strict=True)]
            return names, heads
        if comment and not found:  # what a program says of itself stands above names
            break
    return (found[0], heads) if found else ([], [])


FORMATS: list[Callable[[str], Table | None]] = [_logger_pro, _tracker, _separated]


def _of_runs(source: str, names: Sequence[str], values: Sequence[FloatArray]) -> Table:
    """Return a table whose columns may be of several runs: Capstone, Graphical Analysis."""
    columns, sets = list[Column](), dict[str, int]()
    for name, column in zip(names, values, strict=True):
        found = RUN.match(name)
        label = (found["run"] or found["set"] or "") if found else ""
        source = "Capstone" if found and found["run"] else source
        source = "Logger Pro or Graphical Analysis" if found and found["set"] else source
        sets.setdefault(label, len(sets))
        columns.append(Column(name, column, sets[label]))
    if any(name.lower().startswith("gyroscope") for name in names):
        source = "phyphox"
    return Table(source, columns)


def _cells(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    if '"' in line:  # separators may stand within quotation marks
        with suppress(csv.Error):  # of a cell that is too long
            return next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    return line.split(separator)


def _fitted(cells: list[str], width: int, separator: str | None) -> list[str]:
    """Return cells without empty ones at the end; in a table of tabs with those that lack there."""
    if len(cells) > width and not "".join(cells[width:]).strip():
        return cells[:width]
    return cells + [""] * (width - len(cells)) if separator == "\t" else cells


def _values(cells: list[str], numbers: Sequence[int], comma: bool) -> list[float] | None:
    """Return the numbers of a row, NaN where a cell is empty; None where one is no number."""
    if len(cells) <= numbers[-1]:
        return None
    out = [_number(cells[k], decimal_comma=comma) for k in numbers]
    return None if None in out else cast("list[float]", out)


def _share(cells: Sequence[str], comma: bool) -> float:
    """Return which part of cells are numbers, or empty."""
    return sum(_number(cell, decimal_comma=comma) is not None for cell in cells) / len(cells)


def _instants(cells: Sequence[str]) -> FloatArray | None:
    """Return the seconds from the first date or clock time on; None where cells are no times."""
    plain = [re.sub(r"(Z|[+-]\d\d:?\d\d)$", "", cell.strip().strip('"')) for cell in cells]
    plain = [f"1970-01-01T{cell}" if re.match(r"\d\d:", cell) else cell for cell in plain]
    try:
        instants = np.array(plain, "datetime64[ns]")
    except ValueError:
        return None
    known = instants[~np.isnat(instants)]
    return (instants - known[0]) / np.timedelta64(1, "s") if known.size else None


def _number(cell: str, *, decimal_comma: bool = True) -> float | None:
    """Return the number in a cell, NaN where it is empty, None where it is something else."""
    cell = cell.strip()
    if cell.lower() in _EMPTY:
        return np.nan
    if not _NUMBER.fullmatch(cell) or ("," in cell and not decimal_comma):
        return None
    return float(cell.replace(",", "."))
