"""Planned transitions: a trajectory to an equilibrium within the torque limit, tracked by LQR.

`transcription.py` finds the trajectory. With the tracking, this is what is known for the swing-up
of a double and a triple pendulum on a cart: Graichen, Treuer, Zeitz, Automatica 43 (2007), 63-71,
and Glück, Eder, Kugi, Automatica 49 (2013), 801-808.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.envs import EnvConfig
from npend_gym.envs.goals import checked_equilibrium
from npend_gym.rl.controllers.mpc import MPC
from npend_gym.rl.controllers.regulators import StateFeedback, riccati, state_weights
from npend_gym.rl.controllers.step_model import (
    StepModel,
    at_rest,
    check_config,
    env_actions,
    state_of,
    wrapped,
)
from npend_gym.rl.controllers.transcription import NominalTrajectory, Transcription
from npend_gym.rl.evaluation.settings import keywords_of, number_of_steps

GUESSES = "waves", "mpc"
_LONGER = 5.0 / 3.0  # rail on which MPC guesses where its motions on the real one lead to no plan
_START = 0.05  # rad and rad/s from the equilibrium, as far as environments start from it


class Tracking(NamedTuple):
    """What a plan says about the state of each of B environments."""

    actions: FloatArray  # (B, joints)
    deviation: FloatArray  # (B, 2c), of the state from the trajectory
    relative_cost: FloatArray  # (B,), of the deviation, over the mean at the start of episodes
    action_weight: FloatArray  # (B, joints): times its square, what a wrong action costs


@dataclass(frozen=True, eq=False, repr=False)
class PlannedTransition:
    """Hold the start by LQR, track a nominal trajectory by time-varying LQR, hold the goal by LQR.

    While tracking, the actions are the nominal ones minus gains times the deviation of the state.
    """

    nominal: NominalTrajectory
    gains: FloatArray  # (steps, joints, 2c)
    costs: FloatArray  # (steps + 1, 2c, 2c): x costs[k] x is the cost of a deviation x at step k
    action_weights: FloatArray  # (steps, joints): of the squares of wrong actions in that cost
    hold_start: StateFeedback
    hold_goal: StateFeedback
    settle: float  # time before the trajectory begins [s]

    def __repr__(self) -> str:
        steps, dt, n = len(self.gains), self.config.dt, self.config.n
        return f"PlannedTransition({n} rods, {steps} steps of {dt:g} s, settle={self.settle:g} s)"

    def __call__(self, observation: Any, info: dict[str, Any]) -> FloatArray:
        """Return the actions (B, joints), of discrete ones the numbers (B,); without B of one."""
        del observation
        return env_actions(self.config, self.tracking(info).actions)

    @property
    def config(self) -> EnvConfig:
        """The settings of the environment that the plan is for."""
        return self.hold_goal.config

    def tracking(self, info: dict[str, Any]) -> Tracking:
        """Return the actions, and how far the states are from the trajectory.

        Of a single environment its arrays have no leading axis of B.
        """
        return self.at(state_of(self.config, info), np.asarray(info["time"]))

    def at(self, states: FloatArray, time: FloatArray) -> Tracking:
        """Return `tracking` in states (q, u), (..., 2c), at times [s], (...)."""
        steps, dt = len(self.gains), self.config.dt
        step = np.rint(time / dt).astype(np.int64) - round(self.settle / dt)
        k = np.clip(step, 0, steps - 1)
        away = states - self.nominal.states[np.clip(step, 0, steps)]
        deviation = wrapped(self.config, away)
        track = self.nominal.actions[k] - np.einsum("...ji,...i->...j", self.gains[k], deviation)
        before, after = (step < 0)[..., None], (step >= steps)[..., None]
        start, goal = self.hold_start.actions(states), self.hold_goal.actions(states)
        actions = np.where(before, start, np.where(after, goal, track))
        s = self.costs[np.clip(step, 0, steps)]
        cost = np.einsum("...i,...ij,...j->...", deviation, s, deviation)
        relative_cost = cost / (np.trace(self.costs[0]) * _START**2 / 3.0)
        return Tracking(actions, deviation, relative_cost, self.action_weights[k])

    @property
    def sensitivity(self) -> float:
        """The cost of the worst deviation of length one at the start."""
        return float(np.linalg.eigvalsh(self.costs[0])[-1])


def planned_swing_up(
    config: EnvConfig,
    seconds: float = 6.0,
    *,
    settle: float = 0.0,
    tries: int = 4,
    guess: str = "waves",
    seed: int = 0,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> PlannedTransition:
    """Plan swing-ups and return the one that is least sensitive to deviations at its start.

    It is `planned_transition` from hanging to upright, which explains the arguments. Of the guesses
    "waves" about half lead to a trajectory, of "mpc" nearly all, with up to six rods.

    Examples
    --------
    >>> from npend_gym.envs import EnvConfig
    >>> from npend_gym.rl import evaluate, planned_swing_up
    >>> plan = planned_swing_up(EnvConfig(mode="swingup", n=1), 3.0, tries=1, guess="mpc")
    >>> evaluate(plan, {"mode": "swingup", "n": 1}, episodes=4).success_rate
    1.0
    """
    return planned_transition(
        config, 0.0, np.pi, seconds,
        settle=settle, tries=tries, guess=guess, seed=seed, progress=progress,
    )  # fmt: skip


def planned_transition(
    config: EnvConfig,
    start: ArrayLike,
    goal: ArrayLike,
    seconds: float = 6.0,
    *,
    settle: float = 0.0,
    tries: int = 4,
    guess: str = "mpc",
    seed: int = 0,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> PlannedTransition:
    """Plan motions between equilibria; return the one least sensitive to deviations at its start.

    Parameters
    ----------
    config : EnvConfig
        Of the environment, ``gym.make("npend/SwingUp-v1", ...).unwrapped.config``. The trajectory
        is made of its own steps.
    start, goal : float or array_like, shape (n,)
        Two different equilibria: 0 for a rod that hangs, pi for one that stands [rad].
    seconds : float
        Duration of the trajectory.
    settle : float
        Time [s] for which LQR about the start calms the chain before the trajectory begins.
    tries : int
        Number of first guesses, drawn from `seed`.
    guess : str
        "waves", random paths that are no motions; or "mpc", transitions by `MPC` from near the
        start, which take longer to guess, but lead to a trajectory more often. On a cart, where
        none of these does, `MPC` guesses again on a longer rail.
    seed : int
        Seed of the guesses.
    progress : callable
        May wrap the iteration over the guesses, as tqdm does.

    Returns
    -------
    PlannedTransition

    Raises
    ------
    RuntimeError
        If none of the guesses leads to a trajectory.
    TypeError, ValueError
        If an argument breaks its rule.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym.envs import EnvConfig
    >>> from npend_gym.rl import planned_transition
    >>> config = EnvConfig(mode="transition", n=1)
    >>> plan = planned_transition(config, 0.0, np.pi, 3.0, tries=1)
    >>> plan.nominal.states[-1].round(3).tolist()  # the angle, and its rate
    [3.142, 0.0]
    """
    check_config(config)
    begin, end = (
        np.where(
            checked_equilibrium(name, _checks.vector(name, angles, config.n)) < 0.0, np.pi, 0.0
        )
        for name, angles in (("start", start), ("goal", goal))
    )
    if np.array_equal(begin, end):
        raise ValueError(f"goal must be another equilibrium than start, got {end.tolist()}")
    steps = number_of_steps("seconds", seconds, config.dt)
    settle = _checks.nonnegative_number("settle", settle)
    if _checks.choice("guess", guess, GUESSES) == "mpc" and config.chain.gravity == 0.0:
        raise ValueError('guess must be "waves" without gravity, where MPC knows no horizon')
    problem = Transcription(config, steps, begin, end)
    tries, seed = _checks.count("tries", tries), _checks.count("seed", seed, low=0)

    def generators() -> list[np.random.Generator]:
        return [np.random.default_rng([seed, k]) for k in range(tries)]

    def plans(guesses: Sequence[tuple[FloatArray, FloatArray]]) -> list[PlannedTransition]:
        nominals = [problem.solve(*guesses[attempt]) for attempt in progress(range(len(guesses)))]
        return [track(config, nominal, settle) for nominal in nominals if nominal is not None]

    def by_mpc(config: EnvConfig) -> list[tuple[FloatArray, FloatArray]]:
        near = [rng.uniform(-_START, _START, config.state_size) for rng in generators()]
        motions = mpc_motions(config, np.stack(near) + at_rest(config, begin), end, steps)
        return [problem.unknowns(*motion) for motion in motions]

    if guess == "waves":
        found = plans([problem.wavy_guess(rng) for rng in generators()])
    else:
        found = plans(by_mpc(config))
        if not found and config.rail is not None:
            # MPC may never stand up on a short rail; its motion on a longer one can be made to fit
            longer: dict[str, Any] = keywords_of(config) | {"rail": _LONGER * config.rail}
            found = plans(by_mpc(EnvConfig(**longer)))
    if not found:
        raise RuntimeError(
            f"no trajectory of {steps * config.dt:g} s was found in {tries} tries: "
            "give it more seconds, tries or torque, or another seed"
        )
    return min(found, key=lambda controller: controller.sensitivity)


def mpc_motions(
    config: EnvConfig, states: FloatArray, goal: FloatArray, steps: int
) -> list[NominalTrajectory]:
    """Return transitions by `MPC` from these states, (B, 2c), without those that diverge."""
    step, controller = StepModel(config), MPC(config, goal)
    motions, actions = [states], list[FloatArray]()
    try:
        for k in range(steps):
            actions.append(controller.plan(motions[-1], np.full(len(states), k * config.dt)))
            motions.append(step(motions[-1], actions[-1]))
    except FloatingPointError:  # one of them diverges
        alone = np.split(states, len(states)) if len(states) > 1 else []
        return [motion for one in alone for motion in mpc_motions(config, one, goal, steps)]
    pairs = zip(np.stack(motions, axis=1), np.stack(actions, axis=1), strict=True)
    return [NominalTrajectory(*pair) for pair in pairs]


def replanned(
    config: EnvConfig, near: NominalTrajectory, like: NominalTrajectory
) -> PlannedTransition | None:
    """Return a plan between the equilibria of a motion nearby, or None where that leads to none.

    Of such plans it is one whose actions are most like those of the motion `like`.
    """
    first, last = (np.remainder(near.states[k, : config.n], 2.0 * np.pi) for k in (0, -1))
    problem = Transcription(config, len(near.actions), first, last)
    nominal = problem.solve(*problem.unknowns(*near), like=like)
    return None if nominal is None else track(config, nominal, 0.0)


def track(config: EnvConfig, nominal: NominalTrajectory, settle: float) -> PlannedTransition:
    """Return the controller that tracks `nominal`, which begins and ends in equilibria."""
    a, b = StepModel(config).derivatives(nominal.states[:-1], nominal.actions)
    start, goal = (np.remainder(nominal.states[k, : config.n], 2.0 * np.pi) for k in (0, -1))
    joints, costs = b.shape[2], np.empty((len(a) + 1, *a.shape[1:]))
    gains, hessians = np.empty((len(a), joints, a.shape[2])), np.empty((len(a), joints, joints))
    at_goal, s = riccati(config, goal, 1.0)
    costs[-1] = s
    for k in reversed(range(len(a))):
        hessians[k] = np.eye(joints) + b[k].T @ s @ b[k]
        gains[k] = np.linalg.solve(hessians[k], b[k].T @ s @ a[k])
        s = state_weights(config) + a[k].T @ s @ (a[k] - b[k] @ gains[k])
        s = costs[k] = 0.5 * (s + s.T)
    return PlannedTransition(
        nominal, gains, costs, np.diagonal(hessians, axis1=1, axis2=2),
        StateFeedback(config, start, riccati(config, start, 1.0)[0]),
        StateFeedback(config, goal, at_goal), settle,
    )  # fmt: skip
