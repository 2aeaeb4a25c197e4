"""What the engine needs of a plan: cells, their trials, and how tasks divide them."""

from __future__ import annotations

import hashlib
import json
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from npend_gym import _checks
from npend_gym._version import __version__

MAX_CELLS = MAX_TASKS = 1_000_000
MAX_TRIALS_PER_CELL = 10**12
MAX_BATCH = 1_000_000
GROUP = 1000  # tasks whose parts share a folder


@dataclass(frozen=True)
class Task:
    """Trials `first` to `last` - 1 of a plan: trial k is number k % trials of cell k // trials."""

    index: int
    first: int
    last: int

    @property
    def id(self) -> str:
        """Name of the task; equal plans have equal names."""
        return f"{self.index:07d}"

    @property
    def place(self) -> str:
        """Beginning of the name of the task's part inside the folder of a table."""
        return f"{group_name(self.index // GROUP)}/{self.id}"

    @property
    def size(self) -> int:
        """Number of trials."""
        return self.last - self.first


class Plan(ABC):
    """What a campaign does: a study, its cells, `trials` of each, divided into tasks.

    Attributes
    ----------
    study : str
        The name of what is done in a trial.
    tables : tuple of str
        The tables that a task returns; each has a folder of that name.
    unit : str
        What trials are called.
    """

    study: str
    tables: tuple[str, ...]
    unit: str
    trials: int
    seed: int
    code: str | None = None  # the digest that the plan's file has, of a plan that was read

    @property
    @abstractmethod
    def cells(self) -> int:
        """Number of combinations of the swept values."""

    @property
    @abstractmethod
    def task_count(self) -> int:
        """Number of tasks."""

    @abstractmethod
    def task(self, index: int) -> Task:
        """Return the task `index`, counted from 0."""

    @abstractmethod
    def measure(self, task: Task) -> dict[str, Any]:
        """Return the tables of a task, of pyarrow, by their names; equal whenever it is called."""

    @abstractmethod
    def as_dict(self) -> dict[str, Any]:
        """Return the plan as numbers, texts, lists and dicts: `plan_of` them equals it."""

    def check_code(self) -> str:
        """Return a digest of the code outside the package; raise where `code` is another."""
        return ""

    def describe_cells(self) -> Any:
        """Return a table of what the cell numbers stand for; None where the rows say it."""
        return None

    @property
    def size(self) -> int:
        """Number of trials of all cells."""
        return self.cells * self.trials

    def tasks(self) -> Iterator[Task]:
        """Yield the tasks, in the order of the plan."""
        return map(self.task, range(self.task_count))

    @cached_property
    def digest(self) -> str:
        """Digest of all that the results depend on: the plan and the package's version."""
        return digest_of(self.as_dict())

    def _check_task_count(self) -> None:
        if self.task_count > MAX_TASKS:
            raise ValueError(
                f"trials must be so few, or batch so large, that there are at most {MAX_TASKS} "
                f"tasks, got {self.task_count}: give fewer trials, or a batch of up to {MAX_BATCH}"
            )


def digest_of(values: Mapping[str, Any]) -> str:
    """Return the digest of a plan with these values, of `Plan.as_dict`."""
    text = json.dumps([__version__, values], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def group_name(number: int) -> str:
    """Return the name of the folder of a group of tasks."""
    return f"{number:04d}"


def check_names(values: Mapping[str, Any], known: Iterable[str]) -> None:
    """Refuse a name that no field of a plan has."""
    names = list(known)
    for name in values:
        if name not in names:
            raise ValueError(f"a plan has the names {', '.join(names)}; got {_checks.show(name)}")
