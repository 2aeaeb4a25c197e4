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

import copy
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch

from npend_gym._checks import BoolArray
from npend_gym.rl.policies.history import History
from npend_gym.rl.policies.policy import Policy
from npend_gym.rl.training.checkpoints import Checkpoint, Stopwatch
from npend_gym.rl.training.context_plans import ContextPlans, wrong_chains
from npend_gym.rl.training.dataset import Dataset, Fit, follow
from npend_gym.rl.training.demonstration import base_plan
from npend_gym.rl.training.disturbed_lanes import ERRORS, DisturbedLanes
from npend_gym.rl.training.disturbed_task import differences
from npend_gym.rl.training.keywords import OF_CHAIN, check_swing_up, used_config
from npend_gym.rl.training.tasks import (
    Curve,
    TrainingSettings,
    env_of_task,
    network,
    one_thread,
    policy_of,
)

_LONGEST, _STANDING = 210, 60  # steps of an episode, at least; after the plan, at least
_AVERAGED = 20  # updates, after which the student follows the learner


@dataclass(frozen=True)
class Settings(TrainingSettings):
    """The settings of a training run; its result depends on nothing else."""

    plan_seed: int = 5  # of the first guess that leads to the plan
    seconds: float = 4.5  # of the plan
    variants: int = 0  # of the plan that are tried, to keep what noise leads less astray from
    wrong_chains: bool = True  # whether there are plans for others than the nominal chain
    demonstrator: str = ""  # a policy of the package whose way is the plan
    shares: dict[str, float] = field(default_factory=ERRORS.copy)  # of episodes with each error
    first_level: float = 1.0  # of errors of sensors and motors at first, over the largest
    rounds: int = 48  # after a first one, in which the teacher acts alone
    num_envs: int = 320
    num_steps: int = 120  # of a round
    student_fraction: float = 0.35  # of the lanes: the student acts, and nobody takes over
    teacher_fraction: float = 0.2  # of the lanes: the teacher acts, with noise
    noise_std: float = 0.1  # largest standard deviation of the noise on the teacher's actions
    take_over: float = 3.0  # from this cost on the teacher acts; 1 is the mean at the start
    hand_back: float = 1.0  # below it the student acts again
    lost: float = 100.0  # from this cost on an episode is over
    kept: float = 0.4  # fraction of the states that come into the dataset
    max_states: int = 1_000_000  # in the dataset; then new ones take the place of old ones
    first_updates: int = 400  # after the first round
    updates: int = 500  # after every other round
    minibatch_size: int = 512
    learning_rate: float = 2e-3  # falls to zero along a cosine
    averaging: float = 0.998  # of the student's parameters: what is left of them after an update
    length: int = 10  # observations that the student is given
    with_velocities: bool = False  # without them it has to find them in the angles
    hidden: int = 256
    obs_scale: tuple[float, float, float] = (0.3, 0.3, 1.5)  # of sines, cosines, speeds [rad/s]
    change_scale: tuple[float, float, float] = (0.1, 0.1, 1.0)  # of changes in a step


_NO_ERRORS: dict[str, Any] = {"wrong_chains": False, "shares": {"nothing": 1.0}}
_SHARES_3 = {
    "nothing": 0.05, "chain": 0.47, "torque_noise": 0.08, "motor_lag": 0.02, "delay": 0.25,
    "pulses": 0.08, "several": 0.05,
}  # fmt: skip
_SHARES_4 = {
    "nothing": 0.16, "torque_noise": 0.22, "motor_lag": 0.1, "delay": 0.3, "pulses": 0.16,
    "several": 0.06,
}  # fmt: skip
_LONG: dict[str, Any] = {"rounds": 400, "updates": 600, "length": 5}
TASKS: dict[str, dict[str, Any]] = {
    "swingup-3-robust": {"rounds": 240, "first_level": 0.4, "shares": _SHARES_3},
    "swingup-4-robust": _LONG
    | {"seconds": 7.0, "demonstrator": "swingup-4", "wrong_chains": False}
    | {"first_level": 0.2, "shares": _SHARES_4},
    "swingup-5": _LONG | {"seconds": 7.0, "plan_seed": 11, "variants": 300},
}


def settings_of(task: str, **changes: Any) -> Settings:
    """Return the settings for a task such as "swingup-3-robust", or "swingup-5" without errors."""
    env = env_of_task(task)
    if env["mode"] != "swingup":
        raise ValueError(f'task must be a swing-up, like "swingup-3-robust", got {task!r}')
    # errors are drawn otherwise, see `DisturbedLanes`
    errors = {} if env.pop("randomize", None) else _NO_ERRORS
    return Settings(env=env, **(errors | TASKS.get(task, {}) | changes))


