"""Value iteration with exact dynamics: the acrobot of dm_control swings up from any angles.

    python examples/value_iteration.py    45 minutes on one core
    python examples/value_iteration.py --evaluate acrobot.safetensors  in dm_control, with MuJoCo 3

One network learns the value of a state by looking ahead. In states that were visited, five actions
are simulated for 0.1 s each, and the value where they end is added to their rewards. Another
network is the policy; it follows the gradient of these sums by the action. Both learn from states
alone, so it does not matter which policy has visited them.

This is fitted value iteration: R. Munos, C. Szepesvari, "Finite-time bounds for fitted value
iteration", JMLR 9 (2008); with networks and a policy M. Lutter and others, "Value iteration in
continuous actions, states and time", ICML 2021. Rewards, starts and the motor of 2 N m are those of
dm_control's `acrobot swingup`.
"""

from __future__ import annotations

import argparse
import copy
import math
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from npend_gym.envs import EnvConfig
from npend_gym.physics import Ensemble
from npend_gym.report import prepare_file, write_csv
from npend_gym.rl import HELD_OUT, Policy
from npend_gym.rl.training import Checkpoint, Curve, Stopwatch, TrainingSettings, policy_of
from npend_gym.tools import FloatArray

SCRIPT = "examples/value_iteration.py"  # named in the record of the policy
HOLD, SUBSTEPS = 0.1, 5  # s of an action; Runge-Kutta steps in it, a reward after each of them
ENV = {
    "n": 2, "mode": "swingup", "chain": "dm_control acrobot", "actuated": (1,), "max_torque": 2.0,
    "dt": HOLD, "observation": "sincos",
}  # fmt: skip
SCALE = np.array([1.0, 1.0, 1.0, 1.0, 3.0, 5.0], np.float32)  # of sines, cosines, speeds [rad/s]
LEVELS = np.array([-1.0, -0.3, 0.0, 0.3, 1.0])  # actions that are tried; small ones hold it upright
EPISODE = 10.0  # s
RADIUS, MARGIN = 0.2, 1.0  # m: of the target; beyond it, where the reward is 0.1


@dataclass(frozen=True)
class Settings(TrainingSettings):
    """The settings of a training run; its result depends on nothing else."""

    env: dict[str, Any] = field(default_factory=lambda: dict(ENV))
    updates: int = 100_000  # of both networks
    batch: int = 512  # states in an update
    lanes: int = 256  # pendulums that the policy moves, one action in an update
    memory: int = 400_000  # states that are kept
    hidden: int = 256  # units in each of three layers
    learning_rate: float = 2e-3  # Adam's, falls to zero
    horizon: float = 4.0  # s: the discount is exp(-time / horizon)


def reward(theta: FloatArray, lengths: FloatArray) -> FloatArray:
    """Return the reward of dm_control, (B,), for angles (B, n): 1 where the tip is at the top."""
    tip = np.sin(theta) @ lengths, np.cos(theta) @ lengths + lengths.sum()
    return 0.1 ** (np.maximum(np.hypot(*tip) - RADIUS, 0.0) / MARGIN) ** 2


def starts(rng: np.random.Generator, size: int) -> FloatArray:
    """Return states at rest, (size, 4): both joints at any angle, as dm_control draws them."""
    theta = np.pi - rng.uniform(-np.pi, np.pi, (size, 2)).cumsum(axis=1)
    return np.hstack([theta, np.zeros((size, 2))])


