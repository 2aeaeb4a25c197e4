"""The plan that teaches: one that is found, or the way of a policy."""

from __future__ import annotations

from typing import Any

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.envs import EnvConfig
from npend_gym.rl.controllers.planning import PlannedTransition, planned_swing_up, track
from npend_gym.rl.controllers.step_model import StepModel
from npend_gym.rl.controllers.transcription import NominalTrajectory
from npend_gym.rl.policies.policy import Policy

_START, _STANDS = 1e-9, 0.01  # rad and rad/s from hanging and from standing


def base_plan(settings: Any, config: EnvConfig) -> PlannedTransition:
    """Return the plan for the chain without errors, as settings of `robust_imitation` say."""
    if settings.demonstrator:
        return plan_of(Policy.pretrained(settings.demonstrator), config, settings.seconds)
    options: dict[str, Any] = {"tries": 1, "guess": "mpc", "seed": settings.plan_seed}
    return planned_swing_up(config, settings.seconds, **options)


def plan_of(policy: Policy, config: EnvConfig, seconds: float) -> PlannedTransition:
    """Return the swing-up of a policy without memory, from hanging nearly at rest, as a plan.

    That a network can follow it is then known already.

    Raises
    ------
    ValueError
        If the chain does not stand after so many seconds.
    """
    n, step = config.n, StepModel(config)
    motion, actions = [np.full((1, 2 * n), _START)], list[FloatArray]()
    for _ in range(round(seconds / config.dt)):
        theta, omega = np.split(motion[-1], 2, axis=1)
        observation = np.hstack([np.sin(theta), np.cos(theta), omega]).astype(np.float32)
        actions.append(policy(observation).astype(np.float64))
        motion.append(step(motion[-1], actions[-1]))
    nominal = NominalTrajectory(np.concatenate(motion), np.concatenate(actions))
    end = nominal.states[-1].copy()
    end[:n] = np.remainder(end[:n], 2.0 * np.pi) - np.pi
    if np.abs(end).max() > _STANDS:
        raise ValueError(f"the demonstrator must stand after {seconds:g} s: give it more seconds")
    return track(config, nominal, 0.0)
