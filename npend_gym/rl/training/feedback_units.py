"""Units of a network that begin as the feedback along a plan.

Near a plan the expert's actions change steeply with the state. The gains that hold six poles on a
cart are two thousand times as large as the random weights of a network. A network takes very long
to learn such gains. So some units of the first layer begin as the feedback at steps of the plan.
Later layers learn which of these units counts where.
"""

# torch's stubs leave parts unknown
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.envs import EnvConfig
from npend_gym.rl.training.goal_networks import numbers_of

if TYPE_CHECKING:
    from npend_gym.rl.training.experts import Expert

_SLOPES = 1.0, 4.0  # of the units where the feedback is zero, over its gains, in turns


def check_feedback_units(config: EnvConfig, count: int, hidden: int) -> None:
    """Raise an error for more such units than a layer of `hidden` has, or without velocities."""
    _checks.count("feedback_units", count, low=0, high=hidden)
    if count > 0 and not config.observe_velocities:
        raise ValueError(f"feedback_units must be 0 with observe_velocities=False, got {count}")


def begin_as_feedback(
    networks: Sequence[Any], config: EnvConfig, expert: Expert, to_inputs: torch.Tensor, count: int
) -> None:
    """Make the first units of each network, `count` of them, feedback along the expert's plans.

    `config` is that of the student. There is a network for all goals, or one for each. `to_inputs`
    makes inputs of the networks from rows that begin with an observation.
    """
    if count == 0:
        return
    states, gains = expert.trajectories[0], expert.gains
    plans_of = [[*range(len(expert.pairs))] or [0]]  # without goals: that of the nominal chain
    if len(networks) > 1:
        ends = numbers_of(torch.tensor([end for _, end in expert.pairs])).numpy()
        plans_of = [np.flatnonzero(ends == number).tolist() for number in range(len(networks))]
    for plans, network in zip(plans_of, networks, strict=True):
        if not plans:  # nobody is to reach this goal
            continue
        rows = gains[plans].reshape(-1, gains.shape[-1])
        at = np.repeat(states[plans].reshape(-1, states.shape[-1]), gains.shape[2], axis=0)
        chosen = np.rint(np.linspace(0, len(rows) - 1, count)).astype(np.int64)
        weights, biases = feedback_rows(config, at[chosen], rows[chosen])
        slopes = np.resize(_SLOPES, count)
        of_rows = np.zeros((count, len(to_inputs)))
        of_rows[:, : config.observed] = slopes[:, None] * weights
        with torch.no_grad():
            made = torch.from_numpy(of_rows.astype(np.float32))
            network[0].weight[:count] = torch.linalg.solve(to_inputs, made.T).T
            network[0].bias[:count] = torch.from_numpy((slopes * biases).astype(np.float32))


def feedback_rows(
    config: EnvConfig, states: FloatArray, gains: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return weights, (B, observed), and biases, (B,), that make feedback of an observation.

    The feedback is minus the gains, (B, 2c), times the deviation from the states, (B, 2c). Sines
    take the place of deviations of angles.
    """
    n, c = config.n, states.shape[1] // 2
    of_angles, of_speeds = gains[:, :n], gains[:, c : c + n]
    theta, omega = states[:, :n], states[:, c : c + n]
    weights = np.zeros((len(states), config.observed))
    weights[:, :n] = -of_angles * np.cos(theta)
    weights[:, n : 2 * n] = of_angles * np.sin(theta)
    weights[:, 2 * n : 3 * n] = -of_speeds
    biases = (of_speeds * omega).sum(axis=1)
    if config.rail is not None:
        weights[:, 3 * n] = -gains[:, n] * config.rail
        weights[:, 3 * n + 1] = -gains[:, -1] / config.cart_speed_factor
        biases += gains[:, n] * states[:, n] + gains[:, -1] * states[:, -1]
    return weights, biases
