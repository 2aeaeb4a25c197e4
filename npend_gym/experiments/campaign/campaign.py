"""A campaign in a folder: what is done there, and the drivers that do the rest.

The folder is the only state: the plan, and the parts of tasks that are done. Several drivers work
on one folder without harm, because whoever measures a task writes the same bytes under the same
name. Locks only keep them from doing everything twice; an object store has none.
"""

from __future__ import annotations

import json
import re
from collections.abc import Generator, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from npend_gym import _checks, _extras, _files
from npend_gym._checks import BoolArray
from npend_gym._provenance import provenance
from npend_gym._version import __version__
from npend_gym.experiments.campaign import engine
from npend_gym.experiments.campaign.folder import Folder, open_folder
from npend_gym.experiments.campaign.parts import parquet
from npend_gym.experiments.campaign.plan import CampaignPlan
from npend_gym.experiments.campaign.sweep import plan_of
from npend_gym.experiments.campaign.task import differing, run_task
from npend_gym.experiments.campaign.tasks import GROUP, Plan, Task, digest_of, group_name

filelock: Any = _extras.require("filelock", "campaign", "campaigns")

if TYPE_CHECKING:
    from typing_extensions import Self

PLAN, CELLS, FAILED, _LOCK = "plan.json", "cells.parquet", "failed", ".lock"
_PART = re.compile(r"(\d{7})-([0-9a-f]{16})\.parquet")
_NAMED = 100  # files and errors that are kept to be named; all are counted
_PATIENCE = 10.0  # s that a shard waits for the lock that each of them needs for a moment


class BusyError(RuntimeError):
    """Another driver is at work on the folder."""


