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
from npend_gym.experiments import release
from npend_gym.experiments.campaign.parts import write_parts
from npend_gym.experiments.campaign.plan import CampaignPlan, Task
from npend_gym.period import pseudo_periods


@dataclass(frozen=True)
class Record:
    """What became of a task.

    Attributes
    ----------
    task : str
        Id of the task.
    error : str
        What went wrong in it, empty where nothing did.
    cpu_s : float
        CPU time that it took [s].
    disk_error : str
        Why the results could not be written, which is no fault of the task.
    part : Path, optional
        The task's part of RELEASES, where it is written.
    """

    task: str
    error: str = ""
    cpu_s: float = 0.0
    disk_error: str = ""
    part: Path | None = None

    @property
    def done(self) -> bool:
        """Whether the task was measured."""
        return not self.error


def run_task(plan: CampaignPlan, out: Path, task: Task) -> Record:
    """Measure the releases of `task` and write them below `out`; return what became of it.

    An error in the measurement is returned, and the other tasks can continue.
    """
    started = time.process_time()
    try:
        starts, periods = measure_task(plan, task)
    except Exception as error:  # noqa: BLE001 - whatever it is, it is told
        return Record(task.id, f"{type(error).__name__}: {error}")
    try:
        part = write_parts(plan, out, task, starts, periods)
    except OSError as error:
        reason = f"{error.strerror or error}: {error.filename or out}"
        return Record(task.id, disk_error=reason)
    return Record(task.id, cpu_s=round(time.process_time() - started, 6), part=part)


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
        plan.chain_of(cell), theta, reading=cell["reading"], duration=plan.duration
    )
