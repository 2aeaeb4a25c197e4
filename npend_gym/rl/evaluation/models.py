"""Trained models of Stable-Baselines3 as controllers: what they observe, and what they remember."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from gymnasium.vector import VectorActionWrapper, VectorObservationWrapper
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import BoolArray
from npend_gym.envs.config import EnvConfig
from npend_gym.rl.evaluation.rollouts import Controller

_OF_ONE_ENV = gym.ObservationWrapper, gym.ActionWrapper
_CHANGING: Any = (*_OF_ONE_ENV, VectorObservationWrapper, VectorActionWrapper)
_ROUNDING = 1e-3  # more than that of a sine and a cosine in float32
_WAY_OUT = "or give a function: controller(observation, info) returns the actions"


class Model(Protocol):
    """A trained model of Stable-Baselines3, or of a library with the same method."""

    def predict(self, observation: Any, *, deterministic: bool) -> tuple[NDArray[Any], Any]:
        """Return the actions, and the state of a recurrent model.

        A recurrent model also takes `state`, what it returned before, and `episode_start`, a bool
        for each environment.
        """
        ...


def as_controller(controller: Controller | Model, config: EnvConfig) -> Controller:
    """Return a controller as it is, and a model of Stable-Baselines3 as a `ModelController`.

    `config` is that of the environment in which it is to act.

    Raises
    ------
    TypeError
        If it is neither.
    ValueError
        If the observations of the model's training are not known.
    """
    if callable(controller):
        return controller
    if not hasattr(controller, "predict"):
        raise TypeError(
            "controller must be callable as controller(observation, info), or a model with the "
            f"method predict of Stable-Baselines3; got {_checks.show(controller)}"
        )
    return ModelController(controller, config)


class ModelController:
    """The deterministic actions of a model of Stable-Baselines3.

    Observations are normalised by the statistics of the model's `VecNormalize` environment. A
    recurrent model keeps its state, and starts from a new one where ``info["time"]`` is 0.

    Parameters
    ----------
    model : Model
    config : EnvConfig
        Of the environment.

    Raises
    ------
    ValueError
        If the model was trained on observations that were changed in a way that is not known here.
    """

    def __init__(self, model: Model, config: EnvConfig) -> None:
        self._predict: Any = model.predict
        self._statistics = _statistics(model, config)
        self._is_recurrent = "state" in inspect.signature(self._predict).parameters
        self._state: Any = None

    def reset(self, num_envs: int | None = None) -> None:
        """Forget the state of a recurrent model; `num_envs` changes nothing."""
        del num_envs
        self._state = None

    def __call__(self, observation: Any, info: dict[str, Any]) -> NDArray[Any]:
        """Return the actions."""
        if self._statistics is not None:
            observation = self._statistics.normalize_obs(observation)
        if not self._is_recurrent:
            return self._predict(observation, deterministic=True)[0]
        begins: BoolArray = np.asarray(info["time"]) == 0.0
        state = None if begins.all() else self._state
        action, self._state = self._predict(
            observation, state=state, episode_start=np.atleast_1d(begins), deterministic=True
        )
        return action


def _statistics(model: Any, config: EnvConfig) -> Any:
    """Return the VecNormalize by which a model's observations are normalised, None without any."""
    find = getattr(model, "get_vec_normalize_env", None)
    if find is None:
        return None
    statistics, env = find(), model.get_env()
    changing = None if env is None else _changing(env)
    if changing is not None:
        raise ValueError(
            f"the model's environment must show what this one shows, but its wrapper {changing} "
            "changes observations or actions in a way that is not known here: train with "
            f"VecNormalize instead, {_WAY_OUT}"
        )
    if (statistics is None and _saw_normalised(model, config)) or _are_new(statistics, model):
        raise ValueError(
            "the model must have the statistics of its observations, because it was trained with "
            "VecNormalize: load it with them, "
            f"{type(model).__name__}.load(path, env=VecNormalize.load(path_of_statistics, venv)), "
            f"{_WAY_OUT}"
        )
    return statistics


def _changing(env: Any) -> str | None:
    """Return the name of a wrapper that changes observations or actions, None without any."""
    for layer in _layers(env):
        if isinstance(layer, _CHANGING):
            return type(layer).__name__
    for kind in _OF_ONE_ENV:  # asks environments in other processes too
        if any(env.env_is_wrapped(kind)):
            return kind.__name__
    return None


def _layers(env: Any) -> Iterator[Any]:
    """Yield an environment and what it wraps; of many environments side by side the first."""
    while env is not None:
        yield env
        inner = (getattr(env, name, None) for name in ("venv", "env"))
        env = next((each for each in inner if each is not None), None) or next(
            iter(getattr(env, "envs", ())), None
        )


def _are_new(statistics: Any, model: Any) -> bool:
    """Return whether the statistics of a trained model are of no observation at all."""
    if statistics is None or not statistics.norm_obs or model.num_timesteps == 0:
        return False
    kept, keys = statistics.obs_rms, statistics.norm_obs_keys  # keys of a Dict, else None
    return any(part.count < 1.0 for part in ([kept] if keys is None else map(kept.get, keys)))


def _saw_normalised(model: Any, config: EnvConfig) -> bool:
    """Return whether a model tells that its last training had a VecNormalize, which is missing.

    Stable-Baselines3 keeps the last observation before its normalisation. Off-policy algorithms
    keep one without a VecNormalize too. There the last observation itself tells, where it is one
    that no environment shows: beyond its bounds, or a sine and a cosine of no angle.
    """
    original = getattr(model, "_last_original_obs", None)
    last: Any = getattr(model, "_last_obs", None)
    if original is None or not hasattr(model, "replay_buffer"):
        return original is not None
    space, n = model.observation_space, config.n
    if np.shape(last)[1:] != (config.observed,):  # none, or of a goal_env
        return False
    if config.with_sines:
        radius = np.hypot(last[:, :n], last[:, n : 2 * n])
        return bool(np.any(np.abs(radius - 1.0) > _ROUNDING))
    return bool(np.any((last < space.low) | (last > space.high)))
