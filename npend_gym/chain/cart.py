"""The cart that may carry the pivot of a chain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

from npend_gym import _checks


@dataclass(frozen=True)
class Cart:
    """A cart on a horizontal rail, which carries the pivot of a chain.

    Parameters
    ----------
    mass : float
        [kg], greater than zero.
    damping : float
        Viscous damping on the rail [N s/m], zero or more.

    Raises
    ------
    TypeError, ValueError
        If an argument breaks its rule.

    Examples
    --------
    >>> from npend_gym import Cart, Chain
    >>> Chain.uniform(2, base=Cart(1.0)).base
    Cart(mass=1.0, damping=0.0)
    """

    mass: float
    damping: float = 0.0

    def __post_init__(self) -> None:
        """Check the arguments."""
        object.__setattr__(self, "mass", _checks.positive_number("mass of a cart", self.mass))
        damping = _checks.nonnegative_number("damping of a cart", self.damping)
        object.__setattr__(self, "damping", damping)

    def as_dict(self) -> dict[str, float]:
        """Return the attributes as plain numbers, for JSON."""
        return {"mass": self.mass, "damping": self.damping}


def as_base(value: Any) -> Cart | None:
    """Check what carries a chain: None, a `Cart`, or the cart of which `value` is the dict.

    Raises
    ------
    TypeError, ValueError
        If it is none of them.
    """
    if value is None or isinstance(value, Cart):
        return value
    if not isinstance(value, Mapping):
        raise TypeError(
            f"base must be None or a Cart, such as Cart(mass=1.0), got {_checks.show(value)}"
        )
    given = cast("Mapping[str, Any]", value)
    if not {"mass"} <= set(given) <= {"mass", "damping"}:
        raise ValueError(
            f"base must have the keys mass and damping, got {', '.join(map(str, given)) or 'none'}"
        )
    return Cart(**given)
