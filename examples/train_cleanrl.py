"""PPO in one file, in PyTorch, straight on the native vector environment.

Run it with `python examples/train_cleanrl.py swingup-2`: it writes `swingup-2.npz`, a policy of
plain numbers for `examples/evaluate.py`, and `swingup-2.csv`, its learning curve.
"""

from __future__ import annotations

import argparse
import csv
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from torch import nn
from tqdm import tqdm

import npend_gym
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

    def __init__(self, inputs: int, actions: int, hidden: int, first_spread: float) -> None:
        super().__init__()
        self.mean = network(inputs, actions, hidden, last_gain=0.01)
        self.value = network(inputs, 1, hidden, last_gain=1.0)
        self.log_spread = nn.Parameter(torch.full((actions,), float(np.log(first_spread))))

    def distribution(self, seen: torch.Tensor) -> torch.distributions.Normal:
        """Return the distribution of the actions, each joint on its own."""
        return torch.distributions.Normal(
            self.mean(seen), self.log_spread.exp(), validate_args=False
        )


def network(inputs: int, outputs: int, hidden: int, last_gain: float) -> nn.Sequential:
    """Return a network with orthogonal weights."""
    sizes = [(inputs, hidden, 2**0.5), (hidden, hidden, 2**0.5), (hidden, outputs, last_gain)]
    layers: list[nn.Module] = []
    for wide, high, gain in sizes:
        layer = nn.Linear(wide, high)
        nn.init.orthogonal_(layer.weight, gain)
        nn.init.zeros_(layer.bias)
        layers += [layer, nn.Tanh()]
    return nn.Sequential(*layers[:-1])


