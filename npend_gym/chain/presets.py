"""Chains by name: class methods of `Chain`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from npend_gym import _checks
from npend_gym.chain.parameters import MAX_RODS, STANDARD_GRAVITY

if TYPE_CHECKING:
    from npend_gym.chain.model import Chain


def uniform(
    cls: type[Chain],
    n: int,
    mass: float = 1.0,
    length: float = 1.0,
    gravity: float = STANDARD_GRAVITY,
    damping: float = 0.0,
    drag: float = 0.0,
    quadratic_drag: float = 0.0,
) -> Chain:
    """Return a chain of `n` equal rods, each `length` [m] long with a bob of `mass` [kg]."""
    n = _checks.count("n", n, high=MAX_RODS)
    mass = _checks.positive_number("mass", mass)
    length = _checks.positive_number("length", length)
    equal = np.full(n, mass), np.full(n, length)
    return cls(*equal, gravity, damping, drag, quadratic_drag)