class DiskError(RuntimeError):
    """The results cannot be written."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"{reason}; what is done is kept, the same command continues")


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
    blocked: set[int] = field(default_factory=set[int])  # tasks with several results

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


def _plan_text(plan: Plan, code: str) -> str:
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
        mine = set(_share(plan, group, shard))
        for table in plan.tables:
            for name in folder.names(f"{table}/{group}/"):
                part = _PART.fullmatch(name.rpartition("/")[2])
                if part and int(part[1]) in mine:
                    found.setdefault((table, int(part[1])), []).append(name)
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
            status.blocked.add(task.index)
            status.fail(task.id, differing(task, each))
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


def _share(plan: Plan, group: str, shard: tuple[int, int]) -> range:
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
            found.setdefault(_index(name), []).append(name)
        for index in _share(plan, group, (1, 1)):
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


def read_shard(text: str) -> tuple[int, int]:
    """Return k and n of "k/n"."""
    found = re.fullmatch(r"([0-9]{1,7})/([0-9]{1,7})", text)
    if not found or not 1 <= int(found[1]) <= int(found[2]):
        raise ValueError(f"shard must be k/n, k from 1 to n, such as 2/8; got {_checks.show(text)}")
    return int(found[1]), int(found[2])


class Campaign:
    """A campaign in a folder. As a context manager it holds the folder's lock, on a disk.

    Parameters
    ----------
    plan : CampaignPlan or SweepPlan, optional
        By default the one in the folder.
    out : path or str
        The folder, or the URL of one in an object store, "s3://...", "gs://..." or "memory://...".
        It is made if it does not exist. Machines that work on it must share it, and nothing else.
        What an earlier driver has done there is kept and continued.
    shard : str
        "k/n": only do the k-th of n shares of the tasks, k from 1 to n.

    Attributes
    ----------
    plan : CampaignPlan or SweepPlan
    out : Path or str
    status : FolderStatus
        What the folder held of the share when the context was entered, and what `run` has yielded
        since.

    Raises
    ------
    ValueError
        If the folder holds another plan, a damaged one or none, or cannot be written to; or if the
        plan takes more than 10 MB.
    BusyError
        From the context, if another driver is at work on the folder, or on the same share.

    Examples
    --------
    >>> plan = CampaignPlan(n=[2, 3], trials=100)
    >>> with Campaign(plan, "results") as campaign:
    ...     print(sum(not error for _, error in campaign.run()), "tasks are done")
    2 tasks are done
    """

    def __init__(self, plan: Plan | None, out: Path | str, *, shard: str = "1/1") -> None:
        self.folder: Folder = open_folder(out)
        self.out: Any = str(self.folder) if self.folder.is_store else self.folder.path
        self.shard: tuple[int, int] = read_shard(shard)
        present = read_plan(self.folder, plan)
        if plan is None and present is None:
            raise ValueError(f"there is no campaign in {self.out}: give a plan, or another folder")
        self.plan: Plan = present or plan or CampaignPlan()
        if present is None:  # refuses what cannot be, before the folder is made
            _plan_text(self.plan, self.plan.check_code())
        self.status: FolderStatus
        self._locks: list[Any] = []
        self._open = False

    def share(self) -> range:
        """Return the numbers of the tasks of this driver."""
        return range(self.shard[0] - 1, self.plan.task_count, self.shard[1])

    @property
    def is_alone(self) -> bool:
        """Whether this driver does all tasks of the folder."""
        return self.shard == (1, 1)

    def __enter__(self) -> Self:
        try:
            self.folder.make()
            self._lock()
        except filelock.Timeout as error:
            self._unlock()
            raise BusyError(
                f"another driver is at work on {self.out}: wait for it, or choose another folder"
            ) from error
        except OSError as error:
            self._unlock()
            raise ValueError(
                f"out must be a folder that can be written to, got {self.out}: "
                f"{error.strerror or error}"
            ) from error
        try:
            self._prepare()
        except OSError as error:
            self._unlock()
            reason = error.strerror or error
            raise DiskError(f"{self.out} cannot be written to: {reason}") from error
        except BaseException:
            self._unlock()
            raise
        self._open = True
        return self

    def _lock(self) -> None:
        """Take the folder's lock, and that of the share; a store has none."""
        if self.folder.is_store:
            return
        first = filelock.FileLock(self.folder.path / _LOCK)
        first.acquire(timeout=0.0 if self.is_alone else _PATIENCE)
        self._locks.append(first)
        own = "{}-{}-of-{}".format(_LOCK, *self.shard)
        for name in self.folder.names(f"{_LOCK}-") if self.is_alone else [own]:
            lock = filelock.FileLock(self.folder.path / name)
            lock.acquire(timeout=0.0)
            self._locks.append(lock)

    def _unlock(self) -> None:
        self._open = False
        while self._locks:
            self._locks.pop().release()

    def _prepare(self) -> None:
        if read_plan(self.folder, self.plan) is None:  # no other driver has written it by now
            text = _plan_text(self.plan, self.plan.check_code())
            with suppress(FileExistsError):
                self.folder.create(PLAN, text.encode())
        self.plan = read_plan(self.folder, self.plan) or self.plan
        self.plan.check_code()
        cells = self.plan.describe_cells()
        if cells is not None:
            about = provenance({"plan": self.plan.digest}, self.plan.seed)
            self.folder.write(CELLS, parquet(cells, about))
        if self._locks and not self.is_alone:
            self._locks.pop(0).release()  # it keeps that of its share
        self.status = check_folder(self.plan, self.folder, clean=True, shard=self.shard)

    def run(
        self, backend: str = "loky", count: int | None = None, address: str | None = None
    ) -> Generator[tuple[Task, str], None, None]:
        """Run the tasks that are not done; yield each, with its error, once that is on the disk.

        The error is empty where the task is done. Parameters are those of `engine.workers`. When
        the run is interrupted or the generator is closed, what has been yielded is kept. Results of
        other shards that appear meanwhile are not measured again.

        Raises
        ------
        DiskError
            If a part or an error cannot be written.
        WorkersLostError
            If workers are lost again and again without any result.
        OSError
            If no worker can be started, or no cluster reached.
        """
        if not self._open:
            raise RuntimeError(
                "run() needs the folder's lock: with Campaign(plan, out) as campaign"
            )
        work, status = partial(run_task, self.plan, self.folder), self.status
        if self.folder.is_of_process and backend != "threading" and count != 1:
            raise ValueError(
                f"backend must be threading for {self.out}, which is in the memory of this process"
            )
        status.failed.clear()
        status.failures = 0
        for index in sorted(status.blocked):
            task = self.plan.task(index)
            error = self._several(task)
            status.fail(task.id, error)
            yield task, error
        count_left = len(self.share()) - status.count
        with engine.workers(backend, count, address, count_left):
            for task, result in engine.run(work, self._left()):
                if isinstance(result, OSError):
                    raise self._disk_error(result) from result
                error = result.reason if isinstance(result, engine.WorkerLost) else result
                if error:
                    self._tell(task, error)
                else:
                    status.finish(task)
                yield task, error

    def _left(self) -> Iterator[Task]:
        """Yield the tasks of this share that are not done, group by group as they are reached."""
        for group in range(-(-self.plan.task_count // GROUP)):
            name = group_name(group)
            left = [
                index
                for index in _share(self.plan, name, self.shard)
                if not self.status.done[index] and index not in self.status.blocked
            ]
            by_others = set[int]()
            if left and (not self.is_alone or self.folder.is_store):
                found = (self.folder.names(f"{table}/{name}/") for table in self.plan.tables)
                parts = [{_index(each) for each in names} for names in found]
                by_others = parts[0].intersection(*parts[1:])
            for index in left:
                if index in by_others:  # written since the folder was checked
                    self.status.finish(self.plan.task(index))
                else:
                    yield self.plan.task(index)

    def _several(self, task: Task) -> str:
        names = (self.folder.names(f"{table}/{task.place}-") for table in self.plan.tables)
        return differing(task, max(names, key=len))

    def _tell(self, task: Task, error: str) -> None:
        """Write the error of a task that failed; the next start tries it again."""
        self.status.fail(task.id, error)
        try:
            self.folder.write(f"{FAILED}/{task.id}", error.encode())
        except OSError as reason:
            raise self._disk_error(reason) from reason

    def _disk_error(self, error: OSError) -> DiskError:
        return DiskError(f"{error.strerror or error}: {error.filename or self.out}")

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self._unlock()


def _index(name: str) -> int:
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
