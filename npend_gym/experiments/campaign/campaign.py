"""A campaign in a folder: what is done there, and the driver that does the rest.

Several drivers could work on one folder without harm, because whoever measures a task writes the
same bytes under the same name. The lock only keeps them from doing everything twice.
"""

from __future__ import annotations

import json
import re
from collections import defaultdict
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from npend_gym import _checks, _extras, _files
from npend_gym._provenance import provenance
from npend_gym._version import __version__
from npend_gym.experiments.campaign import engine
from npend_gym.experiments.campaign.parts import RELEASES, TABLES, write_cells
from npend_gym.experiments.campaign.plan import CampaignPlan, Task, digest_of
from npend_gym.experiments.campaign.task import run_task

filelock: Any = _extras.require("filelock", "campaign", "campaigns")

if TYPE_CHECKING:
    from typing_extensions import Self

PLAN, CELLS, FAILED, _LOCK = "plan.json", "cells.parquet", "failed", ".lock"
_PART = re.compile(r"(\d{7})-([0-9a-f]{16})\.parquet")


class BusyError(RuntimeError):
    """Another driver is at work on the folder."""


class DiskError(RuntimeError):
    """The results cannot be written."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"{reason}; what is done is kept, the same command continues")


@dataclass(frozen=True)
class FolderStatus:
    """Which tasks of a campaign are done in a folder, and what is wrong with the folder.

    Attributes
    ----------
    done : dict
        Task id -> the task's part of RELEASES; every part has the bytes that its name says.
    failed : dict
        Task id -> error of the tasks that failed.
    damaged, incomplete : int
        Parts whose bytes are others or whose plan is, and tasks with one of the two parts.
    leftovers : int
        Files that were being written when a driver ended, and parts of other plans.
    """

    done: dict[str, Path]
    failed: dict[str, str]
    damaged: int
    incomplete: int
    leftovers: int

    def text(self) -> str:
        """Return a line about what is wrong with the folder; empty where nothing is."""
        counts = {
            "part(s) damaged": self.damaged,
            "task(s) half done": self.incomplete,
            "half-written or foreign file(s)": self.leftovers,
            "failed task(s)": len(self.failed),
        }
        wrong = ", ".join(f"{count} {name}" for name, count in counts.items() if count)
        return f"found {wrong}; what is missing is measured again" if wrong else ""


def resolved(out: Path | str) -> Path:
    """Return the absolute path of a campaign's folder."""
    try:
        return Path(out).resolve()
    except (OSError, RuntimeError, ValueError) as error:  # a loop of links, a null character
        raise ValueError(f"out must be a path of a folder, got {_checks.show(str(out))}") from error


def read_plan(out: Path, given: CampaignPlan | None = None) -> CampaignPlan | None:
    """Return the plan of the campaign in `out`, which must be `given`; None where there is none."""
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
        if plan is not None and digest_of(values) != digest:
            raise ValueError("its digest does not match")
    except (ValueError, TypeError, KeyError) as error:
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
        raise ValueError(f"{out} holds another plan, with {_difference(given, plan)}")
    vars(plan)["digest"] = digest  # another where a value was written as 10 and is 10.0 now
    return plan


def _plan_text(plan: CampaignPlan) -> str:
    """Return the text of PLAN, refused where `read_plan` would not read it."""
    state = {"version": __version__, "digest": plan.digest, "plan": plan.as_dict()}
    state["provenance"] = provenance(plan.as_dict(), plan.seed)
    text = json.dumps(state, indent=2) + "\n"
    if len(text) > _files.MAX_TEXT:
        raise ValueError(
            f"{PLAN} must have at most {_files.MAX_TEXT} bytes, got {len(text)}: give a plan with "
            "fewer values"
        )
    return text


def check_folder(plan: CampaignPlan, out: Path, *, clean: bool = False) -> FolderStatus:
    """Read and check every part of the campaign `plan` in `out`.

    With `clean`, all that is not a part of a task that is done is removed, which only the driver
    that holds the lock may do.
    """
    found, useless = _parts(out)
    leftovers, failed = len(useless), _failed(out)
    done: dict[str, Path] = {}
    damaged = incomplete = 0
    for task in plan.tasks():
        here = [found.pop((table, task.place), []) for table in TABLES]
        whole = [
            [one for one in each if _files.read_part(plan.digest, one) is not None] for each in here
        ]
        damaged += sum(map(len, here)) - sum(map(len, whole))
        kept = [paths[0] for paths in whole if paths] if all(whole) else []
        incomplete += any(whole) and not kept
        if kept:
            done[task.id] = kept[TABLES.index(RELEASES)]
        useless += [path for paths in here for path in paths if path not in kept]
    foreign = [path for paths in found.values() for path in paths]
    useless += [*foreign, *(out / FAILED / name for name in failed)]
    for path in useless if clean else ():
        _files.remove(path)
    return FolderStatus(done, failed, damaged, incomplete, leftovers + len(foreign))


def _parts(out: Path) -> tuple[dict[tuple[str, str], list[Path]], list[Path]]:
    """Return the parts by table and `Task.place`, and the files that are none."""
    found: defaultdict[tuple[str, str], list[Path]] = defaultdict(list)
    others = list(out.glob(".*.part"))
    for table in TABLES:
        for path in sorted((out / table).glob("n=*/*")):
            name = _PART.fullmatch(path.name)
            if name:
                found[table, f"{path.parent.name}/{name[1]}"].append(path)
            elif path.name.endswith((".part", ".parquet")):
                others.append(path)
    return found, others


