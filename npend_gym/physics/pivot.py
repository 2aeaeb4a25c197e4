"""A pivot that moves: accelerated as prescribed, or a cart on a rail that a force pushes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.physics.kernels.link_terms import Base


@dataclass(frozen=True)
class Pivot:
    """How the pivot of a chain moves; by default it is at rest.

    Attributes
    ----------
    acceleration : (float, float), optional
        Constant acceleration sideways and up [m/s^2], where it is prescribed.
    cart_mass : float, optional
        Mass [kg] of the cart, where one carries the pivot.
    force : float
        Constant horizontal force on the cart [N].
    rail_damping : float
        Viscous damping of the cart on its rail [N s/m].
    velocity : (float, float)
        Of the pivot at the start, sideways and up [m/s].
    """

    acceleration: tuple[float, float] | None = None
    cart_mass: float | None = None
    force: float = 0.0
    rail_damping: float = 0.0
    velocity: tuple[float, float] = (0.0, 0.0)

    @property
    def moves(self) -> bool:
        """Whether the pivot is not at rest."""
        return self.cart_mass is not None or self.acceleration is not None

    @property
    def base(self) -> FloatArray | None:
        """The entries of `kernels.link_terms.Base`, shape (4,); None where the pivot is at rest."""
        if not self.moves:
            return None
        entries = np.zeros(len(Base))
        if self.cart_mass is not None:
            entries[Base.INVERSE_MASS] = 1.0 / self.cart_mass
            entries[Base.DAMPING] = self.rail_damping
        if self.acceleration is not None:
            entries[Base.ACROSS], entries[Base.UP] = self.acceleration
        return entries

    def as_dict(self) -> dict[str, Any]:
        """Return the attributes as plain numbers and lists, ready for JSON."""
        return {
            "acceleration": None if self.acceleration is None else list(self.acceleration),
            "cart_mass": self.cart_mass,
            "force": self.force,
            "rail_damping": self.rail_damping,
            "velocity": list(self.velocity),
        }


def check_pivot(
    acceleration: ArrayLike | None = None,
    cart_mass: float | None = None,
    force: float = 0.0,
    rail_damping: float = 0.0,
    velocity: ArrayLike = 0.0,
) -> Pivot:
    """Return the motion of the pivot that the arguments of `simulate` describe.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, or they contradict each other.
    """
    force = _checks.number("force", force)
    rail_damping = _checks.nonnegative_number("rail_damping", rail_damping)
    if cart_mass is None:
        for name, value in (("force", force), ("rail_damping", rail_damping)):
            if value != 0.0:
                raise ValueError(
                    f"{name} acts on the cart: cart_mass must be given with it, got {value:g}"
                )
    if cart_mass is None and acceleration is None:
        if np.any(_checks.array("pivot_velocity", velocity)):
            raise ValueError(
                "pivot_velocity needs a pivot that moves: give cart_mass or pivot_acceleration"
            )
        return Pivot()
    start = _pair("pivot_velocity", velocity if np.ndim(velocity) else (velocity, 0.0))
    if acceleration is None:
        mass = _checks.positive_number("cart_mass", cart_mass)
        if start[1] != 0.0:
            raise ValueError(f"pivot_velocity must be 0 upwards for a cart, got {start[1]:g}")
        return Pivot(None, mass, force, rail_damping, start)
    if cart_mass is not None:
        raise ValueError(
            "pivot_acceleration must be None with cart_mass, because forces move a cart"
        )
    return Pivot(_pair("pivot_acceleration", acceleration), velocity=start)


def _pair(name: str, value: Any) -> tuple[float, float]:
    given = _checks.array(name, value)
    if given.shape != (2,):
        raise ValueError(f"{name} must be two numbers, sideways and up, got {_checks.show(given)}")
    return float(given[0]), float(given[1])
