"""What Stable-Baselines3 learns with its default settings: the swing-up of one rod.

    python benchmarks/sb3_defaults.py --out results/sb3_defaults.csv

trains PPO and SAC with several seeds, on a single environment as `gym.make` returns it. It writes a
row for every run, with the success in 100 held-out episodes; `docs/results/sb3_defaults.csv` is
such a file. What is in the file already is not trained again, so it can be interrupted. PPO takes
some minutes of processor time for a seed, SAC more than that.
"""

from __future__ import annotations

import argparse
import csv
import time
from itertools import product
from pathlib import Path
from typing import Any

import gymnasium as gym
import stable_baselines3
import torch

import npend_gym
from npend_gym.report import write_csv
from npend_gym.rl import episode_seeds, evaluate

ENV_ID, KEYWORDS = "npend/SwingUp-v1", {"n": 1}
STEPS = {"PPO": 300_000, "SAC": 20_000}
EPISODE = 200  # steps in training; evaluation has the environment's own 1000


def trained(algorithm: str, steps: int, seed: int) -> dict[str, Any]:
    """Train with the defaults, evaluate in held-out episodes and return what to keep."""
    env = gym.make(ENV_ID, max_episode_steps=EPISODE, **KEYWORDS)
    first = episode_seeds("training", 1, run=seed).start
    model = getattr(stable_baselines3, algorithm)("MlpPolicy", env, seed=first, device="cpu")
    start_time = time.process_time()
    model.learn(steps)
    seconds = round(time.process_time() - start_time, 1)
    env.close()
    score = evaluate(model, KEYWORDS | {"id": ENV_ID})
    made = {
        "npend_gym": npend_gym.__version__,
        "stable_baselines3": stable_baselines3.__version__,
        "torch": torch.__version__,
    }
    run = {"algorithm": algorithm, "seed": seed, "steps": model.num_timesteps, "seconds": seconds}
    return run | score.as_row() | made


def main() -> None:
    """Train what is missing and write the table after every run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/sb3_defaults.csv"))
    parser.add_argument("--algorithms", nargs="+", choices=STEPS, default=list(STEPS))
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--steps", type=int, help="in place of each algorithm's own number")
    arguments = parser.parse_args()
    torch.set_num_threads(1)  # two are slower for networks this small
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    if arguments.out.exists():
        with arguments.out.open(encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    for seed, algorithm in product(arguments.seeds, arguments.algorithms):
        if (algorithm, str(seed)) in {(row["algorithm"], str(row["seed"])) for row in rows}:
            continue
        rows.append(trained(algorithm, arguments.steps or STEPS[algorithm], seed))
        write_csv(arguments.out, rows)
        print(rows[-1], flush=True)


if __name__ == "__main__":
    main()
