"""The chains that are released: equal rods of every n, lists for one n, or one chain as it is."""

from __future__ import annotations

import json
import math
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym.chain import MAX_RODS, STANDARD_GRAVITY, Chain, as_chain

MAX_VALUES = 10_000  # of one name of a sweep
# Of sqrt(l/g) [s], l being the mean length: instants are located to 1e-11 s, and angular velocities
# to about 1e-12 rad/s
TIME_SCALES = 1e-6, 1e6
REPLACED = ("masses", "lengths", "gravity", "damping")  # what `chain` is given in place of


def released_chain(
    n: int,
    masses: ArrayLike = 1.0,
    lengths: ArrayLike = 1.0,
    gravity: float = STANDARD_GRAVITY,
    damping: float = 0.0,
) -> Chain:
    """Return the chain of `n` rods; masses and lengths are one number or an array of shape (n,)."""
    ones = np.ones(_checks.count("n", n, high=MAX_RODS))
    mass, length = _checks.array("masses", masses), _checks.array("lengths", lengths)
    for name, value in (("masses", mass), ("lengths", length)):
        if value.ndim and value.shape != (n,):
            raise ValueError(
                f"{name} must be one number{f' or {n} of them' if n > 1 else ''} for n = {n}, "
                f"got shape {value.shape}"
            )
    return Chain(ones * mass, ones * length, gravity, damping)


def check_time_scale(chain: Chain) -> None:
    """Refuse a chain that swings too fast or too slowly for its instants to be resolved."""
    if chain.gravity == 0.0:
        return
    length = float(chain.lengths.mean())
    if not TIME_SCALES[0] <= math.sqrt(length / chain.gravity) <= TIME_SCALES[1]:
        raise ValueError(
            f"gravity must be 0 or such that sqrt(l/g) is between {TIME_SCALES[0]:g} and "
            f"{TIME_SCALES[1]:g} s, l being the mean length of the rods, {length:g} m; got "
            f"{chain.gravity:g} m/s^2: choose another unit of time"
        )


def take_chain(described: Any, n_name: str) -> None:
    """Check the field `chain` of an experiment or a plan, where it is given, and set n by it.

    `n_name` is its field with the numbers of pendulums. Fields that a chain replaces must be left
    at their defaults.
    """
    if described.chain is None:
        return
    chain = as_chain(described.chain)
    for one in fields(described):
        value = getattr(described, one.name)
        if one.name not in (n_name, *REPLACED) or _same(value, one.default):
            continue
        if one.name in REPLACED or not _same(value, chain.n):
            rule = f", or be its {chain.n} links" if one.name == n_name else ", which has its own"
            raise ValueError(
                f"{one.name} must be left out where chain is given{rule}; got {_checks.show(value)}"
            )
    object.__setattr__(described, "chain", chain)
    object.__setattr__(described, n_name, (chain.n,))


def take_count(described: Any, name: str, *, low: int = 1, high: int) -> None:
    """Check an integer field of an experiment or a plan, and keep it as Python's.

    NumPy's overflow, and are no JSON.
    """
    value = _checks.count(name, getattr(described, name), low=low, high=high)
    object.__setattr__(described, name, value)


def _same(value: Any, other: Any) -> bool:
    """Return whether two fields are equal, a value being equal to a list of that value alone."""
    return np.array_equal(np.ravel(np.array(value, object)), np.ravel(np.array(other, object)))


def plain_fields(described: Any, n_name: str) -> dict[str, Any]:
    """Return the fields of an experiment or a plan as numbers, lists, dicts and texts.

    With a chain they lack what it replaces, else they lack the chain.
    """
    values = {one.name: getattr(described, one.name) for one in fields(described)}
    chain = values.pop("chain")
    if isinstance(chain, Chain):
        values = {name: values[name] for name in values if name not in (n_name, *REPLACED)}
        values["chain"] = chain.as_dict()
    return json.loads(json.dumps(values, default=lambda value: np.asarray(value).tolist()))


def swept_values(name: str, value: Any) -> tuple[Any, ...]:
    """Return the values of a swept name as a tuple, each of them checked."""
    size = len(value) if isinstance(value, (list, tuple, range)) else np.size(value)  # pyright: ignore[reportUnknownArgumentType]
    if size > MAX_VALUES:
        raise ValueError(f"{name} must name at most {MAX_VALUES} values, got {size}")
    if isinstance(value, np.ndarray):
        value = value.tolist()
    values: tuple[Any, ...] = tuple(value) if isinstance(value, (list, tuple, range)) else (value,)  # pyright: ignore[reportUnknownArgumentType, reportUnknownVariableType]
    if not values:
        raise ValueError(f"{name} must name at least one value, got none")
    if name == "n":
        values = tuple(_checks.count(name, value) for value in values)
    elif name in ("masses", "lengths"):
        values = tuple(_per_rod(name, value) for value in values)
    elif name != "definition":
        values = tuple(_checks.number(name, value) + 0.0 for value in values)  # no -0.0
    seen: set[str] = set()
    for one in values:
        if repr(one) in seen:
            raise ValueError(f"{name} must name each value once, got {_checks.show(one)} twice")
        seen.add(repr(one))
    return values


def _per_rod(name: str, value: Any) -> float | tuple[float, ...]:
    if isinstance(value, (list, tuple, np.ndarray)):
        numbers = _checks.array(name, value)
        if numbers.ndim > 1:
            raise ValueError(
                f"each value of {name} must be one number or a list with an entry for each rod, "
                f"got shape {numbers.shape}"
            )
        return tuple(numbers.ravel().tolist())
    return _checks.number(name, value)
