"""A pivot that moves: accelerated as prescribed, or a cart on a rail that a force pushes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.physics.energy import positions, velocities
from npend_gym.physics.kernels.dynamics import Rods, pack_rods


def checked_pivot(
    chain: Chain, acceleration: ArrayLike | None, cart_mass: float | None, force: float
) -> dict[str, Any]:
    """Return how the pivot moves, for `rods_on` and the provenance; nothing where it does not."""
    force = _checks.number("force", force)
    if cart_mass is None and force != 0.0:
        raise ValueError(f"force pushes the cart: cart_mass must be given with it, got {force:g}")
    if cart_mass is None and acceleration is None:
        return {}
    if chain.has_drag:
        raise ValueError(
            "drag is known where the pivot rests only: with pivot_acceleration or cart_mass, "
            "drag and quadratic_drag of the chain must be 0"
        )
    if acceleration is None:
        return {"cart_mass": _checks.positive_number("cart_mass", cart_mass), "force": force}
    if cart_mass is not None:
        raise ValueError("pivot_acceleration must be None with cart_mass, for forces move a cart")
    given = _checks.array("pivot_acceleration", acceleration)
    if given.shape != (2,):
        raise ValueError(
            f"pivot_acceleration must be two numbers, sideways and up, got {_checks.show(given)}"
        )
    return {"pivot_acceleration": given.tolist()}


def rods_on(chain: Chain, pivot: dict[str, Any]) -> Rods:
    """Return the parameters of `chain` for the kernels, its pivot moving as `checked_pivot` says.

    In the frame of an accelerated pivot there is more gravity, or less: upwards it is g + y''.
    """
    rods = pack_rods(chain)
    if "cart_mass" in pivot:
        inverse = 1.0 / pivot["cart_mass"]
        return rods._replace(pivot=np.array([pivot["force"] * inverse, inverse]))
    if "pivot_acceleration" in pivot:
        sideways, up = pivot["pivot_acceleration"]
        return rods._replace(gravity=rods.gravity + up, pivot=np.array([sideways, 0.0]))
    return rods


def cart_motion(
    chain: Chain,
    times: FloatArray,
    theta: FloatArray,
    omega: FloatArray,
    pivot: dict[str, Any],
    start: tuple[float, float],
) -> tuple[FloatArray, FloatArray]:
    """Return position [m] and velocity [m/s] of the cart, (T,) each, from the centre of mass.

    The force is all that acts sideways on cart and chain together, so that their centre of mass
    moves as if it alone were pushed: nothing needs to be integrated.
    """
    total = pivot["cart_mass"] + float(chain.masses.sum())
    lever = positions(chain, theta)[..., 0] @ chain.masses / total  # of the chain, from the cart
    drift = velocities(chain, theta, omega)[..., 0] @ chain.masses / total
    since, pushed = times - times[0], pivot["force"] / total
    centre_velocity = start[1] + drift[0] + pushed * since
    centre = start[0] + lever[0] + (start[1] + drift[0] + 0.5 * pushed * since) * since
    return centre - lever, centre_velocity - drift
