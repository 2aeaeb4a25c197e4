"""What surrounds the steps of double pendulums, on one thread: starts of episodes, early ends.

The package is compared with itself: the ratio of a row is that of an environment which does more
to one which does less, all actions being random.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import count
from typing import Any

import gymnasium as gym

from suites.environments import OURS, compared, ours
from suites.timing import Job, Peers, Row, rates

LANES = 1024
MANY = 65_536


def rows(peers: Peers) -> Iterator[Row]:
    """Yield the rows; there are no peers, for none offers the same."""
    del peers
    yield seeds()
    yield from early_ends()


def repeated(function: Callable[[], object], items_per_call: float) -> Job:
    """Return the job of calling a function without arguments."""

    def run(calls: int) -> None:
        for _ in range(calls):
            function()

    return Job(run, items_per_call)


def seeds() -> Row:
    """Return the row of a reset that seeds every one of many lanes."""
    envs: Any = gym.make_vec(OURS, num_envs=MANY)
    seed = count()
    best = rates({"": repeated(lambda: envs.reset(seed=next(seed)), MANY)})[""]
    return Row(f"reset(seed) of {MANY} lanes", "", best, math.nan, f"{MANY / best:.3g} s a call")


def early_ends() -> Iterator[Row]:
    """Yield the rows of episodes that end after some dozen steps, beside those of 1000 steps."""
    for substeps in (None, 1):
        options = {"dt": 0.02, "substeps": substeps}
        name = f"balance, {LANES} lanes, dt 0.02 s, substeps {substeps or 'by default'}"
        jobs = {name: ours(LANES, mode="balance", **options)}
        yield from compared(jobs, {"swingup": ours(LANES, mode="swingup", **options)})
