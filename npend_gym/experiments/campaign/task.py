"""One task, as a worker runs it: its trials are drawn, measured and written."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.experiments import draws
from npend_gym.experiments.campaign.journal import Record
from npend_gym.experiments.campaign.parts import write_parts
from npend_gym.experiments.campaign.plan import CampaignPlan, Task
from npend_gym.period import pseudo_periods


@dataclass(frozen=True)
class WriteFailed:
    """In place of a record: the results could not be written, which is no fault of the task."""

    reason: str


def run_task(
    plan: CampaignPlan, out: Path, task: Task, lease: Path | None = None
) -> Record | WriteFailed:
    """Measure the releases of `task` and write them below `out`; return what to record.

    They are written under the `lease` of the driver, see `npend_gym.experiments.campaign.lease`.

    An error in the measurement is recorded, and the other tasks can continue.
    """
    started = time.process_time()
    try:
        starts, periods = measure_task(plan, task)
    except Exception as error:  # noqa: BLE001 - whatever it is, it is recorded
        return Record(plan.digest, task.id, error=f"{type(error).__name__}: {error}")
    try:
        digests = write_parts(plan, out, task, starts, periods, lease)
    except OSError as error:
        return WriteFailed(f"{error.strerror or error}: {error.filename or out}")
    return Record(plan.digest, task.id, digests, cpu_s=round(time.process_time() - started, 6))


def measure_task(plan: CampaignPlan, task: Task) -> tuple[FloatArray, FloatArray]:
    """Return the starting angles [rad], (R,), and pseudo-periods [s], (R, n), of a task."""
    trials = plan.trials
    cells = range(task.first // trials, -(-task.last // trials))
    starts: list[FloatArray] = []
    periods: list[FloatArray] = []
    for shared, group in groupby(map(plan.cell, cells), key=_without_start):
        first_start = len(starts)
        for cell in group:
            base = (cells.start + len(starts)) * trials
            first, last = max(task.first, base) - base, min(task.last, base + trials) - base
            starts.append(
                draws.starts(plan.seed, first, last - first, cell["amplitude"], cell["spread"])
            )
        angles = np.concatenate(starts[first_start:])
        periods.append(_periods(plan, angles, dict(shared)))
    return np.concatenate(starts), np.concatenate(periods)


def _without_start(cell: Mapping[str, Any]) -> tuple[tuple[str, Any], ...]:
    """Return the values that releases must share to be measured side by side."""
    return tuple((name, cell[name]) for name in cell if name not in ("amplitude", "spread"))


def _periods(plan: CampaignPlan, angles: FloatArray, cell: Mapping[str, Any]) -> FloatArray:
    theta = np.repeat(angles[:, None], cell["n"], axis=1)
    return pseudo_periods(
        plan.chain_of(cell), theta, reading=cell["reading"], duration=plan.duration
    )
