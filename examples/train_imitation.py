"""Imitation: a network that swings up three or four rods, taught by one that knows a plan.

Run it with `python examples/train_imitation.py swingup-3`: it writes `swingup-3.npz`, a policy of
plain numbers for `examples/evaluate.py`, and `swingup-3.csv`, its learning curve. The teacher
(`npend_gym.rl.planning`) computes a swing-up, knows the clock and follows it by time-varying
feedback; the pupil sees the chain alone. Ross, Gordon, Bagnell, arXiv:1011.0686 (DAgger): the pupil
acts, the teacher says what it would have done. Noise on the actions shows more of the
neighbourhood of the path (Laskey, Lee, Fox, Dragan, Goldberg, arXiv:1703.09327).
"""

from __future__ import annotations

import argparse
import math
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import torch
from torch import nn
from tqdm import tqdm
from train_cleanrl import as_policy, keep, network

from npend_gym.rl.planning import Follower, planned_swing_up
from npend_gym.rl.policies import Policy


@dataclass(frozen=True)
class Settings:
    """What a training run is made of; every result is a function of this."""

    env: dict[str, Any] = field(default_factory=dict[str, Any])  # keywords of gym.make_vec
    seed: int = 0
    seconds: float = 4.5  # of the plan
    guesses: int = 24  # from which plans are made
    teachers: int = 3  # with other plans, each with a pupil of its own until the first round
    demonstrations: int = 4  # episodes of a teacher in every lane
    rounds: int = 4  # the pupil acts in most lanes
    num_envs: int = 512
    teacher_share: float = 0.3  # of the lanes
    noise: float = 0.1  # largest standard deviation on the teacher's actions
    standing: int = 120  # steps after the plan: the goal is to be met for 100
    tube: float = 0.6  # rad, and rad/s; the teacher is not asked about states further off
    keep: int = 800_000  # states
    first_epochs: int = 24  # over the demonstrations
    epochs: int = 6  # of a round
    minibatch: int = 1024
    learning_rate: float = 2e-3  # falls to zero in every round, along a cosine
    hidden: int = 192
    scale: tuple[float, float, float] = (0.3, 0.3, 1.5)  # of sines, cosines and speeds [rad/s]


TASKS: dict[str, dict[str, Any]] = {
    "swingup-3": {},
    "swingup-4": {"seconds": 8.0, "noise": 0.05, "rounds": 10},
}


def settings_of(task: str, **changes: Any) -> Settings:
    """Return the settings for a task such as "swingup-3"."""
    mode, n = task.rsplit("-", 1)
    env = {"n": int(n), "mode": mode, "observation": "sincos"}
    return Settings(env=env, **(TASKS.get(task, {}) | changes))


class Lesson(NamedTuple):
    """States that were met, and what the teacher would have done there."""

    seen: torch.Tensor  # (states, k)
    actions: torch.Tensor  # (states, joints), clipped a little outside the box


def steadiest(settings: Settings, envs: gym.vector.VectorEnv) -> list[Follower]:
    """Return the teachers that noise on the actions throws off least, the steadiest first.

    A pupil's mistakes are such noise.
    """
    found: list[tuple[float, Follower]] = []
    for guess in range(settings.guesses):
        seed = settings.guesses * settings.seed + guess
        with suppress(RuntimeError):  # no plan comes of this guess
            teacher = planned_swing_up(envs.unwrapped.config, settings.seconds, tries=1, seed=seed)
            found.append((steadiness(teacher, settings, envs), teacher))
    if not found:
        raise RuntimeError("no guess became a plan: give it more seconds or guesses")
    found.sort(key=lambda pair: -pair[0])
    return [teacher for _, teacher in found[: settings.teachers]]


def steadiness(teacher: Follower, settings: Settings, envs: gym.vector.VectorEnv) -> float:
    """Return in which share of the lanes the chain stands in spite of noise."""
    rng = np.random.default_rng(settings.seed)
    observation, info = envs.reset(seed=100_000 * settings.seed)
    for _ in range(len(teacher.gains) + 20):
        action = teacher(observation, info)
        action = action + 2.0 * settings.noise * rng.normal(size=action.shape)
        observation, _, _, _, info = envs.step(action.clip(-1.0, 1.0))
    return float(np.mean(np.cos(info["theta"]).max(axis=1) < -0.9))


