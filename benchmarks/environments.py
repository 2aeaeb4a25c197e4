"""How fast the environments step beside their peers: ratios in one run.

    pip install -c constraints.txt -e ".[bench]"    and envpool, where there is one to install
    python benchmarks/environments.py               prints a table, writes results/environments.csv

Why: learning wants millions of steps, and an environment written in Python costs more than its
physics. Ours and each peer are timed alternately on one core and the best of several rounds is
kept, so that a noisy machine hurts both alike. The peers do less: CartPole takes one Euler step,
Pendulum too, Acrobot one RK4 step (four in envpool's and Gymnasium's is one of 0.2 s), and none
tells energies or turning points.
"""

from __future__ import annotations

import csv
import platform
import time
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import gymnasium as gym
import numpy as np
from foundation import cpu

import npend_gym  # noqa: F401  registers the environments

ROUNDS = 9
SECONDS = 0.15  # CPU time of one job in one round
Job = tuple[Callable[[int], object], int]  # take k steps; environments stepped by each


def single(name: str, **options: object) -> Job:
    """Return the job of stepping one environment, as a training loop does."""
    env = gym.make(name, **options)
    env.action_space.seed(0)
    env.reset(seed=0)
    actions = [env.action_space.sample() for _ in range(64)]

    def steps(count: int) -> None:
        for k in range(count):
            _, _, terminated, truncated, _ = env.step(actions[k % 64])
            if terminated or truncated:
                env.reset()

    return steps, 1


def vector(envs: gym.vector.VectorEnv, lanes: int) -> Job:
    """Return the job of stepping a vector environment, which resets its lanes itself."""
    envs.action_space.seed(0)
    space = envs.action_space
    # envpool's has the space of one
    sample = space.sample if space.shape[:1] == (lanes,) else lambda: _tile(space, lanes)
    actions = [sample() for _ in range(8)]
    envs.reset()

    def steps(count: int) -> None:
        for k in range(count):
            envs.step(actions[k % 8])

    return steps, lanes


def _tile(space: gym.Space, lanes: int) -> np.ndarray:
    return np.array([space.sample() for _ in range(lanes)])


def rate(jobs: dict[str, Job]) -> dict[str, float]:
    """Return the best environment steps per second of each job, the jobs taking turns."""
    counts = {}
    for name, (steps, _) in jobs.items():
        count, took = 1, 0.0
        steps(2)  # compiled
        while took < 0.3 * SECONDS:
            count, begin = 2 * count, time.process_time()
            steps(count)
            took = time.process_time() - begin
        counts[name] = max(1, round(count * SECONDS / took))
    best = dict.fromkeys(jobs, 0.0)
    for _ in range(ROUNDS):
        for name, (steps, lanes) in jobs.items():
            begin = time.process_time()
            steps(counts[name])
            took = time.process_time() - begin
            best[name] = max(best[name], counts[name] * lanes / took)
    return best
