"""A campaign in a folder: what is done there, and the drivers that do the rest.

The folder is the only state: the plan, and the parts of tasks that are done. Several drivers work
on one folder without harm, because whoever measures a task writes the same bytes under the same
name. Locks only keep them from doing everything twice; an object store has none.
"""

from __future__ import annotations

import re
from collections.abc import Generator, Iterator
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from npend_gym import _checks, _extras
from npend_gym._provenance import provenance
from npend_gym.experiments.campaign import engine
from npend_gym.experiments.campaign.folder import Folder, open_folder
from npend_gym.experiments.campaign.parts import parquet
from npend_gym.experiments.campaign.status import (
    CELLS,
    FAILED,
    PLAN,
    FolderStatus,
    check_folder,
    index_of,
    plan_text,
    read_plan,
    share_of,
)
from npend_gym.experiments.campaign.task import run_task
from npend_gym.experiments.campaign.tasks import GROUP, Plan, Task, group_name
from npend_gym.experiments.studies.release_plan import CampaignPlan

filelock: Any = _extras.require("filelock", "campaign", "campaigns")

if TYPE_CHECKING:
    from typing_extensions import Self

_LOCK = ".lock"
_PATIENCE = 10.0  # s that a shard waits for the lock that each of them needs for a moment


class BusyError(RuntimeError):
    """Another driver is at work on the folder."""


class DiskError(RuntimeError):
    """The results cannot be written."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"{reason}; what is done is kept, the same command continues")


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
            plan_text(self.plan, self.plan.check_code())
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
        present = read_plan(self.folder, self.plan)  # another driver may have written it by now
        if present is None:
            text = plan_text(self.plan, self.plan.check_code())
            try:
                self.folder.create(PLAN, text.encode())
            except FileExistsError:
                present = read_plan(self.folder, self.plan)
        self.plan = present or self.plan
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
        for index, error in status.blocked.items():
            task = self.plan.task(index)
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
                for index in share_of(self.plan, name, self.shard)
                if not self.status.done[index] and index not in self.status.blocked
            ]
            by_others = set[int]()
            if left and (not self.is_alone or self.folder.is_store):
                found = (self.folder.names(f"{table}/{name}/") for table in self.plan.tables)
                parts = [{index_of(each) for each in names} for names in found]
                by_others = parts[0].intersection(*parts[1:])
            for index in left:
                if index in by_others:  # written since the folder was checked
                    self.status.finish(self.plan.task(index))
                else:
                    yield self.plan.task(index)

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
