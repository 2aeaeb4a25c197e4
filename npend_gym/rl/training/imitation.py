"""Imitation: a network learns swing-ups of three and more rods, and transitions, from plans.

The expert (`npend_gym.rl.planned_swing_up`, `planned_transitions`) plans a trajectory, knows the
clock and tracks the trajectory by time-varying feedback; the student sees the chain alone. In
DAgger (Ross, Gordon, Bagnell, arXiv:1011.0686) the student acts and the expert says what it would
have done. A student that has learned little leaves the trajectory at once, and sees nothing of the
rest. Therefore in most environments the expert takes over where the student has come too far away,
and hands back when it has led the chain back, as in SafeDAgger (Zhang, Cho, arXiv:1605.06450). How
far is measured by the cost that the feedback minimises. In some environments the expert alone acts,
with noise (Laskey, Lee, Fox, Dragan, Goldberg, arXiv:1703.09327), in some the student alone.
"""

# torch's stubs leave parts unknown
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from npend_gym.envs.modes import Balance, Calm, SwingUp, Transition
from npend_gym.rl.controllers.planning import (
    PlannedTransition,
    Tracking,
    planned_swing_up,
    track,
)
from npend_gym.rl.controllers.step_model import at_rest
from npend_gym.rl.controllers.transcription import NominalTrajectory
from npend_gym.rl.controllers.transitions import PlannedTransitions, planned_transitions
from npend_gym.rl.evaluation.seeds import episode_seeds
from npend_gym.rl.evaluation.settings import setting_of
from npend_gym.rl.policies.policy import Policy
from npend_gym.rl.training.checkpoints import Checkpoint, Stopwatch
from npend_gym.rl.training.dataset import Dataset, Fit
from npend_gym.rl.training.keywords import OF_ENV, used_config
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

    seconds: float = 4.5  # of a planned trajectory
    guesses: int = 4  # that may lead to trajectories, each an expert
    rounds: int = 24  # after a first one, in which the expert acts alone
    num_envs: int = 512
    expert_fraction: float = 0.25  # of the environments: the expert acts, with noise
    student_fraction: float = 0.25  # of the environments: the student acts, and nobody takes over
    noise_std: float = 0.1  # largest standard deviation of the noise on the expert's actions
    take_over: float = 3.0  # from this cost on the expert acts; 1 is the mean at the start
    hand_back: float = 1.0  # below it the student acts again
    lost: float = 100.0  # nothing more is learned from an environment that has been beyond
    standing: int = 120  # steps after the trajectory; success needs 100
    kept: float = 0.25  # fraction of the states that come into the dataset
    max_states: int = 1_000_000  # in the dataset; then new ones take the place of old ones
    first_updates: int = 1000  # after the first round
    updates: int = 500  # after every other round
    minibatch_size: int = 1024
    learning_rate: float = 2e-3  # falls to zero along a cosine
    hidden: int = 192
    obs_scale: tuple[float, float, float] = (0.3, 0.3, 1.5)  # of sines, cosines, speeds [rad/s]


TASKS: dict[str, dict[str, Any]] = {
    "swingup-3": {"rounds": 15},
    "swingup-4": {"seconds": 7.0, "guesses": 8, "rounds": 90},
    "transition-2": {"seconds": 4.0, "rounds": 45, "first_updates": 1500},
}


def settings_of(task: str, **changes: Any) -> Settings:
    """Return the settings for a task such as "swingup-3"."""
    return Settings(env=env_of_task(task), **(TASKS.get(task, {}) | changes))


class DAgger:
    """An expert, and a student with the dataset that it learns from."""

    changes = ("student", "dataset", "fit")

    def __init__(self, settings: Settings, envs: Any, expert: Any) -> None:
        self.settings, self.envs, self.expert = settings, envs, expert
        config = envs.unwrapped.config
        episodes = settings.num_envs * (settings.rounds + 1)
        self.seeds = episode_seeds("training", episodes, run=settings.seed, spacing=100_000)
        self.obs_scale = observation_scale(config, settings.obs_scale)
        joints = config.joints.size
        self.student = network(config.observed, joints, settings.hidden, last_gain=0.1)
        self.dataset = Dataset(settings.max_states, config.observed, joints)
        self.fit = Fit(self.student, self.dataset, self.obs_scale, settings)
        self.episode_steps = round(settings.seconds / config.dt) + settings.standing

    @torch.no_grad()
    def act(self, observation: np.ndarray) -> np.ndarray:
        """Return the student's actions."""
        return self.student(torch.from_numpy(observation) / self.obs_scale).numpy()

    def play(self, round_: int) -> dict[str, float]:
        """Play an episode in every environment; the expert alone acts in the first round.

        Returns
        -------
        dict
            "return" and "success" of the environments in which the student alone acted, and
            "taken_over", the fraction of the steps of the others in which the expert acted.
        """
        settings, rng = self.settings, np.random.default_rng([self.settings.seed, round_])
        observation, info = self.envs.reset(seed=self.seeds[settings.num_envs * round_])
        share, returns = (
            np.arange(settings.num_envs) / settings.num_envs,
            np.zeros(settings.num_envs),
        )
        by_student = (share < settings.student_fraction) & (round_ > 0)
        by_expert = (share >= 1.0 - settings.expert_fraction) | (round_ == 0)
        std = (settings.noise_std * by_expert * rng.random(share.size))[:, None]
        taken, known, steps_taken = by_expert, np.ones(share.size, np.bool_), 0.0
        for _ in range(self.episode_steps):
            tracking: Tracking = self.expert.tracking(info)
            cost = tracking.relative_cost
            known &= cost < settings.lost
            self.dataset.add(
                observation, tracking, known & (rng.random(share.size) < settings.kept), rng
            )
            limit = np.where(taken, settings.hand_back, settings.take_over)
            taken = ((cost > limit) & ~by_student) | by_expert
            steps_taken += taken[~by_student & ~by_expert].sum()
            action = np.where(taken[:, None], tracking.actions, self.act(observation))
            action = action + std * rng.normal(size=action.shape)
            observation, reward, _, _, info = self.envs.step(action.clip(-1.0, 1.0))
            returns += reward
        if round_ == 0:
            return {}
        steps = self.episode_steps * max(1, np.sum(~by_student & ~by_expert))
        score = {"return": returns, "success": info["success"]}
        means = {name: round(float(value[by_student].mean()), 4) for name, value in score.items()}
        return means | {"taken_over": round(float(steps_taken / steps), 4)}


