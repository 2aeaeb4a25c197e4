"""Curricula: wrappers that make episodes harder when enough of the last ones have succeeded."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorWrapper

from npend_gym import _checks
from npend_gym._checks import BoolArray
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.inputs import checked_options, given_options, reset_mask


def config_below(wrapper: str, env: Any) -> EnvConfig:
    """Return the settings of the environment that a wrapper of this name is given."""
    config = getattr(getattr(env, "unwrapped", None), "config", None)
    if not isinstance(config, EnvConfig):
        raise TypeError(
            f"env must be an environment of N-pendulums for {wrapper}, got {_checks.show(env)}"
        )
    return config


class Levels:
    """The levels of a curriculum: what both wrappers share.

    Attributes
    ----------
    level : int
        Number of the level, from 0, at which the next episodes begin.
    outcomes : deque of bool
        The success of the last episodes that began at this level.
    """

    env: Any

    def _open(
        self, levels: Sequence[Any], threshold: Any, episodes: Any, lanes: int | None = None
    ) -> None:
        config = config_below(type(self).__name__, self.env)
        if not config.mode.defines_success:
            raise ValueError(
                f"env must have a task with a success, which mode {config.mode.name!r} has not"
            )
        given: list[Any] = [*levels] if isinstance(levels, (list, tuple)) else []
        if not given:
            raise TypeError(
                "levels must be a list of options of reset, the easiest first, such as "
                f'[{{"max_torque": 20.0}}, {{"max_torque": 10.0}}]; got {_checks.show(levels)}'
            )
        self.levels: list[dict[str, Any]] = [given_options(each) for each in given]
        for each in self.levels:
            checked_options(each, config, lanes)
        self.threshold: float = _checks.positive_number("threshold", threshold)
        if self.threshold > 1.0:
            raise ValueError(f"threshold must be at most 1, a success rate, got {threshold:g}")
        self.episodes: int = _checks.count("episodes", episodes)
        self.level: int = 0
        self.outcomes: deque[bool] = deque(maxlen=self.episodes)
        self._has_begun = False

    def _reset(self, seed: Any, options: Any) -> tuple[Any, dict[str, Any]]:
        level, own = self.levels[self.level], given_options(options)
        if np.any(own.get("persist", False)):
            raise ValueError(
                "options must leave out 'persist', because later episodes have the options of "
                "their level: give every level these options"
            )
        result = self.env.reset(seed=seed, options=level | own)
        self._has_begun = True
        self.env.unwrapped.set_options(level)
        return result

    def _count(self, successes: Sequence[bool]) -> None:
        """Count episodes that began at this level, and raise the level where it is mastered."""
        for success in successes:
            self.outcomes.append(bool(success))
            rate = sum(self.outcomes) / self.episodes
            is_mastered = len(self.outcomes) == self.episodes and rate >= self.threshold
            if is_mastered and self.level + 1 < len(self.levels):
                self.load_state_dict({"level": self.level + 1, "outcomes": []})
                return

    def state_dict(self) -> dict[str, Any]:
        """Return the level, and the outcomes of its last episodes: numbers that JSON can hold."""
        return {"level": self.level, "outcomes": [*self.outcomes]}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from a state of `state_dict`; the episodes that begin later have its level."""
        given: Any = state
        if not isinstance(given, Mapping) or not {"level", "outcomes"} <= given.keys():
            raise ValueError(
                "state must have level and outcomes, as state_dict returns them, got "
                f"{_checks.show(given)}"  # pyright: ignore[reportUnknownArgumentType]
            )
        last = len(self.levels) - 1
        level = _checks.count("the level of state", state["level"], low=0, high=last)
        listed = _checks.listed("the outcomes of state", state["outcomes"], "[True, False]")
        outcomes = [_checks.truth("each of the outcomes of state", each) for each in listed]
        self.level, self.outcomes = level, deque(outcomes, maxlen=self.episodes)
        if self._has_begun:
            self.env.unwrapped.set_options(self.levels[self.level])


