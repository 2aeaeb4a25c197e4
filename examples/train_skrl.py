"""PPO by skrl, on the native vector environment.

Run it with `python examples/train_skrl.py`. It needs `pip install "npend-gym[rl]" skrl`.
"""

from __future__ import annotations

import argparse
from typing import Any

import gymnasium as gym
import torch
from skrl.agents.torch.ppo import PPO, PPO_CFG
from skrl.envs.wrappers.torch import wrap_env
from skrl.memories.torch import RandomMemory
from skrl.trainers.torch import SequentialTrainer
from skrl.utils.model_instantiators.torch import deterministic_model, gaussian_model

import npend_gym  # noqa: F401 - registers the environments
from npend_gym.rl import evaluate

TASK = {"id": "npend/Calm-v1", "n": 1}
ENVS = 32
NETWORK = [{"name": "net", "input": "OBSERVATIONS", "layers": [64, 64], "activations": "tanh"}]


def train(steps: int) -> Any:
    """Return a policy of skrl that was trained for this many steps of all environments."""
    # With the autoreset mode NEXT_STEP, and `time_limit_bootstrap`, skrl takes the value at a time
    # limit from the last observation of the episode; with SAME_STEP from the first of the next one
    env = wrap_env(gym.make_vec(num_envs=ENVS, max_episode_steps=200, **TASK), wrapper="gymnasium")
    spaces = {"observation_space": env.observation_space, "action_space": env.action_space}
    policy = gaussian_model(**spaces, device="cpu", network=NETWORK, output="ACTIONS")
    value = deterministic_model(**spaces, device="cpu", network=NETWORK, output="ONE")
    settings = PPO_CFG(
        rollouts=32,
        learning_epochs=5,
        mini_batches=4,
        discount_factor=0.98,
        time_limit_bootstrap=True,
        experiment={"write_interval": 0, "checkpoint_interval": 0},
    )
    agent = PPO(
        models={"policy": policy, "value": value},
        memory=RandomMemory(memory_size=32, num_envs=ENVS, device="cpu"),
        cfg=settings,
        device="cpu",
        **spaces,
    )
    # Without "headless" it would draw a picture of every environment in every step
    cfg = {"timesteps": steps // ENVS, "headless": True}
    SequentialTrainer(env=env, agents=agent, cfg=cfg).train()
    return policy


def main() -> None:
    """Train one policy and evaluate it in held-out episodes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=20_480, help="environment steps in total")
    arguments = parser.parse_args()
    torch.set_num_threads(1)  # two are slower for networks this small
    torch.manual_seed(arguments.seed)
    policy = train(arguments.steps)

    @torch.no_grad()
    def act(observation: Any, _: Any) -> Any:
        mean, _ = policy.compute({"observations": torch.as_tensor(observation)})
        return mean.numpy()

    print(f"brought to rest: {evaluate(act, TASK, episodes=20).success_rate:.0%}")


if __name__ == "__main__":
    main()
