"""What a campaign's folder holds: its plan, which tasks are done, and what is wrong with it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from npend_gym import _files
from npend_gym._checks import BoolArray
from npend_gym._provenance import provenance
from npend_gym._version import __version__
from npend_gym.experiments.campaign.folder import Folder, open_folder
from npend_gym.experiments.campaign.sweep import plan_of
from npend_gym.experiments.campaign.task import differing
from npend_gym.experiments.campaign.tasks import GROUP, Plan, Task, digest_of, group_name

PLAN, CELLS, FAILED = "plan.json", "cells.parquet", "failed"
_PART = re.compile(r"(\d{7})-([0-9a-f]{16})\.parquet")
_NAMED = 100  # files and errors that are kept to be named; all are counted


@dataclass
class FolderStatus:
    """Which tasks of a campaign are done in a folder, and what is wrong with the folder.

    Attributes
    ----------
    done : ndarray of bool, shape (T,)
        Which tasks have all their parts, with the bytes that their names say.
    failed : dict
        Task id -> error, of the first hundred tasks that failed.
    trials : int
        Trials of the tasks that are done.
    failures, damaged, incomplete : int
        Tasks that failed, parts whose bytes are others or whose plan is, and tasks with one of
        several parts.
    leftovers : int
        Files that were being written when a driver ended, and parts of other plans.
    named : list of str
        The first hundred damaged parts.
    """

    done: BoolArray
    failed: dict[str, str] = field(default_factory=dict[str, str])
    trials: int = 0
    failures: int = 0
    damaged: int = 0
    incomplete: int = 0
    leftovers: int = 0
    named: list[str] = field(default_factory=list[str])
    blocked: dict[int, str] = field(default_factory=dict[int, str])  # tasks with several results

    @property
    def count(self) -> int:
        """Number of tasks that are done."""
        return int(self.done.sum())

    def text(self) -> str:
        """Return a line about what is wrong with the folder; empty where nothing is."""
        counts = {
            "part(s) damaged": self.damaged,
            "task(s) half done": self.incomplete,
            "half-written or foreign file(s)": self.leftovers,
            "failed task(s)": self.failures,
        }
        wrong = ", ".join(f"{count} {name}" for name, count in counts.items() if count)
        damaged = f" (damaged: {', '.join(self.named)})" if self.named else ""
        return f"found {wrong}{damaged}; what is missing is measured again" if wrong else ""

    def finish(self, task: Task) -> None:
        """Count a task that is done."""
        if not self.done[task.index]:
            self.done[task.index] = True
            self.trials += task.size

    def fail(self, task_id: str, error: str) -> None:
        """Count a task that failed."""
        self.failures += 1
        if len(self.failed) < _NAMED:
            self.failed[task_id] = error


def read_plan(out: Folder | Path | str, given: Plan | None = None) -> Plan | None:
    """Return the plan of the campaign in `out`, which must be `given`; None where there is none."""
    folder = out if isinstance(out, Folder) else open_folder(out)
    path = folder.at(PLAN)
    try:
        text = folder.read_text(PLAN)
    except (FileNotFoundError, NotADirectoryError):
        return None  # the driver reports what is wrong with the folder
    except (OSError, ValueError) as error:
        raise ValueError(f"{path} cannot be read: {error}") from error
    try:
        state = _files.parse_json(text)
        version, digest, values = state["version"], state["digest"], state["plan"]
        plan = plan_of(values) if version == __version__ else None
        if plan is not None and digest_of(values) != digest:
            raise ValueError("its digest does not match")
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise ValueError(
            f"{path} is damaged ({error}): remove it and give the plan again; results of the same "
            f"plan are kept, those of another are removed"
        ) from error
    if plan is None:
        raise ValueError(
            f"{path} was made by npend_gym {version}, this is {__version__}, whose results may "
            f"differ in their last bits: use that version, or choose another folder"
        )
    if given is not None and plan != given:
        raise ValueError(f"{folder} holds another plan, with {_difference(given, plan)}")
    vars(plan)["code"] = state.get("code") or ""
    vars(plan)["digest"] = digest  # another where a value was written as 10 and is 10.0 now
    return plan


def plan_text(plan: Plan, code: str) -> str:
    """Return the text of PLAN, refused where `read_plan` would not read it."""
    state = {"version": __version__, "digest": plan.digest, "code": code, "plan": plan.as_dict()}
    state["provenance"] = provenance(plan.as_dict(), plan.seed)
    text = json.dumps(state, indent=2) + "\n"
    if len(text) > _files.MAX_TEXT:
        raise ValueError(
            f"{PLAN} must have at most {_files.MAX_TEXT} bytes, got {len(text)}: give a plan with "
            "fewer values"
        )
    return text


def check_folder(
    plan: Plan, folder: Folder, *, clean: bool = False, shard: tuple[int, int] = (1, 1)
) -> FolderStatus:
    """Read and check every part of the campaign `plan` in `folder`, or of a shard's tasks.

    With `clean`, all that is not a part of a task that is done is removed. A shard leaves the files
    of others alone, also those that are being written.
    """
    status = FolderStatus(np.zeros(plan.task_count, np.bool_))
    alone = shard == (1, 1)
    useless = [each for each in folder.names("") if each.endswith(".part")] if alone else []
    status.leftovers = len(useless)
    for group in _groups(plan, folder):
        found: dict[tuple[str, int], list[str]] = {}
        foreign: list[str] = []
        mine = set(share_of(plan, group, shard))
        for table in plan.tables:
            for name in folder.names(f"{table}/{group}/"):
                if index_of(name) in mine:
                    found.setdefault((table, index_of(name)), []).append(name)
                elif name.endswith((".part", ".parquet")) and alone:
                    foreign.append(name)
        status.leftovers += len(foreign)
        useless += foreign
        for index in sorted({index for _, index in found}):
            here = [found.get((table, index), []) for table in plan.tables]
            useless += _check_task(plan, folder, plan.task(index), here, status)
        if clean:
            for name in useless:
                folder.remove(name)
            useless.clear()
    for name in folder.names(f"{FAILED}/"):
        task_id = name.rpartition("/")[2]
        known = task_id.isdigit() and int(task_id) < plan.task_count
        if not known or (int(task_id) % shard[1] == shard[0] - 1 and not name.endswith(".part")):
            useless += [name] * (alone or known)
            if known and not status.done[int(task_id)]:
                status.fail(task_id, _text(folder, name))
    for name in useless if clean else ():
        folder.remove(name)
    return status


def _check_task(
    plan: Plan, folder: Folder, task: Task, here: list[list[str]], status: FolderStatus
) -> list[str]:
    """Count a task with its parts, by table; return those that are damaged.

    What is half done is kept: another driver may be about to write the rest.
    """
    whole = [
        [one for one in each if folder.read_part(plan.digest, one) is not None] for each in here
    ]
    damaged = [one for each, good in zip(here, whole, strict=True) for one in {*each} - {*good}]
    status.damaged += len(damaged)
    status.named += sorted(damaged)[: _NAMED - len(status.named)]
    for each in whole:
        if len(each) > 1:
            status.blocked[task.index] = differing(task, each)
            status.fail(task.id, status.blocked[task.index])
            return damaged
    if all(whole):
        status.finish(task)
    else:
        status.incomplete += any(map(bool, whole))
    return damaged


def _groups(plan: Plan, folder: Folder) -> Iterator[str]:
    """Yield the folders of groups of tasks, those of the plan and others that are there."""
    count = -(-plan.task_count // GROUP)
    yield from map(group_name, range(count))
    for table in plan.tables:
        for name in folder.names(f"{table}/"):
            group = name.rpartition("/")[2]
            if not (group.isdigit() and int(group) < count):
                yield group


def share_of(plan: Plan, group: str, shard: tuple[int, int]) -> range:
    """Return the tasks of a group that are a shard's: every n-th, from k - 1 on."""
    if not group.isdigit():
        return range(0)
    first, (number, count) = GROUP * int(group), shard
    begin = first + (number - 1 - first) % count
    return range(begin, min(first + GROUP, plan.task_count), count)


