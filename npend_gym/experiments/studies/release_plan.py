"""The study "release": the release experiment swept, the cells and how tasks divide them."""

from __future__ import annotations

import itertools
import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from npend_gym import _checks
from npend_gym.chain import STANDARD_GRAVITY, Chain
from npend_gym.experiments.campaign.tasks import (
    MAX_BATCH,
    MAX_CELLS,
    MAX_TRIALS_PER_CELL,
    Plan,
    Task,
    check_names,
)
from npend_gym.experiments.chains import (
    REPLACED,
    plain_fields,
    released_chain,
    swept_values,
    take_chain,
    take_count,
)
from npend_gym.experiments.release import (
    PAPER_AMPLITUDE,
    PAPER_N,
    PAPER_SPREAD,
    PAPER_TRIALS,
    ReleaseExperiment,
)

PerRod: TypeAlias = float | Sequence[float]

# A cell has one value of each, and the last name varies fastest. The names that make the chain come
# first, so that neighbouring cells have equal chains and are measured side by side.
SWEPT = ("n", "masses", "lengths", "gravity", "damping", "definition", "amplitude", "spread")
OF_CHAIN = SWEPT[:5]
MAX_CHAINS = 10_000
RELEASES, BOBS = "releases", "bobs"
_SMALLEST, _LARGEST = 16, 4096  # releases in a task, where the plan does not say
_WORK = 1e5  # releases times n^2 in a task: about a second on one core