class Futures:
    """Pendulums in which actions are tried."""

    def __init__(self, settings: Settings) -> None:
        config = EnvConfig(**settings.env)
        self.config, self.lengths = config, config.chain.lengths
        self.torque = config.action_limits[0]
        self.discount = math.exp(-HOLD / settings.horizon)
        self.ensemble = cache(lambda size: Ensemble(config.chain, size, joints=config.actuated))

    def step(self, states: FloatArray, actions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the states after an action, (B, 4), and their mean rewards on the way, (B,)."""
        moved, rewards = self.ensemble(len(states)), np.zeros(len(states))
        moved.set_state(slice(None), states[:, :2], states[:, 2:])
        for _ in range(SUBSTEPS):
            moved.advance(self.torque * actions[:, None], HOLD / SUBSTEPS, substeps=1)
            rewards += reward(moved.theta, self.lengths) / SUBSTEPS
        return np.hstack([moved.theta, moved.omega]), rewards

    def look_ahead(self, states: FloatArray, value: Any) -> FloatArray:
        """Return the discounted sum of the rewards after each of `LEVELS`, (B, 5)."""
        tried = np.repeat(states, len(LEVELS), axis=0), np.tile(LEVELS, len(states))
        ends, rewards = self.step(*tried)
        sums = (1.0 - self.discount) * rewards + self.discount * value(ends)
        return sums.reshape(-1, len(LEVELS))


def network(hidden: int, activation: type[nn.Module]) -> nn.Sequential:
    """Return a network from observations to one number."""
    sizes = [SCALE.size, hidden, hidden, hidden]
    layers = [
        each
        for width_in, width_out in pairwise(sizes)
        for each in (nn.Linear(width_in, width_out), activation())
    ]
    return nn.Sequential(*layers, nn.Linear(hidden, 1))


def observed(states: FloatArray) -> Tensor:
    """Return what the networks are given, (B, 6)."""
    theta, omega = states[:, :2], states[:, 2:]
    seen = np.hstack([np.sin(theta), np.cos(theta), omega]).astype(np.float32)
    return torch.from_numpy(seen / SCALE)


def interpolated(action: Tensor, sums: FloatArray) -> Tensor:
    """Return the sums of `LEVELS`, (B, 5), interpolated at an action, (B,)."""
    levels, known = torch.from_numpy(LEVELS).float(), torch.from_numpy(sums).float()
    right = torch.searchsorted(levels, action.detach()).clamp(1, len(levels) - 1)[:, None]
    low, high = known.gather(1, right - 1)[:, 0], known.gather(1, right)[:, 0]
    start, end = levels[right[:, 0] - 1], levels[right[:, 0]]
    return low + (action - start) / (end - start) * (high - low)


class Learner:
    """The networks, their means over the last updates, and the states that were visited."""

    script, settings_type = SCRIPT, Settings
    changes = ("rng", "value", "policy", "means", "optimizers", "lanes", "ages", "states", "count")

    def __init__(self, settings: Settings) -> None:
        self.settings, self.futures = settings, Futures(settings)
        self.rng = np.random.default_rng(settings.seed)
        torch.manual_seed(settings.seed)
        self.value = network(settings.hidden, nn.SiLU)
        self.policy = network(settings.hidden, nn.ReLU)
        self.means = [copy.deepcopy(self.value), copy.deepcopy(self.policy)]
        parts = self.value, self.policy
        self.optimizers = [torch.optim.Adam(part.parameters()) for part in parts]
        self.lanes = starts(self.rng, settings.lanes)
        self.ages = self.rng.integers(round(EPISODE / HOLD), size=settings.lanes)
        self.states = np.zeros((settings.memory, 4))
        self.count = 0  # of states that were visited

    def valued(self, states: FloatArray) -> FloatArray:
        """Return the value of states, (B,)."""
        with torch.no_grad():
            return self.means[0](observed(states))[:, 0].numpy().astype(float)

    def act(self, states: FloatArray) -> FloatArray:
        """Return the actions of the policy, (B,)."""
        with torch.no_grad():
            return self.means[1](observed(states))[:, 0].tanh().numpy().astype(float)

    def explored(self, states: FloatArray) -> FloatArray:
        """Return actions, (B,): one half of the policy, one by looking ahead; both with noise."""
        size, rng = len(states), self.rng
        ahead = self.futures.look_ahead(states[size // 2 :], self.valued)
        actions = np.append(self.act(states[: size // 2]), LEVELS[ahead.argmax(axis=1)])
        # of each half a quarter has none, the others have more and more
        noise, share = [0.0, 0.2, 0.5, 1.0], [0.0, 0.0, 0.1, 0.3]
        kind = np.arange(size) % len(noise)
        actions += np.choose(kind, noise) * rng.normal(size=size) * (rng.random(size) < 0.5)
        is_random = rng.random(size) < np.choose(kind, share)
        return np.where(is_random, rng.uniform(-1.0, 1.0, size), actions.clip(-1.0, 1.0))

    def explore(self) -> None:
        """Move the lanes by one action, and keep where they are."""
        self.lanes, _ = self.futures.step(self.lanes, self.explored(self.lanes))
        self.ages += 1
        done = self.ages * HOLD >= EPISODE
        self.lanes[done], self.ages[done] = starts(self.rng, int(done.sum())), 0
        self.keep(self.lanes)

    def keep(self, states: FloatArray) -> None:
        """Keep states that were visited, (B, 4), in place of the oldest."""
        self.states[(self.count + np.arange(len(states))) % len(self.states)] = states
        self.count += len(states)

    def update(self, left: float) -> float:
        """Improve both networks, with the share of the run that is left; return the mean value."""
        batch, rng = self.settings.batch, self.rng
        self.explore()
        states = self.states[rng.integers(min(self.count, len(self.states)), size=batch)]
        sums = self.futures.look_ahead(states, self.valued)
        best, width = sums.max(axis=1), np.ptp(sums, axis=1)
        # a state and its mirror image need opposite actions and have the same value
        sign = rng.choice([-1.0, 1.0], batch)
        seen, mirror = observed(states * sign[:, None]), torch.from_numpy(sign).float()
        error = self.value(seen)[:, 0] - torch.from_numpy(best).float()
        # sums are interpolated between the actions that were tried; noise makes the kinks smooth
        noise = 0.3 * (0.3 + 0.7 * left) * torch.from_numpy(rng.normal(size=batch)).float()
        signal = self.policy(seen)[:, 0]
        action = (signal.tanh() * mirror + noise).clamp(-1.0, 1.0)
        gain = interpolated(action, sums / (width + 0.1 * width.mean() + 1e-9)[:, None])
        losses = (error**2).mean(), 1e-3 * (signal**2).mean() - gain.mean()
        rates = left**0.5, left
        for loss, optimizer, rate in zip(losses, self.optimizers, rates, strict=True):
            optimizer.param_groups[0]["lr"] = self.settings.learning_rate * rate
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
        networks = self.value, self.policy
        for mean, trained, share in zip(self.means, networks, (0.1, 0.01), strict=True):
            with torch.no_grad():
                for old, new in zip(mean.parameters(), trained.parameters(), strict=True):
                    old.lerp_(new, share)
        return float(best.mean())


def returns_of(act: Any, futures: Futures, size: int, seed: int) -> FloatArray:
    """Return the returns in some episodes, (size,), 1000 at best."""
    states, returns = starts(np.random.default_rng(seed), size), np.zeros(size)
    for _ in range(round(EPISODE / HOLD)):
        states, rewards = futures.step(states, act(states))
        returns += rewards * 1000.0 * HOLD / EPISODE
    return returns


def train(
    settings: Settings, progress: str | None = None, checkpoint: Checkpoint | None = None,
    kind: type[Learner] = Learner,
) -> tuple[Policy, Curve]:  # fmt: skip
    """Return the trained policy and its learning curve, a row for every thousandth update."""
    torch.set_num_threads(1)
    learner, curve, clock = kind(settings), [], Stopwatch()
    futures = Futures(settings)
    parts = {"learner": learner, "curve": curve, "clock": clock}
    checkpoint = checkpoint or Checkpoint(settings)
    for update in checkpoint.rounds(parts, settings.updates, progress, "update"):
        mean = learner.update(1.0 - (update - 1) / settings.updates)
        if update % 1000 == 0 or update == settings.updates:
            returns = returns_of(learner.act, futures, 100, settings.seed)
            curve.append({
                "updates": update,
                "seconds": round(clock.seconds, 2),
                "value": round(mean, 4),
                "return": round(float(returns.mean()), 1),
            })  # fmt: skip
    made = policy_of(learner.means[1], torch.from_numpy(SCALE), kind.script, settings, curve[-1])
    return replace(made, activation="relu", output="tanh"), curve


def evaluate(policy: Policy, episodes: int, seed: int = HELD_OUT) -> FloatArray:
    """Return the returns of a policy in dm_control's own `acrobot swingup`, (episodes,)."""
    from dm_control import suite

    returns = np.zeros(episodes)
    for k in range(episodes):
        env = suite.load("acrobot", "swingup", task_kwargs={"random": seed + k})
        step, state, hold = env.reset(), env.physics.data, round(HOLD / env.control_timestep())
        while not step.last():  # its angles are from upright, clockwise, and of each joint
            action = policy.act(np.pi - state.qpos.cumsum(), -state.qvel.cumsum())
            for _ in range(hold):
                step = env.step(-action)
                returns[k] += step.reward
    return returns


def main(kind: type[Learner] = Learner, about: str | None = __doc__) -> None:
    """Train a policy, or evaluate one."""
    parser = argparse.ArgumentParser(
        description=about, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--updates", type=int, default=kind.settings_type.updates)
    parser.add_argument("--out", type=Path, default=Path("acrobot.safetensors"), metavar="FILE")
    parser.add_argument("--evaluate", type=Path, metavar="FILE", help="a policy, in dm_control")
    parser.add_argument("--episodes", type=int, default=20, help="of --evaluate")
    arguments = parser.parse_args()
    if arguments.evaluate:
        returns = evaluate(Policy.load(arguments.evaluate), arguments.episodes)
        error = returns.std(ddof=1) / math.sqrt(len(returns))
        print(f"mean return {returns.mean():.0f} +- {error:.0f}, {returns.round().tolist()}")
        return
    if arguments.updates < 1:
        parser.error(f"--updates must be at least 1, got {arguments.updates}")
    settings = kind.settings_type(seed=arguments.seed, updates=arguments.updates)
    prepare_file(arguments.out, [".safetensors"])
    policy, curve = train(settings, "acrobot", kind=kind)
    policy.save(arguments.out)
    write_csv(arguments.out.with_suffix(".csv"), curve)
    print(f"{arguments.out}: {curve[-1]}")


if __name__ == "__main__":
    main()
