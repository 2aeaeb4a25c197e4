"""The environment in which a model is evaluated, however a user names it."""

from __future__ import annotations

import contextlib
import copy
import importlib
import itertools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, ParamSpec, TypeAlias, TypeVar

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode

from npend_gym import _checks
from npend_gym._threads import one_torch_thread
from npend_gym.chain import plain_keywords
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.keywords import CHAIN_KEYWORDS, EnvKeywords
from npend_gym.envs.modes import MODES
from npend_gym.envs.registration import ENV_ID, register_envs
from npend_gym.envs.values import VALUES, unfolded
from npend_gym.rl.evaluation.wrappers import changing_wrappers, layers_of

EnvLike: TypeAlias = Any  # see `npend_gym.rl.evaluate`
_P = ParamSpec("_P")
_R = TypeVar("_R")

_PUSHES = {"push_rate", "push_force"}
_MAX_STEPS = 1_000_000
_LIMIT = "_max_episode_steps"  # of gymnasium.wrappers.TimeLimit
_OF_MAKING = ("num_envs", "vectorization_mode", "autoreset_mode", "render_mode")


def evaluating(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Decorate a function that evaluates a model in an environment, by PyTorch in one thread."""
    return one_torch_thread()(function)


class EnvSetting(NamedTuple):
    """How to make an environment, and what its wrappers do between it and a model."""

    env_id: str
    keywords: dict[str, Any]  # of ``gym.make_vec(env_id, ...)``
    wrappers: tuple[Any, ...] = ()  # from `changing_wrappers`

    def make(self, num_envs: int, **changed: Any) -> Any:
        """Return a vector environment, some keywords changed."""
        register_envs()
        keywords = self.keywords | changed
        try:
            envs: Any = gym.make_vec(_registered(self.env_id), num_envs=num_envs, **keywords)
        except TypeError:
            if keywords:
                EnvSetting(self.env_id, {}).make(1).close()  # says so where it is none of ours
            raise
        if not isinstance(getattr(envs.unwrapped, "config", None), EnvConfig):
            *_, base = layers_of(envs)
            envs.close()
            if isinstance(getattr(base, "config", None), EnvConfig):
                raise ValueError(
                    f"env must be an id of many environments, got {self.env_id!r}: register it "
                    'with vector_entry_point="npend_gym:NPendulumVectorEnv"'
                )
            raise _no_setting(self.env_id)
        if envs.metadata["autoreset_mode"] is not AutoresetMode.NEXT_STEP:
            envs.close()
            raise ValueError(
                "env must be an id of environments with the autoreset mode NEXT_STEP, got "
                f"{envs.metadata['autoreset_mode']} from {self.env_id!r}"
            )
        return envs

    @property
    def reward_threshold(self) -> float | None:
        """The return that solves the task of the id; None where the keywords make another one."""
        envs = self.make(1)
        envs.close()
        return envs.unwrapped.spec.reward_threshold

    @property
    def config(self) -> EnvConfig:
        """What follows from the keywords."""
        envs = self.make(1)
        envs.close()
        return envs.unwrapped.config

    def nominal(self, seconds: float) -> tuple[EnvSetting, EnvConfig, int]:
        """Return the setting by which a score is measured, its config, and the steps of an episode.

        Nothing is drawn there by `randomize`; noise, delays and pushes that are plain keywords are
        kept. Episodes last for `seconds`.
        """
        given = self.config
        if given.observe_context:
            raise ValueError(
                "observe_context must be False, because scores try errors that no model observes"
            )
        if given.goal_env:
            raise ValueError("goal_env must be False, because models must observe one array")
        exact: dict[str, Any] = {"randomize": None}
        if not _PUSHES.isdisjoint(given.randomize or ()):  # half of a pair would be left
            exact |= dict.fromkeys(_PUSHES, 0.0)
        setting = self._replace(keywords=self.keywords | exact)
        config = setting.config
        if config.joints.size == 0:
            raise ValueError(f"mode must be one with a motor, got {config.mode.name!r}")
        steps = number_of_steps("seconds", seconds, config.dt)
        lasting = setting.keywords | {"max_episode_steps": steps}
        return setting._replace(keywords=lasting), config, steps


def setting_of(env: EnvLike) -> EnvSetting:
    """Return how to make environments like one that is given.

    Parameters
    ----------
    env : Env, VectorEnv, EnvSpec, str or dict
        As for `evaluate`: an environment, its `spec`, its id, or the keywords of "NPendulum-v0",
        among which "id" names another.

    Returns
    -------
    EnvSetting

    Raises
    ------
    TypeError, ValueError
        If it is no environment of this package.

    Examples
    --------
    >>> from npend_gym import rl
    >>> setting = rl.setting_of({"id": "npend/Balance-v1", "n": 1})
    >>> setting.config.n, setting.make(4).num_envs
    (1, 4)
    """
    if isinstance(env, str):
        return EnvSetting(env, {})
    if isinstance(env, Mapping):
        keywords: dict[str, Any] = dict(env)  # pyright: ignore[reportUnknownArgumentType]
        return EnvSetting(keywords.pop("id", ENV_ID), _without_making(keywords))
    if isinstance(env, EnvSpec):
        if env.additional_wrappers:
            raise ValueError(
                "env must be a specification without wrappers, which belong to one environment; "
                f"got {env.additional_wrappers[0].name}: give a vector environment with its own"
            )
        keywords = {"max_episode_steps": env.max_episode_steps} | env.kwargs
        return EnvSetting(env.id, _without_making(keywords))
    *_, base = [None, *layers_of(env)]
    config = _attribute(base, "config")
    if not isinstance(config, EnvConfig):
        raise _no_setting(env)
    _check_alike(env, base, config)
    steps = getattr(base, "max_episode_steps", None)  # of a vector environment of ours
    limits: list[Any] = [getattr(each, _LIMIT, None) for each in layers_of(env)]
    steps = steps or min((limit for limit in limits if limit), default=None)
    if not hasattr(base, "max_episode_steps"):
        steps = steps or getattr(_attribute(env, "spec"), "max_episode_steps", None)
    keywords = keywords_of(config) | {"max_episode_steps": steps}
    return EnvSetting(_attribute(base, "env_id") or ENV_ID, keywords, changing_wrappers(env))


def _check_alike(env: Any, base: Any, config: EnvConfig) -> None:
    """Raise a ValueError where one of the environments side by side has other settings."""
    apart = (getattr(layer, "envs", None) or () for layer in layers_of(env))
    envs = (getattr(each, "unwrapped", each) for each in itertools.chain(*apart))
    several: list[Any] = [getattr(each, "config", config) for each in envs]
    if hasattr(base, "get_attr"):  # in other processes
        several += base.get_attr("config")
    own, *others = (
        plain_keywords(keywords_of(each) | {"mode": repr(each.mode)}) for each in (config, *several)
    )
    for other in others:
        if names := [name for name, value in own.items() if value != other[name]]:
            raise ValueError(
                f"env must have sub-environments that are alike, got some that differ in {names}: "
                "evaluate in one environment of each kind"
            )


def _no_setting(env: EnvLike) -> TypeError:
    return TypeError(
        'env must be an id such as "npend/SwingUp-v1", its EnvSpec, a vector environment of '
        "N-pendulums, or a dict of keywords of gym.make_vec such as "
        f'{{"id": "npend/SwingUp-v1", "n": 1}}; got {_checks.show(env)}'
    )


def _without_making(keywords: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keywords of the environments, without those that an evaluation chooses itself."""
    return {name: value for name, value in unfolded(keywords).items() if name not in _OF_MAKING}


def _registered(env_id: str) -> str | EnvSpec:
    """Return an id, or its specification without keywords that an evaluation chooses itself."""
    module, _, name = str(env_id).rpartition(":")
    if module:
        with contextlib.suppress(ImportError):  # gym.make_vec says so
            importlib.import_module(module)
    found = gym.registry.get(name)
    if found is None or not found.kwargs.keys() & _OF_MAKING:
        return env_id
    spec = copy.copy(found)
    spec.kwargs = _without_making(found.kwargs)
    return spec


def number_of_steps(name: str, seconds: Any, dt: float) -> int:
    """Return the steps of `dt`, two or more, in a time of this name."""
    steps = _checks.positive_number(name, seconds) / dt
    if steps > _MAX_STEPS:
        raise ValueError(
            f"{name} must be at most {_MAX_STEPS * dt:g} s, which are {_MAX_STEPS} steps, "
            f"got {seconds:g}"
        )
    return max(2, round(steps))


def keywords_of(config: EnvConfig) -> dict[str, Any]:
    """Return the keywords of an environment of these settings."""
    from_others = {*CHAIN_KEYWORDS, "n", "difficulty", *VALUES}  # which other keywords hold
    return {k: getattr(config, k) for k in EnvKeywords.__annotations__ if k not in from_others}


def env_of(config: EnvConfig, *, strict: bool = True) -> dict[str, Any]:
    """Return keywords of an environment of these settings, as few as say the same, for JSON.

    If not `strict`, they are for readers only: of a mode that was changed they show the attributes,
    and a mode of your own need not be found by its name.
    """
    mode, kind = config.mode, type(config.mode)
    built_in = MODES.get(mode.name) is kind
    name = mode.name if built_in else f"{kind.__module__}:{kind.__qualname__}"
    if built_in and vars(mode) != vars(kind()):
        if strict:
            raise ValueError(
                "mode must be unchanged, because a policy stores only the name of its class; got "
                f"{mode!r}"
            )
        name = repr(mode)
    played = name if strict else mode
    uniform: dict[str, Any] = {"n": config.n, "mode": played}
    of_chain: dict[str, Any] = {"chain": config.chain, "mode": played}
    base = uniform if EnvConfig(**uniform).chain == config.chain else of_chain
    usual = plain_keywords(keywords_of(EnvConfig(**base)))
    plain = plain_keywords(keywords_of(config))
    changed = {k: v for k, v in plain.items() if v != usual[k]}
    return plain_keywords(base) | changed | {"mode": name}


def _attribute(base: Any, name: str) -> Any:
    """Return an attribute of an environment, or of the first of many side by side."""
    if hasattr(base, "get_attr"):
        return base.get_attr(name)[0]
    return getattr(base, name, None)
