"""Imitation: a network that swings up three or four rods learns from a planned swing-up.

The expert (`npend_gym.rl.planned_swing_up`) plans a trajectory, knows the clock and tracks the
trajectory by time-varying feedback; the student sees the chain alone. In DAgger (Ross, Gordon,
Bagnell, arXiv:1011.0686) the student acts and the expert says what it would have done. Noise on the
actions shows more of the neighbourhood of the trajectory (Laskey, Lee, Fox, Dragan, Goldberg,
arXiv:1703.09327).
"""

# torch's stubs leave parts unknown
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

import math
import time
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import nn
from tqdm import tqdm

from npend_gym.envs.registration import ENV_ID
from npend_gym.rl.planning import PlannedTransition, planned_swing_up
from npend_gym.rl.policies import Policy
from npend_gym.rl.rollouts import make_envs
from npend_gym.rl.training.tasks import Curve, env_of_task, network, policy_of


@dataclass(frozen=True)
class Settings:
    """The settings of a training run; its result depends on nothing else."""

    env: dict[str, Any] = field(default_factory=dict[str, Any])  # keywords of gym.make_vec
    seed: int = 0
    seconds: float = 4.5  # of the planned trajectory
    guesses: int = 24  # from which trajectories are planned
    experts: int = 3  # with different trajectories, each with a student until the first round
    demonstrations: int = 4  # episodes in which the expert acts in every environment
    rounds: int = 4  # of DAgger; the student acts in most environments
    num_envs: int = 512
    expert_fraction: float = 0.3  # of the environments in a round
    noise_std: float = 0.1  # largest standard deviation of the noise on the expert's actions
    standing: int = 120  # steps after the trajectory; success needs 100
    tube: float = 0.6  # rad, and rad/s; states further from the trajectory are not learned
    max_states: int = 800_000  # in the dataset
    first_epochs: int = 24  # over the demonstrations
    epochs: int = 6  # of a round
    minibatch_size: int = 1024
    learning_rate: float = 2e-3  # falls to zero in every round, along a cosine
    hidden: int = 192
    obs_scale: tuple[float, float, float] = (0.3, 0.3, 1.5)  # of sines, cosines, speeds [rad/s]


TASKS: dict[str, dict[str, Any]] = {
    "swingup-3": {},
    "swingup-4": {"seconds": 8.0, "noise_std": 0.05, "rounds": 10},
}


def settings_of(task: str, **changes: Any) -> Settings:
    """Return the settings for a task such as "swingup-3"."""
    return Settings(env=env_of_task(task), **(TASKS.get(task, {}) | changes))


class Dataset(NamedTuple):
    """Observations, and what the expert would have done there."""

    observations: torch.Tensor  # (states, k)
    actions: torch.Tensor  # (states, joints), within [-1.5, 1.5]


def most_robust(settings: Settings, envs: Any) -> list[PlannedTransition]:
    """Return the experts that most often stand in spite of noise, the most robust first.

    The mistakes of a student are like noise on the actions.
    """
    found: list[tuple[float, PlannedTransition]] = []
    for guess in range(settings.guesses):
        seed = settings.guesses * settings.seed + guess
        with suppress(RuntimeError):  # this guess leads to no trajectory
            expert = planned_swing_up(envs.unwrapped.config, settings.seconds, tries=1, seed=seed)
            found.append((robustness(expert, settings, envs), expert))
    if not found:
        raise RuntimeError("no guess led to a trajectory: give it more seconds or guesses")
    found.sort(key=lambda pair: -pair[0])
    return [expert for _, expert in found[: settings.experts]]


def robustness(expert: PlannedTransition, settings: Settings, envs: Any) -> float:
    """Return the fraction of the environments in which the chain stands in spite of noise."""
    rng = np.random.default_rng(settings.seed)
    observation, info = envs.reset(seed=100_000 * settings.seed)
    for _ in range(len(expert.gains) + 20):
        action = expert(observation, info)
        action = action + 2.0 * settings.noise_std * rng.normal(size=action.shape)
        observation, _, _, _, info = envs.step(action.clip(-1.0, 1.0))
    return float(np.mean(np.cos(info["theta"]).max(axis=1) < -0.9))


