"""The plan that teaches: one that is found, or the way of a policy.

A student's actions are never quite the teacher's. How far this leads astray differs much from plan
to plan, so that some cannot be learned. Of a plan that is found, variants can be tried, to keep
those along which chains with noisy actions come less far away.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter1d

from npend_gym._checks import FloatArray
from npend_gym.envs import EnvConfig
from npend_gym.rl.controllers.planning import (
    PlannedTransition,
    planned_swing_up,
    replanned,
    track,
)
from npend_gym.rl.controllers.step_model import StepModel
from npend_gym.rl.controllers.transcription import NominalTrajectory
from npend_gym.rl.policies.policy import Policy
from npend_gym.rl.training.context_plans import ContextPlans
from npend_gym.rl.training.disturbed_lanes import DisturbedLanes

_START, _STANDS = 1e-9, 0.01  # rad and rad/s from hanging and from standing
_NOISE = np.repeat([0.02, 0.03, 0.04, 0.06], 64)  # standard deviation of actions, in each lane
_LOST, _AFTER = 300.0, 10  # cost over the mean at the start; steps after the plan
_CHANGE, _SMALLEST, _LARGEST = 0.15, 0.01, 0.4  # of actions, over their limit: at first, and ends
_GROWS, _SHRINKS = 1.8, 0.93  # after a variant that is better, or not
_WIDTHS, _REACH = (1.0, 2.0, 4.0, 8.0), 15.0  # of changes, in steps


def base_plan(settings: Any, config: EnvConfig) -> PlannedTransition:
    """Return the plan for the chain without errors, as settings of `robust_imitation` say."""
    if settings.demonstrator:
        return plan_of(Policy.pretrained(settings.demonstrator), config, settings.seconds)
    options: dict[str, Any] = {"tries": 1, "guess": "mpc", "seed": settings.plan_seed}
    plan = planned_swing_up(config, settings.seconds, **options)
    return steadied(config, plan, settings.variants, settings.plan_seed)


def steadied(
    config: EnvConfig, plan: PlannedTransition, variants: int, seed: int
) -> PlannedTransition:
    """Return the plan, or that of its variants along which noise leads least far astray.

    Each is the motion to the same end whose actions are most like those of the best one so far with
    a smooth random change, which grows after a success and else shrinks.
    """
    if variants == 0:
        return plan
    rng, size, least = np.random.default_rng([seed, 3]), _CHANGE, astray(config, plan)
    for _ in range(variants):
        states, actions = plan.nominal
        change = _smooth_change(rng, len(actions))[:, None]
        wanted = np.clip(actions + size * change, -1.0, 1.0)
        variant = replanned(config, plan.nominal, like=NominalTrajectory(states, wanted))
        if variant is not None and (cost := astray(config, variant)) < least:
            plan, least, size = variant, cost, min(_LARGEST, _GROWS * size)
        else:
            size = _SHRINKS * size if size > _SMALLEST else _LARGEST
    return plan


def _smooth_change(rng: np.random.Generator, steps: int) -> FloatArray:
    """Return a random change of all actions, or of those about a random step."""
    change = gaussian_filter1d(rng.normal(size=steps), rng.choice(_WIDTHS))
    change /= change.std()
    if rng.random() < 0.5:
        change *= np.exp(-0.5 * ((np.arange(steps) - rng.uniform(0.0, steps)) / _REACH) ** 2)
    return change


def astray(config: EnvConfig, plan: PlannedTransition) -> float:
    """Return how far noise of the actions leads from a plan that is tracked: a mean logarithm.

    It is that of the largest cost of the deviation in a lane, over the mean at the start.
    """
    plans, rng = ContextPlans(config, plan, []), np.random.default_rng(0)
    lanes = DisturbedLanes(config, plans, _NOISE.size, 0, {"nothing": 1.0})
    phase, worst = np.zeros(_NOISE.size, np.int64), np.zeros(_NOISE.size)
    lost_at = np.full(_NOISE.size, plans.steps)
    for _ in range(plans.steps + _AFTER):
        phase, tracking = plans.tracking(lanes.which, phase, lanes.states)
        known = worst < _LOST
        worst[known] = np.maximum(worst, tracking.relative_cost)[known]
        lost_at[known] = phase[known]
        actions = tracking.actions[:, 0] + _NOISE * rng.normal(size=_NOISE.size)
        lanes.step(np.where(worst < _LOST, actions.clip(-1.0, 1.0), 0.0))
    lost = worst >= _LOST  # the later, the better
    worst[lost] = _LOST * np.exp(1.0 - 0.5 * lost_at[lost] / plans.steps)
    return float(np.log(worst).mean())


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
