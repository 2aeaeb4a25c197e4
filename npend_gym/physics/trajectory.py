"""The motion of a chain at given times, and the file that keeps it."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from npend_gym import _checks, _files
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain, ChainParameters
from npend_gym.physics import energy as _energy
from npend_gym.physics.pivot import Pivot, check_pivot
from npend_gym.physics.springs import Springs, check_springs, stretched, stretching

OF_PIVOT = ("pivot_position", "pivot_velocity")  # arrays that are there where it moves
AXIAL = ("stretch", "stretch_rate")  # and where rods stretch
MAX_BYTES = 2**33  # of the angles and velocities of a trajectory


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The motion of a chain at given times.

    Attributes
    ----------
    chain : Chain
    times : ndarray, shape (T,)
        Instants [s].
    theta : ndarray, shape (T, n)
        Angles [rad], unwrapped.
    omega : ndarray, shape (T, n)
        Angular velocities [rad/s].
    provenance : dict
        What made it: versions, method, tolerances, torque, motion of the pivot.
    pivot : Pivot
        How the pivot moves.
    pivot_position, pivot_velocity : ndarray, shape (T, 2)
        Of the pivot, sideways and up, from its place at ``times[0]`` [m and m/s]; None where it
        is at rest.
    springs : Springs
        What the rods are where they stretch; None where they are rigid.
    stretch, stretch_rate : ndarray, shape (T, n)
        How much longer the rods are than ``chain.lengths`` [m], and its rate [m/s]; None where
        they are rigid.

    Notes
    -----
    Positions, velocities and energy are relative to the pivot, also where it moves. Of B motions
    side by side `theta` and `omega` have the shape (B, T, n), and what follows from them has the
    same leading axis.
    """

    chain: Chain
    times: FloatArray
    theta: FloatArray
    omega: FloatArray
    provenance: dict[str, Any] = field(default_factory=dict[str, Any])
    pivot: Pivot = field(default_factory=Pivot)
    pivot_position: FloatArray | None = None
    pivot_velocity: FloatArray | None = None
    springs: Springs | None = None
    stretch: FloatArray | None = None
    stretch_rate: FloatArray | None = None

    @property
    def _rods(self) -> Chain | ChainParameters:
        return self.chain if self.stretch is None else stretched(self.chain, self.stretch)

    def lengths(self) -> FloatArray:
        """Return the lengths of the rods [m], shape (T, n)."""
        return np.broadcast_to(self._rods.lengths, self.theta.shape).copy()

    def positions(self) -> FloatArray:
        """Return the positions of the bobs [m], shape (T, n, 2)."""
        return _energy.positions(self._rods, self.theta)

    def centres(self) -> FloatArray:
        """Return the positions of the links' centres of mass [m], shape (T, n, 2)."""
        return _energy.centres(self._rods, self.theta)

    def bodies(self) -> FloatArray:
        """Return `centres` where links are bodies, for pictures; for point masses (T, 0, 2)."""
        return _energy.bodies(self.chain, self.theta)

    def velocities(self) -> FloatArray:
        """Return the velocities of the bobs [m/s], shape (T, n, 2)."""
        turning = _energy.velocities(self._rods, self.theta, self.omega)
        if self.stretch_rate is None:
            return turning
        return turning + stretching(self.chain, self.theta, self.stretch_rate)

    def kinetic_energy(self) -> FloatArray:
        """Return the kinetic energy [J], shape (T,)."""
        if self.springs is None:
            return _energy.kinetic_energy(self.chain, self.theta, self.omega)
        speed_squared = np.sum(self.velocities() ** 2, axis=-1)
        return 0.5 * np.sum(self.chain.masses * speed_squared, axis=-1)

    def energy(self) -> FloatArray:
        """Return the energy above hanging at rest [J], shape (T,); springs are stretched there."""
        if self.springs is None or self.stretch is None:
            return _energy.energy(self.chain, self.theta, self.omega)
        potential = self.springs.potential_energy(self.chain, self.theta, self.stretch)
        return self.kinetic_energy() + potential

    def cart(self, position: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Return position [m] and velocity [m/s] of the cart, shape (T,) each.

        Parameters
        ----------
        position : float
            That at ``times[0]``. The motion does not depend on it.

        Raises
        ------
        ValueError, TypeError
            If there is no cart, or `position` is no number.
        """
        place, velocity = self.pivot_position, self.pivot_velocity
        if self.pivot.cart_mass is None or place is None or velocity is None:
            raise ValueError("cart() needs a trajectory made by simulate(..., cart_mass=...)")
        return _checks.number("position", position) + place[:, 0], velocity[:, 0].copy()

    def save(self, path: str | PathLike[str]) -> None:
        """Write the trajectory to `path` as an npz archive, whole or not at all.

        Raises
        ------
        OSError
            If `path` cannot be written.
        """
        about = json.dumps(
            {
                "chain": self.chain.as_dict(),
                "pivot": self.pivot.as_dict(),
                "springs": self.springs and self.springs.as_dict(),
                "provenance": self.provenance,
            }
        )
        names = ("times", "theta", "omega", *OF_PIVOT, *AXIAL)
        arrays = {name: getattr(self, name) for name in names}
        arrays = {name: array for name, array in arrays.items() if array is not None}
        with _files.replacing(Path(path), binary=True) as file:
            np.savez_compressed(file, about=np.array(about), **arrays)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Trajectory:
        """Read what `save` wrote; nothing in the file is executed.

        Raises
        ------
        ValueError
            If the file is not a whole trajectory.
        OSError
            If `path` cannot be read.
        """
        try:
            return _read(Path(path))
        except (KeyError, ValueError, TypeError, RecursionError) as error:
            raise ValueError(
                f"path must name a trajectory made by save(); {path}: {error}"
            ) from error


def _read(path: Path) -> Trajectory:
    """Return the trajectory in an npz archive, every part of it checked."""
    data = _files.read_arrays(path, 2 * MAX_BYTES)
    about = json.loads(str(data["about"]))
    times, theta, omega = (_checks.array(name, data[name]) for name in ("times", "theta", "omega"))
    chain = Chain.from_dict(about["chain"])
    shape = (times.size, chain.n)
    if times.ndim != 1 or theta.shape[-2:] != shape or omega.shape != theta.shape:
        raise ValueError(f"theta and omega must have the shape {shape}, or (B, *{shape})")
    if not isinstance(about["provenance"], dict):
        raise TypeError("its provenance must be a dict")
    pivot = check_pivot(**about["pivot"])
    given: dict[str, Any] = about.get("springs") or {}
    springs = check_springs(chain, **given)
    beyond: dict[str, FloatArray] = {}
    for names, width in ((OF_PIVOT, 2 * pivot.moves), (AXIAL, chain.n * (springs is not None))):
        for name in names if width else ():
            beyond[name] = _checks.array(name, data[name])
            if beyond[name].shape != (times.size, width):
                raise ValueError(f"{name} must have the shape {(times.size, width)}")
    return Trajectory(
        chain, times, theta, omega, about["provenance"], pivot, springs=springs, **beyond
    )
