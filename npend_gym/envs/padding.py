"""Observations and actions of chains of any length in spaces of one size: for one network."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import (
    VectorActionWrapper,
    VectorObservationWrapper,
    VectorWrapper,
)
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.curriculum import config_below
from npend_gym.envs.keywords import joints_of
from npend_gym.envs.observing import ObsArray


class Padding:
    """The places of observed entries and actions in spaces for `n_max` rods."""

    def __init__(
        self, config: EnvConfig, n_max: Any, actuated: Any, observed: Any, acted: Any
    ) -> None:
        """Pad entries of the spaces `observed` and `acted`, which wrappers may have changed."""
        n, most = config.n, _checks.count("n_max", n_max)
        if n > most:
            raise ValueError(f"n_max must be at least the number of rods, {n}, got {most}")
        if config.goal_env:
            raise ValueError("env must observe an array: leave out goal_env, whose Dict has none")
        if observed.shape != config.observation_space.shape:
            raise ValueError(
                f"env must have observations of the shape {config.observation_space.shape}, got "
                f"{observed.shape}: put wrappers that change the shape around this one"
            )
        rods = (n, most)
        blocks = [rods] * (1 + config.with_sines + config.observe_velocities)
        if config.has_cart:
            blocks += [(1, 1)] * (1 + config.observe_velocities)
        blocks += [rods] * config.observes_goals
        if config.observe_context:
            for _, names in groupby(config.context_names, lambda name: name.split("[")[0]):
                blocks.append(rods if "[" in next(names) else (1, 1))
        self.columns: list[int] = []
        bounds: list[Any] = []
        for entries, width in blocks:
            first, column = len(bounds), len(self.columns)
            self.columns += range(first, first + entries)
            bounds += [(observed.low[column], observed.high[column])] * width
        self.mask: ObsArray = (np.arange(most) < n).astype(np.float32)
        low, high = np.array([*bounds, *[(0.0, 1.0)] * most], np.float32).T
        self.space: gym.spaces.Box = gym.spaces.Box(low, high)
        self.actions: gym.Space[Any] = acted
        self.motors: list[int] | slice = slice(None)
        if actuated is not None:
            if acted != config.action_space:
                raise ValueError(
                    f"actuated must be left out where a wrapper has changed the actions to {acted}"
                )
            self._fit_motors(config, most, actuated)

    def _fit_motors(self, config: EnvConfig, most: int, actuated: Any) -> None:
        joints = [*joints_of(actuated, most, least=0)]
        own = [joint for joint in config.joints.tolist() if joint < config.n]
        lacking = [joint for joint in own if joint not in joints]
        if lacking or not isinstance(config.action_space, gym.spaces.Box):
            raise ValueError(
                "actuated must name all joints with a motor, and be left out where actions are "
                f"discrete; got {_checks.show(joints)} for motors at {own} and "
                f"{config.action_space}"
            )
        carts = int(config.has_cart)
        self.motors = [*range(carts), *(carts + joints.index(joint) for joint in own)]
        self.actions = gym.spaces.Box(-1.0, 1.0, (carts + len(joints),), np.float32)

    def chosen(self, action: Any) -> Any:
        """Return the entries of actions, (..., joints), that have a motor."""
        if not self.actions.shape:
            return action
        given = np.asarray(action)
        if given.shape[-1:] != self.actions.shape:
            raise ValueError(
                f"action must have {self.actions.shape[0]} entries, one for each of the joints in "
                f"actuated, got the shape {given.shape}"
            )
        return given[..., self.motors]

    def padded(self, observation: Any) -> ObsArray:
        """Return observations, (..., k), in the space for `n_max` rods."""
        out = np.zeros((*np.shape(observation)[:-1], *self.space.shape), np.float32)
        out[..., self.columns] = observation
        out[..., out.shape[-1] - self.mask.size :] = self.mask
        return out


class PadRods(gym.Wrapper[Any, Any, Any, Any], gym.utils.RecordConstructorArgs):
    """Gives an environment the spaces of a chain of `n_max` rods, so that one network fits many n.

    Each group of entries of an observation has `n_max` entries, 0 beyond the last rod. A mask
    follows: 1 for each rod that the chain has, 0 for the others.

    Parameters
    ----------
    env : gymnasium.Env
        An environment of this package, or a wrapper of it.
    n_max : int
        Number of rods of the longest chain.
    actuated : sequence of int, optional
        Joints that have an entry in the action, in this order, after the force on a cart. Those
        without a motor are ignored. By default the action is that of the environment.

    Raises
    ------
    TypeError, ValueError
        If an argument breaks its rule.

    Examples
    --------
    >>> import gymnasium as gym
    >>> import npend_gym
    >>> from npend_gym.envs import PadRods
    >>> env = PadRods(gym.make("npend/Balance-v1", n=1), n_max=2)
    >>> env.reset(seed=0)[0].round(3)  # two sines, two cosines, two velocities, the mask
    array([ 0.02 ,  0.   , -1.   ,  0.   , -0.002,  0.   ,  1.   ,  0.   ],
          dtype=float32)
    """

    def __init__(
        self, env: gym.Env[Any, Any], n_max: int, *, actuated: Sequence[int] | None = None
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, n_max=n_max, actuated=actuated)
        gym.Wrapper.__init__(self, env)
        self._padding = Padding(
            config_below("PadRods", env), n_max, actuated, env.observation_space, env.action_space
        )
        self.observation_space = self._padding.space
        self.action_space = self._padding.actions

    def reset(self, **keywords: Any) -> tuple[ObsArray, dict[str, Any]]:
        """Begin an episode, as the environment does."""
        observation, info = self.env.reset(**keywords)
        return self._padding.padded(observation), info

    def step(self, action: Any) -> tuple[ObsArray, Any, bool, bool, dict[str, Any]]:
        """Take a step with the entries of the action that have a motor."""
        observation, *outcome = self.env.step(self._padding.chosen(action))
        return self._padding.padded(observation), *outcome  # type: ignore[return-value]


# Gymnasium 1.1 knows no types of vector wrappers
class VectorPadRods(VectorActionWrapper, VectorObservationWrapper):  # pyright: ignore[reportMissingTypeArgument]
    """`PadRods` for a native vector environment; `evaluate` applies it too.

    Parameters
    ----------
    env : gymnasium.vector.VectorEnv
        A native vector environment of this package, or a wrapper of it.
    n_max, actuated
        As for `PadRods`.

    Raises
    ------
    TypeError, ValueError
        If an argument breaks its rule.

    Examples
    --------
    >>> import gymnasium as gym
    >>> import npend_gym
    >>> from npend_gym.envs import VectorPadRods
    >>> envs = VectorPadRods(gym.make_vec("npend/Balance-v1", num_envs=8, n=3), n_max=4)
    >>> envs.reset(seed=0)[0].shape
    (8, 16)
    """

    def __init__(self, env: Any, n_max: int, *, actuated: Sequence[int] | None = None) -> None:
        VectorWrapper.__init__(self, env)  # that of observation wrappers refuses SAME_STEP
        self._padding = Padding(
            config_below("VectorPadRods", env), n_max, actuated, env.single_observation_space,
            env.single_action_space,
        )  # fmt: skip
        self.single_observation_space = self._padding.space
        self.single_action_space = self._padding.actions
        self.observation_space = batch_space(self._padding.space, self.num_envs)
        self.action_space = batch_space(self._padding.actions, self.num_envs)

    def observations(self, observations: Any) -> ObsArray:
        """Return observations of sub-environments, (B, k), padded."""
        return self._padding.padded(observations)

    def actions(self, actions: Any) -> Any:
        """Return the entries of actions that have a motor, (B, joints)."""
        return self._padding.chosen(actions)

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[ObsArray, dict[str, Any]]:
        """Begin episodes, as the environment does."""
        observations, info = self.env.reset(seed=seed, options=options)
        return self.observations(observations), info

    def step(self, actions: Any) -> Any:
        """Take a step; last observations of episodes are padded too."""
        observations, *outcome, info = self.env.step(self.actions(actions))
        if "final_obs" in info:
            last: NDArray[Any] = info["final_obs"].copy()
            for k in np.flatnonzero(info["_final_obs"]):
                last[k] = self._padding.padded(last[k])
            info["final_obs"] = last
        return self.observations(observations), *outcome, info
