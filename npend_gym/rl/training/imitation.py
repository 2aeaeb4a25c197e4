"""Imitation: a network learns from plans and feedback what to do in every state, with any errors.

The expert plans a trajectory and tracks it by time-varying feedback, or knows feedback alone; it
knows the true state and the true chain. The student is given observations. In DAgger (Ross, Gordon,
Bagnell, arXiv:1011.0686) the student acts and the expert says what it would have done. A student
that has learned little leaves the trajectory at once, and sees nothing of the rest. Therefore in
most environments the expert takes over where the deviation is too large, as in SafeDAgger (Zhang,
Cho, arXiv:1605.06450). It hands back when it has led the chain back. How far is measured by the
cost that the feedback minimises. In some environments the expert alone acts, with noise (Laskey,
Lee, Fox, Dragan, Goldberg, arXiv:1703.09327), in some the student alone.

With `errors` something is wrong in every environment, see `ErrorLanes`, and the expert has a plan
for the very chain. A student that is given its last observations and actions learns the mean of
what experts would do after such a history: it estimates the state and the chain on the way. To
train with what only the simulation knows, and to act on a history, is rapid motor adaptation (A.
Kumar and others, arXiv:2107.04034) without its two stages.
"""

# torch's stubs leave parts unknown
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

import copy
import math
from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from npend_gym import _checks
from npend_gym._checks import BoolArray, FloatArray
from npend_gym._threads import one_torch_thread
from npend_gym.envs import EnvConfig
from npend_gym.envs.modes import Balance, Calm, SwingUp, Transition
from npend_gym.rl.evaluation.seeds import episode_seeds
from npend_gym.rl.evaluation.settings import setting_of
from npend_gym.rl.policies.history import History
from npend_gym.rl.policies.policy import Policy
from npend_gym.rl.training.checkpoints import Checkpoint, Stopwatch
from npend_gym.rl.training.dataset import Dataset, differences
from npend_gym.rl.training.error_lanes import CHAIN, NOTHING, PUSHES, SEVERAL, ErrorLanes
from npend_gym.rl.training.experts import Expert, expert_of
from npend_gym.rl.training.keywords import OF_ENV, used_config
from npend_gym.rl.training.optimizers import Optimizer
from npend_gym.rl.training.tasks import (
    Curve,
    TrainingSettings,
    check_settings,
    env_of_task,
    network,
    observation_scale,
    policy_of,
)

_AVERAGED = 20  # updates, after which the student follows the learner
_EVEN = 0.3  # of the episodes with goals are between all pairs alike
_REMEMBERED, _SELDOM = 0.88, 0.01  # of a pair's failures after an episode; the least share of them


@dataclass(frozen=True)
class Settings(TrainingSettings):
    """The settings of a training run; its result depends on nothing else."""

    seconds: float = 4.5  # of a planned trajectory
    guesses: int = 4  # that may lead to trajectories, each an expert
    plan_seed: int | None = None  # of the first guess; by default another for each `seed`
    tries: int = 1  # for each of them; the least sensitive trajectory counts
    variants: int = 0  # of a plan that are tried, to keep what noise leads less astray from
    demonstrator: str = ""  # a policy, of the package or a file, whose way is the plan
    rescuer: str = ""  # acts where an expert has lost the chain: such a policy, or "mpc"
    errors: dict[str, float] = field(default_factory=dict[str, float])  # shares of `KINDS`
    first_level: float = 1.0  # of errors of sensors and motors at first, over the largest
    margin: float = 0.0  # by which they grow beyond the largest
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
    learning_rate: float = 2e-3  # of Adam; falls to zero along a cosine
    muon_learning_rate: float = 0.0  # of Muon for the matrices; 0: Adam learns them too
    averaging: float = 0.0  # of the student's parameters: what is left of them after an update
    length: int = 1  # observations that the student is given
    hidden: int = 192
    obs_scale: tuple[float, float, float] = (0.3, 0.3, 1.5)  # of sines, cosines, speeds [rad/s]
    change_scale: tuple[float, float, float] = (0.1, 0.1, 1.0)  # of their changes in a step


