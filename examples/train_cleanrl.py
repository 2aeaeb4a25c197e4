"""PPO in one file, in PyTorch, straight on the native vector environment.

Run it with `python examples/train_cleanrl.py swingup-2`: it writes `swingup-2.npz`, a policy of
plain numbers for `examples/evaluate.py`, and `swingup-2.csv`, its learning curve.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import torch
from torch import nn
from tqdm import tqdm

import npend_gym
from npend_gym.report.outputs import write_csv
from npend_gym.rl.policies import Policy


@dataclass(frozen=True)
class Settings:
    """What a training run is made of; every result is a function of this."""

    env: dict[str, Any] = field(default_factory=dict[str, Any])  # keywords of gym.make_vec
    seed: int = 0
    total_steps: int = 1_000_000
    num_envs: int = 32
    rollout: int = 128  # steps of every environment between two updates
    epochs: int = 10
    minibatch: int = 256
    learning_rate: float = 1e-3  # falls linearly to zero
    discount: float = 0.98
    trace: float = 0.95  # lambda of generalised advantage estimation
    clip: float = 0.2
    hidden: int = 64
    # What sines, cosines and speeds [rad/s] are divided by. A running mean and deviation would do
    # worse: chains that whirl would set the scale, and standing and creeping would look the same.
    scale: tuple[float, float, float] = (1.0, 1.0, 5.0)
    first_spread: float = 1.0  # standard deviation of the first actions


class Actor(nn.Module):
    """Two hidden layers of tanh for the mean action and as many for the value."""

    def __init__(self, inputs: int, actions: int, settings: Settings) -> None:
        super().__init__()
        self.scale = torch.tensor(settings.scale).repeat_interleave(inputs // 3)
        self.mean = network(inputs, actions, settings.hidden, last_gain=0.01)
        self.value = network(inputs, 1, settings.hidden, last_gain=1.0)
        self.log_spread = nn.Parameter(torch.full((actions,), math.log(settings.first_spread)))

    def act(self, seen: torch.Tensor) -> torch.distributions.Normal:
        """Return the distribution of the actions, each joint on its own."""
        mean = self.mean(seen / self.scale)
        return torch.distributions.Normal(mean, self.log_spread.exp(), validate_args=False)

    def judge(self, seen: torch.Tensor) -> torch.Tensor:
        """Return the value, (...), of observations, (..., k)."""
        return self.value(seen / self.scale).squeeze(-1)


def network(inputs: int, outputs: int, hidden: int, last_gain: float) -> nn.Sequential:
    """Return a network with orthogonal weights."""
    layers: list[nn.Module] = []
    for wide, high, gain in (
        (inputs, hidden, 2**0.5), (hidden, hidden, 2**0.5), (hidden, outputs, last_gain)
    ):  # fmt: skip
        layer = nn.Linear(wide, high)
        nn.init.orthogonal_(layer.weight, gain)
        nn.init.zeros_(layer.bias)
        layers += [layer, nn.Tanh()]
    return nn.Sequential(*layers[:-1])


class Rollout(NamedTuple):
    """What some steps of all environments have shown; leading axes are step and environment."""

    seen: torch.Tensor
    actions: torch.Tensor
    odds: torch.Tensor  # logarithm of the density with which the actions were drawn
    rewards: torch.Tensor  # times (1 - discount), so that values are of order one
    ends: torch.Tensor
    after: torch.Tensor  # the observation that follows


class Collector:
    """Steps the environments, and keeps count of the episodes that end."""

    def __init__(self, envs: gym.vector.VectorEnv, settings: Settings) -> None:
        self.envs, self.settings = envs, settings
        self.returns = np.zeros(envs.num_envs)
        self.finished: list[tuple[float, float]] = []  # return and success of each episode
        # these seeds are for training, those from 10^6 on for evaluation
        self.observation, _ = envs.reset(seed=1000 * settings.seed)

    @torch.no_grad()
    def collect(self, actor: Actor) -> Rollout:
        """Return the next rollout."""
        steps = []
        for _ in range(self.settings.rollout):
            seen = torch.from_numpy(self.observation)
            choice = actor.act(seen)
            action = choice.sample()
            self.observation, reward, terminated, truncated, info = self.envs.step(
                action.clamp(-1.0, 1.0).numpy()
            )
            worth, ended = (1.0 - self.settings.discount) * reward, terminated | truncated
            self.returns += reward
            if ended.any():
                self.count(ended, info["final_info"]["success"])
            if truncated.any():  # out of time: what would have followed counts
                last = torch.from_numpy(np.stack(info["final_obs"][truncated]))
                worth[truncated] += self.settings.discount * actor.judge(last).numpy()
            odds = choice.log_prob(action).sum(-1)
            steps.append((seen, action, odds, torch.from_numpy(worth), torch.from_numpy(ended)))
        return Rollout(
            *map(torch.stack, zip(*steps, strict=True)), torch.from_numpy(self.observation)
        )

    def count(self, ended: np.ndarray, success: np.ndarray) -> None:
        """Note return and success of the episodes that have ended."""
        self.finished += zip(self.returns[ended], success[ended].astype(float), strict=True)
        self.returns[ended] = 0.0


def train(settings: Settings, progress: str | None = None) -> tuple[Policy, list[dict[str, Any]]]:
    """Return the trained policy and its learning curve, a row for every 16 rollouts."""
    torch.set_num_threads(1)  # two are slower for networks this small
    torch.manual_seed(settings.seed)
    shuffler = torch.Generator().manual_seed(settings.seed)
    envs = gym.make_vec(
        "NPendulum-v0", num_envs=settings.num_envs, autoreset_mode="SAME_STEP", **settings.env
    )
    actor = Actor(
        envs.single_observation_space.shape[0], envs.single_action_space.shape[0], settings
    )
    optimizer = torch.optim.Adam(actor.parameters(), eps=1e-5, fused=True)
    collector = Collector(envs, settings)
    updates = max(1, settings.total_steps // (settings.num_envs * settings.rollout))
    curve: list[dict[str, Any]] = []
    begun = time.perf_counter()
    for update in tqdm(range(1, updates + 1), desc=progress, disable=None, unit="update"):
        rate = settings.learning_rate * (1.0 - (update - 1) / updates)
        optimizer.param_groups[0]["lr"] = rate
        learn(actor, optimizer, settings, shuffler, collector.collect(actor))
        if update % 16 == 0 or update == updates:
            ended, collector.finished = collector.finished, []
            means = np.mean(ended, axis=0).round(4).tolist() if ended else (None, None)
            curve.append({
                "steps": update * settings.num_envs * settings.rollout,
                "seconds": round(time.perf_counter() - begun, 2),
                "return": means[0],
                "success": means[1],
                "spread": round(float(actor.log_spread.detach().exp().mean()), 4),
            })  # fmt: skip
    envs.close()
    return as_policy(actor.mean, actor.scale, "train_cleanrl.py", settings, curve[-1]), curve


def learn(
    actor: Actor,
    optimizer: torch.optim.Optimizer,
    settings: Settings,
    shuffler: torch.Generator,
    rollout: Rollout,
) -> None:
    """Improve actor and values by what was seen in a rollout."""
    gains, targets = advantages(actor, settings, rollout)
    flat = [part.flatten(0, 1) for part in (rollout.seen, rollout.actions, rollout.odds)]
    flat += [gains.flatten(), targets.flatten()]
    for _ in range(settings.epochs):
        for rows in torch.randperm(len(flat[0]), generator=shuffler).split(settings.minibatch):
            seen, actions, odds, gain, target = (part[rows] for part in flat)
            gain = (gain - gain.mean()) / (gain.std() + 1e-8)
            ratio = (actor.act(seen).log_prob(actions).sum(-1) - odds).exp()
            kept = ratio.clamp(1.0 - settings.clip, 1.0 + settings.clip)
            loss = -torch.min(ratio * gain, kept * gain).mean()
            loss = loss + 0.5 * (actor.judge(seen) - target).square().mean()
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(actor.parameters(), 0.5)
            optimizer.step()


@torch.no_grad()
def advantages(
    actor: Actor, settings: Settings, rollout: Rollout
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return generalised advantages and the targets of the values, (steps, environments)."""
    values, following = actor.judge(rollout.seen), actor.judge(rollout.after)
    gains, later = torch.empty_like(values), torch.zeros(values.shape[1], dtype=torch.float64)
    for t in reversed(range(len(values))):
        goes_on = settings.discount * ~rollout.ends[t]
        later = rollout.rewards[t] + goes_on * (following + settings.trace * later) - values[t]
        gains[t], following = later, values[t]
    return gains, gains + values


