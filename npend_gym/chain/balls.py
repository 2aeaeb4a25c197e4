"""Solid balls on a chain: their mass and inertia, and what a fluid at rest makes of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks


def ball_parameters(
    n: int, radius: ArrayLike, spacing: ArrayLike, density: ArrayLike, *, gravity: float,
    fluid_density: float, viscosity: float, drag_coefficient: float,
) -> dict[str, Any]:  # fmt: skip
    """Return parameters of the chain that `Chain.spheres` describes, with turning balls.

    With m = rho V and m_f = rho_f V a ball in a fluid has the weight (m - m_f) g and the inertia
    m + m_f/2. Their ratio, the gravity of the chain, depends on rho alone.

    Raises
    ------
    TypeError, ValueError
        If an argument breaks its rule, balls overlap, or balls in a fluid have unequal densities or
        rise.
    """
    radii = _checks.positive("radius", _checks.vector("radius", radius, n))
    lengths = _checks.positive("spacing", _checks.vector("spacing", spacing, n))
    densities = _checks.positive("density", _checks.vector("density", density, n))
    volume = 4.0 / 3.0 * np.pi * (radii * radii * radii)
    needed = radii + np.concatenate([[0.0], radii[:-1]])
    if np.any(lengths < needed):
        ball = int(np.argmax(lengths < needed))
        above = "the ball above" if ball else "the pivot"
        raise ValueError(
            f"spacing must keep each ball apart from {above}: that of ball {ball} must be at "
            f"least {needed[ball]:g} m, got {lengths[ball]:g}"
        )
    fluid = _checks.nonnegative_number("fluid_density", fluid_density)
    coefficient = _checks.nonnegative_number("drag_coefficient", drag_coefficient)
    if coefficient > 0.0 and fluid == 0.0:
        raise ValueError(
            "drag_coefficient is that of a fluid: fluid_density must be given with it, such as "
            f"1.2 for air [kg/m^3], got drag_coefficient {coefficient:g} alone"
        )
    if fluid > 0.0 and np.ptp(densities) > 0.0:
        raise ValueError(
            "density must be one for all balls in a fluid, because a chain has one gravity; "
            f"got {_checks.show(densities.tolist())}"
        )
    own = float(densities[0])
    if own <= fluid:
        raise ValueError(
            f"density must exceed fluid_density, {fluid:g} kg/m^3, because lighter balls rise; "
            f"got {own:g}"
        )
    ratio = (own - fluid) / (own + 0.5 * fluid)
    return {
        "lengths": lengths,
        "masses": volume * (densities + 0.5 * fluid),
        "inertias": 0.4 * volume * densities * radii**2,  # about the centre
        "gravity": ratio * _checks.nonnegative_number("gravity", gravity),
        "drag": 6.0 * np.pi * _checks.nonnegative_number("viscosity", viscosity) * radii,
        "quadratic_drag": 0.5 * coefficient * fluid * np.pi * radii**2,
    }
