"""How fast Stable-Baselines3's PPO learns on our vector environment and on its own.

    pip install -c constraints.txt -e ".[rl]"
    python benchmarks/learning.py        prints a table, writes results/learning.csv (--out)

The same PPO, policy and number of environments run on the adapter with the native vector
environment, on DummyVecEnv and on SubprocVecEnv with single environments; runs alternate, and the
best of each kind is kept. "collecting" is the part of a run that steps environments and evaluates
the policy. "learning" is the whole run, and "step_fraction" the part of its time that `step` takes.
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
from npend_gym.report import prepare_file, write_csv
from npend_gym.rl import SB3VecEnv
from npend_gym.tools import machine

NUM_ENVS = 64
TASK = {"n": 2, "mode": "swingup", "observation": "sincos", "max_episode_steps": 200}
LEARNERS = {  # passes over a rollout of 64 x 64 steps
    "10 epochs of 256": {"n_epochs": 10, "batch_size": 256},
    "4 epochs of 1024": {"n_epochs": 4, "batch_size": 1024},
    "1 epoch of 4096": {"n_epochs": 1, "batch_size": 4096},
}


def adapter() -> VecEnv:
    """Return the native vector environment through the adapter."""
    return SB3VecEnv(
        gym.make_vec("NPendulum-v0", num_envs=NUM_ENVS, autoreset_mode="SAME_STEP", **TASK)
    )


def single() -> Any:
    """Return a single environment; by name, so that worker processes find it."""
    return gym.make("npend_gym:NPendulum-v0", **TASK)


def dummy() -> VecEnv:
    """Return single environments in SB3's loop."""
    return VecMonitor(DummyVecEnv([single] * NUM_ENVS))


def subproc() -> VecEnv:
    """Return single environments, each in a process of its own."""
    return VecMonitor(SubprocVecEnv([single] * NUM_ENVS, start_method="fork"))


class Clock(BaseCallback):
    """Adds up the time of collecting."""

    collecting = 0.0

    def _on_rollout_start(self) -> None:
        self.start_time = time.perf_counter()

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        self.collecting += time.perf_counter() - self.start_time


def measure(make: Callable[[], VecEnv], learner: dict[str, Any], rollouts: int) -> dict[str, float]:
    """Return frames per second, in total and of collecting, and the fraction of time in `step`."""
    envs = make()
    stepping, step = [0.0], envs.step

    def timed(actions: Any) -> Any:
        start_time = time.perf_counter()
        outputs = step(actions)
        stepping[0] += time.perf_counter() - start_time
        return outputs

    envs.step = timed
    model = PPO("MlpPolicy", envs, n_steps=64, seed=0, device="cpu", **learner)
    model.learn(NUM_ENVS * 64)  # compile, start processes, warm up
    stepping[0], clock, start_time = 0.0, Clock(), time.perf_counter()
    model.learn(NUM_ENVS * 64 * rollouts, callback=clock)
    seconds = time.perf_counter() - start_time
    envs.close()
    frames = NUM_ENVS * 64 * rollouts
    return {
        "learning": frames / seconds,
        "collecting": frames / clock.collecting,
        "step_fraction": stepping[0] / seconds,
    }


def main() -> None:
    """Measure all kinds, print the table and write it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rollouts", type=int, default=4)
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results/learning.csv")
    arguments = parser.parse_args()
    if min(arguments.rollouts, arguments.rounds) < 1:
        parser.error("--rollouts and --rounds must be at least 1")
    prepare_file(arguments.out, [".csv"])
    torch.set_num_threads(1)
    kinds = {"adapter": adapter, "DummyVecEnv": dummy, "SubprocVecEnv": subproc}
    rows: list[dict[str, Any]] = []
    for name, learner in LEARNERS.items():
        results: dict[str, list[dict[str, float]]] = {kind: [] for kind in kinds}
        for _ in range(arguments.rounds):
            for kind, make in kinds.items():
                results[kind].append(measure(make, learner, arguments.rollouts))
        best = {kind: max(runs, key=lambda run: run["learning"]) for kind, runs in results.items()}
        for kind, run in best.items():
            row = {"learner": name, "environment": kind}
            row |= {f"{part}_per_s": round(run[part]) for part in ("learning", "collecting")}
            row |= {"step_fraction": round(run["step_fraction"], 4)}
            row |= {
                f"{part}_ratio": round(best["adapter"][part] / run[part], 2)
                for part in ("learning", "collecting")
            }
            rows.append(row | {"machine": machine()})
            print("|", *(f"{cell} |" for cell in row.values()), flush=True)
    write_csv(arguments.out, rows)


if __name__ == "__main__":
    main()
