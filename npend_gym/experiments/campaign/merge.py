"""A campaign's parts put together: one file for each table, and statistics of a sweep."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from npend_gym._checks import BoolArray
from npend_gym._provenance import provenance
from npend_gym.experiments.campaign.folder import Folder, open_folder
from npend_gym.experiments.campaign.parts import pa, pq, writer
from npend_gym.experiments.campaign.status import FolderStatus, check_folder, parts_of, read_plan
from npend_gym.experiments.campaign.sweep import ROWS, SweepPlan
from npend_gym.experiments.campaign.tasks import Plan

_ROWS = 1 << 17  # rows in a group of a merged file, at least
STATISTICS = ("column", "count", "mean", "sd", "min", "max")


@dataclass(frozen=True)
class Summary:
    """The state of a sweep's folder, and statistics of its numbers.

    Attributes
    ----------
    plan : SweepPlan
    out : Path
    status : FolderStatus
    rows : list of dict
        One for every cell, text that the study returned, and column of numbers: the cell, its
        parameters, the texts, the column, and its count, mean, standard deviation, minimum and
        maximum over the trials.
    """

    plan: SweepPlan
    out: Path
    status: FolderStatus
    rows: list[dict[str, Any]]


def read_status(out: Path | str) -> tuple[Plan, Folder, FolderStatus]:
    """Return the plan of a campaign, its folder, and what is done there; change nothing.

    Raises
    ------
    ValueError
        If there is no campaign in `out`.
    """
    folder = open_folder(out)
    plan = read_plan(folder)
    if plan is None:
        raise ValueError(
            f"there is no campaign in {folder}: npend campaign --out {folder} makes one"
        )
    return plan, folder, check_folder(plan, folder)


def merge(plan: Plan, folder: Folder, status: FolderStatus) -> list[str]:
    """Write each table of a campaign that is complete as one file; return their names.

    The rows are in the order of the plan, and never in memory together.

    Raises
    ------
    ValueError
        If a task is missing.
    """
    if missing := plan.task_count - status.count:
        first = int(status.done.argmin())
        raise ValueError(
            f"all tasks must be done before a merge, {missing} of {plan.task_count} are missing in "
            f"{folder}, the first is {plan.task(first).id}: npend campaign --out {folder} continues"
        )
    about = provenance({"plan": plan.digest, "study": plan.study}, plan.seed)
    names = [f"{table}.parquet" for table in plan.tables]
    for table, name in zip(plan.tables, names, strict=True):
        schema: Any = None
        for part in _parts(plan, folder, table, status.done):
            own = part.schema_arrow.remove_metadata()
            found = own if schema is None else pa.unify_schemas(
                [schema, own], promote_options="permissive"
            )  # fmt: skip
            schema = found
        with folder.writing(name) as file, writer(file, schema, about) as out:
            waiting: list[Any] = []
            for part in _parts(plan, folder, table, status.done):
                waiting.append(_as(part.read(use_threads=False), schema))
                if sum(map(len, waiting)) >= _ROWS:
                    out.write_table(pa.concat_tables(waiting))
                    waiting.clear()
            if waiting:
                out.write_table(pa.concat_tables(waiting))
    return names


def _parts(plan: Plan, folder: Folder, table: str, done: BoolArray) -> Iterator[Any]:
    """Yield the parts of a table, checked, as files of Parquet."""
    for _, name in parts_of(plan, folder, table, done):
        data = folder.read_part(plan.digest, name)
        if data is None:
            raise ValueError(f"{folder.at(name)} has been damaged: npend campaign repairs it")
        yield pq.ParquetFile(pa.BufferReader(data))


def _as(table: Any, schema: Any) -> Any:
    """Return a table with these columns, with nulls where it has none."""
    columns = [
        table[each.name].cast(each.type)
        if each.name in table.column_names
        else pa.nulls(len(table), each.type)
        for each in schema
    ]
    return pa.table(columns, schema=schema)


def summary(plan: SweepPlan, folder: Folder, done: BoolArray) -> list[dict[str, Any]]:
    """Return the rows of a `Summary`, from one part in memory at a time."""
    found: dict[tuple[Any, ...], list[float]] = {}
    for part in _parts(plan, folder, ROWS, done):
        table = part.read(use_threads=False)
        given = {"cell", "seed", *plan.parameters}
        own = [each for each in table.schema if each.name not in given]
        texts = [each.name for each in own if pa.types.is_string(each.type)]
        for each in own:
            if pa.types.is_boolean(each.type):
                place = table.column_names.index(each.name)
                table = table.set_column(place, each.name, table[each.name].cast("int8"))
            elif not (pa.types.is_integer(each.type) or pa.types.is_floating(each.type)):
                continue
            kinds = "count", "mean", "variance", "min", "max"
            grouped = table.group_by(["cell", *texts]).aggregate([(each.name, k) for k in kinds])
            for row in grouped.to_pylist():
                key = (row["cell"], *((name, row[name]) for name in texts), each.name)
                if row[f"{each.name}_count"]:
                    new = [float(row[f"{each.name}_{kind}"]) for kind in kinds]
                    found[key] = _joined(found[key], new) if key in found else new
    rows: list[dict[str, Any]] = []
    for (cell, *texts, column), (count, mean, variance, low, high) in sorted(
        found.items(), key=lambda item: (item[0][0], repr(item[0][1:]))
    ):
        sd = math.sqrt(variance * count / (count - 1.0)) if count > 1.0 else math.nan
        numbers = [column, int(count), mean, sd, low, high]
        values = {"cell": cell} | plan.cell(cell) | dict(texts)
        rows.append(values | dict(zip(STATISTICS, numbers, strict=True)))
    return rows


def _joined(one: list[float], other: list[float]) -> list[float]:
    """Return count, mean, variance, minimum and maximum of two samples together."""
    (n, mean, variance, *_), (m, mean_2, variance_2, *_) = one, other
    total, step = n + m, mean_2 - mean
    spread = (n * variance + m * variance_2) / total + n * m * (step / total) ** 2
    return [total, mean + step * m / total, spread, min(one[3], other[3]), max(one[4], other[4])]
