"""PPO by TorchRL, on the native vector environment.

Run it with `python examples/train_torchrl.py swingup-1`: it writes `swingup-1.safetensors`, a
policy of plain numbers for `npend evaluate`, and `swingup-1.csv`, its learning curve. It needs
`pip install -c constraints.txt ".[rl]" torchrl`.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import torch
from tensordict.nn import AddStateIndependentNormalScale, TensorDictModule
from torch import nn
from torchrl.collectors import Collector
from torchrl.data import LazyTensorStorage, SamplerWithoutReplacement, TensorDictReplayBuffer
from torchrl.envs import (
    Compose,
    GymWrapper,
    InitTracker,
    ObservationNorm,
    RewardScaling,
    RewardSum,
    TransformedEnv,
)
from torchrl.modules import IndependentNormal, ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE
from tqdm import tqdm

from npend_gym.report import write_csv
from npend_gym.rl import Policy, episode_seeds, setting_of
from npend_gym.rl.training import (
    Curve,
    TrainingSettings,
    env_of_task,
    network,
    observation_scale,
    policy_of,
)


@dataclass(frozen=True)
class Settings(TrainingSettings):
    """The settings of a training run, with the names of CleanRL."""

    total_timesteps: int = 200_000
    num_envs: int = 32
    num_steps: int = 128  # of every environment between two updates
    update_epochs: int = 10
    minibatch_size: int = 256
    learning_rate: float = 1e-3  # falls linearly to zero
    gamma: float = 0.98
    gae_lambda: float = 0.95
    clip_coef: float = 0.2
    vf_coef: float = 0.5
    max_grad_norm: float = 0.5
    hidden: int = 64
    obs_scale: tuple[float, float, float] = (1.0, 1.0, 5.0)  # of sines, cosines, speeds [rad/s]


def settings_of(task: str, **changes: Any) -> Settings:
    """Return the settings, with episodes of 200 steps (10 s of a swing-up) to see more starts."""
    return Settings(env=env_of_task(task) | {"max_episode_steps": 200}, **changes)


def make_env(settings: Settings) -> TransformedEnv:
    """Return all environments as one; TorchRL itself says which of them to reset."""
    envs = gym.make_vec(  # the task is the keyword "mode" in `settings.env`
        "npend_gym:NPendulum-v0", settings.num_envs, autoreset_mode="DISABLED", **settings.env
    )
    env = GymWrapper(envs, device="cpu")
    seeds = episode_seeds("training", settings.num_envs, run=settings.seed, spacing=1000)
    env.set_seed(seeds.start)
    return TransformedEnv(
        env,
        Compose(
            RewardSum(),  # the return of an episode
            RewardScaling(0.0, 1.0 - settings.gamma),  # so that values are of order one
            ObservationNorm(0.0, 1.0 / obs_scale(settings), in_keys=["observation"]),
            InitTracker(),  # collectors of TorchRL expect it
        ),
    )


def obs_scale(settings: Settings) -> torch.Tensor:
    """Return the numbers that the observation is divided by."""
    return observation_scale(setting_of(settings.env).config, settings.obs_scale)


def train(settings: Settings, progress: str | None = None) -> tuple[Policy, Curve]:
    """Return the trained policy and its learning curve, a row for every update."""
    torch.set_num_threads(1)  # two are slower for networks this small
    torch.manual_seed(settings.seed)
    env = make_env(settings)
    inputs, actions = env.observation_spec["observation"].shape[-1], env.action_spec.shape[-1]
    mean = network(inputs, actions, settings.hidden, last_gain=0.01)
    mean_and_std = nn.Sequential(mean, AddStateIndependentNormalScale(actions, scale_mapping="exp"))
    actor = ProbabilisticActor(
        TensorDictModule(mean_and_std, in_keys=["observation"], out_keys=["loc", "scale"]),
        in_keys=["loc", "scale"],
        distribution_class=IndependentNormal,
        return_log_prob=True,
    )
    critic = ValueOperator(network(inputs, 1, settings.hidden, last_gain=1.0))
    gae = GAE(gamma=settings.gamma, lmbda=settings.gae_lambda, value_network=critic)
    loss = ClipPPOLoss(
        actor,
        critic,
        clip_epsilon=settings.clip_coef,
        entropy_coeff=0.0,
        critic_coeff=settings.vf_coef,
        loss_critic_type="l2",
        normalize_advantage=True,
    )
    optimizer = torch.optim.Adam(loss.parameters(), settings.learning_rate, eps=1e-5, fused=True)
    batch_size = settings.num_envs * settings.num_steps
    updates = max(1, settings.total_timesteps // batch_size)
    scheduler = torch.optim.lr_scheduler.LinearLR(optimizer, 1.0, 0.0, updates)
    buffer = TensorDictReplayBuffer(
        storage=LazyTensorStorage(batch_size),
        sampler=SamplerWithoutReplacement(),
        batch_size=settings.minibatch_size,
    )
    collector = Collector(
        env, actor, frames_per_batch=batch_size, total_frames=updates * batch_size
    )
    curve: Curve = []
    mean_return: float | None = None  # of the episodes that ended last
    for rollout in tqdm(collector, progress, updates, disable=None, unit="update"):
        gae(rollout)
        buffer.extend(rollout.reshape(-1))
        for _ in range(settings.update_epochs):
            for minibatch in buffer:
                losses = loss(minibatch)
                optimizer.zero_grad()
                (losses["loss_objective"] + losses["loss_critic"]).backward()
                nn.utils.clip_grad_norm_(loss.parameters(), settings.max_grad_norm)
                optimizer.step()
        scheduler.step()
        returns = rollout["next", "episode_reward"][rollout["next", "done"]]
        mean_return = round(float(returns.mean()), 4) if len(returns) > 0 else mean_return
        curve.append({"steps": (len(curve) + 1) * batch_size, "return": mean_return})
    collector.shutdown()
    return policy_of(mean, obs_scale(settings), "torchrl", settings, curve[-1]), curve


def main() -> None:
    """Train one policy as the command line says, and write it to a file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", help='mode and number of rods, as in "swingup-2"')
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path(), help="folder of the files")
    parser.add_argument("--steps", type=int, help="environment steps in total")
    arguments = parser.parse_args()
    if arguments.steps is not None and arguments.steps < 1:
        parser.error(f"--steps must be at least 1, got {arguments.steps}")
    changes = {"total_timesteps": arguments.steps} if arguments.steps else {}
    settings = settings_of(arguments.task, seed=arguments.seed, **changes)
    policy, curve = train(settings, arguments.task)
    path = arguments.out / f"{arguments.task}.safetensors"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_csv(path.with_suffix(".csv"), curve)
    policy.save(path)
    print(f"{path}: {curve[-1]}")


if __name__ == "__main__":
    main()
