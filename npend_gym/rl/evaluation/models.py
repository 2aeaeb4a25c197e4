"""Models as controllers: what they observe, and what they remember."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any, Protocol, cast

import numpy as np
from gymnasium.spaces import Box, Discrete
from gymnasium.vector import VectorActionWrapper
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym.envs.config import EnvConfig
from npend_gym.rl.evaluation.normalisation import check_statistics, trained_through
from npend_gym.rl.evaluation.rollouts import Controller, Observer
from npend_gym.rl.evaluation.wrappers import (
    Behind,
    Nearest,
    is_normalizing,
    layers_of,
)

_OF_PREDICT = ("state", "episode_start", "deterministic")


class Model(Protocol):
    """A trained model of Stable-Baselines3, or anything else with its method `predict`."""

    predict: Any
    """``predict(observation, state=None, episode_start=None, deterministic=True)`` returns the
    actions and the state of a recurrent model, or the actions alone. Only those of the last three
    arguments are given that it has."""


def as_controller(
    model: Controller | Model,
    config: EnvConfig,
    wrappers: Sequence[Any] = (),
    *,
    deterministic: bool = True,
    observes: bool = False,
) -> Controller:
    """A model for an environment of these settings that acts as `model` does behind its wrappers.

    Without wrappers of the environment, the model observes through those of its own training.
    Where the environment does not show the exact state, or the model `observes` it in any case, it
    is given the state as observed.

    Parameters
    ----------
    model : Controller or Model
    config : EnvConfig
    wrappers : sequence
        Wrappers of the environment that change observations or actions.
    deterministic : bool
        Whether a model that draws its actions takes their mean.
    observes : bool

    Returns
    -------
    Controller

    Raises
    ------
    TypeError, ValueError
        If the model has other observations or actions than the environment.

    Examples
    --------
    >>> from npend_gym import rl
    >>> policy = rl.Policy.pretrained("balance-1")
    >>> config = rl.setting_of(policy.env).config
    >>> rl.as_controller(policy, config) is policy
    True
    """
    controller = _behind(model, config, wrappers, deterministic=deterministic)
    return Observer(controller, config) if observes or not config.shows_state else controller


def _behind(
    model: Controller | Model, config: EnvConfig, wrappers: Sequence[Any], *, deterministic: bool
) -> Controller:
    """Return a model as what is called with an observation and an info."""
    if not wrappers:
        _check_observation(model, config)
    if not hasattr(model, "predict"):
        if not deterministic:
            raise _not_random(model)
        acting = Network(model) if _is_network(model) else model
        if config.torque_levels is not None and isinstance(getattr(model, "env", None), Mapping):
            acting = Nearest(cast("Controller", model), config)
        if not (callable(acting) and _takes(acting, 2)):
            named = ": Policy.pretrained or Policy.load reads one" if isinstance(model, str) else ""
            raise TypeError(
                "model must be callable as model(observation, info), be a module of PyTorch from "
                "observations to actions, or have the method predict of Stable-Baselines3; got "
                f"{_checks.show(model)}{named}"
            )
        return Behind(acting, wrappers) if wrappers else acting
    if wrappers:
        _check_shape(_observed_by(model), _observed_by(wrappers[-1]))
    elif getattr(model, "get_env", None) is not None:
        wrappers = trained_through(model, config)
        check_space(model, config, wrappers)
    check_statistics(model, wrappers)
    return Behind(Predicting(model, deterministic=deterministic), wrappers)


def _takes(model: Any, count: int) -> bool:
    """Return whether a model can be called with that many arguments."""
    try:
        inspect.signature(model).bind(*[None] * count)
    except TypeError:
        return False
    except ValueError:  # compiled, without a signature
        pass
    return True


def _check_observation(model: Any, config: EnvConfig) -> None:
    """Raise an error if a `Policy` was trained with another `observation` or other motors.

    The numbers of entries and of actions are often the same.
    """
    env = getattr(model, "env", None)
    keywords = cast("Mapping[str, Any]", env if isinstance(env, Mapping) else {})
    trained = keywords.get("observation")
    if trained not in (None, config.observation):
        raise ValueError(
            f"observation must be {trained!r}, on which the policy was trained, got "
            f'{config.observation!r}: give the policy\'s keywords, policy.env | {{"id": ...}}'
        )
    own: Any = getattr(model, "config", None) if keywords else None
    if isinstance(own, EnvConfig) and (own.n, own.has_cart) == (config.n, config.has_cart):
        motors, others = (c.joints[c.joints < c.n].tolist() for c in (own, config))
        if motors != others:
            raise ValueError(
                f"actuated must be {tuple(motors)}, with which the policy was trained, got "
                f"{tuple(others)}: give the policy's keywords, policy.env | {{...}}"
            )


def check_space(model: Any, config: EnvConfig, wrappers: Sequence[Any] = ()) -> None:
    """Raise an error if a model was trained on other numbers, or on as many with other bounds.

    The `wrappers` of its training stood around the environment that showed them.
    """
    inner = [_observed_by(each) for each in layers_of(next(iter(wrappers), None))][1:]
    trained = next((space for space in inner if space is not None), _observed_by(model))
    shown, acting = config.observation_space, getattr(model, "action_space", None)
    if not any(isinstance(each, VectorActionWrapper) for each in wrappers):
        _check_actions(acting, config)
    _check_shape(trained, shown)
    both = isinstance(trained, Box) and isinstance(shown, Box)
    if both and all(map(is_normalizing, wrappers)) and trained != shown:
        raise ValueError(
            f"observation must be as in the model's training, {trained}, got "
            f"{config.observation!r}, {shown}"
        )


def _check_actions(trained: Any, config: EnvConfig) -> None:
    """Raise an error if the actions of a model are others: torques, or numbers of torques."""
    taken = config.action_space
    discrete = isinstance(trained, Discrete), isinstance(taken, Discrete)
    if discrete == (True, True) and trained == taken:
        return
    if True in discrete and isinstance(trained, (Box, Discrete)):
        raise ValueError(
            f"torque_levels must be as in the model's training, with actions {trained}, got "
            f"{config.torque_levels}, with actions {taken}"
        )
    if isinstance(trained, Box) and trained.shape != taken.shape:
        raise ValueError(
            f"actuated must have as many motors as in the model's training, {trained.shape[0]}, "
            f"got {config.joints.tolist()}"
        )


def _check_shape(trained: Any, shown: Any) -> None:
    """Raise an error if an environment shows a model more or fewer numbers than its training."""
    if isinstance(trained, Box) and isinstance(shown, Box) and trained.shape != shown.shape:
        raise ValueError(
            f"env must show observations of the shape {trained.shape}, on which the model was "
            f"trained, got {shown.shape}: give the environment of its training, model.get_env(), "
            'or the keywords of that, such as {"id": ..., "n": 1}'
        )


def _observed_by(env: Any) -> Any:
    """Return the space of the observations of a model, or of one environment of an environment."""
    single = getattr(env, "single_observation_space", None)
    return getattr(env, "observation_space", None) if single is None else single


def _not_random(model: Any) -> ValueError:
    return ValueError(
        "deterministic must be True for a model without a method predict that takes it, such as "
        f"a Policy, a controller or a function; got False for {_checks.show(model)}: let a "
        "function draw the actions"
    )


def _is_network(model: Any) -> bool:
    """Return whether a model is a module of PyTorch that takes observations alone."""
    forward = getattr(model, "forward", None)
    if forward is None or not hasattr(model, "named_modules") or not _takes(forward, 1):
        return False
    return "info" not in inspect.signature(forward).parameters


class Network:
    """A module of PyTorch, from observations to actions, as a controller.

    It acts as in evaluation, without dropout say, and is left as it was. A module of TensorDict,
    such as an actor of TorchRL, takes its "action", the most likely one where it draws.
    """

    def __init__(self, module: Any) -> None:
        self._module = module

    def __call__(self, observation: Any, info: dict[str, Any]) -> NDArray[Any]:
        """Return the actions."""
        import torch

        del info
        module, like = self._module, next(self._module.parameters(), torch.zeros(()))
        training = [each for each in module.modules() if each.training]
        try:
            for each in training:
                each.training = False
            with torch.no_grad(), _most_likely(module):
                found: Any = module(torch.as_tensor(observation).to(like))
        except (RuntimeError, AssertionError) as error:  # that of a program with one batch size
            raise ValueError(
                "model must take observations of the environment, of the shape "
                f"{np.shape(observation)}, got an error from the module: {error}. Give the "
                'keywords of its training, such as {"id": ..., "n": 1}; a program must take any '
                "number of observations"
            ) from error
        finally:
            for each in training:
                each.training = True
        keys: list[Any] = list(getattr(module, "out_keys", ()))
        if "action" in keys and len(keys) > 1:
            found = found[keys.index("action")]
        if not isinstance(found, torch.Tensor):
            raise TypeError(
                "model must return a tensor of actions, got "
                f"{_checks.show(found)}: give a function, model(observation, info), that "
                "returns the actions"
            )
        return found.cpu().numpy()


def _most_likely(module: Any) -> AbstractContextManager[Any]:
    """Let a module of TensorDict take the most likely action meanwhile."""
    if not hasattr(module, "out_keys"):
        return nullcontext()
    drawing = importlib.import_module("tensordict.nn")
    return drawing.set_interaction_type(drawing.InteractionType.DETERMINISTIC)


class Predicting:
    """The actions of a model, whose state is kept from step to step.

    A recurrent model starts from a new state where ``info["time"]`` is 0.
    """

    def __init__(self, model: Any, *, deterministic: bool = True) -> None:
        self._predict = model.predict
        parameters = inspect.signature(self._predict).parameters
        anything = any(p.kind is p.VAR_KEYWORD for p in parameters.values())
        self._takes = [name for name in _OF_PREDICT if anything or name in parameters]
        if not deterministic and "deterministic" not in self._takes:
            raise _not_random(model)
        self._deterministic = deterministic
        self._state: Any = None

    def reset(self, num_envs: int) -> None:
        """Forget the state of a recurrent model."""
        del num_envs
        self._state = None

    def __call__(self, observation: Any, info: dict[str, Any]) -> NDArray[Any]:
        """Return the actions."""
        begins = np.atleast_1d(info["time"]) == 0.0
        state = None if begins.all() else self._state
        given = {"state": state, "episode_start": begins}
        given["deterministic"] = self._deterministic
        found = self._predict(observation, **{name: given[name] for name in self._takes})
        if not isinstance(found, tuple):
            return found
        action, self._state = found  # pyright: ignore[reportUnknownVariableType]
        return action  # pyright: ignore[reportUnknownVariableType]
