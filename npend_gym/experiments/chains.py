"""The chains that are released: equal rods of every n, lists for one n, or one chain as it is."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym.chain import STANDARD_GRAVITY, Chain, as_chain

REPLACED = ("masses", "lengths", "gravity", "damping")  # what `chain` is given in place of


def released_chain(
    n: int,
    masses: ArrayLike = 1.0,
    lengths: ArrayLike = 1.0,
    gravity: float = STANDARD_GRAVITY,
    damping: float = 0.0,
) -> Chain:
    """Return the chain of `n` rods; masses and lengths are one number or an array of shape (n,).

    Raises
    ------
    TypeError, ValueError
        If an argument breaks its rule.
    """
    ones = Chain.uniform(n).masses  # checks n
    mass, length = _checks.array("masses", masses), _checks.array("lengths", lengths)
    for name, value in (("masses", mass), ("lengths", length)):
        if value.ndim and value.shape != (n,):
            raise ValueError(
                f"{name} must be one number{f' or {n} of them' if n > 1 else ''} for n = {n}, "
                f"got shape {value.shape}"
            )
    return Chain(ones * mass, ones * length, gravity, damping)


def take_chain(described: Any, n_name: str) -> None:
    """Check the field `chain` of an experiment or a plan, where it is given, and set n by it.

    Parameters
    ----------
    described : ReleaseExperiment or CampaignPlan
    n_name : str
        Name of its field with the numbers of pendulums.

    Raises
    ------
    TypeError, ValueError
        If there is no such chain, or a field that it replaces is not left at its default.
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
