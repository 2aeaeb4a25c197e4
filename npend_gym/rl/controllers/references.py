"""The controllers that know the equations of motion, by name, with settings for every task."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from npend_gym import _checks
from npend_gym.envs import EnvConfig
from npend_gym.rl.controllers.mpc import MPC
from npend_gym.rl.controllers.planning import planned_swing_up
from npend_gym.rl.controllers.regulators import energy_swing_up, lqr, modal_damping
from npend_gym.rl.controllers.transitions import planned_transitions
from npend_gym.rl.evaluation.rollouts import Controller

CONTROLLERS = ("LQR", "MPC", "damping", "energy", "plan")
# arguments of planned_swing_up by the number of rods
PLANS: dict[int, dict[str, Any]] = {
    2: {},
    3: {},
    4: {"seconds": 8.0},
    5: {"seconds": 12.0, "settle": 10.0},
    6: {"seconds": 14.0, "settle": 10.0, "guess": "mpc"},
    7: {"seconds": 14.0, "settle": 10.0, "guess": "mpc"},
    8: {"seconds": 22.0, "settle": 10.0, "guess": "mpc", "tries": 2, "seed": 2},
}
ON_CART: dict[int, dict[str, Any]] = {
    3: {"seconds": 10.0, "guess": "mpc"},
    4: {"seconds": 12.0, "settle": 10.0, "guess": "mpc"},
    5: {"seconds": 14.0, "settle": 10.0, "guess": "mpc"},
}
# arguments of lqr about standing: a strong one meets the force limit and loses more starts
BALANCE_ON_CART: dict[int, dict[str, Any]] = {n: {"action_weight": 100.0} for n in (3, 4, 5)}


def reference_controller(
    name: str,
    keywords: Mapping[str, Any],
    progress: Callable[[Iterable[Any]], Iterable[Any]] = iter,
) -> Controller:
    """Return one of `CONTROLLERS` for the environment of these keywords.

    Where episodes have goals it must be "plan". `progress` may wrap the iteration over the guesses
    of a plan, or over many plans, as tqdm does.
    """
    _checks.choice("controller", name, CONTROLLERS)
    known = {key: value for key, value in keywords.items() if key != "max_episode_steps"}
    config = EnvConfig(**known)
    if config.mode.has_goals and name != "plan":
        raise ValueError(
            f'controller must be "plan" in mode "{config.mode.name}", got "{name}", which knows '
            "one equilibrium alone"
        )
    if name == "energy":
        return energy_swing_up(config)
    if name == "plan" and config.mode.has_goals:
        return planned_transitions(config, progress=progress)
    if name == "plan":
        arguments = (ON_CART if config.has_cart else PLANS).get(config.n, {})
        return planned_swing_up(config, **arguments, progress=progress)
    if name == "damping":
        return modal_damping(config)
    angle = 0.0 if config.mode.name == "calm" else np.pi
    if name == "MPC":
        return MPC(config, angle)
    stands_on_cart = config.has_cart and angle > 0.0
    return lqr(config, angle, **(BALANCE_ON_CART.get(config.n, {}) if stands_on_cart else {}))