def as_policy(
    mean: nn.Sequential, scale: torch.Tensor, script: str, settings: Any, end: dict[str, Any]
) -> Policy:
    """Return a network for the mean action as plain arrays, with what made it.

    `end` says how training ended.
    """
    linear = [layer for layer in mean if isinstance(layer, nn.Linear)]
    return Policy(
        scale=scale.numpy(),
        weights=[layer.weight.detach().numpy() for layer in linear],
        biases=[layer.bias.detach().numpy() for layer in linear],
        provenance={
            "npend_gym": npend_gym.__version__,
            "torch": torch.__version__,
            "trained_by": f"examples/{script}",
            "env": {k: v for k, v in settings.env.items() if k != "max_episode_steps"},
            "settings": asdict(settings),
            "training": end,
        },
    )


# Steps of an episode in training: 10 s of swing-up and balance, 20 s of calming; the environment's
# own 1000 steps would show the policy fewer starts.
EPISODE = {"swingup": 200, "balance": 500, "calm": 400}
_BALANCE = {"first_spread": 0.3, "discount": 0.99, "scale": (0.1, 1.0, 0.5)}  # small deviations
TASKS: dict[str, dict[str, Any]] = {
    "swingup-1": {"total_steps": 200_000},
    "balance-1": {"total_steps": 200_000} | _BALANCE,
    "balance-2": {"total_steps": 300_000} | _BALANCE,
    "balance-3": {"total_steps": 600_000} | _BALANCE,
    "calm-1": {"total_steps": 200_000, "discount": 0.99},
    "calm-2": {"total_steps": 200_000, "discount": 0.99},
    "calm-3": {"total_steps": 300_000, "discount": 0.99},
    "calm-5": {"total_steps": 500_000, "discount": 0.99},
    "swingup-2": {"total_steps": 2_000_000},
}


