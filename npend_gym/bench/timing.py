"""Jobs timed in turns, and the rows of results."""

from __future__ import annotations

import math
import platform
import time
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

ROUNDS = 15  # a machine shared with others is quiet for moments only
SECONDS = 0.15  # CPU time of a job in a round, at least
_PACKAGES = (
    "npend_gym", "numba", "numpy", "scipy", "gymnasium", "mujoco", "pin", "envpool", "gymnax",
    "jax", "heyoka", "diffrax",
)  # fmt: skip


class Job(NamedTuple):
    """Something to be done many times."""

    take: Callable[[int], object]  # so many calls
    units: float = 1.0  # of work in each call, such as environments stepped
    multiple: int = 1  # of calls: only so many, or a multiple of it, are a fair share
    wall: bool = False  # time on the wall counts, as with several threads


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


def rates(jobs: dict[str, Job], rounds: int = ROUNDS) -> dict[str, float]:
    """Return the best units per second of each job, the jobs taking turns."""
    calls: dict[str, int] = {}
    for name, job in jobs.items():
        job.take(1)  # compiled
        count, took = 1, seconds(job, 1)
        while took < SECONDS / 10 and count < 2**30:
            count *= 2
            took = seconds(job, count)
        calls[name] = max(1, math.ceil(count * SECONDS / took / job.multiple)) * job.multiple
    best = dict.fromkeys(jobs, 0.0)
    for _ in range(rounds):
        for name, job in jobs.items():
            took = seconds(job, calls[name])
            best[name] = max(best[name], calls[name] * job.units / took)
    return best


def seconds(job: Job, calls: int) -> float:
    """Return the CPU time of so many calls, or the time on the wall where that is less.

    It is less where threads wait for each other by spinning, as those of some peers do.
    """
    begin, wall = time.process_time(), time.perf_counter()
    job.take(calls)
    if job.wall:
        return time.perf_counter() - wall
    return min(time.process_time() - begin, time.perf_counter() - wall)


def machine() -> str:
    """Return the versions of what is compared, and the processor with its widest vectors."""
    found = [f"{name} {_version(name)}" for name in _PACKAGES if _version(name)]
    info = Path("/proc/cpuinfo")
    if not info.exists():
        return ", ".join([*found, platform.machine(), platform.processor()])
    text = info.read_text()
    name = text.split("model name\t: ", 1)[-1].split("\n", 1)[0]
    widest = "AVX-512" if "avx512f" in text else "AVX2" if "avx2" in text else "SSE"
    return ", ".join([*found, platform.machine(), name, widest])


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""
