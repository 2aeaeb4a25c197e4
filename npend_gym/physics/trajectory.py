"""The motion of a chain at given times."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import wraps
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._faces import MethodFromAbove
from npend_gym.chain import Chain, ChainParameters
from npend_gym.physics import energy as _energy
from npend_gym.physics.pivot import Pivot
from npend_gym.physics.springs import Springs, stretched, stretching

if TYPE_CHECKING:
    from npend_gym.physics.adaptive import Motion
    from npend_gym.physics.sensitivities import MotionGradient, Sensitivities

OF_PIVOT = ("pivot_position", "pivot_velocity")  # arrays that are there where it moves
AXIAL = ("stretch", "stretch_rate")  # and where rods stretch
EVENTS = ("t_events", "theta_events", "omega_events")
MAX_BYTES = 2**33  # of the angles and velocities of a trajectory
_STAGES, _DENSE = 12, 3  # evaluations in a step, and more for dense output

IntArray = NDArray[np.int64]


class Integration(NamedTuple):
    """How `simulate` took the steps of a motion."""

    method: str
    torque: FloatArray  # on every joint [N m], (n,)
    settings: dict[str, float]  # "rtol" and "atol", or "dt"


def _each_chain(method: Callable[[Trajectory], FloatArray]) -> Callable[[Trajectory], FloatArray]:
    """Let a method do for motions of chains that differ: one by one."""

    @wraps(method)
    def of_each(self: Trajectory) -> FloatArray:
        if self.chains:
            return np.array([method(self[k]) for k in range(len(self))])
        return method(self)

    return of_each


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The motion of a chain at given times.

    Attributes
    ----------
    chain : Chain
        The first of them, where those of many motions differ: see `chains`.
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
        processor, or torques changed in time.
    status : int
        0 where the motion reached the last of the times that were asked for, 1 where a terminal
        event ended it; shape (B,) for many motions.
    t_events, theta_events, omega_events : list
        For each event its instants [s], shape (k,), and the states there, (k, n) each; for many
        motions a list of such arrays.
    counts : ndarray of int, shape (3,) or (3, B)
        Steps taken, steps refused, and steps in which states were interpolated.
    chains : tuple of Chain
        That of each motion, where they differ.
    motion : Motion
        What `at` integrates again; None where it is made from `integration`.

    Notes
    -----
    Positions, velocities and energy are relative to the pivot, also where it moves. Of B motions
    side by side `theta` and `omega` have the shape (B, T, n), and what follows from them has the
    same leading axis; `trajectory[k]` is one of them, a trajectory of its own.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, simulate
    >>> motion = simulate(Chain.uniform(2), 1.0, 0.0, np.linspace(0.0, 2.0, 21))
    >>> motion.positions().shape
    (21, 2, 2)
    >>> theta, omega = motion.at(1.23)
    >>> theta.round(4).tolist()
    [-0.8631, -1.0712]
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
    status: Any = 0
    t_events: list[Any] = field(default_factory=list[Any])
    theta_events: list[Any] = field(default_factory=list[Any])
    omega_events: list[Any] = field(default_factory=list[Any])
    counts: IntArray | None = field(default=None, repr=False)
    chains: tuple[Chain, ...] = field(default=(), repr=False)
    motion: Motion | None = field(default=None, repr=False)

    plot = MethodFromAbove("npend_gym.report.notebook:plot")
    animate = MethodFromAbove("npend_gym.report.notebook:animate")
    _repr_html_ = MethodFromAbove("npend_gym.report.notebook:as_html")

    @property
    def nfev(self) -> Any:
        """How often the equations were evaluated, as SciPy counts; (B,) for many motions."""
        taken, refused, dense = self._counted
        return 2 + _STAGES * taken + (_STAGES - 1) * refused + _DENSE * dense

    @property
    def steps(self) -> Any:
        """How many steps were taken; (B,) for many motions."""
        return self._counted[0]

    @property
    def refused_steps(self) -> Any:
        """How many more were tried, and taken shorter; (B,) for many motions."""
        return self._counted[1]

    @property
    def _counted(self) -> IntArray:
        if self.counts is None:
            raise ValueError(
                'steps are counted where simulate(..., method="dop853") took them, not those of a '
                'trajectory from a file, of a GPU or of "rk4"'
            )
        return self.counts

    def __len__(self) -> int:
        """Return the number of motions side by side.

        Raises
        ------
        TypeError
            If there is one alone.
        """
        if self.theta.ndim < 3:
            raise TypeError("a trajectory of one motion has no length; len(times) is that of times")
        return len(self.theta)

    def __getitem__(self, k: int) -> Trajectory:
        """Return the motion `k` of many."""
        count = len(self)
        if not -count <= k < count:
            raise IndexError(f"motion must be from {-count} to {count - 1}, got {k}")
        own: dict[str, Any] = {
            name: None if value is None else value[k]
            for name in ("pivot_position", "pivot_velocity", "stretch", "stretch_rate")
            for value in [getattr(self, name)]
        }
        made = self.integration
        if made is not None and made.torque.ndim == 2:
            made = made._replace(torque=made.torque[k])
        return Trajectory(
            self.chains[k] if self.chains else self.chain,
            self.times, self.theta[k], self.omega[k], self.provenance, self.pivot,
            springs=self.springs, integration=made, status=np.broadcast_to(self.status, count)[k],
            t_events=[each[k] for each in self.t_events],
            theta_events=[each[k] for each in self.theta_events],
            omega_events=[each[k] for each in self.omega_events],
            counts=None if self.counts is None else self.counts[:, k], **own,
        )  # fmt: skip

    def at(self, times: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return angles and angular velocities at any instants: the dense output.

        Parameters
        ----------
        times : array_like, shape (...)
            Instants [s], within the first and the last of the motion.

        Returns
        -------
        theta, omega : ndarray, shape (..., n), or (B, ..., n)

        Raises
        ------
        ValueError, TypeError
            If an instant lies outside, or the motion was not made by `simulate` with "dop853".

        Notes
        -----
        The polynomials of order 7 on the steps that were taken. The first call integrates once
        more and keeps the steps, eight states for each.
        """
        if self.theta.ndim > 2:
            each = [self[k].at(times) for k in range(len(self))]
            return np.array([theta for theta, _ in each]), np.array([omega for _, omega in each])
        from npend_gym.physics.simulation import motion_of

        given, (first, last) = _checks.array("times", times), self.times[[0, -1]]
        if np.any((given < first) | (given > last)):
            raise ValueError(
                f"times must lie within the motion, {first:g} to {last:g} s, got "
                f"{_checks.show(given.tolist())}"
            )
        motion, n = self.motion or motion_of(self), self.chain.n
        if first == last:
            states = np.broadcast_to(motion.state, (*given.shape, motion.state.size))
        else:
            states = motion.steps.at(given)
        half = states.shape[-1] // 2
        return states[..., :n].copy(), states[..., half : half + n].copy()

    @property
    def _rods(self) -> Chain | ChainParameters:
        return self.chain if self.stretch is None else stretched(self.chain, self.stretch)

    @_each_chain
    def lengths(self) -> FloatArray:
        """Return the lengths of the rods [m], shape (T, n)."""
        return np.broadcast_to(self._rods.lengths, self.theta.shape).copy()

    @_each_chain
    def positions(self) -> FloatArray:
        """Return the positions of the bobs [m], shape (T, n, 2)."""
        return _energy.positions(self._rods, self.theta)

    @_each_chain
    def centres(self) -> FloatArray:
        """Return the positions of the links' centres of mass [m], shape (T, n, 2)."""
        return _energy.centres(self._rods, self.theta)

    @_each_chain
    def bodies(self) -> FloatArray:
        """Return `centres` where links are bodies, for pictures; for point masses (T, 0, 2)."""
        return _energy.bodies(self.chain, self.theta)

    @_each_chain
    def velocities(self) -> FloatArray:
        """Return the velocities of the bobs [m/s], shape (T, n, 2)."""
        turning = _energy.velocities(self._rods, self.theta, self.omega)
        if self.stretch_rate is None:
            return turning
        return turning + stretching(self.chain, self.theta, self.stretch_rate)

    @_each_chain
    def kinetic_energy(self) -> FloatArray:
        """Return the kinetic energy [J], shape (T,)."""
        if self.springs is None:
            return _energy.kinetic_energy(self.chain, self.theta, self.omega)
        speed_squared = np.sum(self.velocities() ** 2, axis=-1)
        return 0.5 * np.sum(self.chain.masses * speed_squared, axis=-1)

    @_each_chain
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
        ValueError
            If `path` ends in something other than ".npz"; `to_csv` writes text.
        OSError
            If `path` cannot be written.
        """
        from npend_gym.physics.trajectory_file import write_trajectory

        write_trajectory(self, Path(path))

    def to_csv(self, path: str | PathLike[str]) -> None:
        """Write times, angles and angular velocities to `path` as text, whole or not at all.

        The columns are ``time`` [s], ``theta0``, ... [rad] and ``omega0``, ... [rad/s], and where
        the motion had a constant torque ``tau0``, ... [N m]: the form that `npend identify` and
        `identification.read_motion` read. Numbers are read back to the same bits.

        Raises
        ------
        ValueError
            If these are many motions side by side.
        OSError
            If `path` cannot be written.
        """
        from npend_gym.physics.trajectory_file import write_csv

        write_csv(self, Path(path))

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
