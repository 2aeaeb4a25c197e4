"""A nominal trajectory between equilibria, tracked by time-varying LQR."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.envs import EnvConfig
from npend_gym.envs.inputs import env_actions
from npend_gym.rl.controllers.feedback import StateFeedback
from npend_gym.rl.controllers.regulators import riccati, softened, state_weights
from npend_gym.rl.controllers.step_model import StepModel, state_of, wrapped
from npend_gym.rl.controllers.transcription import NominalTrajectory

START = 0.05  # rad and rad/s from the equilibrium, as far as environments start from it


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
        relative_cost = cost / (np.trace(self.costs[0]) * START**2 / 3.0)
        return Tracking(actions, deviation, relative_cost, self.action_weights[k])

    @property
    def sensitivity(self) -> float:
        """The cost of the worst unit deviation at the start."""
        return float(np.linalg.eigvalsh(self.costs[0])[-1])


def track(config: EnvConfig, nominal: NominalTrajectory, settle: float) -> PlannedTransition:
    """Return the controller that tracks `nominal`, which begins and ends in equilibria.

    The trajectory has the chain's own dry friction. Feedback takes friction as `lqr` does about the
    goal. Discrete actions are rounded, so that their size has no cost while tracking. This
    makes the feedback steeper.
    """
    (start, begin), (goal, place) = (rest_of(config, nominal.states[k]) for k in (0, -1))
    at_goal, s, rub = riccati(config, goal, 1.0)
    model = StepModel(config, softened(config, rub))
    a, b = model.derivatives(nominal.states[:-1], nominal.actions)
    joints, costs = b.shape[2], np.empty((len(a) + 1, *a.shape[1:]))
    gains, hessians = np.empty((len(a), joints, a.shape[2])), np.empty((len(a), joints, joints))
    costs[-1] = s
    for k in reversed(range(len(a))):
        hessians[k] = np.eye(joints) + b[k].T @ s @ b[k]
        gains[k] = np.linalg.solve(hessians[k], b[k].T @ s @ a[k])
        s = state_weights(config) + a[k].T @ s @ (a[k] - b[k] @ gains[k])
        s = costs[k] = 0.5 * (s + s.T)
    if config.torque_levels is not None:  # then actions count by what they lead to alone
        gains[:] = np.linalg.solve(hessians - np.eye(joints), hessians @ gains)
    return PlannedTransition(
        nominal, gains, costs, np.diagonal(hessians, axis1=1, axis2=2),
        StateFeedback(config, start, riccati(config, start, 1.0).gain, begin),
        StateFeedback(config, goal, at_goal, place), settle,
    )  # fmt: skip


def rest_of(config: EnvConfig, state: FloatArray) -> tuple[FloatArray, float]:
    """Return the angles without whole turns, (n,), and the place of a cart, of a state at rest."""
    angles = np.remainder(state[: config.n], 2.0 * np.pi)
    return angles, float(state[config.n]) if config.has_cart else 0.0
