"""What users pass to `reset` and `step`: checked, or refused by name; options that persist."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, cast

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import check_parameter, gear_ratios
from npend_gym.compiled.sincos import MAX_ANGLE
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.goals import check_different, checked_equilibrium
from npend_gym.envs.hardware import changes_torques_in_steps
from npend_gym.envs.keywords import CHAIN_KEYWORDS, width_of_starts
from npend_gym.envs.limits import substeps_on_base
from npend_gym.envs.settings import HARDWARE, OF_EPISODES
from npend_gym.physics.arguments import warn_of_degrees
from npend_gym.physics.kernels.layout import MAX_SPEED
from npend_gym.physics.kernels.link_terms import count_terms, lacks_terms
from npend_gym.physics.substeps import MAX_SUBSTEPS, substeps_of

MAX_LANES = 10_000_000
MAX_RODS_IN_ALL = 50_000_000  # some 15 GB
_START_OPTIONS = ("theta", "omega")
CART_STATE = ("cart_position", "cart_velocity")
EQUILIBRIA = ("start", "goal")  # near which an episode starts, and which it is to reach
_ANGLES = ("theta", "amplitude")
_LIMITS = {
    "theta": MAX_ANGLE, "amplitude": MAX_ANGLE, "omega": MAX_SPEED, "cart_velocity": MAX_SPEED
}  # fmt: skip
# Chains may need so many times the default substeps. A chain an eighth as long, which does, keeps
# its energy to some 1e-6 over 1000 steps.
_FASTER = 3
_NUMBERS = ("gravity", *CART_STATE, *OF_EPISODES)  # of a sub-environment; others are of a rod


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


def checked_numbers(which: Any, count: int) -> NDArray[np.int64]:
    """Return numbers of environments, given as numbers or as a mask; all where there are none."""
    if which is None:
        return np.arange(count)
    given = np.asarray(which)
    if given.dtype == np.bool_ and given.shape == (count,):
        return np.flatnonzero(given)
    whole = given.dtype.kind in "iu" and given.ndim == 1
    if not whole or np.any((given < 0) | (given >= count)) or np.unique(given).size < given.size:
        raise ValueError(
            f"which must be different numbers of sub-environments, 0 to {count - 1}, or a "
            f"mask of shape ({count},); got {_checks.show(which)}"
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
    _checks.unmasked("options['reset_mask']", mask)
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


def env_actions(config: EnvConfig, actions: FloatArray) -> Any:
    """Return actions, (..., joints), as the environment takes them.

    Of discrete actions these are the numbers, (...), of those with the nearest torques.
    """
    levels = config.torque_levels
    if levels is None:
        return actions
    if not np.isfinite(actions).all():
        raise ValueError(f"action must be finite, got {_checks.show(actions)}")
    digits = np.rint(0.5 * (levels - 1) * (np.clip(actions, -1.0, 1.0) + 1.0))
    places = levels ** np.arange(config.joints.size)[::-1]
    return (digits.astype(np.int64) * places).sum(axis=-1)


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
        raw = np.asarray(_checks.unmasked("action", action))
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
                "action must be 0, which waits, because this mode has no other action, "
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


def given_options(options: Any) -> dict[str, Any]:
    """Return the reset options as a new dict, empty where there are none."""
    if options is not None and not isinstance(options, Mapping):
        raise TypeError(
            f"options must be a dict of options by their names, got {_checks.show(options)}"
        )
    return dict(cast("Mapping[str, Any]", options or {}))


def checked_options(
    options: Mapping[str, Any], config: EnvConfig, lanes: int | None = None
) -> dict[str, Any]:
    """Return the reset options, or say what is wrong.

    Those given are of a single environment, or have a leading axis of `lanes`; those returned
    always have one. "changes" has the new parameters of the chains, "settings" those of motors,
    sensors and starts; "start" and "goal" are cosines.
    """
    given = dict(options)
    of_goals = EQUILIBRIA if config.mode.has_goals else ()
    of_cart = CART_STATE if config.has_cart else ()
    no_motor = [] if config.has_cart else ["max_force"]
    no_motor += [] if np.any(config.joints < config.n) else ["max_torque"]
    settings = [name for name in OF_EPISODES if name not in no_motor]
    allowed = (*_START_OPTIONS, *settings, *of_cart, *of_goals, "persist", *CHAIN_KEYWORDS)
    unknown = set(given) - set(allowed)
    if unknown:
        raise ValueError(
            f"options must be among {', '.join(allowed)}; "
            f"got {_checks.show(sorted(map(str, unknown)))}"
        )
    limits = _LIMITS | {"cart_position": config.rail or 0.0}
    checked: dict[str, Any] = {}
    if "persist" in given:
        checked["persist"] = _persistence(given.pop("persist"), lanes or 1)
    for name, value in given.items():
        label = f"options[{name!r}]"
        shape = () if name in _NUMBERS else (config.n,)
        shape = shape if lanes is None else (lanes, *shape)
        if name == "gear":
            array = gear_ratios(label, value, shape)
        else:
            array = _checks.broadcast(label, value, shape)
            _checks.within(label, array, limits.get(name, math.inf))
        if name in _ANGLES:
            warn_of_degrees(label, array[..., None] if name in _NUMBERS else array)
        if name in CHAIN_KEYWORDS:
            check_parameter(label, array)
        if name in OF_EPISODES:
            _check_setting(label, name, array, config)
        if name in EQUILIBRIA:
            array = checked_equilibrium(label, array)
        checked[name] = array[None] if lanes is None else array
    if all(name in checked for name in EQUILIBRIA):
        check_different(*(checked[name] for name in EQUILIBRIA))
    changes = {name: checked.pop(name) for name in CHAIN_KEYWORDS if name in checked}
    if changes:
        _check_changes(config, changes)
        checked["changes"] = changes
    chosen = {name: checked.pop(name) for name in settings if name in checked}
    return checked | ({"settings": chosen} if chosen else {})


def _check_setting(label: str, name: str, values: FloatArray, config: EnvConfig) -> None:
    """Raise a ValueError where a setting of an episode breaks the rule of its keyword."""
    if name != "amplitude":
        _checks.at_least_zero(label, values)
    if name == "spread":
        width_of_starts(float(values.max()), config.mode, config.max_tilt, config.rail)
    if name in HARDWARE and np.any(values > config.largest[name]):
        raise ValueError(
            f"{label} must be at most {config.largest[name]:g}, the largest {name} that the "
            f"environment is made for, got {_checks.show(values.tolist())}: make it with a larger "
            f"{name}, and lower it by options"
        )
    is_whole = name != "action_delay" or not np.any(values % 1.0 > 0.0)
    if not (is_whole or changes_torques_in_steps(config)):
        raise ValueError(
            f"{label} must be whole steps, as that of the environment is, got "
            f"{_checks.show(values.tolist())}: make it with action_delay="
            f"{config.action_delay + 0.5:g}, and lower it by options"
        )


def _persistence(value: Any, lanes: int) -> BoolArray:
    """Return which sub-environments keep their options, shape (B,)."""
    given = np.asarray(value)
    if given.dtype != np.bool_ or given.shape not in ((), (lanes,)):
        raise TypeError(f"options['persist'] must be True or False, got {_checks.show(value)}")
    return np.broadcast_to(given, (lanes,))


def _check_changes(config: EnvConfig, changes: Mapping[str, FloatArray]) -> None:
    """Raise a ValueError where chains with `changes` break a rule, or need another kernel."""
    lanes = len(next(iter(changes.values())))
    chain, features = config.chain, config.randomization.with_all_features
    made_for = count_terms(features, chain.base)
    changed = chain.repeated(lanes, **changes)
    if lacks_terms(changed, made_for):
        alone = {k: chain.repeated(lanes, **{k: v}) for k, v in changes.items()}
        lacking = (k for k, each in alone.items() if lacks_terms(each, made_for))
        name = next(lacking, next(iter(changes)))
        raise ValueError(
            f"options[{name!r}] must not turn point masses into links, add friction to them, "
            "or rotors or drag to links: make the environment with a chain that has them, "
            "chain=Chain(...)"
        )
    _check_substeps(config, changes)


def substeps_beyond(config: EnvConfig, changes: Mapping[str, FloatArray]) -> int:
    """Return the substeps that chains with `changes` need, 0 where those by default suffice.

    `MAX_SUBSTEPS` stands for any number beyond. ValueError is raised for a chain that is no task's.
    """
    corners = config.randomization.changed(changes)
    if config.substeps is not None:
        return 0
    dt, random, cart = config.dt, config.randomization, vars(config)
    try:
        needed = max(
            substeps_on_base(substeps_of(each, dt), each, dt, random, cart) for each in corners
        )
    except ValueError:
        needed = MAX_SUBSTEPS
    return needed if needed > _FASTER * config.min_substeps else 0


def _check_substeps(config: EnvConfig, changes: Mapping[str, FloatArray]) -> None:
    """Raise a ValueError where chains with `changes` are too fast for the default substeps."""
    needed = substeps_beyond(config, changes)
    if needed > 0:
        text = f"or with substeps={needed}" if needed < MAX_SUBSTEPS else "and shorten dt"
        raise ValueError(
            f"options[{next(iter(changes))!r}] must leave the chain slow enough for the "
            f"{config.min_substeps} substeps of dt={config.dt:g} s: make the environment with this "
            f"chain, {text}"
        )


class KeptOptions:
    """The options that persist, by sub-environments."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._kept: list[tuple[BoolArray, Mapping[str, Any]]] = []

    def keep(self, mask: BoolArray, options: Mapping[str, Any]) -> None:
        """Forget what the lanes of `mask` had; keep the `options` of those that say "persist"."""
        left = ((lanes & ~mask, kept) for lanes, kept in self._kept)
        persist = mask & options.get("persist", False)
        self._kept = [(lanes, kept) for lanes, kept in (*left, (persist, options)) if lanes.any()]

    def of(self, mask: BoolArray) -> Iterator[tuple[NDArray[np.int64], Mapping[str, Any]]]:
        """Yield sub-environments of `mask` with the options that they have kept."""
        for lanes, options in self._kept:
            if np.any(lanes & mask):
                yield np.flatnonzero(lanes & mask), options
