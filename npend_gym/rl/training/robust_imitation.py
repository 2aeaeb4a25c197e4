"""Imitation of teachers that know what is wrong, by a student that has to find it out.

As `imitation`, with these differences. In every lane one thing is wrong: the chain, the sensors or
the motor. The teacher knows the lane's chain and its true state: it has a plan for this very chain,
and the feedback along it. The student is given its last observations and actions, and so learns
the mean of what teachers would do after such a history: it estimates the state and the chain on
the way, without being told how. To train with what only the simulation knows, and to act on a
history, is rapid motor adaptation (A. Kumar and others, arXiv:2107.04034) without its two stages.
"""

# torch's stubs leave parts unknown
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch

from npend_gym._checks import BoolArray
from npend_gym.envs import EnvConfig
from npend_gym.rl.controllers.planning import planned_swing_up
from npend_gym.rl.policies.history import History
from npend_gym.rl.policies.policy import Policy
from npend_gym.rl.training.checkpoints import Checkpoint, Stopwatch
from npend_gym.rl.training.context_plans import ContextPlans, wrong_chains
from npend_gym.rl.training.dataset import Dataset, Fit
from npend_gym.rl.training.disturbed_lanes import DisturbedLanes
from npend_gym.rl.training.disturbed_task import differences
from npend_gym.rl.training.tasks import Curve, env_of_task, network, policy_of

_LONGEST = 210  # steps of an episode: the plan, and standing


@dataclass(frozen=True)
class Settings:
    """The settings of a training run; its result depends on nothing else."""

    env: dict[str, Any] = field(default_factory=dict[str, Any])  # keywords, without errors
    seed: int = 0
    plan_seed: int = 5  # of the first guess that leads to the plan
    seconds: float = 4.5  # of the plan
    wrong_chains: bool = True  # whether there are plans for others than the nominal chain
    rounds: int = 48  # after a first one, in which the teacher acts alone
    num_envs: int = 320
    num_steps: int = 120  # of a round
    student_fraction: float = 0.35  # of the lanes: the student acts, and nobody takes over
    teacher_fraction: float = 0.2  # of the lanes: the teacher acts, with noise
    noise_std: float = 0.1  # largest standard deviation of the noise on the teacher's actions
    take_over: float = 20.0  # from this cost on the teacher acts; 1 is the mean at the start
    hand_back: float = 5.0  # below it the student acts again
    lost: float = 150.0  # from this cost on an episode is over
    kept: float = 0.4  # fraction of the states that come into the dataset
    max_states: int = 500_000  # in the dataset; then new ones take the place of old ones
    first_updates: int = 1200  # after the first round
    updates: int = 400  # after every other round
    minibatch_size: int = 1024
    learning_rate: float = 2e-3  # falls to zero along a cosine
    length: int = 12  # observations that the student is given
    hidden: int = 184
    obs_scale: tuple[float, float, float] = (0.3, 0.3, 1.5)  # of sines, cosines, speeds [rad/s]
    change_scale: tuple[float, float, float] = (0.1, 0.1, 1.0)  # of changes in a step


TASKS: dict[str, dict[str, Any]] = {"swingup-3-robust": {}}


def settings_of(task: str, **changes: Any) -> Settings:
    """Return the settings for a task such as "swingup-3-robust"."""
    env = env_of_task(task)
    if env["mode"] != "swingup" or "randomize" not in env:
        raise ValueError(f'task must be a robust swing-up, like "swingup-3-robust", got {task!r}')
    del env["randomize"]  # errors are drawn otherwise, see `DisturbedLanes`
    return Settings(env=env, **(TASKS.get(task, {}) | changes))


