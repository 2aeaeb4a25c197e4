"""The controllers that know the equations of motion, by name, with settings for every task."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from npend_gym import _checks
from npend_gym.rl.controllers.energy_shaping import energy_swing_up
from npend_gym.rl.controllers.mpc import MPC
from npend_gym.rl.controllers.planning import planned_swing_up
from npend_gym.rl.controllers.regulators import lqr, modal_damping
from npend_gym.rl.controllers.transitions import planned_transitions
from npend_gym.rl.evaluation.rollouts import Controller
from npend_gym.rl.evaluation.settings import EnvLike, setting_of

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
# by controller, and whether the chain hangs on a cart
_ARGUMENTS: dict[tuple[str, bool], dict[int, dict[str, Any]]] = {
    ("plan", False): PLANS,
    ("plan", True): {
        3: {"seconds": 10.0, "guess": "mpc"},
        4: {"seconds": 12.0, "settle": 10.0, "guess": "mpc"},
        5: {"seconds": 14.0, "settle": 10.0, "guess": "mpc"},
        6: {"seconds": 14.0, "settle": 10.0, "guess": "mpc", "tries": 2},
    },
    # about standing: a strong one meets the force limit and loses more starts
    ("LQR", True): {n: {"action_weight": 100.0} for n in (3, 4, 5)},
}
_SWINGS_UP = {"plan": ("balance", "calm"), "energy": ("calm",)}  # and is none for these tasks


def reference_controller(
    name: str, env: EnvLike, progress: Callable[[Iterable[Any]], Iterable[Any]] = iter
) -> Controller:
    """Return one of `CONTROLLERS` for an environment, which is given as for `evaluate`.

    If episodes have goals, the controller must be "plan".

    Parameters
    ----------
    name : {"LQR", "MPC", "damping", "energy", "plan"}
    env : Env, VectorEnv, EnvSpec, str or dict
    progress : callable
        May wrap the iteration over the guesses of a plan, or over many plans, as tqdm does.

    Returns
    -------
    Controller

    Raises
    ------
    ValueError
        If there is no such controller, or it does not suit the task.

    Examples
    --------
    >>> from npend_gym import rl
    >>> act = rl.reference_controller("LQR", {"n": 1, "mode": "balance"})
    >>> rl.evaluate(act, {"n": 1, "mode": "balance"}, episodes=2).success.tolist()
    [True, True]
    """
    _checks.choice("controller", name, CONTROLLERS)
    config = setting_of(env).config
    task, has_goals = config.mode.name, config.mode.has_goals
    if has_goals and name != "plan":
        raise ValueError(
            f'controller must be "plan" in mode "{task}", got "{name}", which knows one equilibrium'
        )
    if task in _SWINGS_UP.get(name, ()):
        raise ValueError(
            f'controller must not swing up in mode "{task}", got "{name}": take LQR, MPC or damping'
        )
    arguments = _ARGUMENTS.get((name, config.has_cart), {}).get(config.n, {})
    if name == "energy":
        return energy_swing_up(config)
    if name == "plan" and has_goals:
        return planned_transitions(config, progress=progress)
    if name == "plan":
        return planned_swing_up(config, **arguments, progress=progress)
    if name == "damping":
        return modal_damping(config)
    angle = 0.0 if task == "calm" else np.pi
    if name == "MPC":
        return MPC(config, angle)
    return lqr(config, angle, **(arguments if angle > 0.0 else {}))
