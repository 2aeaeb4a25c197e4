"""PPO in one file, in PyTorch, straight on the native vector environment.

The names are those of CleanRL's `ppo_continuous_action.py`, to be compared line by line. It differs
in that observations are divided by fixed numbers, that an episode out of time is bootstrapped with
the value of its last observation, and that values are not clipped.
"""

# torch's stubs leave parts unknown
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import nn
from torch.distributions.normal import Normal

from npend_gym._checks import BoolArray
from npend_gym.envs import EnvConfig
from npend_gym.rl.evaluation.seeds import episode_seeds
from npend_gym.rl.evaluation.settings import setting_of
from npend_gym.rl.policies.policy import Policy
from npend_gym.rl.training.checkpoints import Checkpoint, Stopwatch, TorchRandom
from npend_gym.rl.training.keywords import OF_EPISODES, used_config
from npend_gym.rl.training.tasks import (
    Curve,
    TrainingSettings,
    env_of_task,
    network,
    observation_scale,
    one_thread,
    policy_of,
)


@dataclass(frozen=True)
class Settings(TrainingSettings):
    """The settings of a training run; its result depends on nothing else."""

    total_timesteps: int = 1_000_000
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
    # What sines, cosines and speeds [rad/s] are divided by. A running mean and deviation would do
    # worse: chains that whirl would set the scale, and standing and creeping would look the same.
    obs_scale: tuple[float, float, float] = (1.0, 1.0, 5.0)
    init_std: float = 1.0  # of the first actions


class Agent(nn.Module):
    """Two networks of two hidden tanh layers: one for the mean action, one for the value."""

    def __init__(self, config: EnvConfig, settings: Settings) -> None:
        super().__init__()
        inputs, actions = config.observed, config.joints.size
        self.obs_scale = observation_scale(config, settings.obs_scale)
        self.actor_mean = network(inputs, actions, settings.hidden, last_gain=0.01)
        self.critic = network(inputs, 1, settings.hidden, last_gain=1.0)
        self.actor_logstd = nn.Parameter(torch.full((actions,), math.log(settings.init_std)))

    def get_action_dist(self, obs: torch.Tensor) -> Normal:
        """Return the distribution of the actions; the joints are independent."""
        mean = self.actor_mean(obs / self.obs_scale)
        return Normal(mean, self.actor_logstd.exp(), validate_args=False)

    def get_value(self, obs: torch.Tensor) -> torch.Tensor:
        """Return the value, (...), of observations, (..., k)."""
        return self.critic(obs / self.obs_scale).squeeze(-1)


class Rollout(NamedTuple):
    """Some steps of all environments; the leading axes are step and environment."""

    obs: torch.Tensor
    actions: torch.Tensor
    log_probs: torch.Tensor
    rewards: torch.Tensor  # times (1 - gamma), so that values are of order one
    dones: torch.Tensor  # whether the episode ended with this step
    next_obs: torch.Tensor  # after the last step, (environments, k)


class Collector:
    """Steps the environments, and records the episodes that end."""

    changes = ("envs", "obs", "returns", "finished")

    def __init__(self, envs: Any, settings: Settings) -> None:
        self.envs, self.settings = envs, settings
        self.returns = np.zeros(envs.num_envs)
        self.finished: list[tuple[float, float]] = []  # return and success of each episode
        seeds = episode_seeds("training", envs.num_envs, run=settings.seed, spacing=1000)
        self.obs, _ = envs.reset(seed=seeds.start)

    @torch.no_grad()
    def collect(self, agent: Agent) -> Rollout:
        """Return the next rollout."""
        gamma, steps = self.settings.gamma, list[Any]()
        for _ in range(self.settings.num_steps):
            obs = torch.from_numpy(self.obs)
            dist = agent.get_action_dist(obs)
            action = dist.sample()
            self.obs, reward, terminated, truncated, info = self.envs.step(
                action.clamp(-1.0, 1.0).numpy()
            )
            done = terminated | truncated
            self.returns += reward
            if done.any():
                self.record(done, info["final_info"]["success"])
            reward = (1.0 - gamma) * reward
            if truncated.any():  # out of time: the value of the last observation stands in
                final_obs = torch.from_numpy(np.stack(info["final_obs"][truncated]))
                reward[truncated] += gamma * agent.get_value(final_obs).numpy()
            log_prob = dist.log_prob(action).sum(-1)
            steps.append((obs, action, log_prob, torch.from_numpy(reward), torch.from_numpy(done)))
        parts: list[Any] = [torch.stack(part) for part in zip(*steps, strict=True)]
        return Rollout._make([*parts, torch.from_numpy(self.obs)])

    def record(self, done: BoolArray, success: BoolArray) -> None:
        """Record return and success of the episodes that have ended."""
        self.finished += zip(self.returns[done], success[done].astype(float), strict=True)
        self.returns[done] = 0.0


