"""One task: its releases drawn, measured and written. This is what workers run."""

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
from npend_gym.experiments.campaign.plan import Plan, Task
from npend_gym.experiments.release import Release
from npend_gym.period import pseudo_periods


@dataclass(frozen=True)
class Unwritten:
    """In place of a record: the disk, not the task, is in trouble."""

    reason: str


def carry_out(plan: Plan, out: Path, task: Task) -> Record | Unwritten:
    """Measure the releases of `task` and write them below `out`; return what to record.

    What goes wrong in the measurement is recorded; the other tasks can go on.
    """
    started = time.process_time()
    try:
        starts, periods = measured(plan, task)
    except Exception as error:  # noqa: BLE001 - whatever it is, it is recorded
        return Record(plan.digest, task.id, error=f"{type(error).__name__}: {error}")
    try:
        digests = write_parts(plan, out, task, starts, periods)
    except OSError as error:
        return Unwritten(f"{error.strerror or error}: {error.filename or out}")
    return Record(plan.digest, task.id, digests, cpu_s=round(time.process_time() - started, 6))


def measured(plan: Plan, task: Task) -> tuple[FloatArray, FloatArray]:
    """Return the starting angles [rad], (R,), and pseudo-periods [s], (R, n), of a task."""
    trials = plan.trials
    cells = range(task.first // trials, -(-task.last // trials))
    starts: list[FloatArray] = []
    periods: list[FloatArray] = []
    for physics, group in groupby(map(plan.cell, cells), key=_physics):
        angles: list[FloatArray] = []
        for cell in group:
            base = (cells.start + len(starts)) * trials
            first, last = max(task.first, base) - base, min(task.last, base + trials) - base
            angles.append(
                draws.starts(plan.seed, first, last - first, cell["amplitude"], cell["spread"])
            )
            starts.append(angles[-1])
        periods.append(_periods(dict(physics), np.concatenate(angles), plan.duration))
    return np.concatenate(starts), np.concatenate(periods)


def _physics(cell: Mapping[str, Any]) -> tuple[tuple[str, Any], ...]:
    """Return what releases must share to be measured side by side."""
    return tuple((name, cell[name]) for name in cell if name not in ("amplitude", "spread"))


def _periods(physics: dict[str, Any], angles: FloatArray, duration: float | None) -> FloatArray:
    n, reading = physics.pop("n"), physics.pop("reading")
    chain = Release(n_values=(n,), **physics).chain(n)
    theta = np.repeat(angles[:, None], n, axis=1)
    return pseudo_periods(chain, theta, reading=reading, duration=duration)