@dataclass(frozen=True, eq=False)
class Regulator:
    """The expert of a task without a plan: LQR about its equilibrium."""

    plan: PlannedTransition
    start_cost: float  # mean cost at the start of episodes, over that of the plan's own

    def tracking(self, info: dict[str, Any]) -> Tracking:
        """Return the actions of LQR, and the costs of the states over those at the start."""
        found = self.plan.tracking(info)
        return found._replace(relative_cost=found.relative_cost / self.start_cost)


def regulator_of(settings: Settings, config: Any) -> Regulator:
    """Return LQR about the equilibrium in which the mode succeeds: it hangs in "calm"."""
    rest = at_rest(config, 0.0 if isinstance(config.mode, Calm) else np.pi)
    idle = NominalTrajectory(np.stack([rest, rest]), np.zeros((1, config.joints.size)))
    plan = track(config, idle, 0.0)
    envs = setting_of(settings.env).make(settings.num_envs)
    seeds = episode_seeds("training", settings.num_envs, run=settings.seed, spacing=100_000)
    _, info = envs.reset(seed=seeds.start)
    envs.close()
    return Regulator(plan, float(plan.tracking(info).relative_cost.mean()))


def expert_of(
    settings: Settings, config: Any, guess: int
) -> PlannedTransition | PlannedTransitions | Regulator | None:
    """Return the plan that a guess leads to, if any; with goals an expert has those of all pairs.

    Tasks that begin where they end have a regulator. Nothing calms the chain before a plan begins:
    without a clock, holding looks like leaving.
    """
    if config.mode.has_goals:
        options: dict[str, Any] = {"settle": 0.0, "tries": settings.guesses, "seed": settings.seed}
        return planned_transitions(config, settings.seconds, **options) if guess == 0 else None
    if not isinstance(config.mode, SwingUp):
        return regulator_of(settings, config) if guess == 0 else None
    seed = settings.guesses * settings.seed + guess
    with suppress(RuntimeError):  # this guess leads to no trajectory
        return planned_swing_up(config, settings.seconds, tries=1, guess="mpc", seed=seed)
    return None


def begin(settings: Settings, envs: Any) -> tuple[DAgger, int, int]:
    """Return the student that is nearest to its expert after two rounds.

    Some trajectories are much harder to learn than others, and nothing else tells which.

    Returns
    -------
    tuple
        The student, the number of its guess, and how many students were tried.
    """
    begun: list[tuple[DAgger, int]] = []
    for guess in range(settings.guesses):
        expert = expert_of(settings, envs.unwrapped.config, guess)
        if expert is None:
            continue
        dagger = DAgger(settings, envs, expert)
        dagger.play(0)
        dagger.fit(settings.first_updates)
        dagger.play(1)
        dagger.fit(settings.updates)
        begun.append((dagger, guess))
    if not begun:
        raise RuntimeError("no guess led to a trajectory: give it more seconds or guesses")
    return *min(begun, key=lambda pair: pair[0].fit.distance), len(begun)


@one_thread()
def train(
    settings: Settings, progress: str | None = None, checkpoint: Checkpoint | None = None
) -> tuple[Policy, Curve]:
    """Return the trained policy and its learning curve, a row for every round from the third on.

    Its "seconds" are processor time.
    """
    config = used_config("imitation", settings.env, OF_ENV)
    if not isinstance(config.mode, (SwingUp, Balance, Calm, Transition)):
        raise ValueError(f"mode must be one that an expert is known for, got {config.mode!r}")
    torch.manual_seed(settings.seed)
    clock, curve = Stopwatch(), Curve()
    envs = setting_of(settings.env).make(settings.num_envs, max_episode_steps=None)
    checkpoint = checkpoint or Checkpoint(settings)
    if checkpoint.saved is None:
        dagger, guess, tried = begin(settings, envs)
    else:  # the others have been tried
        guess, tried = checkpoint.saved["parts"]["choice"]
        dagger = DAgger(settings, envs, expert_of(settings, envs.unwrapped.config, guess))
    parts = {"dagger": dagger, "choice": [guess, tried], "curve": curve, "clock": clock}
    for round_ in checkpoint.rounds(parts, settings.rounds, progress, "round", first=2):
        score = dagger.play(round_)
        dagger.fit(settings.updates)
        steps = (2 * (tried - 1) + round_ + 1) * dagger.episode_steps * settings.num_envs
        counts = {"steps": steps, "seconds": round(clock.seconds, 2)}
        curve.append(counts | score | {"distance": round(dagger.fit.distance, 4)})
    envs.close()
    student, scale = dagger.student, dagger.obs_scale
    return policy_of(student, scale, "imitation", settings, curve[-1]), curve