class DAgger:
    """An expert, and a student with the dataset that it learns from."""

    def __init__(self, settings: Settings, envs: Any, expert: PlannedTransition) -> None:
        self.settings, self.envs, self.expert = settings, envs, expert
        config = envs.unwrapped.config
        self.obs_scale = torch.tensor(settings.obs_scale).repeat_interleave(config.chain.n)
        inputs, outputs = 3 * config.chain.n, config.joints.size
        self.student = network(inputs, outputs, settings.hidden, last_gain=0.1)
        self.shuffler = torch.Generator().manual_seed(settings.seed)
        shown = [self.play(k, 1.0)[0] for k in range(settings.demonstrations)]
        self.dataset = Dataset(*map(torch.cat, zip(*shown, strict=True)))
        self.fit(settings.first_epochs)

    @torch.no_grad()
    def act(self, observation: np.ndarray) -> np.ndarray:
        """Return the student's actions."""
        return self.student(torch.from_numpy(observation) / self.obs_scale).numpy()

    def play(self, episode: int, expert_fraction: float) -> tuple[Dataset, dict[str, float]]:
        """Play an episode in every environment.

        Returns
        -------
        Dataset
            The states near the trajectory, with the expert's actions.
        dict
            "return" and "success" of the environments in which the student acted.
        """
        settings, states = self.settings, self.expert.nominal.states
        rng = np.random.default_rng([settings.seed, episode])
        # training takes seeds below 10^6, evaluation those from there on
        seed = 100_000 * settings.seed + settings.num_envs * episode
        observation, info = self.envs.reset(seed=seed)
        lanes, returns = np.arange(settings.num_envs), np.zeros(settings.num_envs)
        by_expert = lanes < expert_fraction * lanes.size
        std = (settings.noise_std * by_expert * rng.permutation(lanes) / lanes.size)[:, None]
        near = np.ones(lanes.size, bool)
        observations, labels = [], []
        for step in range(len(states) + settings.standing):
            expert_action = self.expert(observation, info)
            theta, omega = np.split(states[min(step, len(states) - 1)], 2)
            near &= np.abs(info["theta"] - theta).max(axis=1) < settings.tube
            near &= np.abs(info["omega"] - omega).max(axis=1) < settings.tube
            observations.append(observation[near])
            labels.append(expert_action[near].clip(-1.5, 1.5))
            action = np.where(by_expert[:, None], expert_action, self.act(observation))
            action = action + std * rng.normal(size=action.shape)
            observation, reward, _, _, info = self.envs.step(action.clip(-1.0, 1.0))
            returns += reward
        dataset = Dataset(
            torch.from_numpy(np.concatenate(observations)),
            torch.from_numpy(np.concatenate(labels).astype(np.float32)),
        )
        score = {"return": returns[~by_expert], "success": info["success"][~by_expert]}
        return dataset, {name: round(float(v.mean()), 4) for name, v in score.items() if v.size}

    def aggregate(self, new: Dataset) -> float:
        """Add `new` to the dataset and fit the student to it; return the mean distance."""
        observations, actions = map(torch.cat, zip(self.dataset, new, strict=True))
        chosen = torch.randperm(len(observations), generator=self.shuffler)
        chosen = chosen[: self.settings.max_states]
        self.dataset = Dataset(observations[chosen], actions[chosen])
        return self.fit(self.settings.epochs)

    def fit(self, epochs: int) -> float:
        """Fit the student to the dataset; return the mean distance from the expert's actions."""
        settings, dataset, size = self.settings, self.dataset, len(self.dataset.observations)
        optimizer = torch.optim.Adam(self.student.parameters(), fused=True)
        batches = math.ceil(size / settings.minibatch_size) * epochs
        done, total = 0, 0.0
        for _ in range(epochs):
            order = torch.randperm(size, generator=self.shuffler)
            for rows in order.split(settings.minibatch_size):
                rate = 0.5 * settings.learning_rate * (1.0 + math.cos(math.pi * done / batches))
                optimizer.param_groups[0]["lr"] = rate
                prediction = self.student(dataset.observations[rows] / self.obs_scale)
                loss = nn.functional.smooth_l1_loss(prediction, dataset.actions[rows], beta=0.2)
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
                done += 1
                total += float((prediction.detach() - dataset.actions[rows]).abs().mean())
        return total / done


def train(settings: Settings, progress: str | None = None) -> tuple[Policy, Curve]:
    """Return the trained policy and its learning curve, a row for every round."""
    torch.set_num_threads(1)  # two are slower for networks this small
    torch.manual_seed(settings.seed)
    start_time = time.perf_counter()
    envs = make_envs(ENV_ID, settings.num_envs, settings.env | {"max_episode_steps": None})
    pairs = [DAgger(settings, envs, expert) for expert in most_robust(settings, envs)]
    trials = [pair.play(settings.demonstrations, settings.expert_fraction) for pair in pairs]
    best = max(range(len(trials)), key=lambda k: (trials[k][1]["success"], trials[k][1]["return"]))
    dagger, (new, score) = pairs[best], trials[best]
    episodes = len(pairs) * (settings.demonstrations + 1)
    steps = (len(dagger.expert.nominal.states) + settings.standing) * settings.num_envs
    curve: Curve = []
    for round_ in tqdm(range(settings.rounds), progress, disable=None, unit="round"):
        if round_ > 0:
            new, score = dagger.play(settings.demonstrations + round_, settings.expert_fraction)
        distance = dagger.aggregate(new)
        seconds = round(time.perf_counter() - start_time, 2)
        counts = {"steps": (episodes + round_) * steps, "seconds": seconds}
        curve.append(counts | score | {"distance": round(distance, 4)})
    envs.close()
    student, scale = dagger.student, dagger.obs_scale
    return policy_of(student, scale, "imitation", settings, curve[-1]), curve