@one_thread()
def train(
    settings: Settings, progress: str | None = None, checkpoint: Checkpoint | None = None
) -> tuple[Policy, Curve]:
    """Return the trained policy and its learning curve, a row for every 16 iterations."""
    config = used_config("ppo", settings.env, OF_EPISODES)
    torch.manual_seed(settings.seed)
    shuffler = torch.Generator().manual_seed(settings.seed)
    envs = setting_of(settings.env).make(settings.num_envs, autoreset_mode="SAME_STEP")
    agent = Agent(config, settings)
    optimizer = torch.optim.Adam(agent.parameters(), eps=1e-5, fused=True)
    collector = Collector(envs, settings)
    batch_size = settings.num_envs * settings.num_steps
    num_iterations = max(1, settings.total_timesteps // batch_size)
    curve: Curve = []
    clock = Stopwatch()
    parts = {
        "agent": agent, "optimizer": optimizer, "collector": collector, "shuffler": shuffler,
        "random": TorchRandom(), "curve": curve, "clock": clock,
    }  # fmt: skip
    checkpoint = checkpoint or Checkpoint(settings)
    for iteration in checkpoint.rounds(parts, num_iterations, progress, "update"):
        frac = 1.0 - (iteration - 1) / num_iterations
        optimizer.param_groups[0]["lr"] = frac * settings.learning_rate
        update(agent, optimizer, settings, shuffler, collector.collect(agent))
        if iteration % 16 == 0 or iteration == num_iterations:
            finished, collector.finished = collector.finished, []
            means = np.mean(finished, axis=0).round(4).tolist() if finished else (None, None)
            curve.append({
                "steps": iteration * batch_size,
                "seconds": round(clock.seconds, 2),
                "return": means[0],
                "success": means[1],
                "std": round(float(agent.actor_logstd.detach().exp().mean()), 4),
            })  # fmt: skip
    envs.close()
    mean, scale = agent.actor_mean, agent.obs_scale
    return policy_of(mean, scale, "ppo", settings, curve[-1]), curve


def update(
    agent: Agent,
    optimizer: torch.optim.Optimizer,
    settings: Settings,
    shuffler: torch.Generator,
    rollout: Rollout,
) -> None:
    """Improve the policy and the value network with a rollout."""
    advantages, returns = gae(agent, settings, rollout)
    steps = (rollout.obs, rollout.actions, rollout.log_probs, advantages, returns)
    batch = [part.flatten(0, 1) for part in steps]
    for _ in range(settings.update_epochs):
        b_inds = torch.randperm(len(batch[0]), generator=shuffler)
        for mb_inds in b_inds.split(settings.minibatch_size):
            obs, actions, log_probs, mb_advantages, mb_returns = (part[mb_inds] for part in batch)
            mean, std = mb_advantages.mean(), mb_advantages.std()
            mb_advantages = (mb_advantages - mean) / (std + 1e-8)
            new_log_probs = agent.get_action_dist(obs).log_prob(actions).sum(-1)
            ratio = (new_log_probs - log_probs).exp()
            clipped = ratio.clamp(1.0 - settings.clip_coef, 1.0 + settings.clip_coef)
            pg_loss = -torch.min(ratio * mb_advantages, clipped * mb_advantages).mean()
            v_loss = (agent.get_value(obs) - mb_returns).square().mean()
            loss = pg_loss + settings.vf_coef * v_loss
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), settings.max_grad_norm)
            optimizer.step()


@torch.no_grad()
def gae(agent: Agent, settings: Settings, rollout: Rollout) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the generalised advantages and the returns, (steps, environments)."""
    values, next_values = agent.get_value(rollout.obs), agent.get_value(rollout.next_obs)
    advantages = torch.empty_like(values)
    lastgaelam = torch.zeros(values.shape[1], dtype=torch.float64)
    for t in reversed(range(len(values))):
        discount = settings.gamma * ~rollout.dones[t]
        following = next_values + settings.gae_lambda * lastgaelam
        lastgaelam = rollout.rewards[t] + discount * following - values[t]
        advantages[t], next_values = lastgaelam, values[t]
    return advantages, advantages + values


# Steps of an episode in training: 10 s of swing-up and balance, 20 s of calming. With the
# environment's own 1000 steps the policy would see fewer starts.
EPISODE = {"swingup": 200, "balance": 500, "calm": 400}
# The heaviest, longest chain under the weakest motor is slow: of 10 s it learns too little
LONGER = {"swingup-1-robust": 300}
_BALANCE = {"init_std": 0.3, "gamma": 0.99, "obs_scale": (0.1, 1.0, 0.5)}  # small deviations
TASKS: dict[str, dict[str, Any]] = {
    "swingup-1": {"total_timesteps": 200_000},
    "balance-1": {"total_timesteps": 200_000} | _BALANCE,
    "balance-2": {"total_timesteps": 300_000} | _BALANCE,
    "balance-3": {"total_timesteps": 600_000} | _BALANCE,
    "calm-1": {"total_timesteps": 200_000, "gamma": 0.99},
    "calm-2": {"total_timesteps": 200_000, "gamma": 0.99},
    "calm-3": {"total_timesteps": 300_000, "gamma": 0.99},
    "calm-5": {"total_timesteps": 500_000, "gamma": 0.99},
    "swingup-2": {"total_timesteps": 2_000_000},
    "swingup-1-robust": {"total_timesteps": 200_000},
    "calm-2-robust": {"total_timesteps": 200_000, "gamma": 0.99},
}


def settings_of(task: str, **changes: Any) -> Settings:
    """Return the settings for a task such as "swingup-2"."""
    env = env_of_task(task)
    env["max_episode_steps"] = LONGER.get(task, EPISODE[env["mode"]])
    return Settings(env=env, **(TASKS.get(task, {}) | changes))