class RobustDAgger:
    """A student with memory, and the dataset that it learns from."""

    changes = (
        "student", "learner", "dataset", "fit", "lanes", "history", "rng", "phase", "taken", "ended"
    )  # fmt: skip

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        config = used_config("robust_imitation", settings.env, OF_CHAIN)
        check_swing_up("robust_imitation", config)
        if config.joints.tolist() != [0] or not config.chain.is_ideal:
            raise ValueError("the chain must be point masses, with one motor at the base")
        chains = wrong_chains(config.chain, settings.seed) if settings.wrong_chains else []
        self.plans = ContextPlans(config, base_plan(settings, config), chains)
        self.longest = max(_LONGEST, self.plans.steps + _STANDING)
        size = settings.num_envs
        self.lanes = DisturbedLanes(config, self.plans, size, settings.seed, settings.shares)
        self.lanes.levels *= settings.first_level
        if settings.first_level < 1.0:
            self.lanes.restart(np.ones(size, np.bool_))
        scale = torch.tensor(settings.obs_scale).repeat_interleave(config.n)
        self.to_inputs = differences(settings.length, scale, settings.change_scale)
        if not settings.with_velocities:
            seen = np.arange(3 * config.n + 1) // config.n != 2
            self.to_inputs = self.to_inputs[:, np.tile(seen, settings.length)]
        inputs = self.to_inputs.shape[1]
        self.history = History(settings.length, 3 * config.n, 1)
        self.history.reset(size)
        self.learner = network(inputs, 1, settings.hidden, last_gain=0.1)
        self.student = copy.deepcopy(self.learner)  # what acts, with averages of its parameters
        self.dataset = Dataset(settings.max_states, inputs, 1)
        self.fit = Fit(self.learner, self.dataset, torch.ones(inputs), settings)
        self.rng = np.random.default_rng([settings.seed, 2])
        self.phase = np.zeros(size, np.int64)
        share = np.arange(size) / size
        self.alone = share < settings.student_fraction
        self.taught = share >= 1.0 - settings.teacher_fraction
        self.std = settings.noise_std * self.taught * self.rng.random(size)
        self.taken = self.taught.copy()  # where the teacher acts
        self.ended = list[bool]()  # whether the chain stood, where the student was alone

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
            self.end(~known | (lanes.age >= self.longest), known)
        return taken_over / steps

    def learn(self, updates: int) -> float:
        """Fit the learner, which the student follows; return its mean distance from the teacher."""
        left, distances = self.settings.averaging**_AVERAGED, list[float]()
        for _ in range(0, updates, _AVERAGED):
            self.fit(_AVERAGED)
            distances.append(self.fit.distance)
            follow(self.student, self.learner, left)
        return float(np.mean(distances))

    def end(self, over: BoolArray, known: BoolArray) -> None:
        """Record the episodes that are over, and begin others."""
        rows = np.flatnonzero(over & self.alone)
        self.ended += known[rows].tolist()
        self.lanes.judge(rows, known[rows])
        self.lanes.restart(over)
        self.phase[over], self.taken[over] = 0, self.taught[over]

    def policy(self, last: dict[str, Any]) -> Policy:
        """Return the student as a policy with memory."""
        settings, n = self.settings, self.lanes.config.n
        made = policy_of(self.student, torch.ones(1), "robust_imitation", settings, last)
        first = torch.from_numpy(made.weights[0]) @ self.to_inputs.T
        frames = np.ones((settings.length, 3 * n + 1), np.float32)
        return replace(made, scale=frames, weights=[first.numpy(), *made.weights[1:]])


@one_thread()
def train(
    settings: Settings, progress: str | None = None, checkpoint: Checkpoint | None = None
) -> tuple[Policy, Curve]:
    """Return the trained policy and its learning curve, a row for every fourth round.

    Its "seconds" are processor time; "success" is the share of the episodes that the student alone
    played, with errors, in which it did not lose the chain.
    """
    torch.manual_seed(settings.seed)
    clock, curve = Stopwatch(), Curve()
    dagger = RobustDAgger(settings)
    parts = {"dagger": dagger, "curve": curve, "clock": clock}
    checkpoint = checkpoint or Checkpoint(settings)
    for round_ in checkpoint.rounds(parts, settings.rounds, progress, "round", first=0):
        if round_ == 0:
            dagger.play(dagger.longest, first=True)
            dagger.ended.clear()
            dagger.lanes.judged[:] = 0
            dagger.learn(settings.first_updates)
            continue
        taken_over = dagger.play(settings.num_steps)
        distance = dagger.learn(settings.updates)
        if round_ % 4 == 0 or round_ == settings.rounds:
            ended, dagger.ended = dagger.ended, []
            curve.append({
                "steps": (dagger.longest + round_ * settings.num_steps) * settings.num_envs,
                "seconds": round(clock.seconds, 2),
                "success": round(float(np.mean(ended or [0.0])), 4),
                "taken_over": round(float(taken_over), 4),
                "distance": round(distance, 4),
            })  # fmt: skip
            dagger.lanes.grow()
    return dagger.policy(curve[-1]), curve
