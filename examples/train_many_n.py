"""PPO trains one network that balances chains of one to four rods, all at once.

Run it with `python examples/train_many_n.py`. It needs `pip install "npend-gym[rl]"`. The chains
have their observations and motors in the spaces of the longest one, with a motor at every joint.
"""

from __future__ import annotations

import argparse

import gymnasium as gym
import torch
from stable_baselines3 import PPO

import npend_gym  # noqa: F401 - registers the environments
from npend_gym.envs import JoinedVectorEnv, VectorPadRods
from npend_gym.rl import SB3VecEnv, episode_seeds, evaluate

LENGTHS = 1, 2, 3, 4
ENVS, STEPS = 16, 64  # environments of each length, and their steps between two updates


def make(n: int, count: int, steps: int = 500) -> VectorPadRods:
    """Return environments of n rods in the spaces of the longest chain."""
    envs = gym.make_vec(
        "npend/Balance-v1", num_envs=count, n=n, actuated=range(n), max_episode_steps=steps,
        autoreset_mode="SAME_STEP",
    )  # fmt: skip
    return VectorPadRods(envs, max(LENGTHS), actuated=range(max(LENGTHS)))


def train(steps: int, seed: int) -> PPO:
    """Return a model that was trained for this many steps of all environments."""
    envs = JoinedVectorEnv([make(n, ENVS) for n in LENGTHS])
    model = PPO(
        "MlpPolicy",
        SB3VecEnv(envs),
        n_steps=STEPS,
        batch_size=256,
        n_epochs=10,
        gamma=0.98,
        learning_rate=lambda left: 1e-3 * max(left, 0.0),  # the last rollout may exceed the steps
        policy_kwargs={"net_arch": [64, 64]},
        seed=episode_seeds("training", envs.num_envs, run=seed, spacing=envs.num_envs).start,
        device="cpu",
    )
    return model.learn(steps)


def main() -> None:
    """Train one policy, and evaluate it with each length in held-out episodes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=400_000, help="environment steps in total")
    parser.add_argument("--episodes", type=int, default=100, help="held-out ones of each length")
    arguments = parser.parse_args()
    least = {"steps": STEPS * ENVS * len(LENGTHS), "episodes": 1}
    for name, count in least.items():
        if (given := getattr(arguments, name)) < count:
            parser.error(f"--{name} must be at least {count}, got {given}")
    torch.set_num_threads(1)  # two are slower for networks this small
    model, met = train(arguments.steps, arguments.seed), 0
    for n in LENGTHS:
        found = evaluate(model, make(n, 1, steps=1000), episodes=arguments.episodes)
        met += int(found.success.sum())
        print(f"n = {n}: success {found.success.sum()}/{found.success.size}")
    print(f"all: success {met}/{len(LENGTHS) * arguments.episodes}")


if __name__ == "__main__":
    main()
