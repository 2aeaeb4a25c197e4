"""The driver of a campaign: one at a time on a folder, resuming what another has left."""

from __future__ import annotations

from collections.abc import Generator
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from npend_gym import _extras
from npend_gym.experiments.campaign import engine
from npend_gym.experiments.campaign.folder import (
    CELLS,
    JOURNAL,
    LOCK,
    Found,
    folder_of,
    inspect,
    open_tasks,
    read_plan,
    write_plan,
)
from npend_gym.experiments.campaign.journal import Journal, Record
from npend_gym.experiments.campaign.measuring import Unwritten, carry_out
from npend_gym.experiments.campaign.parts import write_cells
from npend_gym.experiments.campaign.plan import Plan, Task

filelock: Any = _extras.require("filelock", "campaign", "campaigns")

if TYPE_CHECKING:
    from typing_extensions import Self


class BusyError(RuntimeError):
    """Another driver is at work on the folder."""


class DiskError(RuntimeError):
    """The results cannot be written."""


class Campaign:
    """A campaign in a folder, as a context: it holds the folder's lock.

    Parameters
    ----------
    plan : Plan, optional
        By default the one in the folder.
    out : path
        The folder, made if need be; for a cluster one that all machines share. What another driver
        has left there is gone on with.

    Attributes
    ----------
    plan : Plan
    out : Path
    found : Found
        What the folder held, once the context is entered.

    Raises
    ------
    ValueError
        If the folder holds another plan, a damaged one or none, or cannot be written to.
    BusyError
        On entering, if another driver is at work on the folder.

    Examples
    --------
    >>> plan = Plan(n=[2, 3], trials=100)
    >>> with Campaign(plan, "results") as campaign:  # doctest: +SKIP
    ...     records = list(campaign.run(count=2))
    """

    def __init__(self, plan: Plan | None, out: Path | str) -> None:
        self.out = folder_of(out)
        there = read_plan(self.out)
        if plan is None and there is None:
            raise ValueError(f"there is no campaign in {self.out}: give a plan, or another folder")
        if plan is not None and there is not None and plan != there:
            raise ValueError(f"{self.out} holds another plan, with {_difference(plan, there)}")
        self.plan = plan or there or Plan()
        self._known = there is not None
        self.found: Found
        self._lock = filelock.FileLock(self.out / LOCK, blocking=False)

    def __enter__(self) -> Self:
        try:
            self.out.mkdir(parents=True, exist_ok=True)
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
            if not self._known:
                write_plan(self.plan, self.out)
            write_cells(self.plan, self.out / CELLS)
            self.found = inspect(self.plan, self.out, clean=True)
        except OSError as error:
            raise DiskError(f"{self.out} cannot be written to: {error.strerror}") from error

    def run(
        self, backend: str = "loky", count: int | None = None, address: str | None = None
    ) -> Generator[tuple[Task, Record], None, None]:
        """Carry out what is not done; yield each task with its record, when it is on the disk.

        Parameters are those of `engine.workers`. Interrupted, or with the iterator closed, what
        has been yielded is kept.

        Raises
        ------
        DiskError
            If a part or a record cannot be written.
        WorkersLostError
            If workers are lost again and again without any result.
        """
        work = partial(carry_out, self.plan, self.out)
        done = self.found.records
        try:
            with (
                Journal(self.out / JOURNAL, done.values()) as journal,
                engine.workers(backend, count, address),
            ):
                for task, result in engine.run(work, open_tasks(self.plan, self.found)):
                    if isinstance(result, Unwritten):
                        raise DiskError(result.reason)
                    if isinstance(result, engine.Lost):
                        result = Record(self.plan.digest, task.id, error=result.reason)  # noqa: PLW2901
                    journal.append(result)
                    yield task, result
        except OSError as error:
            raise DiskError(f"{error.strerror or error}: {self.out}") from error

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self._lock.release()


def _difference(plan: Plan, there: Plan) -> str:
    given, held = plan.as_dict(), there.as_dict()
    name = next(name for name in given if given[name] != held[name])
    return (
        f"{name} = {held[name]} where {given[name]} was given: choose another folder, or give no "
        f"plan to go on with that one"
    )
