"""Sweeps of any function of parameters and a seed, `function(seed=..., name=value, ...)`."""

from __future__ import annotations

import inspect
import json
import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, cast

import numpy as np

from npend_gym import _checks, _files
from npend_gym.experiments.campaign import tasks
from npend_gym.experiments.campaign.parts import pa
from npend_gym.experiments.campaign.tasks import Plan, Task
from npend_gym.experiments.chains import MAX_VALUES, take_count
from npend_gym.experiments.studies.release_plan import CampaignPlan

_STUDIES = "npend_gym.experiments.studies.built_in"
BUILT_IN = ("evaluate", "identify", "lyapunov", "robustness", "train")
ROWS = "rows"
_OWN = ("cell", "seed")  # columns of every table


@dataclass(frozen=True)
class SweepPlan(Plan):
    """A sweep of a study: every combination of the parameters, with `trials` seeds each.

    Attributes
    ----------
    study : str
        "evaluate", "robustness", "train", "lyapunov" or "identify", or a function of your own,
        "module:function". It is called as ``function(seed=seed, **parameters)``. It returns a table
        and must return the same whenever it is called: a mapping of columns, rows as
        mappings, one row, or a table of pyarrow, pandas or Polars.
    parameters : mapping
        Its arguments by name. A list is swept; for an argument that is a list, put it in a list.
    trials : int
        Seeds of each combination (cell).
    seed : int
        Seed of the first trial; the others have the following ones.
    batch : int
        Trials in a task.

    Raises
    ------
    TypeError, ValueError
        If a value breaks its rule, or there is no such study.

    Examples
    --------
    >>> from npend_gym import experiments
    >>> plan = experiments.SweepPlan("lyapunov", {"n": 2, "theta": [1.0, 2.0]}, trials=5)
    >>> plan.size
    10
    """

    study: str
    parameters: Mapping[str, Any] = field(default_factory=dict[str, Any])
    trials: int = 1
    seed: int = 0
    batch: int = 1

    tables = (ROWS,)
    unit = "trials"

    def __post_init__(self) -> None:
        text: Any = self.study
        if not (text in BUILT_IN or (isinstance(text, str) and all(text.partition(":")))):
            raise ValueError(
                f"study must be release, {', '.join(BUILT_IN)}, or a function of your own, "
                f'"module:function"; got {_checks.show(text)}'
            )
        take_count(self, "trials", high=tasks.MAX_TRIALS_PER_CELL)
        take_count(self, "seed", low=0, high=2**31 - 1)
        take_count(self, "batch", high=tasks.MAX_BATCH)
        if not isinstance(cast("Any", self.parameters), Mapping):
            raise TypeError(
                f"parameters must be names and values, got {_checks.show(self.parameters)}"
            )
        # sorted, so that equal plans have equal cells
        values = {str(name): _plain(str(name), self.parameters[name]) for name in self.parameters}
        object.__setattr__(self, "parameters", dict(sorted(values.items())))
        for name in _OWN:
            if name in self.parameters:
                raise ValueError(f"parameters must not have {name}: it is a column of every table")
        _checks.count(
            "the number of cells, the product of all lists,", self.cells, high=tasks.MAX_CELLS
        )
        self._check_task_count()

    @cached_property
    def _swept(self) -> dict[str, list[Any]]:
        """The values of each parameter."""
        given = self.parameters.items()
        return {name: value if isinstance(value, list) else [value] for name, value in given}

    @property
    def cells(self) -> int:
        """Number of combinations."""
        return math.prod(map(len, self._swept.values()))

    def cell(self, index: int) -> dict[str, Any]:
        """Return the parameters of the cell `index`; the last name varies fastest."""
        found: dict[str, Any] = {}
        for name, values in reversed(self._swept.items()):
            index, place = divmod(index, len(values))
            found[name] = values[place]
        return dict(reversed(found.items()))

    @property
    def task_count(self) -> int:
        """Number of tasks."""
        return -(-self.size // self.batch)

    def task(self, index: int) -> Task:
        """Return the task `index`, counted from 0."""
        return Task(index, index * self.batch, min((index + 1) * self.batch, self.size))

    def measure(self, task: Task) -> dict[str, Any]:
        """Return the table of a task: each row has the cell, the seed and the parameters."""
        function = function_of(self.study)
        found: list[Any] = []
        for trial in range(task.first, task.last):
            cell, number = divmod(trial, self.trials)
            values, seed = self.cell(cell), self.seed + number
            rows = as_table(function(seed=seed, **values))
            own = {"cell": pa.scalar(cell), "seed": pa.scalar(seed)}
            own |= {name: self._as_column(name, values[name]) for name in values}
            columns = {name: pa.repeat(value, len(rows)) for name, value in own.items()}
            for name, column in zip(rows.column_names, rows.columns, strict=True):
                if columns.setdefault(name, column).to_pylist() != column.to_pylist():
                    raise ValueError(
                        f"column {name} must have the value of the parameter, "
                        f"{own[name].as_py()}: give it another name"
                    )
            found.append(pa.table(columns))
        return {ROWS: pa.concat_tables(found, promote_options="permissive").combine_chunks()}

    def _as_column(self, name: str, value: Any) -> Any:
        """Return a parameter's value as all parts of the campaign have it."""
        values = self._swept[name]
        kinds: set[type[Any]] = {type(each) for each in values}
        if kinds <= {int, float}:
            return pa.scalar(float(value) if float in kinds else value)
        if len(kinds - {type(None)}) == 1 and kinds.isdisjoint({list, dict}):
            return pa.scalar(value, pa.array(values).type)
        return pa.scalar(value if isinstance(value, str) else json.dumps(value))

    def check_code(self) -> str:
        """Return the digest of the module of the function; see the base class.

        Raises
        ------
        ValueError, TypeError
            If there is no such function, it does not take the parameters, or its file is another.
        """
        function = function_of(self.study)
        try:
            inspect.signature(function).bind(seed=self.seed, **self.cell(0))
        except TypeError as error:
            raise TypeError(
                f"parameters must be those of {self.study}, beside its seed: {error}"
            ) from error
        if self.study in BUILT_IN:
            return ""  # the version stands for it
        try:
            file = inspect.getfile(inspect.unwrap(function))
        except TypeError:  # an object that can be called
            file = str(import_module(self.study.partition(":")[0]).__file__)
        found = _files.sha256(Path(file))
        if self.code not in (None, found):
            raise ValueError(
                f"the file of {self.study} has changed since the campaign began: choose another "
                "folder, or restore it"
            )
        return found or ""

    def as_dict(self) -> dict[str, Any]:
        """Return the plan as numbers, texts, lists and dicts."""
        return asdict(self)


def plan_of(values: Mapping[str, Any]) -> Plan:
    """Return the plan with `values`, such as those read from a file.

    Without a "study" it is that of releases.

    Raises
    ------
    TypeError, ValueError
        If a name is unknown or a value breaks its rule.
    """
    study = values.get("study", CampaignPlan.study)
    if study == CampaignPlan.study:
        given = {name: value for name, value in values.items() if name != "study"}
        return CampaignPlan.from_dict(given)
    tasks.check_names(values, (each.name for each in fields(SweepPlan)))
    return SweepPlan(**values)


def function_of(study: str) -> Callable[..., Any]:
    """Return the function of a study; the current folder may have its module."""
    module, _, name = (f"{_STUDIES}:{study}" if study in BUILT_IN else study).partition(":")
    if (here := str(Path.cwd())) not in sys.path:  # which a command is without
        sys.path.append(here)
    try:
        found = getattr(import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise ValueError(f"study must be a function that can be imported: {error}") from error
    if not callable(found):
        raise TypeError(f"study must be a function, {study} is {_checks.show(found)}")
    return found


def as_table(result: Any) -> Any:
    """Return the result of a study as a table of pyarrow; raise a TypeError where it is none."""
    shown = _checks.show(result)
    if isinstance(result, pa.Table) or hasattr(result, "__arrow_c_stream__"):
        return pa.table(result)
    rows: list[Any] = list(result) if isinstance(result, (list, tuple)) else [result]  # pyright: ignore[reportUnknownArgumentType]
    if not all(isinstance(one, Mapping) for one in rows):
        raise TypeError(
            "a study must return columns by name, a row, rows, or a table of pyarrow, pandas or "
            f"Polars; got {shown}"
        )
    if isinstance(result, Mapping) and any(np.ndim(value) for value in rows[0].values()):
        return pa.table({name: np.asarray(value) for name, value in rows[0].items()})
    names = dict.fromkeys(name for row in rows for name in row)
    return pa.table({name: [_item(row.get(name)) for row in rows] for name in names})


def _item(value: Any) -> Any:
    return cast("Any", value).item() if isinstance(value, np.generic) else value


def _plain(name: str, value: Any) -> Any:
    """Return a parameter as JSON has it: numbers, texts, lists and dicts."""
    try:
        text = json.dumps(
            list(value) if isinstance(value, range) else value,
            allow_nan=False,
            default=lambda one: np.asarray(one).tolist(),
        )
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"{name} must be numbers, texts, lists and names with values: {error}; got "
            f"{_checks.show(value)}"
        ) from error
    plain: Any = json.loads(text)
    if isinstance(plain, list):
        written: list[str] = [json.dumps(each) for each in cast("list[Any]", plain)]
        if not 0 < len(written) <= MAX_VALUES:
            raise ValueError(f"{name} must name 1 to {MAX_VALUES} values, got {len(written)}")
        if len({*written}) < len(written):
            raise ValueError(f"{name} must name each value once, got {_checks.show(value)}")
    return cast("Any", plain)