class DAgger:
    """An expert, and a student with the dataset that it learns from."""

    changes: tuple[str, ...] = (
        "student", "learner", "dataset", "optimizer", "shuffler", "updates", "distance", "lanes",
        "failed",
    )  # fmt: skip

    def __init__(self, settings: Settings, expert: Expert) -> None:
        self.settings: Settings = settings
        self.expert: Expert = expert
        setting, size = setting_of(settings.env), settings.num_envs
        config = setting.config
        self.episode_steps: int = round(settings.seconds / config.dt) + settings.standing
        levels = settings.first_level, settings.margin
        self.lanes: ErrorLanes = ErrorLanes(
            setting, size, settings.errors, self.episode_steps, *levels
        )
        episodes = size * (settings.rounds + 1)
        self.seeds: range = episode_seeds("training", episodes, run=settings.seed, spacing=100_000)
        scales = settings.obs_scale, settings.change_scale
        obs_scale, change_scale = (observation_scale(config, each) for each in scales)
        joints = config.joints.size
        self.to_inputs: torch.Tensor = differences(settings.length, obs_scale, change_scale, joints)
        self.history: History = History(settings.length, config.observed, joints)
        inputs = self.to_inputs.shape[1]
        self.learner: nn.Sequential = network(inputs, joints, settings.hidden, last_gain=0.1)
        # it acts, with averages of the learner's parameters
        self.student: nn.Sequential = copy.deepcopy(self.learner)
        self.dataset: Dataset = Dataset(settings.max_states, inputs, joints)
        self.optimizer: Optimizer = Optimizer(
            self.learner, settings.learning_rate, settings.muon_learning_rate
        )
        self.shuffler: torch.Generator = torch.Generator().manual_seed(settings.seed)
        self.failed: FloatArray = np.ones(len(expert.pairs))  # share of the episodes, lately
        self.updates: int = 0  # so far
        self.distance = math.inf  # of the learner's actions from the expert's, in `learn`

    @torch.no_grad()
    def inputs(self, observation: np.ndarray, info: dict[str, Any]) -> torch.Tensor:
        """Return what the student is given, (B, inputs), after observations (B, k)."""
        frames = self.history.observe(observation, info["time"] == 0.0)
        rows = torch.from_numpy(frames.reshape(len(frames), -1))
        return rows[:, : len(self.to_inputs)] @ self.to_inputs

    @torch.no_grad()
    def act(self, inputs: torch.Tensor) -> np.ndarray:
        """Return the student's actions."""
        return self.student(inputs).numpy()

    def play(self, round_: int) -> dict[str, float]:
        """Play an episode in every environment; the expert alone acts in the first round.

        "return" and "success" are of the environments in which the student alone acted; with goals
        most of these are the harder ones.
        "taken_over" is the fraction of the steps of the others in which the expert acted.
        """
        settings, rng = self.settings, np.random.default_rng([self.settings.seed, round_])
        size, lanes, expert = settings.num_envs, self.lanes, self.expert
        drawn, starts = self.starts(rng)
        observation, info = lanes.reset(self.seeds[size * round_], expert.chains, rng, starts)
        expert.begin(drawn if drawn.size > 0 else lanes.which, round_)
        self.history.reset(size)
        returns = np.zeros(size)
        by_student = (lanes.rank < settings.student_fraction) & (round_ > 0)
        by_expert = (lanes.rank >= 1.0 - settings.expert_fraction) | (round_ == 0)
        std = (settings.noise_std * by_expert * rng.random(size))[:, None]
        taken, known, steps_taken = by_expert, np.ones(size, np.bool_), 0.0
        for _ in range(self.episode_steps):
            inputs, tracking = self.inputs(observation, info), expert.tracking(info)
            cost = tracking.relative_cost
            known &= cost < settings.lost
            self.dataset.add(inputs, tracking, known & (rng.random(size) < settings.kept), rng)
            limit = np.where(taken, settings.hand_back, settings.take_over)
            taken = ((cost > limit) & ~by_student) | by_expert
            steps_taken += taken[~by_student & ~by_expert].sum()
            action = np.where(taken[:, None], tracking.actions, self.act(inputs))
            action = (action + std * rng.normal(size=action.shape)).clip(-1.0, 1.0)
            self.history.act(action.astype(np.float32))
            observation, reward, info = lanes.step(action)
            returns += reward
        if round_ == 0:
            return {}
        lanes.judge(np.flatnonzero(by_student), info["success"][by_student])
        if drawn.size > 0:
            self.count(drawn[by_student], info["success"][by_student])
        steps = self.episode_steps * max(1, np.sum(~by_student & ~by_expert))
        score = {"return": returns, "success": info["success"]}
        means = {name: round(float(value[by_student].mean()), 4) for name, value in score.items()}
        return means | {"taken_over": round(float(steps_taken / steps), 4)}

    def starts(self, rng: np.random.Generator) -> tuple[NDArray[np.int64], dict[str, FloatArray]]:
        """Return the pair of equilibria of each lane, with the options of `reset` that say so.

        Pairs are drawn more often where the student failed more often. Without goals there are
        none.
        """
        pairs = self.expert.pairs
        if len(pairs) == 0:
            return np.zeros(0, np.int64), {}
        share = _EVEN / len(pairs) + (1.0 - _EVEN) * self.failed / self.failed.sum()
        drawn = rng.choice(len(pairs), self.settings.num_envs, p=share)
        begin, end = np.moveaxis(np.pi * np.array(pairs)[drawn], 1, 0)
        return drawn, {"start": begin, "goal": end}

    def count(self, drawn: NDArray[np.int64], good: BoolArray) -> None:
        """Count episodes of the student between pairs of equilibria, and those that were good."""
        size = len(self.failed)
        played, bad = (np.bincount(each, minlength=size) for each in (drawn, drawn[~good]))
        latest = bad / np.maximum(played, 1)
        self.failed += (1.0 - _REMEMBERED**played) * (latest - self.failed)
        self.failed = np.maximum(self.failed, _SELDOM)

    def learn(self, updates: int) -> None:
        """Fit the learner to the dataset; every few updates the student follows it.

        A student that is such a mean of what the learner was lately stands long before the learner
        does, which every few updates lead astray (B. T. Polyak, A. B. Juditsky, SIAM Journal on
        Control and Optimization 30 (1992), 838-855).
        """
        distances = list[float]()
        for begun in range(0, updates, _AVERAGED):
            count, total = min(_AVERAGED, updates - begun), 0.0
            for _ in range(count):
                total += self.update()
            distances.append(total / count)
            moved = 1.0 - self.settings.averaging**count
            pairs = zip(self.student.parameters(), self.learner.parameters(), strict=True)
            with torch.no_grad():
                for mean, latest in pairs:
                    mean.lerp_(latest, moved)
        self.distance: float = float(np.mean(distances))

    def update(self) -> float:
        """Fit the learner to some states; return the distance of its actions from the expert's."""
        settings, dataset = self.settings, self.dataset
        last = settings.first_updates + settings.rounds * settings.updates
        left = 0.5 * (1.0 + math.cos(math.pi * self.updates / last))
        rows = torch.randint(dataset.size, (settings.minibatch_size,), generator=self.shuffler)
        actions, weights = dataset.actions[rows], dataset.weights[rows]
        prediction = self.learner(dataset.inputs[rows])
        losses = nn.functional.smooth_l1_loss(prediction, actions, beta=0.2, reduction="none")
        loss = (weights * losses).mean() / weights.mean()
        loss.backward()
        self.optimizer.step(left)
        self.updates += 1
        return float((prediction.detach() - actions).abs().mean())

    def policy(self, last: dict[str, Any]) -> Policy:
        """Return the student as a policy, with memory where it is given several observations."""
        settings = self.settings
        made = policy_of(self.student, torch.ones(1), "imitation", settings, last)
        first = torch.from_numpy(made.weights[0]) @ self.to_inputs.T
        frames = np.ones(self.history.frames.shape[1:], np.float32)
        scale = frames if settings.length > 1 else frames[0, : len(self.to_inputs)]
        return replace(made, scale=scale, weights=[first.numpy(), *made.weights[1:]])


