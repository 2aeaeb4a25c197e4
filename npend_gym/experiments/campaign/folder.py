"""What lies in a campaign's folder: its plan, what is done, and what must be done again."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from npend_gym import _checks, _files
from npend_gym._provenance import provenance
from npend_gym._version import __version__
from npend_gym.experiments.campaign.journal import Record, read_journal
from npend_gym.experiments.campaign.parts import TABLES, sha256
from npend_gym.experiments.campaign.plan import Plan, Task

PLAN, JOURNAL, CELLS, LOCK = "plan.json", "journal.jsonl", "cells.parquet", ".lock"


@dataclass(frozen=True)
class Found:
    """What a folder holds of a campaign.

    Attributes
    ----------
    records : dict
        Task id -> record of the tasks whose parts are there and right.
    failed : dict
        Task id -> record of the tasks that failed.
    damaged, missing : int
        Parts that differ from their checksum, or are gone.
    unrecorded : int
        Parts that were written, but not recorded, before the end came.
    leftovers : int
        Files that were being written then.
    bad_lines : int
        Lines of the journal that are torn, damaged, or another plan's.
    """

    records: dict[str, Record]
    failed: dict[str, Record]
    damaged: int
    missing: int
    unrecorded: int
    leftovers: int
    bad_lines: int

    def text(self) -> str:
        """Return what is odd, and what follows, as a line; empty where nothing is."""
        counts = {
            "part(s) damaged": self.damaged,
            "part(s) missing": self.missing,
            "part(s) not recorded": self.unrecorded,
            "half-written file(s)": self.leftovers,
            "line(s) of the journal unreadable": self.bad_lines,
            "failed task(s)": len(self.failed),
        }
        odd = ", ".join(f"{count} {name}" for name, count in counts.items() if count)
        return f"found {odd}; what they stand for is measured anew" if odd else ""


def folder_of(out: Path | str) -> Path:
    """Return the absolute path of a campaign's folder.

    Raises
    ------
    ValueError
        If the path cannot be followed.
    """
    try:
        return Path(out).resolve()
    except (OSError, RuntimeError, ValueError) as error:  # a loop of links, a null character
        raise ValueError(f"out must be a path of a folder, got {_checks.show(str(out))}") from error


def write_plan(plan: Plan, out: Path) -> None:
    """Write the plan to its folder."""
    state = {"version": __version__, "digest": plan.digest, "plan": plan.as_dict()}
    record = {"provenance": provenance(plan.as_dict(), plan.seed)}
    with _files.replacing(out / PLAN) as file:
        json.dump(state | record, file, indent=2)
        file.write("\n")


def read_plan(out: Path) -> Plan | None:
    """Return the plan of the campaign in `out`; None where there is none.

    Raises
    ------
    ValueError
        If the plan is damaged or of another version of the package.
    """
    path = out / PLAN
    try:
        text = path.read_text(encoding="utf-8")
    except (FileNotFoundError, NotADirectoryError):
        return None  # the driver says what is wrong with the folder
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} cannot be read: {error}") from error
    try:
        given: Any = json.loads(text)
        version, digest, values = given["version"], given["digest"], given["plan"]
        plan = Plan.of(values) if version == __version__ else None
        if plan is not None and plan.digest != digest:
            raise ValueError("its digest is another")
    except (ValueError, TypeError, KeyError) as error:
        raise ValueError(
            f"{path} is damaged ({error}): remove it and give the plan again; what was measured "
            f"by the same plan is kept"
        ) from error
    if plan is None:
        raise ValueError(
            f"{path} was made by npend_gym {version}, this is {__version__}, which may measure "
            f"other bits: go on with that version, or choose another folder"
        )
    return plan


def inspect(plan: Plan, out: Path, *, clean: bool = False) -> Found:
    """Return what `out` holds of the campaign `plan`, every part read and checked.

    With `clean`, files that were being written when the end came are removed: only the one driver
    may do that.
    """
    records, bad_lines = read_journal(out / JOURNAL, plan.digest)
    right: dict[str, Record] = {}
    failed: dict[str, Record] = {}
    damaged = missing = unrecorded = 0
    for task in plan.tasks():
        record = records.get(task.id)
        if record is not None and not record.done:
            failed[task.id] = record
            continue
        found = {table: sha256(out / table / task.part) for table in TABLES}
        if record is None:
            unrecorded += sum(digest is not None for digest in found.values())
            continue
        damaged += sum(d not in (None, record.parts.get(table)) for table, d in found.items())
        missing += sum(digest is None for digest in found.values())
        if found == record.parts:
            right[task.id] = record
    leftovers = list(_leftovers(out))
    for path in leftovers if clean else ():
        path.unlink(missing_ok=True)
    return Found(right, failed, damaged, missing, unrecorded, len(leftovers), bad_lines)


def _leftovers(out: Path) -> Iterator[Path]:
    yield from out.glob(".*.part")
    for table in TABLES:
        yield from (out / table).glob("*/.*.part")


def open_tasks(plan: Plan, found: Found) -> Iterator[Task]:
    """Yield the tasks that are not done."""
    return (task for task in plan.tasks() if task.id not in found.records)
