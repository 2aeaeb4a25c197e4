"""The driver of a campaign: it continues what is in the folder, and works there alone."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from npend_gym import _extras, _files
from npend_gym.experiments.campaign import engine
from npend_gym.experiments.campaign.folder import (
    CELLS,
    JOURNAL,
    LOCK,
    FolderStatus,
    check_folder,
    read_plan,
    remaining_tasks,
    resolved,
    write_plan,
)
from npend_gym.experiments.campaign.journal import Journal, Record
from npend_gym.experiments.campaign.lease import end_leases, remove_ended, take_lease
from npend_gym.experiments.campaign.parts import write_cells
from npend_gym.experiments.campaign.plan import CampaignPlan, Task
from npend_gym.experiments.campaign.task import WriteFailed, run_task

filelock: Any = _extras.require("filelock", "campaign", "campaigns")

if TYPE_CHECKING:
    from typing_extensions import Self


class BusyError(RuntimeError):
    """Another driver is at work on the folder."""


class DiskError(RuntimeError):
    """The results cannot be written."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"{reason}; what is done is kept, the same command continues")


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
        What the folder held when the context was entered.

    Raises
    ------
    ValueError
        If the folder holds another plan, a damaged one or none, or cannot be written to.
    BusyError
        From the context, if another driver is at work on the folder.

    Examples
    --------
    >>> plan = CampaignPlan(n=[2, 3], trials=100)
    >>> with Campaign(plan, "results") as campaign:
    ...     print(sum(not record.error for _, record in campaign.run()), "tasks are done")
    2 tasks are done
    """

    def __init__(self, plan: CampaignPlan | None, out: Path | str) -> None:
        self.out = resolved(out)
        present = read_plan(self.out)
        if plan is None and present is None:
            raise ValueError(f"there is no campaign in {self.out}: give a plan, or another folder")
        if plan is not None and present is not None and plan != present:
            raise ValueError(f"{self.out} holds another plan, with {_difference(plan, present)}")
        self.plan = plan or present or CampaignPlan()
        self.status: FolderStatus
        self._lease: Path
        self._new = present is None
        self._lock = filelock.FileLock(self.out / LOCK, blocking=False)

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
        except BaseException:
            self._lock.release()
            raise
        return self

    def _prepare(self) -> None:
        try:
            if self._new:
                write_plan(self.plan, self.out)
            write_cells(self.plan, self.out / CELLS)
            self._lease = take_lease(self.out)  # before any part is read
            self.status = check_folder(self.plan, self.out, clean=True)
        except OSError as error:
            raise DiskError(f"{self.out} cannot be written to: {error.strerror}") from error

    def run(
        self, backend: str = "loky", count: int | None = None, address: str | None = None
    ) -> Generator[tuple[Task, Record], None, None]:
        """Run the tasks that are not done; yield each with its record, once that is on the disk.

        Parameters are those of `engine.workers`. When the run is interrupted or the generator is
        closed, what has been yielded is kept.

        Raises
        ------
        DiskError
            If a part or a record cannot be written.
        WorkersLostError
            If workers are lost again and again without any result.
        """
        work = partial(run_task, self.plan, self.out, lease=self._lease)
        tasks = remaining_tasks(self.plan, self.status)
        try:
            with (
                Journal(self.out / JOURNAL, self.status.records.values()) as journal,
                engine.workers(backend, count, address),
            ):
                for task, result in engine.run(work, tasks):
                    if isinstance(result, WriteFailed):
                        raise DiskError(result.reason)
                    record = (
                        Record(self.plan.digest, task.id, error=result.reason)
                        if isinstance(result, engine.WorkerLost)
                        else result
                    )
                    journal.append(record)
                    yield task, record
        except OSError as error:
            raise DiskError(f"{error.strerror or error}: {self.out}") from error

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        try:
            with suppress(OSError):  # the next driver will do it
                end_leases(self.out)
                remove_ended(self.out)
        finally:
            self._lock.release()


def _difference(plan: CampaignPlan, present: CampaignPlan) -> str:
    asked, held = plan.as_dict(), present.as_dict()
    name = next(name for name in asked if asked[name] != held[name])
    return (
        f"{name} = {held[name]} where {asked[name]} was given: choose another folder, or give no "
        f"plan to continue with that one"
    )
