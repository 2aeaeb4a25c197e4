"""The tables of a campaign: Parquet parts, written whole, each known by its SHA-256."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from npend_gym import _extras, _files, theory
from npend_gym._checks import FloatArray
from npend_gym._provenance import provenance
from npend_gym.experiments.campaign.plan import CampaignPlan, Task

pa: Any = _extras.require("pyarrow", "campaign", "campaigns")  # it has no types
pq: Any = _extras.require("pyarrow.parquet", "campaign", "campaigns")

RELEASES, BOBS = "releases", "bobs"
TABLES = (RELEASES, BOBS)


def write_parts(
    plan: CampaignPlan, out: Path, task: Task, starts: FloatArray, periods: FloatArray
) -> dict[str, str]:
    """Write the parts of a task, whole or not at all; return table -> SHA-256."""
    about = provenance({"plan": plan.digest, "task": task.id}, plan.seed)
    tables = {
        RELEASES: _releases(plan, task, starts, periods),
        BOBS: _bobs(plan, task, periods),
    }
    return {name: _write(table, out / name / task.part, about) for name, table in tables.items()}


def _releases(plan: CampaignPlan, task: Task, starts: FloatArray, periods: FloatArray) -> Any:
    """Return the table with a row for every release."""
    cell, trial = _places(plan, task)
    done = np.isfinite(periods)
    count = done.sum(axis=1)
    total = np.where(done, periods, 0.0).sum(axis=1)
    ordered = np.sort(periods, axis=1)  # NaN last
    rows = np.arange(len(periods))
    median = 0.5 * (ordered[rows, (count - 1) // 2] + ordered[rows, count // 2])
    return pa.table(
        {
            "cell": cell,
            "trial": trial,
            "start_rad": starts,
            "completed": count.astype(np.int32),
            "mean_s": _nullable(total / np.where(count, count, np.nan)),
            "median_s": _nullable(median),
            "tip_s": _nullable(periods[:, -1]),
        }
    )


def _bobs(plan: CampaignPlan, task: Task, periods: FloatArray) -> Any:
    """Return the table with a row for every release and bob, bobs counted from 1 at the pivot."""
    cell, trial = _places(plan, task)
    count, n = periods.shape
    return pa.table(
        {
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


def _write(table: Any, path: Path, about: dict[str, Any]) -> str:
    """Write `table` to `path` and return the SHA-256 of the file."""
    sink = pa.BufferOutputStream()
    table = table.replace_schema_metadata({"npend_gym": json.dumps(about, sort_keys=True)})
    pq.write_table(table, sink, compression="zstd", use_dictionary=False)
    data = sink.getvalue().to_pybytes()
    _files.make_folder(path.parent)
    with _files.replacing(path, binary=True) as file:
        file.write(data)
    return hashlib.sha256(data).hexdigest()


def write_cells(plan: CampaignPlan, path: Path) -> None:
    """Write what every cell number stands for, with the models' periods [s]."""
    cells = [plan.cell(index) for index in range(plan.cells)]
    known: dict[Any, dict[str, Any]] = {}
    chains: list[dict[str, Any]] = []
    for cell in cells:
        key = tuple(cell[name] for name in _CHAIN if name in cell)
        if key not in known:
            known[key] = _chain_columns(plan, cell)
        chains.append(known[key])
    columns: dict[str, Any] = {"cell": np.arange(plan.cells)}
    columns |= {name: [row[name] for row in chains] for name in chains[0]}
    columns |= {
        "reading": [cell["reading"] for cell in cells],
        "amplitude_rad": [cell["amplitude"] for cell in cells],
        "spread_rad": [cell["spread"] for cell in cells],
    }
    _write(pa.table(columns), path, provenance({"plan": plan.digest}, plan.seed))


_CHAIN = ("n", "masses", "lengths", "gravity", "damping")


def _chain_columns(plan: CampaignPlan, cell: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a cell releases; the chain of the plan, where it has one, whole as JSON."""
    chain = plan.chain_of(cell)
    ideal = theory.ideal_period(chain) if chain.has_bobs else np.nan
    own = {"chain": json.dumps(chain.as_dict())} if plan.chain is not None else {}
    return {
        "n": chain.n,
        "masses_kg": chain.masses.tolist(),
        "lengths_m": chain.lengths.tolist(),
        "gravity_m_s2": chain.gravity,
        "damping_nms": cell["damping"] if "damping" in cell else chain.damping.tolist(),
        "fundamental_s": finite_or_none(theory.fundamental_period(chain)),
        "ideal_s": finite_or_none(ideal),
        **own,
    }


def finite_or_none(value: float) -> float | None:
    """Return `value`, or None where it is not a number."""
    return value if np.isfinite(value) else None


def read_part(path: Path, columns: Sequence[str] | None = None) -> Any:
    """Return a part as a pyarrow table, without the columns that its path stands for."""
    return pq.ParquetFile(path).read(columns=columns)
