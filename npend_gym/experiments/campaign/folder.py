"""The folder of a campaign: its plan, which tasks are done, and which must be run again."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from npend_gym import _checks, _files
from npend_gym._provenance import provenance
from npend_gym._version import __version__
from npend_gym.experiments.campaign.journal import Record, read_journal
from npend_gym.experiments.campaign.lease import half_written, remove_ended
from npend_gym.experiments.campaign.parts import TABLES
from npend_gym.experiments.campaign.plan import CampaignPlan, Task

PLAN, JOURNAL, CELLS, LOCK = "plan.json", "journal.jsonl", "cells.parquet", ".lock"


@dataclass(frozen=True)
class FolderStatus:
    """Which tasks of a campaign are done in a folder, and what is wrong with the folder.

    Attributes
    ----------
    records : dict
        Task id -> record of the tasks that are done: their parts have the recorded checksums.
    failed : dict
        Task id -> record of the tasks that failed.
    damaged, missing : int
        Parts whose checksum differs, and parts that are recorded but absent.
    unrecorded : int
        Parts that were written but not recorded before the driver ended.
    leftovers : int
        Files that were being written when the driver ended.
    bad_lines : int
        Lines of the journal that are incomplete, damaged, or of another plan.
    """

    records: dict[str, Record]
    failed: dict[str, Record]
    damaged: int
    missing: int
    unrecorded: int
    leftovers: int
    bad_lines: int

    def text(self) -> str:
        """Return a line about what is wrong with the folder; empty where nothing is."""
        counts = {
            "part(s) damaged": self.damaged,
            "part(s) missing": self.missing,
            "part(s) not recorded": self.unrecorded,
            "half-written file(s)": self.leftovers,
            "line(s) of the journal unreadable": self.bad_lines,
            "failed task(s)": len(self.failed),
        }
        wrong = ", ".join(f"{count} {name}" for name, count in counts.items() if count)
        return f"found {wrong}; these releases are measured again" if wrong else ""


def resolved(out: Path | str) -> Path:
    """Return the absolute path of a campaign's folder.

    Raises
    ------
    ValueError
        If the path is not valid, or a link in it leads nowhere.
    """
    try:
        return Path(out).resolve()
    except (OSError, RuntimeError, ValueError) as error:  # a loop of links, a null character
        raise ValueError(f"out must be a path of a folder, got {_checks.show(str(out))}") from error


def write_plan(plan: CampaignPlan, out: Path) -> None:
    """Write the plan to its folder."""
    state = {"version": __version__, "digest": plan.digest, "plan": plan.as_dict()}
    record = {"provenance": provenance(plan.as_dict(), plan.seed)}
    with _files.replacing(out / PLAN) as file:
        json.dump(state | record, file, indent=2)
        file.write("\n")


def read_plan(out: Path) -> CampaignPlan | None:
    """Return the plan of the campaign in `out`; None where there is none.

    Raises
    ------
    ValueError
        If the plan is damaged or of another version of the package.
    """
    path = out / PLAN
    try:
        text = _files.read_text(path)
    except (FileNotFoundError, NotADirectoryError):
        return None  # the driver reports what is wrong with the folder
    except (OSError, ValueError) as error:
        raise ValueError(f"{path} cannot be read: {error}") from error
    try:
        state = _files.parse_json(text)
        version, digest, values = state["version"], state["digest"], state["plan"]
        plan = CampaignPlan.from_dict(values) if version == __version__ else None
        if plan is not None and plan.digest != digest:
            raise ValueError("its digest does not match")
    except (ValueError, TypeError, KeyError) as error:
        raise ValueError(
            f"{path} is damaged ({error}): remove it and give the plan again; results of the same "
            f"plan are kept"
        ) from error
    if plan is None:
        raise ValueError(
            f"{path} was made by npend_gym {version}, this is {__version__}, whose results may "
            f"differ in their last bits: use that version, or choose another folder"
        )
    return plan


def check_folder(plan: CampaignPlan, out: Path, *, clean: bool = False) -> FolderStatus:
    """Read and check every part of the campaign `plan` in `out`.

    With `clean`, half-written files are removed, which only the driver that holds the lock may do,
    having ended earlier leases.
    """
    records, bad_lines = read_journal(out / JOURNAL, plan.digest)
    done: dict[str, Record] = {}
    failed: dict[str, Record] = {}
    damaged = missing = unrecorded = 0
    for task in plan.tasks():
        record = records.get(task.id)
        if record is not None and not record.done:
            failed[task.id] = record
            continue
        digests = {table: _files.sha256(out / table / task.part) for table in TABLES}
        if record is None:
            unrecorded += sum(digest is not None for digest in digests.values())
            continue
        damaged += sum(d not in (None, record.parts.get(table)) for table, d in digests.items())
        missing += sum(digest is None for digest in digests.values())
        if digests == record.parts:
            done[task.id] = record
    leftovers = list(_leftovers(out))
    for path in leftovers if clean else ():
        _files.remove(path)
    if clean:
        remove_ended(out)
    return FolderStatus(done, failed, damaged, missing, unrecorded, len(leftovers), bad_lines)


def _leftovers(out: Path) -> Iterator[Path]:
    yield from half_written(out)
    yield from out.glob(".*.part")
    for table in TABLES:
        yield from (out / table).glob("*/.*.part")


def remaining_tasks(plan: CampaignPlan, status: FolderStatus) -> Iterator[Task]:
    """Yield the tasks that are not done."""
    return (task for task in plan.tasks() if task.id not in status.records)