@dataclass(frozen=True)
class CampaignPlan(Plan):
    """A sweep of the release experiment: every combination of the values, `trials` times.

    Each of the first eight is one value or a list of values to sweep over.

    Attributes
    ----------
    n : int or list of int
        Numbers of pendulums.
    masses : float, or list of float or of lists
        Mass of all bobs [kg]. A list inside the list has one for each.
    lengths : float, or list of float or of lists
        Length of all rods [m]. A list inside the list has one for each.
    gravity : float or list of float
        Acceleration of gravity [m/s^2].
    damping : float or list of float
        Viscous damping of every joint [N m s].
    definition : str or list of str
        What completes a pseudo-period: "bob", "link", "height", "com" or "horizontal". See
        `npend_gym.pseudo_periods`.
    amplitude : float or list of float
        Angle of all rods at the start, where they are at rest [rad].
    spread : float or list of float
        Each release adds to all rods one angle drawn between zero and this [rad].
    trials : int
        Releases of each combination (cell).
    seed : int
        Seed of the draws. A trial's draw depends on `seed` plus its number alone, as in
        `npend_gym.experiments.starts`: not on the cell, the batch, the workers or the order.
    duration : float, optional
        Time for which a release is observed [s]; by default long enough for every bob.
    batch : int, optional
        Releases in a task; by default as many as take about a second on one core.
    chain : Chain, dict or str, optional
        A chain, in place of numbers of pendulums, masses, lengths, gravity and damping. It is a
        `Chain`, the dict of its parameters, a preset's name, or a JSON file.

    Raises
    ------
    TypeError, ValueError
        If a value breaks its rule, alone or together with others, or is named twice.

    Examples
    --------
    >>> from npend_gym import experiments
    >>> experiments.CampaignPlan(n=[2, 5], trials=100).releases
    200
    """

    study = "release"
    tables = BOBS, RELEASES
    unit = "releases"

    n: int | Sequence[int] = PAPER_N
    masses: float | Sequence[PerRod] = 1.0
    lengths: float | Sequence[PerRod] = 1.0
    gravity: float | Sequence[float] = STANDARD_GRAVITY
    damping: float | Sequence[float] = 0.0
    definition: str | Sequence[str] = "bob"
    amplitude: float | Sequence[float] = PAPER_AMPLITUDE
    spread: float | Sequence[float] = PAPER_SPREAD
    trials: int = PAPER_TRIALS
    seed: int = 0
    duration: float | None = None
    batch: int | None = None
    chain: Chain | Mapping[str, Any] | str | None = None

    def __post_init__(self) -> None:
        take_chain(self, "n")
        for name in SWEPT:
            object.__setattr__(self, name, swept_values(name, getattr(self, name)))
        take_count(self, "trials", high=MAX_TRIALS_PER_CELL)
        take_count(self, "seed", low=0, high=2**63 - 1)
        if self.batch is not None:
            take_count(self, "batch", high=MAX_BATCH)
        _checks.count("the number of cells, the product of all lists,", self.cells, high=MAX_CELLS)
        chains = math.prod(len(self._sweep(name)) for name in OF_CHAIN)
        _checks.count("the number of chains, the product of their lists,", chains, high=MAX_CHAINS)
        self._check_cells()
        if self.duration is not None:
            object.__setattr__(self, "duration", float(self.duration))
        self._check_task_count()

    def _check_cells(self) -> None:
        """Check the values of each name by themselves, and those that have a rule together."""
        first = {name: self._sweep(name)[0] for name in SWEPT}
        for values in itertools.product(*(self._sweep(name) for name in OF_CHAIN)):
            self._release(first | dict(zip(OF_CHAIN, values, strict=True)))
        for name in SWEPT[len(OF_CHAIN) :]:
            for value in self._sweep(name):
                self._release(first | {name: value})
        largest = {"amplitude": max(self._sweep("amplitude"), key=abs)}
        self._release(first | largest | {"spread": max(self._sweep("spread"))})

    def _sweep(self, name: str) -> tuple[Any, ...]:
        return getattr(self, name)

    def _release(self, cell: Mapping[str, Any]) -> ReleaseExperiment:
        values = {name: cell[name] for name in SWEPT if name != "n"}
        return ReleaseExperiment(
            n_values=(cell["n"],),
            seed=self.seed,
            duration=self.duration,
            chain=self.chain,
            **values,
        )

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Number of values of each swept name."""
        return tuple(len(self._sweep(name)) for name in SWEPT)

    @property
    def cells(self) -> int:
        """Number of combinations."""
        return math.prod(self.shape)

    @property
    def releases(self) -> int:
        """Number of releases."""
        return self.size

    def cell(self, index: int) -> dict[str, Any]:
        """Return the values of the cell `index`, counted from 0; see `chain_of`."""
        places = zip(SWEPT, np.unravel_index(index, self.shape), strict=True)
        replaced = REPLACED if self.chain is not None else ()
        return {name: self._sweep(name)[int(k)] for name, k in places if name not in replaced}

    def chain_of(self, cell: Mapping[str, Any]) -> Chain:
        """Return the chain that is released in a cell."""
        if isinstance(self.chain, Chain):
            return self.chain
        return released_chain(cell["n"], *(cell[name] for name in REPLACED))

    def batch_of(self, n: int) -> int:
        """Return the number of releases in a task of chains of `n` rods."""
        if self.batch is not None:
            return self.batch
        power = int(math.log2(_WORK / n**2)) if n**2 < _WORK else 0
        return min(_LARGEST, max(_SMALLEST, 2**power))

    def n_of(self, task: Task) -> int:
        """Return the number of pendulums, which the releases of a task share."""
        return self._sweep("n")[task.first // (self.size // self.shape[0])]

    def task(self, index: int) -> Task:
        """Return the task `index`, counted from 0; a batch never has chains of several n."""
        place = bisect_right(self._tasks_below, index) - 1
        per_n, batch = self.size // self.shape[0], self.batch_of(self._sweep("n")[place])
        first = batch * (index - self._tasks_below[place])
        return Task(index, place * per_n + first, place * per_n + min(first + batch, per_n))

    @cached_property
    def _tasks_below(self) -> list[int]:
        """Number of tasks before those of each n."""
        per_n = self.size // self.shape[0]
        counts = (-(-per_n // self.batch_of(n)) for n in self._sweep("n"))
        return list(itertools.accumulate(counts, initial=0))

    @property
    def task_count(self) -> int:
        """Number of tasks."""
        return self._tasks_below[-1]

    def measure(self, task: Task) -> dict[str, Any]:
        """Return the tables of a task."""
        from npend_gym.experiments.studies.release_tables import tables_of

        return tables_of(self, task)

    def describe_cells(self) -> Any:
        """Return a table of what the cell numbers stand for."""
        from npend_gym.experiments.studies.release_tables import cells_table

        return cells_table(self)

    def as_dict(self) -> dict[str, Any]:
        """Return the plan as numbers and lists: `CampaignPlan(**plan.as_dict())` equals it."""
        return plain_fields(self, "n")

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> CampaignPlan:
        """Return the plan with `values`, such as those read from a file.

        Raises
        ------
        TypeError, ValueError
            If a name is unknown or a value breaks its rule.
        """
        check_names(values, (field.name for field in fields(cls)))
        return cls(**values)