Trainer = Callable[[Settings, str | None], tuple[Policy, list[dict[str, Any]]]]


def settings_of(task: str, **changes: Any) -> Settings:
    """Return the settings for a task such as "swingup-2"."""
    mode, n = task.rsplit("-", 1)
    env = {
        "n": int(n),
        "mode": mode,
        "observation": "sincos",
        "max_episode_steps": EPISODE[mode],
    }
    return Settings(env=env, **(TASKS.get(task, {}) | changes))


def keep(policy: Policy, curve: list[dict[str, Any]], path: Path) -> None:
    """Write a policy to `path` (.npz), after its learning curve beside it (.csv)."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_csv(path.with_suffix(".csv"), curve)
    policy.save(path)


def main(train: Trainer = train, description: str | None = __doc__) -> None:
    """Train one policy and write it down."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("task", help='mode and number of rods, as in "swingup-2"')
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, help="environment steps in all")
    parser.add_argument("--out", type=Path, default=Path())
    arguments = parser.parse_args()
    changes = {} if arguments.steps is None else {"total_steps": arguments.steps}
    settings = settings_of(arguments.task, seed=arguments.seed, **changes)
    policy, curve = train(settings, arguments.task)
    keep(policy, curve, arguments.out / f"{arguments.task}.npz")
    print(f"{arguments.task}: {curve[-1]}")


if __name__ == "__main__":
    main()
