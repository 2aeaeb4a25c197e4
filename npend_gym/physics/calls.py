"""How work on many groups of chains is divided into compiled calls, and over threads."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym._threads import Call, Crew, each_once
from npend_gym.physics.kernels.advance import MAX_PARTS
from npend_gym.physics.kernels.layout import Timing

_RODS_PER_CALL = 2_000_000  # rods times substeps in one compiled call: some tenths of a second
_CHUNKS = 4  # of a thread's share in a step: with fewer, all wait longer for the last one
_SPAN = [Timing.FIRST_GROUP, Timing.LAST_GROUP, Timing.FIRST_SUBSTEP, Timing.LAST_SUBSTEP]


class Cut(NamedTuple):
    """How a step is cut."""

    dt: float  # s
    substeps: int
    max_rotation: float  # rad: a substep in which a rod would turn by more is cut again


class CallPlan(NamedTuple):
    """How a step of all groups is divided into compiled calls."""

    substeps: int
    total: int  # groups
    groups: int  # in one call
    piece: int  # substeps of one call
    whole: bool  # whether one call does it all
    timing: list[FloatArray]  # of each thread


def plan_of(cut: Cut, rods: int, groups: int, threads: int, *, at_once: bool = False) -> CallPlan:
    """Return a plan for groups with `rods` each; all substeps of a group may be taken `at_once`."""
    dt, substeps, max_rotation = cut
    most = rods * (1 if math.isinf(max_rotation) else int(MAX_PARTS))
    piece = max(1, _RODS_PER_CALL // most)  # substeps of a group
    share = groups if threads == 1 else -(-groups // (_CHUNKS * threads))
    each = max(1, min(piece // max(1, substeps), share))
    piece = max(1, substeps if at_once else min(piece, substeps))
    timing = np.zeros((threads, len(Timing)))
    timing[:] = dt, substeps, 1.0 / max_rotation, 0.0, groups, 0.0, substeps
    return CallPlan(substeps, groups, each, piece, each >= groups and piece >= substeps, [*timing])


def run(
    kernel: Callable[..., None], arrays: tuple[Any, ...], plan: CallPlan, crew: Crew,
    work: Sequence[FloatArray],
) -> None:  # fmt: skip
    """Call ``kernel(*arrays, timing, work)`` for all groups, with work space for each thread.

    Large steps are divided over threads, and over calls so short that Ctrl-C takes effect
    between them. The caller must check whether one was interrupted.
    """
    if plan.whole:
        kernel(*arrays, plan.timing[0], work[0])
        return
    chunks = deque(range(0, plan.total, plan.groups))

    def share(thread: int, call: Call | None) -> None:
        timing = plan.timing[thread]
        for first in each_once(chunks):  # threads share them
            last = min(first + plan.groups, plan.total)
            for begin in range(0, max(1, plan.substeps), plan.piece):
                timing[_SPAN] = first, last, begin, min(begin + plan.piece, plan.substeps)
                kernel(*arrays, timing, work[thread])
                if call is not None and call.stopped:
                    return

    crew.run(share, plan.total)