def begin(settings: Settings, config: Any) -> tuple[DAgger, int, int]:
    """Return the student nearest to its expert after two rounds, its guess, and the number tried.

    Some trajectories are much harder to learn than others, and nothing else tells which.
    """
    begun: list[tuple[DAgger, int]] = []
    for guess in range(settings.guesses):
        expert = expert_of(settings, config, guess)
        if expert is None:
            continue
        dagger = DAgger(settings, expert)
        dagger.play(0)
        dagger.learn(settings.first_updates)
        dagger.play(1)
        dagger.learn(settings.updates)
        begun.append((dagger, guess))
    if not begun:
        raise RuntimeError("no guess led to a trajectory: give it more seconds or guesses")
    return *min(begun, key=lambda pair: pair[0].distance), len(begun)


@one_torch_thread()
def train(
    settings: Settings, progress: str | None = None, checkpoint: Checkpoint | None = None
) -> tuple[Policy, Curve]:
    """Return the trained policy and its learning curve, a row for every round from the third on.

    Its "seconds" are processor time.
    """
    config = used_config("imitation", settings.env, OF_ENV)
    if not isinstance(config.mode, (SwingUp, Balance, Calm, Transition)):
        raise ValueError(f"mode must be one with an expert, got {config.mode!r}")
    if not isinstance(cast("Any", settings.errors), dict):
        raise TypeError(f"errors must be a dict, got {_checks.show(settings.errors)}")
    if settings.errors and config.observe_context:
        raise ValueError("observe_context must be False with errors, which no policy observes")
    check_settings(settings)
    _checks.count("rounds", settings.rounds, low=2)
    _checks.count("max_states", settings.max_states, low=settings.num_envs)
    if settings.plan_seed is not None:
        _checks.count("plan_seed", settings.plan_seed, low=0)
    if settings.averaging >= 1.0:
        raise ValueError(f"averaging must lie from 0 to below 1, got {settings.averaging}")
    for name in ("student_fraction", "kept"):
        _checks.positive_number(name, getattr(settings, name))
    for name in ("student_fraction", "expert_fraction", "kept"):
        if getattr(settings, name) > 1.0:
            raise ValueError(f"{name} must be at most 1, got {getattr(settings, name)}")
    if settings.rescuer and not isinstance(config.mode, SwingUp):
        raise ValueError(
            f'rescuer must be left out in mode "{config.mode.name}", it helps in swing-ups alone; '
            f'got "{settings.rescuer}"'
        )
    torch.manual_seed(settings.seed)
    clock, curve = Stopwatch(), Curve()
    checkpoint = checkpoint or Checkpoint(settings)
    known: dict[str, Any] = settings.env | {"observe_velocities": True}  # experts know the state
    config = EnvConfig(**known)
    if checkpoint.saved is None:
        dagger, guess, tried = begin(settings, config)
    else:  # the others have been tried
        guess, tried = checkpoint.saved["parts"]["choice"]
        dagger = DAgger(settings, cast("Expert", expert_of(settings, config, guess)))
    parts = {"dagger": dagger, "choice": [guess, tried], "curve": curve, "clock": clock}
    for round_ in checkpoint.rounds(parts, settings.rounds, progress, "round", first=2):
        score = dagger.play(round_)
        dagger.learn(settings.updates)
        if round_ % 4 == 0:
            dagger.lanes.grow()
        steps = (2 * (tried - 1) + round_ + 1) * dagger.episode_steps * settings.num_envs
        counts = {"steps": steps, "seconds": round(clock.seconds, 2)}
        curve.append(counts | score | {"distance": round(dagger.distance, 4)})
    dagger.lanes.close()
    return dagger.policy(curve[-1]), curve


