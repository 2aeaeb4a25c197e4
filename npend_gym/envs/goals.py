"""Observations with a goal, as Dict like those of Gymnasium-Robotics, and the reward of a goal."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.envs.modes import Mode

MAX_KINETIC_ENERGY = 4.0  # in a goal, in units of `Chain.lifting_energy`; more is clipped
_NEARNESS = 1e-6  # rad, of an angle to 0 or pi

GoalObservation = dict[str, NDArray[Any]]


def goal_space(observation: spaces.Box, n: int) -> spaces.Dict:
    """Return the space of observations with a goal, of n rods."""
    high = np.append(np.ones(n), MAX_KINETIC_ENERGY)
    goal = spaces.Box(np.append(-np.ones(n), 0.0), high, dtype=np.float64)
    return spaces.Dict(observation=observation, achieved_goal=goal, desired_goal=goal)


def with_goals(
    observation: NDArray[np.float32], cosines: FloatArray, kinetic_energy: FloatArray,
    goals: FloatArray,
) -> GoalObservation:  # fmt: skip
    """Return observations (B, k) with what has been achieved, and what is desired, (B, n + 1)."""
    achieved = np.column_stack([cosines, np.minimum(kinetic_energy, MAX_KINETIC_ENERGY)])
    desired = np.column_stack([goals, np.zeros(len(goals))])
    return {"observation": observation, "achieved_goal": achieved, "desired_goal": desired}


def of_lane(observation: NDArray[np.float32] | GoalObservation, lane: int) -> Any:
    """Return the observation of one sub-environment, whether it has a goal or not."""
    if isinstance(observation, dict):
        return {key: value[lane] for key, value in observation.items()}
    return observation[lane]


class GoalReward:
    """The reward of an environment with goals: 1 where the goal is met, else 0.

    A goal is the cosine of each angle and the kinetic energy in units of `Chain.lifting_energy`,
    shape (n + 1,); any state that has been reached can be one. It has no cart: where a cart
    is beyond its rail, `step` returns 0, and the reward of the goal may be 1.
    """

    def __init__(self, mode: Mode, n: int) -> None:
        self._mode, self._size = mode, n + 1

    def __call__(self, achieved_goal: ArrayLike, desired_goal: ArrayLike, info: Any) -> Any:
        """Return the reward of having achieved one goal where another was desired.

        Parameters
        ----------
        achieved_goal, desired_goal : array_like, shape (n + 1,) or (B, n + 1)
        info
            Not needed; Gymnasium-Robotics' interface has it.

        Returns
        -------
        float, or ndarray of shape (B,)
        """
        del info
        for name, goal in (("achieved_goal", achieved_goal), ("desired_goal", desired_goal)):
            if np.shape(goal)[-1:] != (self._size,):
                raise ValueError(
                    f"{name} must have n + 1 = {self._size} numbers on its last axis, "
                    f"got the shape {np.shape(goal)}"
                )
        away = np.abs(np.subtract(achieved_goal, desired_goal, dtype=np.float64))
        known: Any = SimpleNamespace(
            goal_distance=away[..., :-1].max(axis=-1), kinetic_energy=away[..., -1]
        )
        reward = np.asarray(self._mode.achieved(known), np.float64)
        return reward if reward.ndim else float(reward)


def checked_equilibrium(label: str, angles: FloatArray) -> FloatArray:
    """Return the cosines, +-1, of angles that are 0 or pi, or say that they are not."""
    stands = np.abs(angles - math.pi) <= _NEARNESS
    if not np.all(stands | (np.abs(angles) <= _NEARNESS)):
        raise ValueError(
            f"{label} must be an equilibrium: 0 (hanging) or pi (standing) for each rod, to "
            f"{_NEARNESS:g} rad, such as np.pi * np.array([0, 1]); "
            f"got {_checks.show(angles.tolist())}"
        )
    return np.where(stands, -1.0, 1.0)


def check_different(start: FloatArray, goal: FloatArray) -> None:
    """Raise a ValueError where a goal (B, n) is the equilibrium of the start."""
    same = np.all(start == goal, axis=-1)
    if np.any(same):
        angles = np.where(goal[same][0] > 0.0, 0.0, math.pi).tolist()
        raise ValueError(
            "options['goal'] must differ from options['start'] in at least one rod, got "
            f"{_checks.show(angles)} for both; leave one out, and another equilibrium is drawn"
        )


def check_goal_env(mode: Mode, reward_type: str, *, goal_env: bool) -> None:
    """Raise a ValueError where the keyword `goal_env` does not go with the others."""
    if goal_env and not mode.has_goals:
        raise ValueError(
            f"goal_env must be False in mode {mode.name!r}, whose episodes have no goal of their "
            'own; mode="transition" has goals'
        )
    if goal_env and reward_type != "sparse":
        raise ValueError(
            'reward_type must be "sparse" with goal_env=True, because the dense reward needs the '
            f"actions, which compute_reward does not receive; got {reward_type!r}"
        )
    if goal_env:
        try:
            GoalReward(mode, 1)(np.zeros(2), np.zeros(2), {})
        except AttributeError as error:
            raise ValueError(
                f"achieved of mode {mode.name!r} must use goal_distance and kinetic_energy alone "
                "with goal_env=True, because a goal has no other quantity; got "
                f"{error.name}: leave goal_env out to use it"
            ) from error
