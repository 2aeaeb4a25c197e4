"""PPO by Tianshou, on single environments.

Run it with `python examples/train_tianshou.py`. It needs `pip install "npend-gym[rl]" tianshou`.
"""

from __future__ import annotations

import argparse
from typing import Any

import gymnasium as gym
import torch
from tianshou.algorithm import PPO
from tianshou.algorithm.modelfree.reinforce import ProbabilisticActorPolicy
from tianshou.algorithm.optim import AdamOptimizerFactory
from tianshou.data import Collector, VectorReplayBuffer
from tianshou.env import DummyVectorEnv
from tianshou.trainer import OnPolicyTrainerParams
from tianshou.utils.net.common import Net
from tianshou.utils.net.continuous import ContinuousActorProbabilistic, ContinuousCritic
from torch.distributions import Independent, Normal

import npend_gym  # noqa: F401 - registers the environments
from npend_gym.rl import evaluate

TASK = {"id": "npend/Calm-v1", "n": 1}
BATCH = 1024  # steps between two updates


def train(steps: int, seed: int) -> ProbabilisticActorPolicy:
    """Return a policy of Tianshou that was trained for this many steps of all environments."""
    envs = DummyVectorEnv([lambda: gym.make(max_episode_steps=200, **TASK)] * 8)
    envs.seed(seed)
    observed, actions = envs.observation_space[0].shape, envs.action_space[0]
    hidden = {"state_shape": observed, "hidden_sizes": [64, 64], "activation": torch.nn.Tanh}
    actor = ContinuousActorProbabilistic(
        preprocess_net=Net(**hidden), action_shape=actions.shape, unbounded=True
    )
    policy = ProbabilisticActorPolicy(
        actor=actor,
        dist_fn=lambda numbers: Independent(Normal(*numbers), 1),
        action_space=actions,
    )
    ppo = PPO(
        policy=policy,
        critic=ContinuousCritic(preprocess_net=Net(**hidden)),
        optim=AdamOptimizerFactory(lr=1e-3),
        gamma=0.98,
    )
    settings = OnPolicyTrainerParams(
        training_collector=Collector(ppo, envs, VectorReplayBuffer(BATCH, len(envs))),
        max_epochs=1,
        epoch_num_steps=steps,
        collection_step_num_env_steps=BATCH,
        update_step_num_repetitions=5,
        batch_size=256,
        verbose=False,
    )
    ppo.run_training(settings)
    return policy


def main() -> None:
    """Train one policy and evaluate it in held-out episodes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=10_240, help="environment steps in total")
    arguments = parser.parse_args()
    torch.set_num_threads(1)  # two are slower for networks this small
    torch.manual_seed(arguments.seed)
    policy = train(arguments.steps, arguments.seed)

    @torch.no_grad()
    def act(observation: Any, _: Any) -> Any:
        (mean, _), _ = policy.actor(observation)
        return policy.map_action(mean.numpy())

    print(f"brought to rest: {evaluate(act, TASK, episodes=20).success_rate:.0%}")


if __name__ == "__main__":
    main()
