"""What the files of other programs say of a policy or a controller."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from npend_gym._version import __version__
from npend_gym.chain import plain_keywords
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.keywords import DEFAULTS
from npend_gym.rl.controllers.planning import PlannedTransition
from npend_gym.rl.controllers.regulators import StateFeedback
from npend_gym.rl.evaluation.settings import keywords_of
from npend_gym.rl.policies.policy import Policy

Feedback: TypeAlias = StateFeedback | PlannedTransition


def described(model: Policy | Feedback) -> dict[str, Any]:
    """Return plain values by name: the version, the environment, and what made the model.

    The environment of a controller has the keywords that are not the defaults.
    """
    if isinstance(model, Policy):
        config = model.config if model.env else None
        env, made = model.env, model.provenance
    else:
        config = config_of(model)
        mine = {k: value for k, value in keywords_of(config).items() if value != DEFAULTS[k]}
        env = mine | {"mode": config.mode.name}
        made = _made_by(model)
    return {
        "npend_gym": __version__,
        "env": plain_keywords(env),
        "dt": None if config is None else config.dt,
        "action_limits": None if config is None else config.action_limits.tolist(),
        "provenance": made,
    }


def config_of(controller: Feedback) -> EnvConfig:
    """Return the settings of the environment of a controller."""
    held = controller.hold_goal if isinstance(controller, PlannedTransition) else controller
    return held.config


def _made_by(controller: Feedback) -> dict[str, Any]:
    """Return what a controller is, as the provenance of a policy says how it was trained."""
    if isinstance(controller, StateFeedback):
        return {"controller": "state feedback", "angle": np.asarray(controller.angle).tolist()}
    seconds = len(controller.gains) * config_of(controller).dt
    return {"controller": "planned transition", "seconds": seconds, "settle": controller.settle}
