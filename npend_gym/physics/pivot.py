"""A pivot that moves: accelerated as prescribed, or a cart on a rail that a force pushes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.physics.energy import positions, velocities
from npend_gym.physics.kernels.dynamics import ChainArrays, chain_arrays


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
    """

    acceleration: tuple[float, float] | None = None
    cart_mass: float | None = None
    force: float = 0.0

    def as_dict(self) -> dict[str, Any]:
        """Return the attributes as plain numbers and lists, ready for JSON."""
        acceleration = None if self.acceleration is None else list(self.acceleration)
        return {"acceleration": acceleration, "cart_mass": self.cart_mass, "force": self.force}


def check_pivot(
    chain: Chain,
    acceleration: ArrayLike | None = None,
    cart_mass: float | None = None,
    force: float = 0.0,
) -> Pivot:
    """Return the motion of the pivot of `chain` that the arguments of `simulate` describe.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, or they contradict each other.
    """
    force = _checks.number("force", force)
    if cart_mass is None and force != 0.0:
        raise ValueError(f"force pushes the cart: cart_mass must be given with it, got {force:g}")
    if cart_mass is None and acceleration is None:
        return Pivot()
    if chain.has_drag:
        raise ValueError(
            "drag is known only where the pivot rests: with pivot_acceleration or cart_mass, "
            "drag and quadratic_drag of the chain must be 0"
        )
    if acceleration is None:
        mass = _checks.positive_number("cart_mass", cart_mass)
        return Pivot(cart_mass=mass, force=force)
    if cart_mass is not None:
        raise ValueError(
            "pivot_acceleration must be None with cart_mass, because forces move a cart"
        )
    given = _checks.array("pivot_acceleration", acceleration)
    if given.shape != (2,):
        raise ValueError(
            f"pivot_acceleration must be two numbers, sideways and up, got {_checks.show(given)}"
        )
    return Pivot(acceleration=(float(given[0]), float(given[1])))


def kernel_arguments(chain: Chain, pivot: Pivot) -> ChainArrays:
    """Return the parameters of `chain`, with its pivot, in the form that the kernels take.

    In the frame of an accelerated pivot there is more gravity, or less: upwards it is g + y''.
    """
    rods = chain_arrays(chain)
    if pivot.cart_mass is not None:
        inverse = 1.0 / pivot.cart_mass
        return rods._replace(pivot=np.array([pivot.force * inverse, inverse]))
    if pivot.acceleration is not None:
        sideways, up = pivot.acceleration
        return rods._replace(gravity=rods.gravity + up, pivot=np.array([sideways, 0.0]))
    return rods


def cart_motion(
    chain: Chain,
    pivot: Pivot,
    times: FloatArray,
    theta: FloatArray,
    omega: FloatArray,
    start: tuple[float, float],
) -> tuple[FloatArray, FloatArray]:
    """Return position [m] and velocity [m/s] of the cart, (T,) each, from the centre of mass.

    The force is all that acts sideways on cart and chain together, so that their centre of mass
    moves as if it alone were pushed: nothing needs to be integrated. `start` has position and
    velocity at ``times[0]``.
    """
    if pivot.cart_mass is None:
        raise ValueError("cart() needs a trajectory made by simulate(..., cart_mass=...)")
    total = pivot.cart_mass + float(chain.masses.sum())
    lever = positions(chain, theta)[..., 0] @ chain.masses / total  # of the chain, from the cart
    drift = velocities(chain, theta, omega)[..., 0] @ chain.masses / total
    elapsed, pushed = times - times[0], pivot.force / total
    centre_velocity = start[1] + drift[0] + pushed * elapsed
    centre = start[0] + lever[0] + (start[1] + drift[0] + 0.5 * pushed * elapsed) * elapsed
    return centre - lever, centre_velocity - drift
