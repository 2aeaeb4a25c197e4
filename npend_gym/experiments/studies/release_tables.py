"""The tables of the study "release": made by tasks, read by the analysis."""

from __future__ import annotations

import json
from collections.abc import Mapping
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks, theory
from npend_gym._checks import FloatArray
from npend_gym.experiments import release
from npend_gym.experiments.campaign.folder import Folder
from npend_gym.experiments.campaign.parts import pa, pq
from npend_gym.experiments.campaign.tasks import Task
from npend_gym.experiments.studies.release_plan import BOBS, OF_CHAIN, RELEASES, CampaignPlan
from npend_gym.period import pseudo_periods

_PERIODS = ("mean_s", "median_s", "tip_s")
_RELEASE = pa.schema(  # a row of RELEASES
    [
        ("n", pa.int32()), ("cell", pa.int64()), ("trial", pa.int64()), ("start_rad", pa.float64()),
        ("completed", pa.int32()), *((name, pa.float64()) for name in _PERIODS),
    ]
)  # fmt: skip
# The description of a file that is not trusted may take so much memory
_THRIFT = {"thrift_string_size_limit": 1_000_000, "thrift_container_size_limit": 10_000}


def measure_task(plan: CampaignPlan, task: Task) -> tuple[FloatArray, FloatArray]:
    """Return the starting angles [rad], (R,), and pseudo-periods [s], (R, n), of a task."""
    cells = range(task.first // plan.trials, -(-task.last // plan.trials))
    starts: list[FloatArray] = []
    periods: list[FloatArray] = []
    for shared, group in groupby(cells, key=lambda cell: _without_start(plan.cell(cell))):
        angles = np.concatenate([_starts(plan, task, cell) for cell in group])
        starts.append(angles)
        periods.append(_periods(plan, angles, dict(shared)))
    return np.concatenate(starts), np.concatenate(periods)


def _without_start(cell: Mapping[str, Any]) -> tuple[tuple[str, Any], ...]:
    """Return the values that releases must share to be measured side by side."""
    return tuple((name, cell[name]) for name in cell if name not in ("amplitude", "spread"))


def _starts(plan: CampaignPlan, task: Task, index: int) -> FloatArray:
    """Return the starting angles [rad] of the releases of a cell that are in the task."""
    cell, base = plan.cell(index), index * plan.trials
    first, last = max(task.first - base, 0), min(task.last - base, plan.trials)
    return release.starts(plan.seed, first, last - first, cell["amplitude"], cell["spread"])


def _periods(plan: CampaignPlan, angles: FloatArray, cell: Mapping[str, Any]) -> FloatArray:
    theta = np.repeat(angles[:, None], cell["n"], axis=1)
    return pseudo_periods(
        plan.chain_of(cell), theta, definition=cell["definition"], duration=plan.duration
    )


def tables_of(plan: CampaignPlan, task: Task) -> dict[str, Any]:
    """Return the tables of a task."""
    starts, periods = measure_task(plan, task)
    return {RELEASES: _releases(plan, task, starts, periods), BOBS: _bobs(plan, task, periods)}


def _releases(plan: CampaignPlan, task: Task, starts: FloatArray, periods: FloatArray) -> Any:
    """Return the table with a row for every release."""
    cell, trial = _places(plan, task)
    done = np.isfinite(periods)
    count = done.sum(axis=1)
    total = np.where(done, periods, 0.0).sum(axis=1)
    ordered = np.sort(periods, axis=1)  # NaN last: a bob that does not complete is the slowest
    n = periods.shape[1]
    median = 0.5 * (ordered[:, (n - 1) // 2] + ordered[:, n // 2])
    return pa.table(
        {
            "n": np.full(len(cell), plan.n_of(task), np.int32),
            "cell": cell,
            "trial": trial,
            "start_rad": starts,
            "completed": count,
            "mean_s": _nullable(total / np.where(count, count, np.nan)),
            "median_s": _nullable(median),
            "tip_s": _nullable(periods[:, -1]),
        },
        schema=_RELEASE,
    )


def _bobs(plan: CampaignPlan, task: Task, periods: FloatArray) -> Any:
    """Return the table with a row for every release and bob, bobs counted from 1 at the pivot."""
    cell, trial = _places(plan, task)
    count, n = periods.shape
    return pa.table(
        {
            "n": np.full(count * n, n, np.int32),
            "cell": np.repeat(cell, n),
            "trial": np.repeat(trial, n),
            "bob": np.tile(np.arange(1, n + 1, dtype=np.int32), count),
            "pseudo_period_s": _nullable(periods.ravel()),
        }
    )


def _places(plan: CampaignPlan, task: Task) -> tuple[Any, Any]:
    cell, trial = np.divmod(np.arange(task.first, task.last), plan.trials)
    return cell, trial + 1


def _nullable(values: FloatArray) -> Any:
    """Return the values with null for NaN: a bob that does not complete has no pseudo-period."""
    return pa.array(values, mask=np.isnan(values))


def cells_table(plan: CampaignPlan) -> Any:
    """Return a table of the cells: the values of each, with the models' periods [s]."""
    cells = [plan.cell(index) for index in range(plan.cells)]
    known: dict[Any, dict[str, Any]] = {}
    chains: list[dict[str, Any]] = []
    for cell in cells:
        key = tuple(cell[name] for name in OF_CHAIN if name in cell)
        if key not in known:
            known[key] = _chain_columns(plan, cell)
        chains.append(known[key])
    columns: dict[str, Any] = {"cell": np.arange(plan.cells)}
    columns |= {name: [row[name] for row in chains] for name in chains[0]}
    columns |= {
        "definition": [cell["definition"] for cell in cells],
        "amplitude_rad": [cell["amplitude"] for cell in cells],
        "spread_rad": [cell["spread"] for cell in cells],
    }
    return pa.table(columns)


def _chain_columns(plan: CampaignPlan, cell: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of the releases of a cell; the chain of the plan, if any, whole as JSON."""
    chain = plan.chain_of(cell)
    ideal = theory.ideal_period(chain) if chain.has_bobs and chain.is_hung else np.nan
    fundamental = theory.fundamental_period(chain) if chain.is_hung else np.nan
    own = {"chain": json.dumps(chain.as_dict())} if plan.chain is not None else {}
    return {
        "n": chain.n,
        "masses_kg": chain.masses.tolist(),
        "lengths_m": chain.lengths.tolist(),
        "gravity_m_s2": chain.gravity,
        "damping_nms": cell["damping"] if "damping" in cell else chain.damping.tolist(),
        "fundamental_s": finite_or_none(fundamental),
        "ideal_s": finite_or_none(ideal),
        **own,
    }


def finite_or_none(value: float) -> float | None:
    """Return `value`, or None where it is not a number."""
    return value if np.isfinite(value) else None


def read_releases(
    plan: CampaignPlan, folder: Folder, part: str, task: Task
) -> dict[str, NDArray[Any]]:
    """Return the columns of a task's part of RELEASES by name, all of it checked; NaN is null."""
    try:
        table = _read_bounded(plan, folder, part, task.size)
        columns = {name: table[name].to_numpy() for name in _RELEASE.names}
        for name, values in columns.items():
            if np.isnan(values).sum() != table[name].null_count:
                raise ValueError(f"its {name} is NaN where it should be null")
        _check_releases(plan, task, columns)
    except (pa.ArrowException, OSError, ValueError, LookupError) as error:  # as pyarrow likes
        first = str(error).partition("\n")[0] or type(error).__name__
        raise ValueError(f"{folder.at(part)} is no part of this campaign: {first}") from error
    return columns


def _read_bounded(plan: CampaignPlan, folder: Folder, part: str, rows: int) -> Any:
    """Return a part as a table, if it takes no more memory than this number of rows needs."""
    data = folder.read_part(plan.digest, part, len(_RELEASE) * (16 * rows + 4096))
    if data is None:  # pyarrow may end the process on damage
        raise ValueError("its size or its bytes are not those that its name says")
    file = pq.ParquetFile(pa.BufferReader(data), **_THRIFT)
    if not file.schema_arrow.equals(_RELEASE):
        wanted, got = (
            [f"{each.name}: {each.type}" for each in one] for one in (_RELEASE, file.schema_arrow)
        )
        raise ValueError(f"its columns must be {', '.join(wanted)}; got {_checks.show(got)}")
    about = file.metadata
    if about.num_rows != rows or about.num_row_groups != 1:
        raise ValueError(f"it must have {rows} rows in one group, got {about.num_rows}")
    columns = map(about.row_group(0).column, range(len(_RELEASE)))
    if any(column.compression != "UNCOMPRESSED" for column in columns):
        raise ValueError("its columns must not be compressed")
    return file.read(use_threads=False)


def _check_releases(plan: CampaignPlan, task: Task, columns: dict[str, NDArray[Any]]) -> None:
    """Refuse values that no release has."""
    cell, trial = _places(plan, task)
    present, place = np.unique(cell, return_inverse=True)
    cells = [plan.cell(each) for each in present.tolist()]
    low, width = (np.array([c[name] for c in cells])[place] for name in ("amplitude", "spread"))
    start, completed = columns["start_rad"], columns["completed"]
    right = {
        "n": columns["n"] == plan.n_of(task),
        "cell": columns["cell"] == cell,
        "trial": columns["trial"] == trial,
        "start_rad": (start >= low) & (start <= low + width),
        "completed": (completed >= 0) & (completed <= plan.n_of(task)),
    }
    for name in _PERIODS:
        period = columns[name]
        right[name] = np.isnan(period) | ((period > 0.0) & (period <= _checks.LARGEST))
    for name, each in right.items():
        if not each.all():
            row = int(np.argmin(each))
            raise ValueError(f"its {name} is {columns[name][row]} in row {row}")