def _failed(out: Path) -> dict[str, str]:
    """Return the errors of the tasks that failed."""
    return {path.name: _text(path) for path in sorted((out / FAILED).glob("n*"))}


def _text(path: Path) -> str:
    try:
        return _files.read_text(path)
    except (OSError, ValueError) as error:
        return str(error)


class Campaign:
    """A campaign in a folder. As a context manager it holds the folder's lock.

    Parameters
    ----------
    plan : CampaignPlan, optional
        By default the one in the folder.
    out : path
        The folder; it is made if it does not exist. The machines of a cluster must share it. What
        an earlier driver has done there is kept and continued.

    Attributes
    ----------
    plan : CampaignPlan
    out : Path
    status : FolderStatus
        What the folder held when the context was entered, and what `run` has yielded since.

    Raises
    ------
    ValueError
        If the folder holds another plan, a damaged one or none, or cannot be written to; or if the
        plan takes more than 10 MB.
    BusyError
        From the context, if another driver is at work on the folder.

    Examples
    --------
    >>> plan = CampaignPlan(n=[2, 3], trials=100)
    >>> with Campaign(plan, "results") as campaign:
    ...     print(sum(not error for _, error in campaign.run()), "tasks are done")
    2 tasks are done
    """

    def __init__(self, plan: CampaignPlan | None, out: Path | str) -> None:
        self.out: Path = resolved(out)
        present = read_plan(self.out, plan)
        if plan is None and present is None:
            raise ValueError(f"there is no campaign in {self.out}: give a plan, or another folder")
        self.plan: CampaignPlan = present or plan or CampaignPlan()
        if present is None:
            _plan_text(self.plan)  # refuses one that is too large, before the folder is made
        self.status: FolderStatus
        self._lock = filelock.FileLock(self.out / _LOCK, blocking=False)

    def __enter__(self) -> Self:
        try:
            _files.make_folder(self.out)
            self._lock.acquire()
        except filelock.Timeout as error:
            raise BusyError(
                f"another driver is at work on {self.out}: wait for it, or choose another folder"
            ) from error
        except OSError as error:
            raise ValueError(
                f"out must be a folder that can be written to, got {self.out}: "
                f"{error.strerror or error}"
            ) from error
        try:
            self._prepare()
        except OSError as error:
            self._lock.release()
            raise DiskError(f"{self.out} cannot be written to: {error.strerror}") from error
        except BaseException:
            self._lock.release()
            raise
        return self

    def _prepare(self) -> None:
        present = read_plan(self.out, self.plan)  # another driver may have written it by now
        if present is None:
            with _files.replacing(self.out / PLAN) as file:
                file.write(_plan_text(self.plan))
        self.plan = present or self.plan
        write_cells(self.plan, self.out / CELLS)
        self.status = check_folder(self.plan, self.out, clean=True)

    def run(
        self, backend: str = "loky", count: int | None = None, address: str | None = None
    ) -> Generator[tuple[Task, str], None, None]:
        """Run the tasks that are not done; yield each, with its error, once that is on the disk.

        The error is empty where the task is done. Parameters are those of `engine.workers`. When
        the run is interrupted or the generator is closed, what has been yielded is kept.

        Raises
        ------
        DiskError
            If a part or an error cannot be written.
        WorkersLostError
            If workers are lost again and again without any result.
        OSError
            If no worker can be started, or no cluster reached.
        """
        if not self._lock.is_locked:
            raise RuntimeError(
                "run() needs the folder's lock: with Campaign(plan, out) as campaign"
            )
        work, status = partial(run_task, self.plan, self.out), self.status
        left: Iterator[Task] = (task for task in self.plan.tasks() if task.id not in status.done)
        status.failed.clear()
        count_left = self.plan.task_count - len(status.done)
        with engine.workers(backend, count, address, count_left):
            for task, result in engine.run(work, left):
                if isinstance(result, OSError):
                    raise self._disk_error(result) from result
                if isinstance(result, Path):
                    status.done[task.id], error = result, ""
                else:
                    error = result.reason if isinstance(result, engine.WorkerLost) else result
                    self._tell(task, error)
                yield task, error

    def _tell(self, task: Task, error: str) -> None:
        """Write the error of a task that failed; the next start tries it again."""
        self.status.failed[task.id] = error
        try:
            _files.make_folder(self.out / FAILED)
            with _files.replacing(self.out / FAILED / task.id) as file:
                file.write(error)
        except OSError as reason:
            raise self._disk_error(reason) from reason

    def _disk_error(self, error: OSError) -> DiskError:
        return DiskError(f"{error.strerror or error}: {error.filename or self.out}")

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self._lock.release()


def _difference(plan: CampaignPlan, present: CampaignPlan) -> str:
    # first the chain, because a plan with one lacks what it replaces
    asked, held = ({"chain": None} | each.as_dict() for each in (plan, present))
    name = next(name for name in asked if asked[name] != held[name])
    return (
        f"{name} = {held[name]} where {asked[name]} was given: choose another folder, or give no "
        f"plan to continue with that one"
    )
