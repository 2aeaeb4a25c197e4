"""What a campaign costs beside a plain loop over `pseudo_periods`, and what two cores give.

    python benchmarks/campaign.py                     ratios, writes results/campaign.csv (--out)
    python benchmarks/campaign.py --releases 1000000  the whole of it with a million releases

Why: a campaign also draws, writes, checks and records, in processes that have to be started. The
plain loop measures the same releases at N = 5 and keeps nothing. CPU time is that of all processes,
their start and imports included; that of the loop is the loop's alone. Two cores are compared with
one by wall time. Two plain loops at once show what the two cores of the machine gave at that
moment. Memory is the largest sum over driver and workers, and the largest of one process.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil

from npend_gym import Chain, pseudo_periods
from npend_gym.experiments import Campaign, CampaignPlan
from npend_gym.experiments.campaign.task import run_task
from npend_gym.report import prepare_file, write_csv

N = 5
_LOOP = f"""
import sys, time
import numpy as np
from npend_gym import Chain, pseudo_periods
chain, releases = Chain.uniform({N}), int(sys.argv[1])
angles = np.pi / 4 + 0.017 * np.random.default_rng(0).random(releases)
pseudo_periods(chain, np.repeat(angles[:16, None], {N}, axis=1))
wall, cpu = time.perf_counter(), time.process_time()
for first in range(0, releases, 2048):
    pseudo_periods(chain, np.repeat(angles[first : first + 2048, None], {N}, axis=1))
print(time.perf_counter() - wall, time.process_time() - cpu)
"""


@dataclass
class Cost:
    """Seconds on the wall and of CPU, and peaks of memory [MiB]."""

    wall: float
    cpu: float
    all_mib: float = 0.0
    one_mib: float = 0.0


def loops(releases: int, count: int = 1) -> Cost:
    """Run `count` plain loops at once; return the longest wall time and the mean CPU time."""
    command = [sys.executable, "-c", _LOOP, str(releases)]
    started = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(count)]
    times = [[float(t) for t in p.communicate()[0].split()] for p in started]
    return Cost(max(wall for wall, _ in times), sum(cpu for _, cpu in times) / count)


def campaign(releases: int, workers: int) -> Cost:
    """Run `npend campaign` in a folder of its own."""
    with tempfile.TemporaryDirectory() as out:
        command = [sys.executable, "-m", "npend_gym", "campaign", "--out", out]
        command += ["--n", str(N), "--trials", str(releases), "--workers", str(workers)]
        start = time.perf_counter()
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        peaks = Peaks(process.pid)
        _, status, usage = os.wait4(process.pid, 0)
        wall = time.perf_counter() - start
        peaks.stop()
    if status:
        raise RuntimeError(f"npend campaign ended with {status}")
    return Cost(wall, usage.ru_utime + usage.ru_stime, peaks.together, peaks.one)


class Peaks(threading.Thread):
    """Samples the resident memory of a process and all below it [MiB]."""

    def __init__(self, pid: int) -> None:
        super().__init__(daemon=True)
        self.pid, self.together, self.one = pid, 0.0, 0.0
        self._stopped = threading.Event()
        self.start()

    def run(self) -> None:
        """Sample four times per second."""
        while not self._stopped.wait(0.25):
            with suppress(psutil.NoSuchProcess):  # one has ended meanwhile
                driver = psutil.Process(self.pid)
                family = (driver, *driver.children(recursive=True))
                sizes = [process.memory_info().rss / 2**20 for process in family]
                self.together = max(self.together, sum(sizes))
                self.one = max(self.one, *sizes)

    def stop(self) -> None:
        """End the sampling."""
        self._stopped.set()
        self.join()


def task_ratio() -> float:
    """Return the CPU time of a task over that of its `pseudo_periods` alone, taken in turns."""
    plan, chain = CampaignPlan(n=N, trials=2048), Chain.uniform(N)
    (task,) = plan.tasks()
    starts = plan.measure(task)["releases"]["start_rad"].to_numpy()
    theta = np.repeat(starts[:, None], N, axis=1)
    best = [np.inf, np.inf]
    with tempfile.TemporaryDirectory() as out:
        folder = Campaign(plan, out).folder
        jobs = (lambda: run_task(plan, folder, task), lambda: pseudo_periods(chain, theta))
        for _ in range(5):
            for k, job in enumerate(jobs):
                began = time.process_time()
                job()
                best[k] = min(best[k], time.process_time() - began)
    return best[0] / best[1]


def ratios(releases: int, turns: int) -> list[dict[str, object]]:
    """Measure in turns and return the rows; the best round of each counts."""
    rounds = []
    for _ in range(turns):
        costs = {"loop": loops(releases), "two loops": loops(releases, 2)}
        rounds.append(costs | {"one": campaign(releases, 1), "two": campaign(releases, 2)})
        print({name: (round(c.wall, 1), round(c.cpu, 1)) for name, c in rounds[-1].items()})

    def best(name: str, quantity: str) -> float:
        return min(getattr(costs[name], quantity) for costs in rounds)

    loop_cpu = best("loop", "cpu")
    gained = 2.0 * best("loop", "wall") / best("two loops", "wall")
    return [
        row("plain loop, CPU", 1e6 * loop_cpu / releases, "us a release"),
        row("a task of 2048 over its loop, CPU", task_ratio(), "ratio"),
        row("campaign over loop, 1 worker, CPU", best("one", "cpu") / loop_cpu, "ratio"),
        row("campaign over loop, 2 workers, CPU", best("two", "cpu") / loop_cpu, "ratio"),
        row("two loops against one, wall", gained, "ratio"),
        row("two workers against one, wall", best("one", "wall") / best("two", "wall"), "ratio"),
        row("campaign, 2 workers, wall", releases / best("two", "wall"), "releases a second"),
        row("memory, all processes", max(c["two"].all_mib for c in rounds), "MiB"),
        row("memory, largest process", max(c["two"].one_mib for c in rounds), "MiB"),
    ]


def row(what: str, value: float, unit: str) -> dict[str, object]:
    """Return a row of the table, and print it."""
    print(f"{what:40} {value:12.4g} {unit}", flush=True)
    return {"what": what, "value": value, "unit": unit}


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--releases", type=int, default=50_000, help="in each run (50000)")
    parser.add_argument("--rounds", type=int, default=3, help="in turns (3)")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results/campaign.csv")
    arguments = parser.parse_args()
    releases, rounds = arguments.releases, arguments.rounds
    if min(releases, rounds) < 1:
        parser.error("--releases and --rounds must be at least 1")
    prepare_file(arguments.out, [".csv"])
    write_csv(arguments.out, [row("releases", releases, f"N = {N}"), *ratios(releases, rounds)])


if __name__ == "__main__":
    main()