# What is wrong in robust training, and in which share of the environments
ERRORS = {
    NOTHING: 0.05, CHAIN: 0.35, "velocity_noise": 0.1, "torque_noise": 0.05, "motor_lag": 0.02,
    "delay": 0.1, PUSHES: 0.28, SEVERAL: 0.05,
}  # fmt: skip
_ROBUST: dict[str, Any] = {
    "errors": ERRORS, "first_level": 0.4, "guesses": 1, "plan_seed": 5, "rounds": 120,
    "num_envs": 320, "student_fraction": 0.35, "expert_fraction": 0.2, "kept": 0.4,
    "first_updates": 400, "minibatch_size": 512, "averaging": 0.998, "length": 5, "hidden": 256,
}  # fmt: skip
_LONG = _ROBUST | {"seconds": 7.0, "rounds": 400, "updates": 600}
_THREE: dict[str, Any] = {
    "seconds": 4.0, "plan_seed": 11, "standing": 160, "rounds": 125, "length": 10,
    "updates": 400, "minibatch_size": 1024, "muon_learning_rate": 0.02,
    "rescuer": "mpc", "margin": 0.6,  # so that sensors a whole step late are no rare case
    "errors": {NOTHING: 0.05, CHAIN: 0.42, "torque_noise": 0.08, "motor_lag": 0.02, "delay": 0.26,
               PUSHES: 0.14, SEVERAL: 0.03},
}  # fmt: skip
_FOUR: dict[str, Any] = _LONG | {  # the plan is that of a policy
    "demonstrator": "swingup-4", "variants": 300, "first_level": 0.2, "standing": 220, "length": 10,
    "errors": {NOTHING: 0.1, CHAIN: 0.32, "torque_noise": 0.16, "motor_lag": 0.04, "delay": 0.2,
               PUSHES: 0.18},
}  # fmt: skip
_FIVE: dict[str, Any] = _LONG | {
    "plan_seed": 0, "tries": 4, "variants": 300, "first_level": 0.1, "standing": 220, "length": 10,
    "rounds": 240, "hidden": 288, "muon_learning_rate": 0.015,
    "errors": {NOTHING: 0.13, CHAIN: 0.32, "torque_noise": 0.15, "motor_lag": 0.08, "delay": 0.22,
               PUSHES: 0.1},
}  # fmt: skip
_ROBOT: dict[str, Any] = {  # of RealAIGym: steps of 0.02 s
    "seconds": 3.0, "plan_seed": 1, "rounds": 60, "standing": 220, "length": 6, "hidden": 128,
    "obs_scale": (0.5, 0.5, 4.0),
}  # fmt: skip
_QUICK: dict[str, Any] = {"guesses": 1, "averaging": 0.998}
_FOUR_POLES: dict[str, Any] = _QUICK | {
    "seconds": 10.0, "plan_seed": 4, "variants": 100, "rounds": 80, "hidden": 256,
    "muon_learning_rate": 0.015,
}  # fmt: skip
_FIVE_POLES: dict[str, Any] = _FOUR_POLES | {
    "seconds": 14.0, "plan_seed": 0, "tries": 4, "variants": 60, "rounds": 180,
}  # fmt: skip
_POLES: dict[str, Any] = {"seconds": 3.0, "rounds": 8, "averaging": 0.998, "hidden": 64}
TASKS: dict[str, dict[str, Any]] = {
    "swingup-1": _QUICK | {"seconds": 3.0, "plan_seed": 0, "rounds": 4, "hidden": 32},
    "swingup-2": _QUICK | {"seconds": 3.0, "plan_seed": 0, "rounds": 10, "hidden": 64},
    "swingup-3": _QUICK | {"seconds": 4.0, "plan_seed": 4, "rounds": 10},
    "swingup-4": _QUICK | {"seconds": 5.0, "plan_seed": 10, "rounds": 24, "variants": 100},
    "swingup-5": _LONG | {"errors": {}, "plan_seed": 11, "variants": 300, "rounds": 300},
    "swingup-2-robust": {"rescuer": "swingup-2"},
    "swingup-2-acrobot-robust": _ROBOT | {"rescuer": "swingup-2-acrobot"},
    "swingup-2-pendubot-robust": _ROBOT | {"rescuer": "swingup-2-pendubot"},
    "swingup-3-robust": _THREE,
    "swingup-4-robust": _FOUR,
    "swingup-5-robust": _FIVE,
    "calm-2-robust": {"rounds": 20, "hidden": 48},
    "swingup-2-cart": {"seconds": 6.0, "rounds": 30, "averaging": 0.998},
    "swingup-3-cart": _QUICK | {"seconds": 8.0, "plan_seed": 0, "rounds": 55},
    "swingup-4-cart": _FOUR_POLES,
    "swingup-5-cart": _FIVE_POLES,
    "transition-2": {
        "seconds": 4.0,
        "rounds": 45,
        "first_updates": 1500,
        "muon_learning_rate": 0.01,
        "averaging": 0.998,
    },
    "transition-3": {
        "seconds": 5.0,
        "guesses": 8,
        "rounds": 150,
        "num_envs": 1024,
        "first_updates": 1500,
        "kept": 0.15,
        "max_states": 2_000_000,
        "muon_learning_rate": 0.015,
        "averaging": 0.998,
        "hidden": 320,
    },
    "balance-4-cart": _POLES | {"obs_scale": (0.005, 1.0, 0.03)},
    "balance-5-cart": _POLES | {"obs_scale": (0.002, 1.0, 0.01)},
}
_FROM_ANGLES = "swingup-5", *(f"swingup-{n}-robust" for n in (3, 4, 5))  # without velocities


def settings_of(task: str, **changes: Any) -> Settings:
    """Return the settings for a task such as "swingup-3", or "swingup-3-robust" with `errors`."""
    env = env_of_task(task)
    robust = _ROBUST if env.pop("randomize", None) else {}  # errors are drawn by `ErrorLanes`
    if task in _FROM_ANGLES:
        env["observe_velocities"] = False
    fields: dict[str, Any] = {"env": env, **robust, **TASKS.get(task, {}), **changes}
    return Settings(**fields)