def parts_of(plan: Plan, folder: Folder, table: str, done: BoolArray) -> Iterator[tuple[Task, str]]:
    """Yield tasks that are done, with the part of a table, in the order of the plan."""
    for group in map(group_name, range(-(-plan.task_count // GROUP))):
        found: dict[int, list[str]] = {}
        for name in folder.names(f"{table}/{group}/"):
            found.setdefault(index_of(name), []).append(name)
        for index in share_of(plan, group, (1, 1)):
            if done[index]:
                names = found.get(index, [])
                whole = (one for one in names if folder.read_part(plan.digest, one) is not None)
                name = names[0] if len(names) == 1 else next(whole, None)
                if name is None:
                    raise ValueError(f"a part of task {index} has been removed from {folder}")
                yield plan.task(index), name


def _text(folder: Folder, name: str) -> str:
    try:
        return folder.read_text(name)
    except (OSError, ValueError) as error:
        return str(error)


def index_of(name: str) -> int:
    """Return the number of the task of a part; -1 for another file."""
    part = _PART.fullmatch(name.rpartition("/")[2])
    return int(part[1]) if part else -1


def _difference(plan: Plan, present: Plan) -> str:
    # first the chain, because a plan with one lacks what it replaces
    given = ({"study": each.study, "chain": None} | each.as_dict() for each in (plan, present))
    asked, held = given
    name = next(name for name in {**held, **asked} if asked.get(name) != held.get(name))
    return (
        f"{name} = {held.get(name)} where {asked.get(name)} was given: choose another folder, or "
        "give no plan to continue with that one"
    )