class RobustDAgger:
    """A student with memory, and the dataset that it learns from."""

    changes = ("student", "dataset", "fit", "lanes", "history", "rng", "phase", "taken", "ended")

    def __init__(self, settings: Settings) -> None:
        self.settings, config = settings, EnvConfig(**settings.env)
        if config.joints.tolist() != [0] or not config.chain.is_ideal:
            raise ValueError("the chain must be point masses, with one motor at the base")
        base = planned_swing_up(
            config, settings.seconds, tries=1, guess="mpc", seed=settings.plan_seed
        )
        chains = wrong_chains(config.chain, settings.seed) if settings.wrong_chains else []
        self.plans = ContextPlans(config, base, chains)
        self.lanes = DisturbedLanes(config, self.plans, settings.num_envs, settings.seed)
        scale = torch.tensor(settings.obs_scale).repeat_interleave(config.n)
        self.to_inputs = differences(settings.length, scale, settings.change_scale)
        inputs, size = len(self.to_inputs), settings.num_envs
        self.history = History(settings.length, 3 * config.n, 1)
        self.history.reset(size)
        self.student = network(inputs, 1, settings.hidden, last_gain=0.1)
        self.dataset = Dataset(settings.max_states, inputs, 1)
        self.fit = Fit(self.student, self.dataset, torch.ones(inputs), settings)
        self.rng = np.random.default_rng([settings.seed, 2])
        self.phase = np.zeros(size, np.int64)
        share = np.arange(size) / size
        self.alone = share < settings.student_fraction
        self.taught = share >= 1.0 - settings.teacher_fraction
        self.std = settings.noise_std * self.taught * self.rng.random(size)
        self.taken = self.taught.copy()  # where the teacher acts
        self.ended: list[tuple[int, bool]] = []  # where the student was alone: error, whether stood

    @torch.no_grad()
    def inputs(self) -> torch.Tensor:
        """Return what the student is given of all lanes."""
        observed = self.lanes.observe().astype(np.float32)
        frames = self.history.observe(observed, self.lanes.begins)
        return torch.from_numpy(frames.reshape(len(frames), -1)) @ self.to_inputs

    @torch.no_grad()
    def play(self, steps: int, *, first: bool = False) -> float:
        """Play steps in every lane, where the teacher alone acts in the first round.

        Returns
        -------
        float
            The fraction of the steps in which the teacher took over.
        """
        settings, lanes, rng = self.settings, self.lanes, self.rng
        watched, taken_over = ~self.alone & ~self.taught, 0.0
        for _ in range(steps):
            inputs = self.inputs()
            action = self.student(inputs).numpy()
            self.phase, tracking = self.plans.tracking(lanes.which, self.phase, lanes.states)
            cost = tracking.relative_cost
            known = cost < settings.lost
            chosen = known & (rng.random(len(cost)) < settings.kept)
            self.dataset.add(inputs, tracking, chosen, rng)
            limit = np.where(self.taken, settings.hand_back, settings.take_over)
            self.taken = ((cost > limit) & ~self.alone) | self.taught | first
            taken_over += self.taken[watched].mean()
            action = np.where(self.taken[:, None], tracking.actions, action)
            action[:, 0] += self.std * rng.normal(size=len(cost))
            action = action.clip(-1.0, 1.0).astype(np.float32)
            self.history.act(action)
            lanes.step(action[:, 0].astype(np.float64))
            self.end(~known | (lanes.age >= _LONGEST), known)
        return taken_over / steps

    def end(self, over: BoolArray, known: BoolArray) -> None:
        """Record the episodes that are over, and begin others."""
        rows = np.flatnonzero(over & self.alone).tolist()
        self.ended += [(int(self.lanes.error[k]), bool(known[k])) for k in rows]
        self.lanes.restart(over)
        self.phase[over], self.taken[over] = 0, self.taught[over]

    def policy(self, last: dict[str, Any]) -> Policy:
        """Return the student as a policy with memory."""
        settings, n = self.settings, self.lanes.config.n
        made = policy_of(self.student, torch.ones(1), "robust_imitation", settings, last)
        first = torch.from_numpy(made.weights[0]) @ self.to_inputs.T
        frames = np.ones((settings.length, 3 * n + 1), np.float32)
        return replace(made, scale=frames, weights=[first.numpy(), *made.weights[1:]])


def train(
    settings: Settings, progress: str | None = None, checkpoint: Checkpoint | None = None
) -> tuple[Policy, Curve]:
    """Return the trained policy and its learning curve, a row for every fourth round.

    Its "seconds" are processor time; "stood" is the share of the episodes that the student alone
    played, with errors, in which it did not lose the chain.
    """
    torch.set_num_threads(1)  # two are slower for networks this small
    torch.manual_seed(settings.seed)
    clock, curve = Stopwatch(), Curve()
    dagger = RobustDAgger(settings)
    parts = {"dagger": dagger, "curve": curve, "clock": clock}
    checkpoint = checkpoint or Checkpoint(settings)
    for round_ in checkpoint.rounds(parts, settings.rounds, progress, "round", first=0):
        if round_ == 0:
            dagger.play(_LONGEST, first=True)
            dagger.ended.clear()
            dagger.fit(settings.first_updates)
            continue
        taken_over = dagger.play(settings.num_steps)
        dagger.fit(settings.updates)
        if round_ % 4 == 0 or round_ == settings.rounds:
            ended, dagger.ended = dagger.ended, []
            curve.append({
                "steps": (_LONGEST + round_ * settings.num_steps) * settings.num_envs,
                "seconds": round(clock.seconds, 2),
                "stood": round(float(np.mean([stood for _, stood in ended] or [0.0])), 4),
                "taken_over": round(float(taken_over), 4),
                "distance": round(dagger.fit.distance, 4),
            })  # fmt: skip
    return dagger.policy(curve[-1]), curve
