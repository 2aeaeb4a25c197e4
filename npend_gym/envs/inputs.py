"""What users pass to `reset` and `step`: checked, or refused by name."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import BoolArray, FloatArray
from npend_gym.compiled.sincos import MAX_ANGLE
from npend_gym.physics.kernels.layout import MAX_SPEED

MAX_LANES = 10_000_000
MAX_RODS_IN_ALL = 50_000_000  # some 15 GB


def checked_autoreset_mode(value: Any) -> AutoresetMode:
    """Return the autoreset mode of that name or value."""
    if isinstance(value, AutoresetMode):
        return value
    names = {mode.value: mode for mode in AutoresetMode} | {m.name: m for m in AutoresetMode}
    if not isinstance(value, str) or value not in names:
        raise ValueError(
            f"autoreset_mode must be one of {', '.join(m.name for m in AutoresetMode)}; "
            f"got {_checks.show(value)}"
        )
    return names[value]


def checked_num_envs(value: Any, n: int) -> int:
    """Return the number of environments of n rods each."""
    count = _checks.count("num_envs", value, high=MAX_LANES)
    if count * n > MAX_RODS_IN_ALL:
        raise ValueError(
            f"num_envs times n must be at most {MAX_RODS_IN_ALL}, got {count} times {n}"
        )
    return count


def checked_episode_steps(value: Any) -> int | None:
    """Return the number of steps after which an episode is truncated; None for never."""
    return None if value is None else _checks.count("max_episode_steps", value, high=2**63 - 1)


def checked_lanes(lanes: Any, count: int) -> NDArray[np.int64]:
    """Return numbers of lanes, given as numbers or as a mask; all where there are none."""
    if lanes is None:
        return np.arange(count)
    given = np.asarray(lanes)
    if given.dtype == np.bool_ and given.shape == (count,):
        return np.flatnonzero(given)
    whole = given.dtype.kind in "iu" and given.ndim == 1
    if not whole or np.any((given < 0) | (given >= count)) or np.unique(given).size < given.size:
        raise ValueError(
            f"lanes must be different numbers from 0 to {count - 1}, or a mask of shape "
            f"({count},); got {_checks.show(lanes)}"
        )
    return given.astype(np.int64)


def checked_state(value: Any, shape: tuple[int, int], n: int) -> FloatArray:
    """Return angles and angular velocities, and those of a cart, or say what is wrong with them."""
    given = _checks.array("state", value)
    if given.size != math.prod(shape) or given.shape[-1:] != shape[-1:]:
        wanted = shape[1:] if shape[0] == 1 else shape
        raise ValueError(f"state must have the shape {wanted}, got {given.shape}")
    theta, omega, of_cart = np.hsplit(given.reshape(shape), [n, 2 * n])
    _checks.within("the angles of state", theta, MAX_ANGLE)
    _checks.within("the velocities of state", omega, MAX_SPEED)
    _checks.within("the cart of state", of_cart, MAX_ANGLE)
    return given.reshape(shape)


def reset_mask(mask: Any, count: int, *, every: bool) -> BoolArray:
    """Return the lanes to reset: all where there is no mask, or where `every` lane must be."""
    if mask is None:
        return np.ones(count, np.bool_)
    shown = _checks.show(mask)
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
        raise TypeError(f"options['reset_mask'] must be a bool array, got {shown}")
    if mask.shape != (count,) or not mask.any():
        raise ValueError(
            f"options['reset_mask'] must have the shape ({count},) and be True somewhere, "
            f"got {shown}"
        )
    if every and not mask.all():
        raise ValueError(
            "options['reset_mask'] must be all True in the first reset and after an interruption"
        )
    return np.array(mask, np.bool_)  # pyright: ignore[reportUnknownArgumentType]


def checked_action(
    action: Any, shape: tuple[int, ...], table: FloatArray
) -> float | NDArray[Any] | None:
    """Return the action, torques over their limit, or say what is wrong with it.

    Its shape is (joints,) or (B, joints). Where `table`, (actions, joints), has rows, an action is
    the number of a row. In a mode without a motor there are no joints, every action must be 0 and
    None is returned.
    """
    if type(action) is np.ndarray and action.shape == (1,) == shape and len(table) == 0:
        value = action.item()
        if type(value) is float and math.isfinite(value):
            return value  # the common case, quickly; the rules below are for all others
    joints, is_discrete = shape[-1], len(table) > 0 or shape[-1] == 0
    try:
        raw = np.asarray(action)
    except (ValueError, TypeError, OverflowError) as error:
        raise ValueError(f"action must be rectangular, got {_checks.show(action)}") from error
    if raw.dtype.kind not in ("iu" if is_discrete else "iuf"):
        kind = "integers" if is_discrete else "real numbers"
        raise TypeError(f"action must hold {kind}, got {_checks.show(action)}")
    wanted = shape[:-1] if is_discrete else shape
    if raw.shape != wanted:
        raise ValueError(f"action must have the shape {wanted}, got {raw.shape}")
    if joints == 0:
        if np.any(raw != 0):
            raise ValueError(
                "action must be 0, for waiting is the only action in this mode, "
                f"got {_checks.show(action)}"
            )
        return None
    if is_discrete:
        if np.any((raw < 0) | (raw >= len(table))):
            raise ValueError(
                f"action must be between 0 and {len(table) - 1}, got {_checks.show(action)}"
            )
        return table[raw]
    if raw.dtype.itemsize > 8:  # a long double may be finite, and infinite as a double
        with np.errstate(over="ignore"):
            raw = raw.astype(np.float64)
    if np.count_nonzero(np.isfinite(raw)) < raw.size:
        raise ValueError(f"action must be finite, got {_checks.show(action)}")
    return raw
