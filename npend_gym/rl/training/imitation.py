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
from npend_gym.rl.training.checkpoints import Checkpoint, Stopwatch, restore
from npend_gym.rl.training.dataset import Dataset, differences
from npend_gym.rl.training.error_lanes import ErrorLanes, check_errors
from npend_gym.rl.training.experts import Expert, expert_of, rescuing_policy
from npend_gym.rl.training.feedback_units import begin_as_feedback, check_feedback_units
from npend_gym.rl.training.goal_networks import GoalNetworks
from npend_gym.rl.training.imitation_settings import TASKS, Settings, settings_of
from npend_gym.rl.training.keywords import OF_IMITATION, used_config
from npend_gym.rl.training.knock_downs import knocked_down
from npend_gym.rl.training.optimizers import Optimizer, Spring
from npend_gym.rl.training.tasks import (
    Curve,
    check_settings,
    network,
    observation_scale,
    policy_of,
)

__all__ = ["TASKS", "Settings", "settings_of", "train"]  # what a `Trainer` has

_AVERAGED = 20  # updates, after which the student follows the learner
_EVEN = 0.3  # of the episodes with goals are between all pairs alike
_REMEMBERED, _SELDOM = 0.88, 0.01  # of a pair's failures after an episode; the least share of them


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
        self.history: History = History((settings.length, config.observed + joints), joints)
        inputs = self.to_inputs.shape[1]
        goals = range(2**config.n if settings.by_goal else 1)
        networks = [network(inputs, joints, settings.hidden, 0.1, settings.layers) for _ in goals]
        begin_as_feedback(networks, config, expert, self.to_inputs, settings.feedback_units)
        self.learner: nn.Module = GoalNetworks(networks) if settings.by_goal else networks[0]
        # it acts, with averages of the learner's parameters
        self.student: nn.Module = copy.deepcopy(self.learner)
        self.dataset: Dataset = Dataset(settings.max_states, inputs, joints)
        self.optimizer: Optimizer | Spring
        if settings.spring_learning_rate > 0.0:
            self.optimizer = Spring(networks[0], settings.spring_learning_rate)
        else:
            rates = settings.learning_rate, settings.muon_learning_rate
            self.optimizer = Optimizer(self.learner, *rates)
        self.shuffler: torch.Generator = torch.Generator().manual_seed(settings.seed)
        self.failed: FloatArray = np.ones(len(expert.pairs))  # share of the episodes, lately
        self.down = np.zeros((0, config.state_size))  # states to start from
        if settings.disturbed > 0.0:
            rng = np.random.default_rng(settings.seed)
            self.down: FloatArray = knocked_down(config, rng, turns=settings.turns)
        self.updates: int = 0  # so far
        self.distance = math.inf  # of the learner's actions from the expert's, in `learn`

    @torch.no_grad()
    def inputs(self, observation: np.ndarray, info: dict[str, Any]) -> torch.Tensor:
        """Inputs of the student, (B, inputs), after observations (B, k)."""
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
        returns, lasts = np.zeros(size), np.ones(size, np.bool_)
        by_student = (lanes.rank < settings.student_fraction) & (round_ > 0)
        by_expert = (lanes.rank >= 1.0 - settings.expert_fraction) | (round_ == 0)
        std = (settings.noise_std * by_expert * rng.random(size))[:, None]
        taken, known, steps_taken = by_expert, np.ones(size, np.bool_), 0.0
        for _ in range(self.episode_steps):
            inputs = self.inputs(observation, info)
            tracking = lanes.against_lag(expert.tracking(info))
            cost = tracking.relative_cost
            known &= cost < settings.lost
            self.dataset.add(inputs, tracking, known & (rng.random(size) < settings.kept), rng)
            limit = np.where(taken, settings.hand_back, settings.take_over)
            taken = ((cost > limit) & ~by_student) | by_expert
            steps_taken += taken[~by_student & ~by_expert].sum()
            action = np.where(taken[:, None], tracking.actions, self.act(inputs))
            action = (action + std * rng.normal(size=action.shape)).clip(-1.0, 1.0)
            self.history.act(action.astype(np.float32))
            observation, reward, terminated, info = lanes.step(action)
            returns += np.where(lasts, reward, 0.0)
            lasts &= ~terminated
        if round_ == 0:
            if self.dataset.size > 0 and not known.any():  # else `learn` says what keeps nothing
                raise RuntimeError(
                    "the expert must follow its own plan, but loses the chain in every environment,"
                    " so nothing can be learned from it: give it another plan_seed, more seconds, "
                    "or less noise_std, or a larger torque limit"
                )
            return {}
        success = info["success"] & lasts  # else it is that of a later episode
        lanes.judge(np.flatnonzero(by_student), success[by_student])
        if drawn.size > 0:
            self.count(drawn[by_student], success[by_student])
        steps = self.episode_steps * max(1, np.sum(~by_student & ~by_expert))
        score = {"return": returns, "success": success}
        means = {name: round(float(value[by_student].mean()), 4) for name, value in score.items()}
        return means | {"taken_over": round(float(steps_taken / steps), 4)}

    def starts(self, rng: np.random.Generator) -> tuple[NDArray[np.int64], dict[str, FloatArray]]:
        """Return the pair of equilibria of each lane, with the options of `reset` that say so.

        Pairs are drawn more often where the student failed more often. Without goals there are
        none, but with `disturbed` there are states to start from.
        """
        pairs, size = self.expert.pairs, self.settings.num_envs
        if len(pairs) == 0 and len(self.down) == 0:
            return np.zeros(0, np.int64), {}
        if len(pairs) == 0:
            config = self.lanes.config
            hanging = rng.uniform(-config.spread, config.spread, (size, config.state_size))
            down = (rng.random(size) < self.settings.disturbed)[:, None]
            states = np.where(down, self.down[rng.integers(len(self.down), size=size)], hanging)
            theta, omega = np.split(states, 2, axis=1)
            return np.zeros(0, np.int64), {"theta": theta, "omega": omega}
        share = _EVEN / len(pairs) + (1.0 - _EVEN) * self.failed / self.failed.sum()
        drawn = rng.choice(len(pairs), size, p=share)
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
        if self.dataset.size == 0:
            raise ValueError(
                "kept, lost and num_envs must be larger: no state of a round was kept, got "
                f"{self.settings.kept}, {self.settings.lost} and {self.settings.num_envs}"
            )
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
        inputs, actions = dataset.inputs[rows], dataset.actions[rows]
        weights = dataset.weights[rows]
        if isinstance(self.optimizer, Spring):
            prediction = self.optimizer.step(inputs, actions, weights, left)
        else:
            prediction = self.learner(inputs)
            losses = nn.functional.smooth_l1_loss(prediction, actions, beta=0.2, reduction="none")
            loss = (weights * losses).mean() / weights.mean()
            loss.backward()
            self.optimizer.step(left)
        self.updates += 1
        return float((prediction.detach() - actions).abs().mean())

    def policy(self, last: dict[str, Any]) -> Policy:
        """Return the student as a policy, with memory where it is given several observations."""
        student = self.student
        merged = student.merged() if isinstance(student, GoalNetworks) else copy.deepcopy(student)
        mean = cast("nn.Sequential", merged)
        first = cast("nn.Linear", mean[0])  # takes observations, not the inputs made of them
        first.weight = nn.Parameter(first.weight.detach() @ self.to_inputs.T)
        frames = torch.ones(self.history.frames.shape[1:])
        scale = frames if self.settings.length > 1 else frames[0, : len(self.to_inputs)]
        return policy_of(mean, scale, "imitation", self.settings, last)


