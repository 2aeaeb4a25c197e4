"""Transitions between all equilibria: plan them, or take a policy, and evaluate each pair.

    python examples/transitions.py 3 --plans plans-3.npz --csv transitions-3.csv
    python examples/transitions.py 2 --pretrained transition-2

The plans are kept in the file `--plans`, and read from it where it exists. Each pair is evaluated
in 100 episodes of seeds that no plan and no training has seen.
"""

from __future__ import annotations

import argparse
import itertools
import time
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from tqdm import tqdm

import npend_gym  # noqa: F401  registers the environments
from npend_gym.report import write_csv
from npend_gym.rl import (
    Controller,
    PlannedTransitions,
    evaluate,
    find_policy,
    planned_transitions,
    pretrained_names,
    setting_of,
)

EPISODES = 100


def name_of(equilibrium: Any) -> str:
    """Return a name such as "hang stand" of angles 0 and pi."""
    return " ".join("stand" if angle > 0.0 else "hang" for angle in equilibrium)


def plans_of(keywords: dict[str, Any], path: Path | None, tries: int) -> PlannedTransitions:
    """Return the plans that `path` holds, or new ones, which are written there."""
    config = gym.make("npend/Transition-v1", **keywords).unwrapped.config
    if path is not None and path.exists():
        return PlannedTransitions.load(path, config)
    start = time.process_time()
    progress = partial(tqdm, desc="plans", disable=None)
    plans = planned_transitions(config, tries=tries, progress=progress)
    print(f"{len(plans.plans)} plans in {time.process_time() - start:.0f} s of processor time")
    if path is not None:
        plans.save(path)
    return plans


def evaluated_pairs(controller: Controller, keywords: dict[str, Any]) -> list[dict[str, Any]]:
    """Return a row for every pair of equilibria, with the success in its episodes."""
    n, rows = setting_of(keywords).config.n, list[dict[str, Any]]()
    equilibria = np.pi * np.array(list(itertools.product([0.0, 1.0], repeat=n)))
    for start, goal in tqdm(list(itertools.permutations(equilibria, 2)), "pairs", disable=None):
        options = {"start": np.tile(start, (EPISODES, 1)), "goal": np.tile(goal, (EPISODES, 1))}
        found = evaluate(controller, keywords, episodes=EPISODES, options=options)
        row = {"from": name_of(start), "to": name_of(goal), "success": int(found.success.sum())}
        settled = found.as_row()["settling_time"]
        rows.append(row | {"episodes": EPISODES, "settling_time": settled})
    return rows


def main() -> None:
    """Judge what the command line names."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("n", type=int, help="number of rods")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--pretrained", choices=pretrained_names(), help="policy of the package")
    what.add_argument("--policy", type=Path, help=".safetensors that a training script has written")
    what.add_argument("--plans", type=Path, help=".npz of plans, written where it is missing")
    parser.add_argument("--tries", type=int, default=4, help="guesses for each plan")
    parser.add_argument("--csv", type=Path, help="file of the table")
    arguments = parser.parse_args()
    for path in filter(None, (arguments.plans, arguments.csv)):
        path.parent.mkdir(parents=True, exist_ok=True)
    keywords: dict[str, Any] = {"n": arguments.n, "mode": "transition", "observation": "sincos"}
    controller: Controller
    if arguments.pretrained or arguments.policy:
        policy = find_policy(str(arguments.policy or arguments.pretrained))
        controller, keywords = policy, policy.env
        config = setting_of(keywords).config
        if (config.mode.name, config.n) != ("transition", arguments.n):
            parser.error(
                f'the policy must be for mode "transition" with n={arguments.n}, '
                f'got "{config.mode.name}" with n={config.n}'
            )
    else:
        controller = plans_of(keywords, arguments.plans, arguments.tries)
    rows = evaluated_pairs(controller, keywords)
    for row in rows:
        print(f"{row['from']} -> {row['to']}: {row['success']} of {EPISODES}")
    share = np.array([row["success"] for row in rows]) / EPISODES
    print(
        f"{np.sum(share >= 0.95)} of {share.size} pairs with 95 % or more, mean {share.mean():.1%}"
    )
    if arguments.csv:
        write_csv(arguments.csv, rows)


if __name__ == "__main__":
    main()
