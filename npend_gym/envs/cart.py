"""A cart that carries the pivot: its keywords, and what follows from them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import STANDARD_GRAVITY, Cart, Chain
from npend_gym.envs.keywords import DEFAULTS, motor_limit
from npend_gym.envs.modes import Mode
from npend_gym.envs.settings import CartSettings
from npend_gym.physics.mechanism import mechanism_of

if TYPE_CHECKING:
    from npend_gym.envs.config import EnvConfig  # which imports this module

KEYWORDS = [each.name for each in fields(CartSettings) if each.name != "base"]


def given_cart(
    chain: Chain, given: Mapping[str, Any], keywords: Mapping[str, Any]
) -> Mapping[str, Any]:
    """Return the keywords of the cart; a chain that has its own brings those that are left out.

    Raises
    ------
    ValueError
        If rods stretch, or `base` is "pivot" for a chain on a cart.
    """
    if chain.stiffness is not None:
        raise ValueError(
            "chain must have rigid rods in an environment, because equal steps do not resolve the "
            f"vibrations of springs; chain.hung() has them, got {chain!r}"
        )
    if chain.base is None:
        return given
    if keywords.get("base", "cart") != "cart":
        raise ValueError(
            'base must be "cart", or left out, for a chain that has a cart of its own, got '
            f"{_checks.show(keywords['base'])}; chain.hung() has none"
        )
    own = {"cart_mass": chain.base.mass, "rail_damping": chain.base.damping}
    own = {name: value for name, value in own.items() if keywords.get(name) is None}
    return {**given, "base": "cart", **own}


def checked_cart(given: Mapping[str, Any], mode: Mode, chain: Chain) -> dict[str, Any]:
    """Return the keywords of the cart, those that are left out filled in.

    By default the cart has the mass of the chain, the rail is twice as long as the chain to each
    side, and the force is the mode's share of the weight of both.

    Raises
    ------
    TypeError, ValueError
        If one breaks its rule, or is given without a cart.
    """
    base = given["base"]
    if base == "pivot":
        for name in KEYWORDS:
            if given[name] is not None and given[name] != DEFAULTS[name]:
                raise ValueError(
                    f'{name} belongs to a cart: give base="cart" with it, or leave it out; '
                    f"got {_checks.show(given[name])}"
                )
        return {"base": base} | {name: DEFAULTS[name] for name in KEYWORDS}
    defaults = {"cart_mass": float(chain.masses.sum()), "rail": 2.0 * chain.total_length}
    checked: dict[str, Any] = {"base": base}
    for name, default in defaults.items():
        value = default if given[name] is None else given[name]
        checked[name] = _checks.positive_number(name, value)
    weight = chain.gravity * (checked["cart_mass"] + float(chain.masses.sum()))
    return checked | {
        "rail_damping": _checks.nonnegative_number("rail_damping", given["rail_damping"]),
        "max_force": motor_limit(given, "max_force", mode, weight),
    }


def base_of(config: EnvConfig) -> FloatArray | None:
    """Return the entries of `link_terms.Base` of a cart; None of a pivot at rest."""
    if config.cart_mass is None:
        return None
    cart = Cart(config.cart_mass, config.rail_damping)
    return mechanism_of([Chain(1.0, 1.0, base=cart)]).base


def cart_speed_factor(config: EnvConfig) -> float:
    """Return by what the velocity of a cart is multiplied in observations [s/m]; 0 without one.

    A cart as fast as what has fallen through half of `rail` has 1 there.
    """
    return (
        0.0
        if config.rail is None
        else 1.0 / math.sqrt((config.chain.gravity or STANDARD_GRAVITY) * config.rail)
    )
