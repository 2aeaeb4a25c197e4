"""The keys of the environments' info, once for the single and the vector environment."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from typing_extensions import NotRequired, TypedDict  # that of Python 3.10 cannot be generic

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.envs.goals import of_lane

_Real = TypeVar("_Real")
_Count = TypeVar("_Count")
_Truth = TypeVar("_Truth")


class Info(TypedDict, Generic[_Real, _Count, _Truth]):
    """What `reset` and `step` tell beside the observation; the same keys from the reset on.

    ``Info[float, int, bool]`` is that of the single environment. In the vector environment each
    value is an array with a leading axis of B, and each key has a bool mask (B,) named ``_key``.
    There is no NaN in it, and every array is new: no later step writes to it.
    """

    time: _Real
    """Time since the start of the episode [s]."""
    energy: _Real
    """Energy above hanging at rest [J]."""
    energy_error: _Real
    """Relative error of the energy: the energy minus that at the start minus the work of torques,
    damping and drag, over the larger of the two energies."""
    bobs_completed: _Count
    """Number of bobs whose pseudo-period is complete."""
    pseudo_period: _Real
    """Mean pseudo-period of the completed bobs [s]; 0.0 before the first."""
    pseudo_periods: FloatArray
    """Pseudo-period of each bob [s], shape (n,), in the reading "bob" of
    `npend_gym.pseudo_periods`; 0.0 where not complete."""
    pseudo_period_com: NotRequired[_Real]
    """In mode "passive": the pseudo-period of the chain's centre of mass [s], the reading "com" of
    `npend_gym.pseudo_periods`; 0.0 where not complete. On a cart: relative to it."""
    ideal_period: _Real
    """The paper's T0 of the chain [s]; 0.0 without gravity, and for links, to which T0 does not
    apply."""
    tip_height: _Real
    """Height of the tip above the pivot [m]."""
    theta: FloatArray
    """Angles from the downward vertical, not wrapped [rad], shape (n,)."""
    omega: FloatArray
    """Angular velocities [rad/s], shape (n,)."""
    diverged: _Truth
    """Whether the state has left all bounds; the last finite state is kept then."""
    success: _Truth
    """Whether the goal of the mode has held without interruption for the mode's `hold` seconds."""

    torque: NotRequired[FloatArray]
    """With motors: the torque of each in the last step [N m], shape (joints,), in the order of the
    action; of the motor of a cart its force [N]. It is the mean over the step of what the motor
    exerted, with its limit, delay, lag, noise and ripple, and without pushes. 0.0 at the start."""
    context: NotRequired[FloatArray]
    """With `randomize`: the numbers drawn for this episode, (k,), by `EnvConfig.context_names`."""
    goal: NotRequired[FloatArray]
    """In a mode with goals: the angles, 0 or pi, that the rods are to reach [rad], shape (n,)."""
    cart_position: NotRequired[_Real]
    """With a cart: its place, from the middle of the rail [m]."""
    cart_velocity: NotRequired[_Real]
    """With a cart: [m/s]."""


BatchInfo = Info[FloatArray, NDArray[np.int64], BoolArray]


def mask_names(optional: Mapping[str, bool]) -> list[str]:
    """Return the names of the masks of a vector environment: ``_key`` for every key of its info.

    `optional` says of some keys whether they are in the info; the others are.
    """
    return [f"_{key}" for key in Info.__annotations__ if optional.get(key, True)]


def final_info(observation: Any, info: dict[str, Any], done: BoolArray) -> dict[str, Any]:
    """Return the keys that tell the last observation of episodes that are over, and their info."""
    last = np.full(done.size, None, dtype=object)
    for lane in np.flatnonzero(done).tolist():
        last[lane] = copy.deepcopy(of_lane(observation, lane))
    return {
        "final_obs": last,
        "_final_obs": done.copy(),
        "final_info": {
            key: np.where(done.reshape(-1, *[1] * (value.ndim - 1)), value, np.zeros_like(value))
            for key, value in info.items()
        },
        "_final_info": done.copy(),
    }