def begin(settings: Settings, config: Any, progress: str | None) -> tuple[DAgger, int, int]:
    """Return the student nearest to its expert after two rounds, its guess, and the number tried.

    Some trajectories are much harder to learn than others, and nothing else tells which.
    """
    begun: list[tuple[DAgger, int]] = []
    for guess in range(settings.guesses):
        expert = expert_of(settings, config, guess, progress)
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
    config = used_config("imitation", settings.env, OF_IMITATION)
    if not isinstance(config.mode, (SwingUp, Balance, Calm, Transition)):
        raise ValueError(f"mode must be one with an expert, got {config.mode!r}")
    check_errors(settings.errors)
    if settings.errors and config.observe_context:
        raise ValueError("observe_context must be False with errors, which no policy observes")
    check_settings(settings, below_one=("averaging",))
    _checks.count("rounds", settings.rounds, low=2)
    _checks.count("max_states", settings.max_states, low=settings.num_envs)
    check_feedback_units(config, settings.feedback_units, settings.hidden)
    if settings.plan_seed is not None:
        _checks.count("plan_seed", settings.plan_seed, low=0)
    for name in ("student_fraction", "kept", "lost"):
        _checks.positive_number(name, getattr(settings, name))
    for name in ("student_fraction", "expert_fraction", "kept", "disturbed"):
        if getattr(settings, name) > 1.0:
            raise ValueError(f"{name} must be at most 1, got {getattr(settings, name)}")
    if settings.rescuer and not isinstance(config.mode, SwingUp):
        raise ValueError(
            f'rescuer must be left out in mode "{config.mode.name}", it helps in swing-ups alone; '
            f'got "{settings.rescuer}"'
        )
    if settings.disturbed > 0.0 and (not settings.rescuer or config.has_cart):
        raise ValueError(
            "disturbed must be 0 without a rescuer, and on a cart, which no knock-down moves; got "
            f"{settings.disturbed}"
        )
    if settings.rescuer not in ("", "mpc"):
        rescuing_policy(settings.rescuer, config)
    goals_end_inputs = config.mode.has_goals and not config.observe_context
    if settings.by_goal and not (goals_end_inputs and settings.length == 1 < settings.layers):
        raise ValueError(
            "by_goal must be False in a mode without goals, with memory, observe_context or a "
            f"single layer; got mode {config.mode.name!r}, length={settings.length}, "
            f"observe_context={config.observe_context} and layers={settings.layers}"
        )
    if settings.by_goal and settings.spring_learning_rate > 0.0:
        rate = settings.spring_learning_rate
        raise ValueError(f"spring_learning_rate must be 0 with by_goal, got {rate}")
    torch.manual_seed(settings.seed)
    clock, curve = Stopwatch(), Curve()
    checkpoint = checkpoint or Checkpoint(settings)
    known: dict[str, Any] = settings.env | {"observe_velocities": True}  # experts know the state
    config = EnvConfig(**known)
    if checkpoint.saved is None:
        dagger, guess, tried = begin(settings, config, progress)
    else:  # the others have been tried
        guess, tried, *kept = restore(None, checkpoint.saved["parts"]["choice"])
        dagger = DAgger(settings, cast("Expert", expert_of(settings, config, guess, kept=kept)))
    choice = [guess, tried, *dagger.expert.trajectories]
    parts = {"dagger": dagger, "choice": choice, "curve": curve, "clock": clock}
    for round_ in checkpoint.rounds(parts, settings.rounds, progress, "rounds", first=2):
        score = dagger.play(round_)
        dagger.learn(settings.updates)
        if round_ % 4 == 0:
            dagger.lanes.grow()
        steps = (2 * (tried - 1) + round_ + 1) * dagger.episode_steps * settings.num_envs
        counts = {"steps": steps, "seconds": round(clock.seconds, 2)}
        curve.append(counts | score | {"distance": round(dagger.distance, 4)})
    dagger.lanes.close()
    return dagger.policy(curve[-1]), curve
