"""The record of a campaign's tasks: a line of JSON for each, the last one of a task counts."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import TracebackType
from typing import IO, TYPE_CHECKING, Any

from npend_gym import _checks, _files

if TYPE_CHECKING:
    from typing_extensions import Self

_MAX_LINE = 100_000  # characters; a longer line is none that `Record.line` writes


@dataclass(frozen=True)
class Record:
    """What became of a task.

    Attributes
    ----------
    plan : str
        Digest of the plan.
    task : str
        Id of the task.
    parts : mapping
        Table -> SHA-256 of the task's part of it; empty where the task failed.
    error : str
        What went wrong, empty where nothing did.
    cpu_s : float
        CPU time that the task took [s].
    """

    plan: str
    task: str
    parts: Mapping[str, str] = field(default_factory=dict[str, str])
    error: str = ""
    cpu_s: float = 0.0

    @property
    def done(self) -> bool:
        """Whether the task was measured."""
        return not self.error

    def line(self) -> str:
        """Return the record as a line of the journal."""
        return json.dumps(asdict(self), sort_keys=True) + "\n"


def read_journal(path: Path, plan: str) -> tuple[dict[str, Record], int]:
    """Return the records of the plan with the digest `plan` by task, and how many lines are bad."""
    records: dict[str, Record] = {}
    bad = 0
    if not path.is_file():
        return records, bad
    with path.open(encoding="utf-8", errors="replace") as file:
        while line := file.readline(_MAX_LINE):
            record = _record(line)
            if record is None or record.plan != plan:
                bad += 1
            else:
                records[record.task] = record
    return records, bad


def _record(line: str) -> Record | None:
    """Return the record in a line; None where the line is torn or damaged."""
    try:
        record = Record(**_files.parse_json(line))
        parts: Any = record.parts
        texts = [record.plan, record.task, record.error, *parts, *parts.values()]
        whole = all(isinstance(text, str) for text in texts)  # pyright: ignore[reportUnnecessaryIsInstance]
        _checks.nonnegative_number("cpu_s", record.cpu_s)
        return record if whole and bool(parts) != bool(record.error) else None
    except (ValueError, TypeError, AttributeError):
        return None


class Journal:
    """The journal at `path`, rewritten with `records` and open for more."""

    def __init__(self, path: Path, records: Iterable[Record]) -> None:
        with _files.replacing(path) as file:  # a torn last line would spoil the next
            file.writelines(record.line() for record in records)
        _files.sync_names(path.parent)  # otherwise a power cut may bring the old journal back
        self._file: IO[str] = _files.appending(path)

    def append(self, record: Record) -> None:
        """Add a record; it is on the disk when this returns."""
        self._file.write(record.line())
        _files.sync(self._file)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self._file.close()
