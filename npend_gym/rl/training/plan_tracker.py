"""Plans of many lanes, tracked without a clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.envs import EnvConfig
from npend_gym.rl.controllers.planning import PlannedTransition, Tracking
from npend_gym.rl.controllers.step_model import state_of, wrapped
from npend_gym.rl.controllers.transitions import Pair

_BACK, _AHEAD = 2, 4  # steps within which the nearest state of a plan is sought
_START = 0.05  # rad and rad/s, as far as episodes start from the beginning of a plan


class PlanTracker:
    """Plans of equal length, one of them in each lane, each tracked by its own feedback.

    The cost of the feedback, not the clock, decides at which state of a plan a chain is: a student
    that is late, and knows no clock, is not far from the plan.

    `start_cost` is the mean cost at the start of episodes, over that of starts near the beginning
    of a plan.
    """

    pairs: Sequence[Pair] = ()

    def __init__(
        self, config: EnvConfig, plans: Sequence[PlannedTransition], start_cost: float = 1.0
    ) -> None:
        self._config = config
        self.steps: int = len(plans[0].gains)
        idle = np.zeros((1, config.joints.size))
        self._states = np.array([plan.nominal.states for plan in plans])
        self._actions = np.array([[*plan.nominal.actions, *idle] for plan in plans])
        self._gains = np.array([[*plan.gains, plan.hold_goal.gain] for plan in plans])
        self._costs = np.array([plan.costs for plan in plans])
        weights = [[*plan.action_weights, plan.action_weights[-1]] for plan in plans]
        self._weights = np.array(weights)
        unit = np.trace(self._costs[:, 0], axis1=1, axis2=2) * _START**2 / 3.0
        self._unit = start_cost * unit
        self.begin(np.zeros(0, np.int64))

    def begin(self, which: NDArray[np.int64], round_: int = 0) -> None:
        """Begin episodes in lanes with the plans of these numbers, (B,)."""
        del round_
        self._which, self._phase = which, np.zeros(which.size, np.int64)

    def tracking(self, info: Mapping[str, Any]) -> Tracking:
        """Return what the plans say about the states of all lanes.

        From the last step of a plan on, or wherever that is nearer, the goal is held.
        """
        states, which = state_of(self._config, info), self._which
        steps, lanes = self.steps, np.arange(len(which))
        self._phase[info["time"] == 0.0] = 0
        near = np.clip(self._phase[:, None] + [*range(-_BACK, _AHEAD + 1), steps], 0, steps)
        away = states[:, None] - self._states[which[:, None], near]
        away = np.where(near[..., None] == steps, wrapped(self._config, away), away)
        costs = self._costs[which[:, None], near]
        cost = np.einsum("bwi,bwij,bwj->bw", away, costs, away)
        nearest = cost.argmin(axis=1)
        phase, deviation = near[lanes, nearest], away[lanes, nearest]
        feedback = np.einsum("bji,bi->bj", self._gains[which, phase], deviation)
        relative_cost = cost[lanes, nearest] / self._unit[which]
        actions, weights = self._actions[which, phase] - feedback, self._weights[which, phase]
        self._phase = phase
        return Tracking(actions, deviation, relative_cost, weights)

    def rest(
        self, states: FloatArray, lanes: NDArray[np.int64], steps: int
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the next steps of the plans of some lanes; after its end a plan holds the goal.

        These are states, (steps + 1, B, 2c), whole turns away from the plan where the chain is;
        actions, (steps, B, joints); and gains.
        """
        which, ahead = self._which[lanes], np.arange(steps + 1)[:, None]
        steps_of = np.minimum(self._phase[lanes] + ahead, self.steps)
        nominal = self._states[which, steps_of]
        away = states - nominal[0]
        turns = away - wrapped(self._config, away)
        before = which, steps_of[:-1]
        return nominal + turns, self._actions[before], self._gains[before]
