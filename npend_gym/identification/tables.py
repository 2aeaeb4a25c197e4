"""Tables of numbers in the files of other programs, recognised by what stands in them.

`FORMATS` has one function for each format; it returns the table, or None where a file is another
one. A new format is a new function in that list.
"""

from __future__ import annotations

import io
import re
import tarfile
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray

MAX_BYTES = 500_000_000
_SEPARATORS = "\t", ";", ",", None  # None stands for any blanks
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?", re.ASCII)
_EMPTY = "", "nan", "-", "z1 1:"  # cells without a value, in lower case
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


def read_table(path: Path) -> Table:
    """Return the table in a file.

    Raises
    ------
    ValueError
        If it has no table that is known.
    OSError
        If it cannot be read.
    """
    if path.exists() and not path.is_file():  # a FIFO would wait for ever
        raise ValueError(f"{path} is no file")
    if path.stat().st_size > MAX_BYTES:
        raise ValueError(f"{path} must have at most {MAX_BYTES} bytes")
    data = path.read_bytes()
    if data.startswith(b"\x89MCAP0\r\n"):
        from npend_gym.identification.bags import read_bag  # it makes tables of this module

        return read_bag(data)
    text = _text_of(data, path)
    if not text.strip():
        raise ValueError(f"{path} must have the column time, but it is empty")
    for read in FORMATS:
        if (table := read(text)) is not None:
            return table
    raise ValueError(
        f"{path} must be a table: lines with equally many numbers, below a line with their names; "
        f"it begins with {_checks.show(text.splitlines()[0][:80])}"
    )


def _text_of(data: bytes, path: Path) -> str:
    """Return the text of a file, or of the one in an archive that has the data."""
    if data.startswith(b"\xd0\xcf\x11\xe0"):
        raise ValueError(f"{path} is an old Excel file (.xls): save or export it as CSV")
    if data.startswith(b"SQLite format 3"):
        raise ValueError(f"{path} is SQLite: ros2 bag convert makes MCAP of a ROS bag")
    try:
        if data.startswith(b"PK"):
            with zipfile.ZipFile(io.BytesIO(data)) as archive:
                names = archive.namelist()
                if "xl/workbook.xml" in names:
                    raise ValueError(f"{path} is an Excel file (.xlsx): save or export it as CSV")
                found = [n for n in names if n.endswith(".csv") and not n.startswith("meta/")]
                if not found:
                    raise ValueError(f"{path} must have a CSV file, got {', '.join(names[:9])}")
                if archive.getinfo(found[0]).file_size > MAX_BYTES:
                    raise ValueError(f"{path} must have at most {MAX_BYTES} bytes")
                data = archive.read(found[0])
        elif data[257:262] == b"ustar":
            with tarfile.open(fileobj=io.BytesIO(data)) as archive:
                documents = (archive.extractfile(one) for one in archive if one.isfile())
                parts = [one.read() for one in documents if one is not None]
                data = next((part for part in parts if b"<Document" in part), b"")
    except (zipfile.BadZipFile, tarfile.TarError, RuntimeError, NotImplementedError) as error:
        raise ValueError(f"{path} is an archive that cannot be read: {error}") from error
    encoding = "utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    try:
        return data.decode(encoding)
    except UnicodeDecodeError as error:
        raise ValueError(
            f"{path} must be a CSV file in UTF-8, or an export of a program for measurements; "
            f"save it as CSV in UTF-8: {error}"
        ) from error


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
    rows = _numbers(lines[several + 2 :], separator, len(names))
    if rows is None:
        return None
    columns = [
        Column(name, rows[:, k], track=max(0, sum(t <= k for t in tracks) - 1) if several else 0)
        for k, name in enumerate(names)
    ]
    return Table("Tracker", columns)


def _separated(text: str) -> Table | None:
    """Rows of cells below a line with their names, or without one; comments before them."""
    lines = [line for line in text.splitlines() if line.strip()]
    if lines and re.fullmatch(r"sep=.", lines[0].strip()):
        del lines[0]
    comments = [*takewhile(lambda line: line.lstrip()[:1] in ("%", "#"), lines)]
    body = lines[len(comments) :]
    for separator in _SEPARATORS:
        head = [cell.strip().strip('"') for cell in _cells(body[0], separator)] if body else []
        if len(head) < 2:
            continue
        named = any(_number(cell) is None for cell in head)
        rows = _numbers(body[named:], separator, len(head))
        if rows is None or not len(rows):
            continue
        if named:
            return _of_runs("a table", head, rows)
        if comments and (head := comments[-1].lstrip("%# \t").split()):
            lead = rows.shape[1] - len(head)
            if len(head) == 4 and rows.shape[1] == 10:  # trial and time stand before angles
                head, lead = ["trial", "time", *head, *(f"({k})" for k in range(4))], 0
            if lead == 0:
                return _of_runs("a table of blanks", head, rows)
        names = [str(k + 1) for k in range(rows.shape[1])]
        columns = [Column(name, cells) for name, cells in zip(names, rows.T, strict=True)]
        return Table("a table without names", columns, named=False)
    return None


FORMATS: list[Callable[[str], Table | None]] = [_logger_pro, _tracker, _separated]


def _of_runs(source: str, names: Sequence[str], rows: FloatArray) -> Table:
    """Return a table whose columns may be of several runs: Capstone, Graphical Analysis."""
    columns, sets = list[Column](), dict[str, int]()
    for name, values in zip(names, rows.T, strict=True):
        found = RUN.match(name)
        label = (found["run"] or found["set"] or "") if found else ""
        source = "Capstone" if found and found["run"] else source
        source = "Logger Pro or Graphical Analysis" if found and found["set"] else source
        sets.setdefault(label, len(sets))
        columns.append(Column(name, values, sets[label]))
    if any(name.lower().startswith("gyroscope") for name in names):
        source = "phyphox"
    return Table(source, columns)


def _cells(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return line.split()
    if '"' in line:  # separators may stand within quotation marks
        return [cell.strip('"') for cell in re.findall(rf'"[^"]*"|[^{separator}]+|(?<={separator})'
                                                       rf"(?={separator}|$)", line)]  # fmt: skip
    return line.split(separator)


def _numbers(lines: Sequence[str], separator: str | None, width: int) -> FloatArray | None:
    """Return the numbers of lines, NaN where a cell is empty; None where one is no number."""
    out = list[list[float]]()
    for line in lines:
        cells = _cells(line, separator)
        if len(cells) > width and not "".join(cells[width:]).strip():
            cells = cells[:width]  # the separator stands at the end, too
        cells += [""] * (width - len(cells)) if separator == "\t" else []
        values = [_number(cell, decimal_comma=separator != ",") for cell in cells]
        if len(values) != width or None in values:
            return None
        out.append([np.nan if value is None else value for value in values])
    return np.array(out, np.float64).reshape(len(out), width)


def _number(cell: str, *, decimal_comma: bool = True) -> float | None:
    """Return the number in a cell, NaN where it is empty, None where it is something else."""
    cell = cell.strip()
    if cell.lower() in _EMPTY:
        return np.nan
    if not _NUMBER.fullmatch(cell) or ("," in cell and not decimal_comma):
        return None
    return float(cell.replace(",", "."))
