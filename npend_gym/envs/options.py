"""The options of `reset`: checked, or refused by name, and kept where they persist."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import check_parameter, gear_ratios
from npend_gym.compiled.sincos import MAX_ANGLE
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.goals import check_different, checked_equilibrium
from npend_gym.envs.keywords import CHAIN_KEYWORDS, check_weight
from npend_gym.physics.arguments import warn_of_degrees
from npend_gym.physics.kernels.layout import MAX_SPEED
from npend_gym.physics.kernels.link_terms import count_terms

_START_OPTIONS = ("theta", "omega", "amplitude")
CART_STATE = ("cart_position", "cart_velocity")
EQUILIBRIA = ("start", "goal")  # near which an episode starts, and which it is to reach
_ANGLES = ("theta", "amplitude")
_LIMITS = {
    "theta": MAX_ANGLE, "amplitude": MAX_ANGLE, "omega": MAX_SPEED, "cart_velocity": MAX_SPEED
}  # fmt: skip
_NUMBERS = ("amplitude", "gravity", *CART_STATE)  # of a lane; others are of a rod


def given_options(options: Any) -> dict[str, Any]:
    """Return the reset options as a new dict, empty where there are none.

    Raises
    ------
    TypeError
        If they are no mapping.
    """
    if options is not None and not isinstance(options, Mapping):
        raise TypeError(
            f"options must be a dict of options by their names, got {_checks.show(options)}"
        )
    return dict(cast("Mapping[str, Any]", options or {}))


def checked_options(
    options: Mapping[str, Any], config: EnvConfig, lanes: int | None = None
) -> dict[str, Any]:
    """Return the reset options, or say what is wrong.

    Parameters
    ----------
    options : mapping
        As users give them: of a single environment, or with a leading axis of `lanes`.

    Returns
    -------
    dict
        With a leading lane axis and where they are given: "theta", "omega", "amplitude",
        "cart_position", "cart_velocity", "changes", the new parameters of chains by name, the
        cosines of "start" and "goal", and "persist".
    """
    given = dict(options)
    of_goals = EQUILIBRIA if config.mode.has_goals else ()
    of_cart = CART_STATE if config.has_cart else ()
    allowed = (*_START_OPTIONS, *of_cart, *of_goals, "persist", *CHAIN_KEYWORDS)
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
        if name in EQUILIBRIA:
            array = checked_equilibrium(label, array)
        checked[name] = array[None] if lanes is None else array
    if all(name in checked for name in EQUILIBRIA):
        check_different(*(checked[name] for name in EQUILIBRIA))
    changes = {name: checked.pop(name) for name in CHAIN_KEYWORDS if name in checked}
    if changes:
        _check_changes(config, changes)
        checked["changes"] = changes
    return checked


def _persistence(value: Any, lanes: int) -> BoolArray:
    """Return which lanes keep their options, shape (B,)."""
    given = np.asarray(value)
    if given.dtype != np.bool_ or given.shape not in ((), (lanes,)):
        raise TypeError(f"options['persist'] must be True or False, got {_checks.show(value)}")
    return np.broadcast_to(given, (lanes,))


def _check_changes(config: EnvConfig, changes: Mapping[str, FloatArray]) -> None:
    """Raise a ValueError where chains with `changes` break a rule, or need another kernel."""
    lanes = len(next(iter(changes.values())))
    chain, made_for = config.chain, count_terms(config.randomization.richest)
    changed = chain.repeated(lanes, **changes)
    if count_terms(changed) > made_for:
        alone = {k: count_terms(chain.repeated(lanes, **{k: v})) for k, v in changes.items()}
        name = next((k for k, count in alone.items() if count > made_for), next(iter(changes)))
        raise ValueError(
            f"options[{name!r}] must not make links of point masses, nor give links friction, "
            "rotors or drag that the environment was made without: make it with a chain that has "
            "some, chain=Chain(...)"
        )
    check_weight(changed)


class KeptOptions:
    """The options that persist, by lanes."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._kept: list[tuple[BoolArray, Mapping[str, Any]]] = []

    def __bool__(self) -> bool:
        return len(self._kept) > 0

    def keep(self, mask: BoolArray, options: Mapping[str, Any]) -> None:
        """Forget what the lanes of `mask` had; keep the `options` of those that say "persist"."""
        left = ((lanes & ~mask, kept) for lanes, kept in self._kept)
        persist = mask & options.get("persist", False)
        self._kept = [(lanes, kept) for lanes, kept in (*left, (persist, options)) if lanes.any()]

    def of(self, mask: BoolArray) -> Iterator[tuple[NDArray[np.int64], Mapping[str, Any]]]:
        """Yield lanes of `mask` with the options that they have kept."""
        for lanes, options in self._kept:
            if np.any(lanes & mask):
                yield np.flatnonzero(lanes & mask), options