class Curriculum(Levels, gym.Wrapper[Any, Any, Any, Any], gym.utils.RecordConstructorArgs):
    """Makes the episodes of one environment harder, level by level.

    A level is a dict of options of `NPendulumEnv.reset`: torque limit, spread of the starts, errors
    of motors and sensors, and the chain. ``info["level"]`` is the level of the episode.

    Parameters
    ----------
    env : gymnasium.Env
        An environment of this package, or a wrapper of it, whose task has a success.
    levels : sequence of dict
        The easiest first.
    threshold : float
        The level rises when this share of its last episodes has succeeded.
    episodes : int
        Number of these episodes. All of them began at the level.

    Raises
    ------
    TypeError, ValueError
        If an argument breaks its rule.

    Examples
    --------
    >>> import gymnasium as gym
    >>> import npend_gym
    >>> from npend_gym.envs import Curriculum
    >>> env = gym.make("npend/Balance-v1", n=1, max_episode_steps=3)
    >>> env = Curriculum(env, [{"spread": 0.02}, {"spread": 0.2}], episodes=2)
    >>> for seed in range(3):
    ...     _, info = env.reset(seed=seed)
    ...     print(info["level"])
    ...     for _ in range(3):
    ...         _ = env.step([0.0])
    0
    0
    1
    """

    def __init__(
        self, env: gym.Env[Any, Any], levels: Sequence[Mapping[str, Any]], *,
        threshold: float = 0.8, episodes: int = 50,
    ) -> None:  # fmt: skip
        gym.utils.RecordConstructorArgs.__init__(
            self, levels=levels, threshold=threshold, episodes=episodes
        )
        gym.Wrapper.__init__(self, env)
        self._open(levels, threshold, episodes)
        self._begun_at = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode at the present level; `options` come before those of the level."""
        self._begun_at = self.level
        observation, info = self._reset(seed, options)
        return observation, info | {"level": self._begun_at}

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Take a step; at the end of an episode its success counts."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        if (terminated or truncated) and self._begun_at == self.level:
            self._count([info["success"]])
        return observation, reward, terminated, truncated, info | {"level": self._begun_at}


# Gymnasium 1.1 knows no types of a vector wrapper
class VectorCurriculum(Levels, VectorWrapper):  # pyright: ignore[reportMissingTypeArgument]
    """Makes the episodes of a vector environment harder, level by level.

    As `Curriculum`, with one level for all sub-environments. Episodes go on at their level, which
    ``info["level"]`` tells; the next ones have the new level, with any autoreset mode.

    Parameters
    ----------
    env : gymnasium.vector.VectorEnv
        A native vector environment of this package, or a wrapper of it.
    levels, threshold, episodes
        As for `Curriculum`.

    Raises
    ------
    TypeError, ValueError
        If an argument breaks its rule.

    Examples
    --------
    >>> import gymnasium as gym
    >>> import npend_gym
    >>> from npend_gym.envs import VectorCurriculum
    >>> envs = gym.make_vec("npend/Calm-v1", num_envs=4, n=1)
    >>> envs = VectorCurriculum(envs, [{"amplitude": 0.3}, {"amplitude": 1.0}], threshold=0.9)
    >>> envs.reset(seed=0)[1]["level"]
    array([0, 0, 0, 0])
    >>> envs.load_state_dict({"level": 1, "outcomes": []})
    >>> envs.state_dict()
    {'level': 1, 'outcomes': []}
    """

    def __init__(
        self, env: Any, levels: Sequence[Mapping[str, Any]], *, threshold: float = 0.8,
        episodes: int = 50,
    ) -> None:  # fmt: skip
        super().__init__(env)
        self._open(levels, threshold, episodes, env.num_envs)
        self._begun_at = np.zeros(env.num_envs, np.int64)
        self._waiting: BoolArray = np.zeros(env.num_envs, np.bool_)  # for the reset of NEXT_STEP

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin episodes at the present level; `options` come before those of the level."""
        observation, info = self._reset(seed, options)
        mask = reset_mask(given_options(options).get("reset_mask"), self.num_envs, every=False)
        self._begun_at[mask], self._waiting = self.level, self._waiting & ~mask
        return observation, info | {"level": self._begun_at.copy(), "_level": mask.copy()}

    def step(self, actions: Any) -> tuple[Any, Any, BoolArray, BoolArray, dict[str, Any]]:
        """Take a step; the success of episodes that end counts."""
        observation, reward, terminated, truncated, info = self.env.step(actions)
        self._begun_at[self._waiting] = self.level
        done, last = terminated | truncated, info.get("final_info", info)
        level = {"level": self._begun_at.copy(), "_level": np.ones(self.num_envs, np.bool_)}
        counted = last["success"][done & (self._begun_at == self.level)]
        if "final_info" in info:  # SAME_STEP: these have begun again
            self._begun_at[done] = self.level
            info["final_info"] = last | level | {"_level": done}
            level["level"] = self._begun_at.copy()
        mode = self.metadata.get("autoreset_mode")
        self._waiting = done if mode is AutoresetMode.NEXT_STEP else np.zeros_like(done)
        self._count(counted.tolist())
        return observation, reward, terminated, truncated, info | level
