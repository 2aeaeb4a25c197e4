"""What a campaign would take: tasks, time and bytes, before anything is released."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.experiments.campaign.tasks import Plan
from npend_gym.experiments.studies.release_plan import CampaignPlan
from npend_gym.period import pseudo_periods

# Time of a release over that of one of five rods, side by side, measured; in between it grows as a
# power of n, and beyond as the last two entries do
_RODS, _TIMES = (1, 2, 5, 10, 20, 50, 100), (0.22, 0.37, 1.0, 2.7, 9.2, 59.0, 252.0)
# Cells that are timed, releases of each, and rods of their chain, at most
_CELLS, _SAMPLE, _LONGEST_CHAIN = 16, 16, 20
# Bytes of a release, of a bob, and of the two parts of a task, measured
_OF_RELEASE, _OF_BOB, _OF_TASK = 32.0, 8.5, 5000.0


@dataclass(frozen=True)
class CampaignEstimate:
    """What a campaign would take, within a factor of two."""

    plan: CampaignPlan
    seconds: float  # on one core of this machine
    size: float  # bytes of the results

    def text(self, workers: int) -> str:
        """Return a line for a number of workers."""
        plan = self.plan
        return (
            f"{counts_text(plan)}: about "
            f"{duration(self.seconds)} on one core, {duration(self.seconds / workers)} with "
            f"{workers} worker(s), and {bytes_text(self.size)} of results"
        )


def counts_text(plan: Plan) -> str:
    """Return how much a plan is, in numbers alone."""
    return f"{plan.cells} cells, {plan.size} {plan.unit} in {plan.task_count} tasks"


def estimate(plan: CampaignPlan) -> CampaignEstimate:
    """Estimate time and space of a campaign on this machine, from some timed releases."""
    counts = np.array(plan.n).reshape(-1)
    per_n = plan.releases // counts.size
    seconds = per_n * float(relative_time(counts).sum()) * _time_of_five_rods(plan)
    size = per_n * float((_OF_RELEASE + _OF_BOB * counts).sum()) + _OF_TASK * plan.task_count
    return CampaignEstimate(plan, seconds, size)


def relative_time(n: NDArray[np.int64]) -> FloatArray:
    """Return the time of a release of n rods over that of one of five rods."""
    known, times = np.log(_RODS), np.log(_TIMES)
    slope = (times[-1] - times[-2]) / (known[-1] - known[-2])
    beyond = np.maximum(np.log(n) - known[-1], 0.0)
    return np.exp(np.interp(np.log(n), known, times) + slope * beyond)


def _time_of_five_rods(plan: CampaignPlan) -> float:
    """Return the time of a release of five rods [s], as a mean over cells drawn from the plan."""
    drawn = np.random.default_rng(0).permutation(plan.cells)[:_CELLS]
    return float(np.mean([_time_in_cell(plan, plan.cell(int(index))) for index in drawn]))


def _time_in_cell(plan: CampaignPlan, cell: Mapping[str, Any]) -> float:
    """Return the time of a release [s] in a cell, over the relative time of its rods."""
    chain = plan.chain_of(cell)
    if chain.n > _LONGEST_CHAIN and chain.stiffness is None:
        length, damping = float(chain.lengths.mean()), float(chain.damping.mean())
        chain = type(chain).uniform(_LONGEST_CHAIN, 1.0, length, chain.gravity, damping)
    theta = np.full((_SAMPLE, chain.n), cell["amplitude"])
    taken = 0.0
    for _ in range(2):  # the first may compile
        began = time.process_time()
        pseudo_periods(chain, theta, definition=cell["definition"], duration=plan.duration)
        taken = time.process_time() - began
    return taken / _SAMPLE / float(relative_time(np.array([chain.n]))[0])


def duration(seconds: float) -> str:
    """Return a time with a unit that people count in."""
    for unit, size in (("years", 31_557_600.0), ("days", 86_400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.2g} s"


def bytes_text(size: float) -> str:
    """Return a number of bytes with a unit."""
    for unit, one in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6)):
        if size >= one:
            return f"{size / one:.3g} {unit}"
    return f"{size / 1e3:.3g} kB"