def train(settings: Settings, progress: str | None = None) -> tuple[Policy, list[dict[str, Any]]]:
    """Return the trained policy and its learning curve, a row for every 16 rollouts."""
    torch.set_num_threads(1)  # two are slower for networks this small
    torch.manual_seed(settings.seed)
    shuffler = torch.Generator().manual_seed(settings.seed)
    envs = gym.make_vec(
        "NPendulum-v0",
        num_envs=settings.num_envs,
        autoreset_mode="SAME_STEP",
        **settings.env,
    )
    size = envs.single_observation_space.shape[0]
    joints = envs.single_action_space.shape[0]
    actor = Actor(size, joints, settings.hidden, settings.first_spread)
    optimizer = torch.optim.Adam(actor.parameters(), settings.learning_rate, eps=1e-5, fused=True)
    scale = np.repeat(np.float32(settings.scale), size // 3)

    lanes, length = settings.num_envs, settings.rollout
    seen = np.empty((length, lanes, size), np.float32)
    actions, odds = torch.empty(length, lanes, joints), torch.empty(length, lanes)
    rewards, ends = np.empty((length, lanes)), np.empty((length, lanes), bool)
    updates = max(1, settings.total_steps // (lanes * length))
    curve: list[dict[str, Any]] = []
    finished: list[tuple[float, float]] = []
    returns = np.zeros(lanes)
    begun = time.perf_counter()
    # the first seeds are for training, those from 10^6 on for evaluation
    observation, _ = envs.reset(seed=1000 * settings.seed)
    for update in tqdm(range(updates), desc=progress, disable=None, unit="update"):
        optimizer.param_groups[0]["lr"] = settings.learning_rate * (1.0 - update / updates)
        for t in range(length):
            seen[t] = observation
            with torch.no_grad():
                choice = actor.distribution(torch.from_numpy(observation / scale))
                actions[t] = choice.sample()
                odds[t] = choice.log_prob(actions[t]).sum(-1)
            observation, reward, terminated, truncated, info = envs.step(
                actions[t].clamp(-1.0, 1.0).numpy()
            )
            returns += reward
            rewards[t] = (1.0 - settings.discount) * reward  # so that values are of order one
            ends[t] = terminated | truncated
            if ends[t].any():
                rewards[t] += settings.discount * unfinished(info, truncated, actor, scale)
                success = info["final_info"].get("success", np.zeros(lanes))
                finished += zip(returns[ends[t]], success[ends[t]].astype(float), strict=True)
                returns[ends[t]] = 0.0
        learn(actor, optimizer, settings, shuffler, scale,
              (seen, actions, odds, rewards, ends, observation))  # fmt: skip
        if (update + 1) % 16 == 0 or update + 1 == updates:
            means = np.mean(finished, axis=0).round(4).tolist() if finished else (None, None)
            curve.append({
                "steps": (update + 1) * lanes * length,
                "seconds": round(time.perf_counter() - begun, 2),
                "return": means[0],
                "success": means[1],
                "spread": round(float(actor.log_spread.detach().exp().mean()), 4),
            })  # fmt: skip
            finished = []
    envs.close()
    return as_policy(actor, scale, settings, curve[-1]), curve


def unfinished(
    info: dict[str, Any], cut: np.ndarray, actor: Actor, scale: np.ndarray
) -> np.ndarray:
    """Return the value of what would have followed in lanes that ran out of time, else 0."""
    value = np.zeros(len(cut))
    if cut.any():
        with torch.no_grad():
            value[cut] = (
                actor.value(torch.from_numpy(np.stack(info["final_obs"][cut]) / scale))
                .squeeze(-1)
                .numpy()
            )
    return value


def learn(actor, optimizer, settings, shuffler, scale, rollout) -> None:
    """Improve actor and values by what was seen in a rollout."""
    seen, actions, odds, rewards, ends, observation = rollout
    length, lanes = rewards.shape
    states = torch.from_numpy(seen / scale).reshape(length * lanes, -1)
    with torch.no_grad():
        values = actor.value(states).reshape(length, lanes).numpy()
        following = actor.value(torch.from_numpy(observation / scale)).squeeze(-1).numpy()
    advantages, later = np.empty((length, lanes), np.float32), np.zeros(lanes)
    for t in reversed(range(length)):
        goes_on = settings.discount * ~ends[t]
        surprise = rewards[t] + goes_on * following - values[t]
        advantages[t] = later = surprise + goes_on * settings.trace * later
        following = values[t]
    targets = torch.from_numpy(advantages + values).reshape(-1)
    gains = torch.from_numpy(advantages).reshape(-1)
    tried, before = actions.reshape(length * lanes, -1), odds.reshape(-1)
    for _ in range(settings.epochs):
        for rows in torch.randperm(len(states), generator=shuffler).split(settings.minibatch):
            gain = gains[rows]
            gain = (gain - gain.mean()) / (gain.std() + 1e-8)
            choice = actor.distribution(states[rows])
            ratio = (choice.log_prob(tried[rows]).sum(-1) - before[rows]).exp()
            kept = ratio.clamp(1.0 - settings.clip, 1.0 + settings.clip)
            loss = -torch.min(ratio * gain, kept * gain).mean()
            loss = (
                loss + 0.5 * (actor.value(states[rows]).squeeze(-1) - targets[rows]).square().mean()
            )
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(actor.parameters(), 0.5)
            optimizer.step()


def as_policy(actor: Actor, scale: np.ndarray, settings: Settings, last: dict[str, Any]) -> Policy:
    """Return the mean action as plain arrays, with where it comes from."""
    linear = [layer for layer in actor.mean if isinstance(layer, nn.Linear)]
    return Policy(
        scale=scale,
        weights=[layer.weight.detach().numpy() for layer in linear],
        biases=[layer.bias.detach().numpy() for layer in linear],
        provenance={
            "trained_by": "examples/train_cleanrl.py",
            "npend_gym": npend_gym.__version__,
            "torch": torch.__version__,
            "env": {k: v for k, v in settings.env.items() if k != "max_episode_steps"},
            "settings": asdict(settings),
            "training": last,
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
    "calm-10": {"total_steps": 600_000, "discount": 0.99},
    "swingup-2": {"total_steps": 2_000_000},
}


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


def main() -> None:
    """Train one policy and write it down."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", help='mode and number of rods, as in "swingup-2"')
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, help="environment steps in all")
    parser.add_argument("--out", type=Path, default=Path())
    arguments = parser.parse_args()
    changes = {} if arguments.steps is None else {"total_steps": arguments.steps}
    settings = settings_of(arguments.task, seed=arguments.seed, **changes)
    policy, curve = train(settings, arguments.task)
    arguments.out.mkdir(parents=True, exist_ok=True)
    policy.save(arguments.out / f"{arguments.task}.npz")
    with (arguments.out / f"{arguments.task}.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, curve[0].keys())
        writer.writeheader()
        writer.writerows(curve)
    print(f"{arguments.task}: {curve[-1]}")


if __name__ == "__main__":
    main()
