"""How fast Stable-Baselines3's PPO learns on our vector environment and on its own.

    pip install -c constraints.txt -e ".[rl]"
    python benchmarks/learning.py        prints a table, writes results/learning.csv

The same PPO, policy and number of environments, once on the adapter over the native vector
environment, once on DummyVecEnv and once on SubprocVecEnv over the single one; runs alternate and
the best of each kind is kept. "collecting" is the part of a run that steps environments and asks
the policy, "learning" all of it, "share" what the environment's `step` takes of all.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv, VecMonitor

import npend_gym  # noqa: F401  registers the environments
from npend_gym._machine import machine
from npend_gym.report.outputs import write_csv
from npend_gym.rl import SB3VecEnv

COUNT = 64
TASK = {"n": 2, "mode": "swingup", "observation": "sincos", "max_episode_steps": 200}
LEARNERS = {  # one rollout of 64 x 64 steps, then so many passes over it
    "10 epochs of 256": {"n_epochs": 10, "batch_size": 256},
    "4 epochs of 1024": {"n_epochs": 4, "batch_size": 1024},
    "1 epoch of 4096": {"n_epochs": 1, "batch_size": 4096},
}


def adapter() -> VecEnv:
    """Return our environments through the adapter."""
    return SB3VecEnv(
        gym.make_vec("NPendulum-v0", num_envs=COUNT, autoreset_mode="SAME_STEP", **TASK)
    )


def one() -> Any:
    """Return a single environment; by name, so that worker processes find it."""
    return gym.make("npend_gym:NPendulum-v0", **TASK)


def dummy() -> VecEnv:
    """Return as many in SB3's loop."""
    return VecMonitor(DummyVecEnv([one] * COUNT))


def subproc() -> VecEnv:
    """Return as many in a process each."""
    return VecMonitor(SubprocVecEnv([one] * COUNT, start_method="fork"))


class Clock(BaseCallback):
    """Adds up the time that collecting takes."""

    collecting = 0.0

    def _on_rollout_start(self) -> None:
        self.begun = time.perf_counter()

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        self.collecting += time.perf_counter() - self.begun


def measure(make: Callable[[], VecEnv], learner: dict[str, Any], rollouts: int) -> dict[str, float]:
    """Return frames a second, of all and of collecting, and the environment's share of the time."""
    envs = make()
    stepping, step = [0.0], envs.step

    def timed(actions: Any) -> Any:
        begun = time.perf_counter()
        seen = step(actions)
        stepping[0] += time.perf_counter() - begun
        return seen

    envs.step = timed
    model = PPO("MlpPolicy", envs, n_steps=64, seed=0, device="cpu", **learner)
    model.learn(COUNT * 64)  # compile, start processes, warm up
    stepping[0], clock, begun = 0.0, Clock(), time.perf_counter()
    model.learn(COUNT * 64 * rollouts, callback=clock)
    seconds = time.perf_counter() - begun
    envs.close()
    frames = COUNT * 64 * rollouts
    return {
        "learning": frames / seconds,
        "collecting": frames / clock.collecting,
        "share": stepping[0] / seconds,
    }


def main() -> None:
    """Measure all, print the table and write it down."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rollouts", type=int, default=4)
    parser.add_argument("--rounds", type=int, default=4)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    kinds = {"adapter": adapter, "DummyVecEnv": dummy, "SubprocVecEnv": subproc}
    rows: list[dict[str, Any]] = []
    for name, learner in LEARNERS.items():
        seen: dict[str, list[dict[str, float]]] = {kind: [] for kind in kinds}
        for _ in range(arguments.rounds):
            for kind, make in kinds.items():
                seen[kind].append(measure(make, learner, arguments.rollouts))
        best = {kind: max(runs, key=lambda run: run["learning"]) for kind, runs in seen.items()}
        for kind, run in best.items():
            row = {"learner": name, "environment": kind}
            row |= {f"{part}_per_s": round(run[part]) for part in ("learning", "collecting")}
            row |= {"share": round(run["share"], 4)}
            row |= {
                f"{part}_ratio": round(best["adapter"][part] / run[part], 2)
                for part in ("learning", "collecting")
            }
            rows.append(row | {"machine": machine()})
            print("|", *(f"{cell} |" for cell in row.values()), flush=True)
    write_csv(Path(__file__).parent / "results" / "learning.csv", rows)


if __name__ == "__main__":
    main()
