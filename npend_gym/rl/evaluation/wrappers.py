"""What the wrappers of an environment do between it and a model, for any number of environments.

An evaluation makes environments of its own, with other errors and as many environments as it needs.
What wraps the environment of a user is therefore applied here, in front of the model:
`VecNormalize` and `VecFrameStack` of Stable-Baselines3, and the wrappers of Gymnasium's vector
environments.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import VectorActionWrapper, VectorObservationWrapper, VectorWrapper
from gymnasium.vector.utils import create_empty_array
from numpy.typing import NDArray

from npend_gym._checks import BoolArray
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.goals import of_lane
from npend_gym.envs.inputs import env_actions
from npend_gym.rl.evaluation.rollouts import Controller, forget

WAY_OUT = "or give a function: model(observation, info) returns the actions"
# Wrappers of single environments whose `step` changes neither observations nor actions
_HARMLESS = {
    "Autoreset", "ClipReward", "Curriculum", "HumanRendering", "Monitor", "NormalizeReward",
    "OrderEnforcing", "PassiveEnvChecker", "RecordEpisodeStatistics", "RecordVideo",
    "RenderCollection", "RewardWrapper", "TimeLimit", "TransformReward", "Wrapper",
}  # fmt: skip
# The same of vector environments, and those whose changes of observations or actions are known
_KNOWN = {
    "DictInfoToList", "HumanRendering", "NormalizeObservation", "NormalizeReward",
    "RecordEpisodeStatistics", "RecordVideo", "VecCheckNan", "VecEnv", "VecEnvWrapper",
    "VecFrameStack", "VecMonitor", "VecNormalize", "VecVideoRecorder", "VectorActionWrapper",
    "VectorCurriculum", "VectorObservationWrapper", "VectorPadRods", "VectorRewardWrapper",
    "VectorWrapper",
    "VectorizeTransformObservation",
}  # fmt: skip
_STEPPING = "step", "step_async", "step_wait", "reset"
_WRAPPERS: Any = gym.Wrapper, VectorWrapper
_OF_MANY: Any = VectorObservationWrapper, VectorActionWrapper
_Change = Callable[[Any, BoolArray], Any]


def layers_of(env: Any) -> Iterator[Any]:
    """Yield an environment and what it wraps; of many environments side by side the first."""
    while env is not None:
        yield env
        inner = (getattr(env, name, None) for name in ("venv", "env"))
        env = next((each for each in inner if each is not None), None) or next(
            iter(getattr(env, "envs", None) or ()), None
        )


def changing_wrappers(env: Any) -> tuple[Any, ...]:
    """Return the wrappers that change observations or actions, the innermost first.

    It refuses what changes them in a way that is not known here.
    """
    found: list[Any] = []
    layer: Any = None
    for layer in layers_of(env):
        if _changes_step(layer):
            raise _unknown(type(layer).__name__)
        if is_normalizing(layer) or _is_stacking(layer) or isinstance(layer, _OF_MANY):
            found.insert(0, layer)
        elif _has_other_spaces(layer):
            raise _unknown(type(layer).__name__)
    _check_class(layer)
    for name in _in_other_processes(layer):
        if name not in _HARMLESS:
            raise _unknown(name)
    return tuple(found)


def _check_class(base: Any) -> None:
    """Raise a ValueError where a subclass steps otherwise than what its `env_id` makes."""
    kinds: list[type] = type(base).mro()
    owner = {
        name: next((kind for kind in kinds if name in vars(kind)), object)
        for name in ("env_id", "step", "reset")
    }
    is_ours = {name: kind.__module__.startswith("npend_gym.") for name, kind in owner.items()}
    for name in ("step", "reset"):
        if is_ours["env_id"] and not is_ours[name]:
            raise ValueError(
                f"env must not be of the class {owner[name].__name__}, whose {name} is its own: "
                "register an id with this class as vector_entry_point, and give the id"
            )


def _changes_step(layer: Any) -> bool:
    """Return whether a wrapper has a `step` or `reset` that is not known."""
    kinds = {kind.__name__: vars(kind) for kind in type(layer).__mro__}
    if not (isinstance(layer, _WRAPPERS) or "VecEnvWrapper" in kinds):
        return False
    known = _HARMLESS if isinstance(layer, gym.Wrapper) else _KNOWN
    owners = (next((kind for kind in kinds if name in kinds[kind]), None) for name in _STEPPING)
    return any(owner not in known for owner in owners if owner is not None)


def _in_other_processes(base: Any) -> list[str]:
    """Return the names of the wrappers of an environment in another process, as it prints them."""
    if not hasattr(base, "get_attr"):  # the sub-environments of a native one are no environments
        return []
    call = getattr(base, "call", None) or base.env_method
    return re.findall(r"<(\w+)(?=<\w+[< ])", call("__str__")[0])


def is_normalizing(layer: Any) -> bool:
    """Return whether a wrapper is a VecNormalize of Stable-Baselines3."""
    return hasattr(layer.__class__, "normalize_obs")  # itself it has what it wraps, too


def _is_stacking(layer: Any) -> bool:
    """Return whether a wrapper is a VecFrameStack of Stable-Baselines3."""
    return "stacked_obs" in vars(layer) and not isinstance(layer, gym.Wrapper)


def _has_other_spaces(layer: Any) -> bool:
    """Return whether a wrapper changes a space, in a way that is not known."""
    name = "env" if isinstance(layer, _WRAPPERS) else "venv"
    inner: Any = getattr(layer, name, None)
    if inner is None or not (isinstance(layer, _WRAPPERS) or hasattr(inner, "venv")):
        return False
    spaces = "observation_space", "action_space"
    return any(getattr(layer, name) != getattr(inner, name) for name in spaces)


def _unknown(wrapper: str) -> ValueError:
    return ValueError(
        f"the environment's wrapper {wrapper} changes observations or actions in a way that is not "
        "known here: use VecNormalize, VecFrameStack or a wrapper of gymnasium.wrappers.vector "
        f"instead, {WAY_OUT}"
    )


class Nearest:
    """A `Policy` with continuous actions where actions are discrete: it takes the nearest."""

    def __init__(self, policy: Controller, config: EnvConfig) -> None:
        self._policy, self._config = policy, config

    def reset(self, num_envs: int) -> None:
        """Let the policy forget."""
        forget(self._policy, num_envs)

    def __call__(self, observation: Any, info: dict[str, Any]) -> NDArray[Any]:
        """Return the numbers of the actions."""
        actions = np.asarray(self._policy(observation, info), np.float64)
        return env_actions(self._config, actions)


class Behind:
    """A controller behind the wrappers of an environment, in any number of sub-environments.

    The wrappers are from `changing_wrappers`, and are not changed.
    """

    def __init__(self, controller: Controller, wrappers: Sequence[Any]) -> None:
        self._controller, self._wrappers, self._lanes = controller, wrappers, 0
        self._observing: list[_Change] = []
        self._acting: list[Callable[[Any], Any]] = []

    def reset(self, num_envs: int) -> None:
        """Let the controller forget."""
        forget(self._controller, num_envs)

    def __call__(self, observation: Any, info: dict[str, Any]) -> NDArray[Any]:
        """Return the actions of the environment that is wrapped."""
        begins = np.atleast_1d(info["time"]) == 0.0
        if begins.all() or begins.size != self._lanes:
            self._lanes = begins.size
            self._observing = [_observing(w, begins.size) for w in self._wrappers]
            self._acting = [_acting(w, begins.size) for w in self._wrappers[::-1]]
        shown = copy.copy(observation)  # a wrapper may write into what it is given
        for change in self._observing:
            shown = change(shown, begins)
        action = self._controller(shown, info)
        for change in self._acting:
            action = change(action)
        return action


def _observing(wrapper: Any, lanes: int) -> _Change:
    """Change that a wrapper makes to observations."""
    if is_normalizing(wrapper):
        return lambda shown, _: wrapper.normalize_obs(shown)
    if _is_stacking(wrapper):
        stack = _stack_for(wrapper.stacked_obs, lanes)

        def stacked(shown: Any, begins: BoolArray) -> Any:
            if begins.all():
                return stack.reset(shown)
            last = [{"terminal_observation": of_lane(shown, k)} for k in range(lanes)]
            return stack.update(shown, begins, last)[0]

        return stacked
    if isinstance(wrapper, VectorObservationWrapper):
        own = _for_lanes(wrapper, wrapper.single_observation_space, lanes)
        own.update_running_mean = False  # of NormalizeObservation
        return lambda shown, _: own.observations(shown)
    return lambda shown, _: shown


def _stack_for(kept: Any, lanes: int) -> Any:
    """Return a copy of the frames of a VecFrameStack, for another number of sub-environments."""
    own = copy.copy(kept)
    if hasattr(kept, "stacked_obs"):
        own.stacked_obs = np.zeros((lanes, *kept.stacked_shape), kept.stacked_obs.dtype)
    else:  # of a Dict
        parts = kept.sub_stacked_observations.items()
        own.sub_stacked_observations = {key: _stack_for(part, lanes) for key, part in parts}
    return own


def _acting(wrapper: Any, lanes: int) -> Callable[[Any], Any]:
    """Change that a wrapper makes to actions."""
    if isinstance(wrapper, VectorActionWrapper):
        return _for_lanes(wrapper, wrapper.env.single_action_space, lanes).actions
    return lambda action: action


def _for_lanes(wrapper: Any, space: Any, lanes: int) -> Any:
    """Return a copy of a wrapper of Gymnasium, for another number of sub-environments."""
    own = copy.copy(wrapper)
    if hasattr(own, "out"):  # where it puts what it makes of each sub-environment
        own.out = create_empty_array(space, lanes)
    return own
