"""What a campaign releases: the cells of a sweep, their trials, and how tasks divide them."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from npend_gym import _checks
from npend_gym._version import __version__
from npend_gym.chain import STANDARD_GRAVITY, Chain
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
MAX_CELLS = 1_000_000
MAX_CHAINS = 10_000
MAX_TASKS = 1_000_000
MAX_TRIALS_PER_CELL = 10**12
MAX_BATCH = 1_000_000
_SMALLEST, _LARGEST = 16, 4096  # releases in a task, where the plan does not say
_WORK = 1e5  # releases times n^2 in a task: about a second on one core


@dataclass(frozen=True)
class CampaignPlan:
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
        if self.task_count > MAX_TASKS:
            raise ValueError(
                f"trials must be so few, or batch so large, that there are at most {MAX_TASKS} "
                f"tasks, got {self.task_count}: give fewer trials, or a batch of up to {MAX_BATCH}"
            )

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
        return self.cells * self.trials

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

    def tasks(self) -> Iterator[Task]:
        """Yield the tasks, in the order of the plan."""
        per_n = self.releases // self.shape[0]
        for place, n in enumerate(self._sweep("n")):
            base, batch = place * per_n, self.batch_of(n)
            for number, first in enumerate(range(0, per_n, batch)):
                yield Task(n, number, base + first, base + min(first + batch, per_n))

    @cached_property
    def task_count(self) -> int:
        """Number of tasks."""
        per_n = self.releases // self.shape[0]
        return sum(-(-per_n // self.batch_of(n)) for n in self._sweep("n"))

    def as_dict(self) -> dict[str, Any]:
        """Return the plan as numbers and lists: `CampaignPlan(**plan.as_dict())` equals it."""
        return plain_fields(self, "n")

    @cached_property
    def digest(self) -> str:
        """Digest of all that the results depend on: the plan and the package's version."""
        return digest_of(self.as_dict())

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> CampaignPlan:
        """Return the plan with `values`, such as those read from a file.

        Raises
        ------
        TypeError, ValueError
            If a name is unknown or a value breaks its rule.
        """
        known = [field.name for field in fields(cls)]
        for name in values:
            if name not in known:
                raise ValueError(
                    f"a plan has the names {', '.join(known)}; got {_checks.show(name)}"
                )
        return cls(**values)


def digest_of(values: Mapping[str, Any]) -> str:
    """Return the digest of a plan with these values, of `CampaignPlan.as_dict`."""
    text = json.dumps([__version__, values], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@dataclass(frozen=True)
class Task:
    """Releases `first` to `last` - 1 of a plan, of chains of `n` rods.

    Release k of a plan is trial k % trials + 1 of cell k // trials.
    """

    n: int
    number: int
    first: int
    last: int

    @property
    def id(self) -> str:
        """Name of the task; equal plans have equal names."""
        return f"n{self.n}-{self.number:07d}"

    @property
    def place(self) -> str:
        """What the path of the task's part begins with inside the folder of a table."""
        return f"n={self.n}/{self.number:07d}"

    @property
    def releases(self) -> int:
        """Number of releases."""
        return self.last - self.first
