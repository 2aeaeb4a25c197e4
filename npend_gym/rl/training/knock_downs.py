"""Where knock-downs leave a chain: states in which episodes of training begin."""

from __future__ import annotations

import math

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.envs import EnvConfig
from npend_gym.physics import Ensemble
from npend_gym.rl.angles import wrap
from npend_gym.rl.controllers.step_model import states_of
from npend_gym.rl.evaluation.disturbances import holding_torques
from npend_gym.rl.evaluation.recovery import RULES, Rule

# Here the motors of the simulation have half the damping of `recovery`
_KNOCKS = RULES | {"simulation": RULES["simulation"]._replace(damping=1.0 / 6.0)}


def knocked_down(
    config: EnvConfig,
    rng: np.random.Generator,
    count: int | None = None,
    rule: str = "simulation",
    turns: float = 0.0,
) -> FloatArray:
    """States, (count, 2c), in which upright chains are left by a knock-down.

    A proportional-differential controller with compensation of gravity turns all joints. It is
    simpler than the motors of `recovery`: its steps are those of the environment. It turns joints
    the short way, and further by whole turns with the standard deviation `turns`. `recovery` does
    so after a swing-up in which joints turned over. Such states differ more, so that there are
    20 000 of them, else 2000.
    """
    knock, n = _KNOCKS[rule], config.n
    if count is None:
        count = 20_000 if turns > 0.0 else 2000
    goal = rng.uniform(-math.pi, math.pi, (count, n))
    lanes = Ensemble(config.chain, count, joints=range(n))
    lanes.set_state(
        slice(None), rng.normal(math.pi, 0.05, (count, n)), rng.normal(0.0, 0.2, (count, n))
    )
    upright = np.diff(lanes.theta, axis=1, prepend=0.0)
    goal = upright + wrap(goal - upright)
    if turns > 0.0:
        goal += 2.0 * math.pi * np.rint(rng.normal(0.0, turns, goal.shape))
    for _ in range(round(knock.seconds / config.dt)):
        torque = _turning(config, goal, lanes.theta, lanes.omega, knock)
        lanes.advance(torque, config.dt, config.substeps)
    return states_of(config, lanes)


def _turning(
    config: EnvConfig, goal: FloatArray, theta: FloatArray, omega: FloatArray, knock: Rule
) -> FloatArray:
    """Return the torques at all joints [N m], (B, n), that turn them to their goals [rad]."""
    angle = np.diff(theta, axis=1, prepend=0.0)
    speed = np.diff(omega, axis=1, prepend=0.0)
    pull = np.clip(knock.stiffness * (goal - angle), -knock.most, knock.most)
    drive = config.max_torque * (pull - knock.damping * speed)
    drive += holding_torques(config.chain, theta)
    return np.clip(drive, -config.max_torque, config.max_torque)
