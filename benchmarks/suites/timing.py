"""Jobs timed in turns, peers that may be missing, and the rows of results."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import NamedTuple, TypeVar

from npend_gym import tools

ROUNDS = 15  # a machine shared with others is quiet for moments only
SECONDS = 0.15  # CPU time of a job in a round, at least
_PEERS = ("mujoco", "pin", "envpool", "gymnax", "jax", "brax", "mujoco-mjx", "heyoka", "diffrax")

_T = TypeVar("_T")


class Job(NamedTuple):
    """Something to be timed: `run(calls)` makes this many calls."""

    run: Callable[[int], object]
    items_per_call: float = 1.0  # what is counted, such as environments stepped
    repeat: int = 1  # the number of calls must be a multiple of it, as with whole episodes
    wall: bool = False  # count wall time instead of CPU time, as for several threads


class Row(NamedTuple):
    """One comparison; `note` says what else was found."""

    job: str
    peer: str  # "" where there is none
    ours_per_s: float
    peer_per_s: float  # NaN where there is no peer
    note: str = ""

    @property
    def ratio(self) -> float:
        """How many times as fast as the peer."""
        return self.ours_per_s / self.peer_per_s


class Peers:
    """Makes the jobs of peers. One that fails is left out from then on; why is reported once."""

    def __init__(self, report: Callable[[str], None]) -> None:
        self.report = report
        self.failed: set[str] = set()

    def get(self, name: str, make: Callable[[], _T]) -> _T | None:
        """Return what `make` returns, or None where it raises: a job, or a function to be timed.

        Importing a peer may fail in any way: it is missing, or a library that it needs is, or
        its binary was built for another version of one.
        """
        if name in self.failed:
            return None
        try:
            return make()
        except Exception as error:  # noqa: BLE001
            self.failed.add(name)
            self.report(f"{name} is left out: {type(error).__name__}: {error}")
            return None

    def job(self, name: str, make: Callable[[], Job]) -> Job | None:
        """Return the job that `make` returns, having run it once, or None where that fails."""

        def make_and_run() -> Job:
            job = make()
            job.run(1)
            return job

        return self.get(name, make_and_run)


def rates(jobs: dict[str, Job], rounds: int = ROUNDS) -> dict[str, float]:
    """Return the best items per second of each job, the jobs taking turns."""
    calls: dict[str, int] = {}
    for name, job in jobs.items():
        job.run(1)  # compiles
        count, took = 1, seconds(job, 1)
        while took < SECONDS / 10 and count < 2**30:
            count *= 2
            took = seconds(job, count)
        calls[name] = max(1, math.ceil(count * SECONDS / took / job.repeat)) * job.repeat
    best = dict.fromkeys(jobs, 0.0)
    for _ in range(rounds):
        for name, job in jobs.items():
            took = seconds(job, calls[name])
            best[name] = max(best[name], calls[name] * job.items_per_call / took)
    return best


def seconds(job: Job, calls: int) -> float:
    """Return the CPU time of this many calls, or the wall time where that is less.

    It is less where threads wait for each other by spinning, as those of some peers do.
    """
    begin, wall = time.process_time(), time.perf_counter()
    job.run(calls)
    if job.wall:
        return time.perf_counter() - wall
    return min(time.process_time() - begin, time.perf_counter() - wall)


def timed(run: Callable[[], _T]) -> tuple[_T, float]:
    """Return what a function returns, and its CPU time."""
    begin = time.process_time()
    return run(), time.process_time() - begin


def machine() -> str:
    """Return the versions of everything that is compared, and the processor."""
    return tools.machine(_PEERS)
