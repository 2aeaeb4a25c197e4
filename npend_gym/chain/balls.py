"""Solid balls on a chain: their mass and inertia, and what a fluid at rest makes of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray


class Balls:
    """Solid balls whose centres are the joints of a chain.

    Parameters
    ----------
    n : int
        Number of balls.
    radius, spacing : float or array_like, shape (n,)
        Of each ball, and from its centre to that of the ball above or to the pivot [m].
    density : float or array_like, shape (n,)
        Of each ball [kg/m^3].

    Raises
    ------
    TypeError, ValueError
        If an argument breaks its rule, or balls overlap.
    """

    radius: FloatArray
    spacing: FloatArray
    density: FloatArray
    volume: FloatArray
    inertias: FloatArray

    def __init__(self, n: int, radius: ArrayLike, spacing: ArrayLike, density: ArrayLike) -> None:
        self.radius = _checks.positive("radius", _checks.vector("radius", radius, n))
        self.spacing = _checks.positive("spacing", _checks.vector("spacing", spacing, n))
        self.density = _checks.positive("density", _checks.vector("density", density, n))
        self.volume = 4.0 / 3.0 * np.pi * (self.radius * self.radius * self.radius)
        self.inertias = 0.4 * self.volume * self.density * self.radius**2  # about the centre
        needed = self.radius + np.concatenate([[0.0], self.radius[:-1]])
        if np.any(self.spacing < needed):
            ball = int(np.argmax(self.spacing < needed))
            above = "the ball above" if ball else "the pivot"
            raise ValueError(
                f"spacing must keep each ball apart from {above}: that of ball {ball} must be at "
                f"least {needed[ball]:g} m, got {self.spacing[ball]:g}"
            )

    def immersed(
        self, gravity: float, fluid_density: float, viscosity: float, drag_coefficient: float
    ) -> dict[str, Any]:
        """Return `masses`, `gravity` and drag of the chain in a fluid, or in vacuum.

        With m = rho V and m_f = rho_f V a ball has the weight (m - m_f) g and the inertia
        m + m_f/2. Their ratio, the gravity of the chain, depends on rho alone.

        Raises
        ------
        TypeError, ValueError
            If an argument breaks its rule, or balls in a fluid have unequal densities or rise.
        """
        fluid = _checks.nonnegative_number("fluid_density", fluid_density)
        coefficient = _checks.nonnegative_number("drag_coefficient", drag_coefficient)
        if coefficient > 0.0 and fluid == 0.0:
            raise ValueError(
                "drag_coefficient is that of a fluid: fluid_density must be given with it, such as "
                f"1.2 for air [kg/m^3], got drag_coefficient {coefficient:g} alone"
            )
        if fluid > 0.0 and np.ptp(self.density) > 0.0:
            raise ValueError(
                "density must be one for all balls in a fluid, because a chain has one gravity; "
                f"got {_checks.show(self.density.tolist())}"
            )
        density = float(self.density[0])
        if density <= fluid:
            raise ValueError(
                f"density must exceed fluid_density, {fluid:g} kg/m^3, because lighter balls rise; "
                f"got {density:g}"
            )
        ratio = (density - fluid) / (density + 0.5 * fluid)
        return {
            "masses": self.volume * (self.density + 0.5 * fluid),
            "gravity": ratio * _checks.nonnegative_number("gravity", gravity),
            "drag": 6.0 * np.pi * _checks.nonnegative_number("viscosity", viscosity) * self.radius,
            "quadratic_drag": 0.5 * coefficient * fluid * np.pi * self.radius**2,
        }
