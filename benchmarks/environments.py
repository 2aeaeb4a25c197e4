"""How fast the environments step beside their peers: ratios in one run.

    pip install -c constraints.txt -e ".[bench]" envpool    (envpool may be missing)
    python benchmarks/environments.py        prints a table, writes results/environments.csv

Why: learning takes millions of steps, and what surrounds the physics can cost more than it does.
Ours and the peers are timed alternately on one core and the best of several rounds is kept, so
that a noisy machine hurts all alike. The peers do less: one Euler step (CartPole, Pendulum) or one
RK4 step (Acrobot) in each step, and none tells energies or turning points. Each job of ours with a
vector environment holds one whole episode of 1000 steps with its reset, or several.
"""

from __future__ import annotations

import csv
import math
import platform
import time
import warnings
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from foundation import cpu

import npend_gym  # noqa: F401  registers the environments

ROUNDS = 9
SECONDS = 0.15  # CPU time of a job in a round, at least
EPISODE = 1001  # calls of a vector environment of ours from reset to reset
OURS = "NPendulum-v0"


class Job(NamedTuple):
    """Steps of an environment."""

    take: Callable[[int], None]  # so many calls of step
    lanes: int = 1  # environments stepped by each
    multiple: int = 1  # of calls: only so many, or a multiple of it, are a fair share


def single(name: str, **options: Any) -> Job:
    """Return the job of stepping one environment as a training loop does."""
    env = gym.make(name, **options)
    env.action_space.seed(0)
    env.reset(seed=0)
    actions = [env.action_space.sample() for _ in range(64)]

    def take(calls: int) -> None:
        for k in range(calls):
            _, _, terminated, truncated, _ = env.step(actions[k % 64])
            if terminated or truncated:
                env.reset()

    return Job(take)


def vector(envs: Any, lanes: int, actions: np.ndarray, multiple: int = 1) -> Job:
    """Return the job of stepping environments side by side, which reset themselves."""
    envs.reset()

    def take(calls: int) -> None:
        for k in range(calls):
            envs.step(actions[k % len(actions)])

    return Job(take, lanes, multiple)


def ours(lanes: int, **options: Any) -> Job:
    """Return the job of stepping our vector environment."""
    envs = gym.make_vec(OURS, num_envs=lanes, threads=1, **options)
    actions = np.random.default_rng(0).uniform(-1, 1, (8, *envs.action_space.shape))
    whole = "max_episode_steps" not in options
    return vector(envs, lanes, actions.astype(np.float32), EPISODE if whole else 1)


def peers(lanes: int) -> dict[str, Job]:
    """Return the jobs of the peers that there are."""
    choices = np.random.default_rng(0).integers(0, 6, (8, lanes))
    cartpole = gym.make_vec("CartPole-v1", num_envs=lanes)  # Gymnasium's own, in NumPy
    jobs = {"Gymnasium CartPole-v1": vector(cartpole, lanes, choices % 2)}
    try:
        import envpool

        acrobot = envpool.make_gymnasium("Acrobot-v1", num_envs=lanes, num_threads=1)
        jobs["envpool Acrobot-v1"] = vector(acrobot, lanes, choices % 3)
    except Exception as error:  # noqa: BLE001  not there, or not for this Gymnasium
        print(f"envpool skipped: {error!r}")
    return jobs


def rates(jobs: dict[str, Job]) -> dict[str, float]:
    """Return the best environment steps per second of each job, the jobs taking turns."""
    calls = {}
    for name, job in jobs.items():
        job.take(2)  # compiled
        count, took = 8, 0.0
        while took < 0.02:
            count *= 2
            took = seconds(job, count)
        calls[name] = math.ceil(count * SECONDS / took / job.multiple) * job.multiple
    best = dict.fromkeys(jobs, 0.0)
    for _ in range(ROUNDS):
        for name, job in jobs.items():
            took = seconds(job, calls[name])
            best[name] = max(best[name], calls[name] * job.lanes / took)
    return best


def seconds(job: Job, calls: int) -> float:
    """Return the CPU time of so many calls, or the time on the wall where that is less.

    It is less where threads wait for each other by spinning, as envpool's two do.
    """
    begin, wall = time.process_time(), time.perf_counter()
    job.take(calls)
    return min(time.process_time() - begin, time.perf_counter() - wall)


def beside_peers(lanes: int | None) -> list[tuple]:
    """Return the rows of the double pendulum beside each peer; `lanes` None: a single env."""
    substeps = gym.make(OURS).unwrapped.config.substeps
    kind = "gym.make" if lanes is None else f"gym.make_vec, {lanes} lanes"
    mine = {f"{kind}, N = 2, {substeps} substeps (default)": {}}
    mine[f"{kind}, N = 2, 1 substep"] = {"substeps": 1}
    make = ours if lanes else lambda _lanes, **options: single(OURS, **options)
    jobs = {name: make(lanes, **options) for name, options in mine.items()}
    if lanes:
        others = peers(lanes)
    else:
        others = {f"Gymnasium {name}": single(name) for name in ("Acrobot-v1", "Pendulum-v1")}
    best = rates(jobs | others)
    return [
        (name, peer, best[name], best[peer], best[name] / best[peer], "")
        for name in jobs
        for peer in others
    ]


def along_n() -> list[tuple]:
    """Return the rows of long chains: ns per rod and step, one substep each."""
    rows = []
    lanes = 1024
    for n in (2, 5, 20, 100):
        # small steps and torques, for a chain that diverges is not stepped
        options = {"n": n, "mode": "calm", "dt": 0.002, "substeps": 1, "max_torque": 1.0}
        name = f"gym.make_vec, {lanes} lanes, N = {n}, 1 substep"
        best = rates({name: ours(lanes, max_episode_steps=None, **options)})[name]
        rows.append((name, "", best, "", "", 1e9 / (best * n)))
    return rows


def main() -> None:
    """Measure, print and write."""
    warnings.filterwarnings("ignore", module="gymnasium")  # of the peers' spaces
    rows = []
    for lanes in (None, 64, 1024, 4096):
        rows += beside_peers(lanes)
    write(rows + along_n())


def write(rows: list[tuple]) -> None:
    """Print the table and keep it as CSV, with what made it."""
    about = ", ".join(
        [
            *(f"{name} {release(name)}" for name in ("npend_gym", "numba", "gymnasium", "envpool")),
            platform.machine(),
            cpu(),
        ]
    )
    print(about)
    for name, peer, mine, theirs, ratio, per_rod in rows:
        rest = f"{theirs:10.3g}/s {ratio:7.2f} x  {peer}" if peer else f"{per_rod:10.1f} ns per rod"
        print(f"{name:54s} {mine:10.3g}/s {rest}")
    path = Path(__file__).parent / "results" / "environments.csv"
    path.parent.mkdir(exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(
            ["job", "peer", "ours_per_s", "peer_per_s", "ratio", "ns_per_rod_and_step", "made_by"]
        )
        writer.writerows([*row, about] for row in rows)


def release(name: str) -> str:
    """Return the version of an installed package."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "missing"


if __name__ == "__main__":
    main()
