"""What the files of other programs say of a policy or a controller."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from npend_gym._version import __version__
from npend_gym.chain import plain_keywords
from npend_gym.rl.controllers.feedback import StateFeedback
from npend_gym.rl.controllers.tracking import PlannedTransition
from npend_gym.rl.evaluation.settings import env_of
from npend_gym.rl.policies.policy import Policy

Feedback: TypeAlias = StateFeedback | PlannedTransition


def described(model: Policy | Feedback) -> dict[str, Any]:
    """Return plain values by name: the version, the environment, and what made the model."""
    if isinstance(model, Policy):
        config = model.config if model.env else None
        env, made = model.env, model.provenance
    else:
        config = model.config
        env, made = env_of(config, strict=False), _made_by(model)
    return {
        "npend_gym": __version__,
        "env": plain_keywords(env),
        "dt": None if config is None else config.dt,
        "action_limits": None if config is None else config.action_limits.tolist(),
        "provenance": made,
    }


def _made_by(controller: Feedback) -> dict[str, Any]:
    """Description of a controller, as the provenance of a policy says how it was trained."""
    if isinstance(controller, StateFeedback):
        about = {"controller": "state feedback", "angle": np.asarray(controller.angle).tolist()}
        on_cart = controller.config.has_cart
        return about | ({"cart_position": controller.cart_position} if on_cart else {})
    seconds = len(controller.gains) * controller.config.dt
    return {"controller": "planned transition", "seconds": seconds, "settle": controller.settle}