class School:
    """A teacher, and a pupil with all that it has been taught."""

    def __init__(self, settings: Settings, envs: gym.vector.VectorEnv, teacher: Follower) -> None:
        self.settings, self.envs, self.teacher = settings, envs, teacher
        config = envs.unwrapped.config
        self.scale = torch.tensor(settings.scale).repeat_interleave(config.chain.n)
        self.pupil = network(3 * config.chain.n, config.joints.size, settings.hidden, last_gain=0.1)
        self.shuffler = torch.Generator().manual_seed(settings.seed)
        shown = [self.play(k, 1.0)[0] for k in range(settings.demonstrations)]
        self.known = Lesson(*map(torch.cat, zip(*shown, strict=True)))
        self.learn(settings.first_epochs)

    @torch.no_grad()
    def act(self, observation: np.ndarray) -> np.ndarray:
        """Return what the pupil does."""
        return self.pupil(torch.from_numpy(observation) / self.scale).numpy()

    def play(self, episode: int, teacher_share: float) -> tuple[Lesson, dict[str, float]]:
        """Play an episode in every lane; return what can be learned, and how the pupil did."""
        settings, path = self.settings, self.teacher.plan.states
        rng = np.random.default_rng([settings.seed, episode])
        # these seeds are for training, those from 10^6 on for evaluation
        seed = 100_000 * settings.seed + settings.num_envs * episode
        observation, info = self.envs.reset(seed=seed)
        lanes, returns = np.arange(settings.num_envs), np.zeros(settings.num_envs)
        taught = lanes < teacher_share * lanes.size
        noise = (settings.noise * taught * rng.permutation(lanes) / lanes.size)[:, None]
        near = np.ones(lanes.size, bool)
        seen, wanted = [], []
        for step in range(len(path) + settings.standing):
            advice = self.teacher(observation, info)
            theta, omega = np.split(path[min(step, len(path) - 1)], 2)
            near &= np.abs(info["theta"] - theta).max(axis=1) < settings.tube
            near &= np.abs(info["omega"] - omega).max(axis=1) < settings.tube
            seen.append(observation[near])
            wanted.append(advice[near].clip(-1.5, 1.5))
            action = np.where(taught[:, None], advice, self.act(observation))
            action = action + noise * rng.normal(size=action.shape)
            observation, reward, _, _, info = self.envs.step(action.clip(-1.0, 1.0))
            returns += reward
        lesson = Lesson(
            torch.from_numpy(np.concatenate(seen)),
            torch.from_numpy(np.concatenate(wanted).astype(np.float32)),
        )
        own = {"return": returns[~taught], "success": info["success"][~taught]}
        return lesson, {name: round(float(v.mean()), 4) for name, v in own.items() if v.size}

    def take_in(self, lesson: Lesson) -> float:
        """Add a lesson to what is known and learn that; return the mean distance."""
        seen, actions = map(torch.cat, zip(self.known, lesson, strict=True))
        kept = torch.randperm(len(seen), generator=self.shuffler)[: self.settings.keep]
        self.known = Lesson(seen[kept], actions[kept])
        return self.learn(self.settings.epochs)

    def learn(self, epochs: int) -> float:
        """Fit the pupil to what is known; return the mean distance from the teacher's actions."""
        settings, lesson, count = self.settings, self.known, len(self.known.seen)
        optimizer = torch.optim.Adam(self.pupil.parameters(), fused=True)
        batches = math.ceil(count / settings.minibatch) * epochs
        done, total = 0, 0.0
        for _ in range(epochs):
            for rows in torch.randperm(count, generator=self.shuffler).split(settings.minibatch):
                rate = 0.5 * settings.learning_rate * (1.0 + math.cos(math.pi * done / batches))
                optimizer.param_groups[0]["lr"] = rate
                told = self.pupil(lesson.seen[rows] / self.scale)
                loss = nn.functional.smooth_l1_loss(told, lesson.actions[rows], beta=0.2)
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
                done += 1
                total += float((told.detach() - lesson.actions[rows]).abs().mean())
        return total / done


def train(settings: Settings, progress: str | None = None) -> tuple[Policy, list[dict[str, Any]]]:
    """Return the trained policy and its learning curve, a row for every round."""
    torch.set_num_threads(1)  # two are slower for networks this small
    torch.manual_seed(settings.seed)
    begun = time.perf_counter()
    envs = gym.make_vec(
        "NPendulum-v0", num_envs=settings.num_envs, max_episode_steps=None, **settings.env
    )
    schools = [School(settings, envs, teacher) for teacher in steadiest(settings, envs)]
    trials = [school.play(settings.demonstrations, settings.teacher_share) for school in schools]
    best = max(range(len(trials)), key=lambda k: (trials[k][1]["success"], trials[k][1]["return"]))
    school, (lesson, score) = schools[best], trials[best]
    episodes = len(schools) * (settings.demonstrations + 1)
    steps = (len(school.teacher.plan.states) + settings.standing) * settings.num_envs
    curve: list[dict[str, Any]] = []
    for round_ in tqdm(range(settings.rounds), progress, disable=None, unit="round"):
        if round_ > 0:
            lesson, score = school.play(settings.demonstrations + round_, settings.teacher_share)
        distance = school.take_in(lesson)
        seconds = round(time.perf_counter() - begun, 2)
        end = {"steps": (episodes + round_) * steps, "seconds": seconds}
        curve.append(end | score | {"distance": round(distance, 4)})
    envs.close()
    policy = as_policy(school.pupil, school.scale, "train_imitation.py", settings, curve[-1])
    return policy, curve


def main() -> None:
    """Train one policy and write it down."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", help='mode and number of rods, as in "swingup-3"')
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rounds", type=int, help="of acting and learning")
    parser.add_argument("--num-envs", type=int, help="environments side by side")
    parser.add_argument("--out", type=Path, default=Path())
    arguments = parser.parse_args()
    changes = {k: getattr(arguments, k) for k in ("rounds", "num_envs") if getattr(arguments, k)}
    policy, curve = train(
        settings_of(arguments.task, seed=arguments.seed, **changes), arguments.task
    )
    path = arguments.out / f"{arguments.task}.npz"
    keep(policy, curve, path)
    print(f"{path}: {curve[-1]}")


if __name__ == "__main__":
    main()
