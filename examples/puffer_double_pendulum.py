"""Imitation learns PufferLib's double pendulum on a cart, with three forces and no others.

Run it with `python examples/puffer_double_pendulum.py`. It needs `pip install "npend-gym[rl]"`.
The expert plans a swing-up with any force up to 10 N, and follows it with the nearest of the three.
So does the network, which thereby learns to correct what the coarse forces do.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from npend_gym import rl
from npend_gym.envs import PufferDoublePendulum, steps_held
from npend_gym.report import prepare_file
from npend_gym.rl.training import imitation

ID = "npend/PufferDoublePendulum-v1"
EVALUATED = {"id": ID, "observation": "sincos"}
TRAINED: dict[str, Any] = gym.spec(ID).kwargs | {
    "mode": "swingup", "n": 2, "observation": "sincos", "dt": PufferDoublePendulum.dt,
    "spread": PufferDoublePendulum.spread,
}  # fmt: skip
PLAN: dict[str, Any] = {  # poles and cart are slow from 1.72 s on
    "seconds": 2.92, "plan_guess": "waves", "plan_seed": 12, "guesses": 1, "cart_position": 2.0,
    "speed_weight": 2.0, "slow_from": 1.72,
}  # fmt: skip
LEARNING: dict[str, Any] = {
    "rounds": 8, "num_envs": 192, "standing": 200, "hidden": 128, "obs_scale": (0.5, 0.5, 4.0),
    "muon_learning_rate": 0.015, "averaging": 0.998, "minibatch_size": 256, "updates": 800,
    # The coarse forces lead far from the plan, and the expert brings the chain back
    "take_over": 10.0, "hand_back": 3.0, "lost": 1000.0,
}  # fmt: skip


def held(policy: Any, episodes: int, seed: int = rl.HELD_OUT) -> np.ndarray:
    """Return how many of the 600 steps the chain was held upright without a break, (episodes,)."""
    setting = rl.setting_of(EVALUATED)
    controller = rl.as_controller(policy, setting.config)
    steps = rl.rollout(controller, setting.make(episodes), seed)
    successes = np.array([step.running & step.info["success"] for step in steps])
    return np.array([steps_held(each) for each in successes.T])


def main() -> None:
    """Train a policy, and count the steps that it holds."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rounds", type=int, default=LEARNING["rounds"])
    parser.add_argument("--episodes", type=int, default=100, help="held-out ones")
    parser.add_argument("--out", type=Path, default=Path("puffer.safetensors"), metavar="FILE")
    arguments = parser.parse_args()
    if arguments.episodes < 2:
        parser.error(f"--episodes must be at least 2, for an error, got {arguments.episodes}")
    prepare_file(arguments.out, [".safetensors"])
    given: dict[str, Any] = PLAN | LEARNING | {"rounds": arguments.rounds, "seed": arguments.seed}
    policy, curve = imitation.train(imitation.Settings(env=TRAINED, **given), "rounds")
    policy.save(arguments.out)
    found = held(policy, arguments.episodes)
    error = found.std(ddof=1) / np.sqrt(len(found))
    print(
        f"{found.mean():.1f} +- {error:.1f} of 600 steps held, at least {found.min()}, after "
        f"{curve[-1]['seconds']:.0f} s of one core"
    )


if __name__ == "__main__":
    main()
