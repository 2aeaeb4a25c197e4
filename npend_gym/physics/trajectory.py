"""The motion of a chain at given times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain, ChainParameters
from npend_gym.physics import energy as _energy
from npend_gym.physics.pivot import Pivot
from npend_gym.physics.springs import Springs, stretched, stretching

if TYPE_CHECKING:
    from npend_gym.physics.sensitivities import MotionGradient, Sensitivities

OF_PIVOT = ("pivot_position", "pivot_velocity")  # arrays that are there where it moves
AXIAL = ("stretch", "stretch_rate")  # and where rods stretch
MAX_BYTES = 2**33  # of the angles and velocities of a trajectory


class Integration(NamedTuple):
    """How `simulate` took the steps of a motion."""

    method: str
    torque: FloatArray  # on every joint [N m], (n,)
    settings: dict[str, float]  # "rtol" and "atol", or "dt"


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
    integration : Integration
        How its steps were taken; None where `simulate` did not take them on this machine's
        processor.

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
    integration: Integration | None = None

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

    def sensitivities(
        self, joints: Sequence[int] = (0,), parameters: Mapping[str, ArrayLike] | None = None
    ) -> Sensitivities:
        """Return the derivatives of theta and omega at all times by what the motion began with.

        Parameters
        ----------
        joints : sequence of int
            Joints by whose torques derivatives are wanted.
        parameters : mapping of str to array_like, shape (K, n), optional
            K directions in which parameters of the chain change together, by their names in
            `Chain`; the shape for gravity is (K,). ``{"masses": np.eye(n)}`` is each mass alone.

        Returns
        -------
        Sensitivities
            A, shape (T, 2n, 2n), by the state at ``times[0]``; B, shape (T, 2n, len(joints)), by
            the torques; C, shape (T, 2n, K), along the directions.

        Raises
        ------
        ValueError, TypeError
            If an argument breaks its rule, the motion is not one of rigid rods on a pivot at rest,
            made by `simulate`, or the derivatives would take more than 8 GB.
        FloatingPointError
            If derivatives grow beyond all bounds.

        Notes
        -----
        They are the derivatives of the steps that were taken, to rounding, their lengths held
        fixed: for "dop853" those of each accepted step and of the polynomial between its ends. The
        steps are not kept: the motion is integrated once more, with the same bits. The time grows
        as the number of derivatives, the memory is that of the result.
        """
        from npend_gym.physics.sensitivities import sensitivities

        return sensitivities(self, joints, parameters)

    def gradient(
        self, theta_bar: ArrayLike, omega_bar: ArrayLike, parameters: Sequence[str] = ()
    ) -> MotionGradient:
        """Return the gradient of a function of this motion by what the motion began with.

        Parameters
        ----------
        theta_bar, omega_bar : array_like, shape (T, n)
            Derivatives of the function by `theta` and `omega` at all times; one number stands for
            all.
        parameters : sequence of str
            Names of the parameters of `Chain` by which derivatives are wanted as well.

        Returns
        -------
        MotionGradient
            `by_theta` and `by_omega`, of the state at ``times[0]``, `by_torque` on every joint,
            shape (n,) each, and `by_parameters`, a dict.

        Raises
        ------
        ValueError, TypeError, FloatingPointError
            As for `sensitivities`.

        Notes
        -----
        It goes back through the steps that `sensitivities` goes forward through, and takes the same
        time for one derivative or all. Of S steps it holds some 6 sqrt(S) states at a time: the
        motion is integrated twice.
        """
        from npend_gym.physics.sensitivities import gradient

        return gradient(self, theta_bar, omega_bar, parameters)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the trajectory to `path` as an npz archive, whole or not at all.

        Raises
        ------
        OSError
            If `path` cannot be written.
        """
        from npend_gym.physics.trajectory_file import write_trajectory

        write_trajectory(self, Path(path))

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
        from npend_gym.physics.trajectory_file import read_trajectory

        return read_trajectory(Path(path))
