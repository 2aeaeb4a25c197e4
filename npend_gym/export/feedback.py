"""Linear feedback as a policy: a network that computes it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from npend_gym import _checks
from npend_gym.envs.config import EnvConfig
from npend_gym.export.about import described
from npend_gym.rl.angles import wrap
from npend_gym.rl.controllers.feedback import StateFeedback
from npend_gym.rl.evaluation.settings import env_of, keywords_of
from npend_gym.rl.policies.policy import Policy

_TURNS_OVER = 1e-3  # rad, within which the deviation of an angle goes from -pi to pi


def policy_of(controller: StateFeedback) -> Policy:
    """Return the policy that acts as linear feedback does, for files of policies, ONNX and PyTorch.

    Parameters
    ----------
    controller : StateFeedback
        What `npend_gym.rl.lqr`, `modal_damping` and `state_feedback` return.

    Returns
    -------
    Policy
        It observes "angles" in the environment of the controller.

    Raises
    ------
    TypeError
        If it is no linear feedback.
    ValueError
        If the actions are discrete (`torque_levels`), or attributes of the mode were changed.

    Notes
    -----
    The network is float32, and has three hidden layers. They wrap the deviations of angles and
    pass on all other numbers, so that actions are those of the controller but for rounding. Only
    where an angle is opposite to its target does the network differ, within 0.001 rad: there the
    deviation goes from -pi to pi.

    Examples
    --------
    >>> from npend_gym.envs import EnvConfig
    >>> from npend_gym.export import policy_of
    >>> from npend_gym.rl import evaluate, lqr
    >>> policy = policy_of(lqr(EnvConfig(n=2, mode="balance")))
    >>> policy.save("balance.safetensors")
    >>> evaluate(policy, policy.env, episodes=2).success.tolist()
    [True, True]
    """
    if not isinstance(controller, StateFeedback):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise TypeError(
            "controller must be what rl.lqr, modal_damping or state_feedback returns, got "
            f"{_checks.show(controller)}; to_c writes plans as well"
        )
    given = controller.config
    if given.torque_levels is not None:
        raise ValueError(
            "torque_levels must be left out: the actions of a policy are not discrete; got "
            f"{given.torque_levels}"
        )
    shown: dict[str, Any] = {"observation": "angles", "observe_velocities": True}
    shown |= {"observe_context": False, "goal_env": False}
    config = EnvConfig(**keywords_of(given) | shown)
    n, size = config.n, config.state_size
    # which entry of an observation shows an entry of the state (q, u), and the unit of it
    entries, units = [*range(n), *range(n, 2 * n)], np.ones(size)
    if config.rail is not None:
        entries = [*range(n), 2 * n, *range(n, 2 * n), 2 * n + 1]
        units[[n, size - 1]] = config.rail, 1.0 / config.cart_speed_factor
    rest = controller.rest / units
    rest[:n] = wrap(rest[:n])
    both = np.array([[1.0], [-1.0]])  # x is relu(x) - relu(-x)
    rectified, joined = np.kron(np.eye(size), both), np.kron(np.eye(size), both.T)
    seen = np.eye(config.observed)[entries]
    # the angle at which a deviation goes from -pi to pi; below it a turn is added
    opposite = np.where(rest[:n] < 0.0, rest[:n] + math.pi, rest[:n] - math.pi)
    turn = np.where(rest[:n] == 0.0, 0.0, 2.0 * math.pi)
    below = np.vstack([rectified @ seen, -seen[:n] / _TURNS_OVER])
    weights, biases = [below], [np.concatenate([np.zeros(2 * size), opposite / _TURNS_OVER])]
    weights.append(np.diag(np.concatenate([np.ones(2 * size), -np.ones(n)])))
    biases.append(np.concatenate([np.zeros(2 * size), np.ones(n)]))  # above: 1, else 0
    away = np.hstack([joined, np.vstack([-np.diag(turn), np.zeros((size - n, n))])])
    shift = -rest
    shift[:n] += turn - np.where(rest[:n] < 0.0, 2.0 * math.pi, 0.0)
    weights.append(rectified @ away)
    biases.append(rectified @ shift)
    weights.append(-(controller.gain * units) @ joined)
    biases.append(np.zeros(len(controller.gain)))
    return Policy(
        np.ones(config.observed, np.float32),
        [weight.astype(np.float32) for weight in weights],
        [bias.astype(np.float32) for bias in biases],
        env_of(config),
        described(controller)["provenance"],
        activation="relu",
    )
