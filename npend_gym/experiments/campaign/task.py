"""One task, as a worker runs it: its trials are drawn, measured and written."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.experiments import release
from npend_gym.experiments.campaign.parts import write_parts
from npend_gym.experiments.campaign.plan import CampaignPlan, Task
from npend_gym.period import pseudo_periods


def run_task(plan: CampaignPlan, out: Path, task: Task) -> Path | str | OSError:
    """Measure the releases of `task` and write them below `out`; return their part of RELEASES.

    An error in the measurement is returned as a text, so that the other tasks continue; one of the
    disk, which is no fault of the task, as it is.
    """
    try:
        starts, periods = measure_task(plan, task)
    except Exception as error:  # noqa: BLE001 - whatever it is, it is told
        return f"{type(error).__name__}: {error}"
    try:
        return write_parts(plan, out, task, starts, periods)
    except OSError as error:
        return error


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
