"""Trajectories: `simulate` integrates a chain, `Trajectory` holds the result."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks, _files
from npend_gym._checks import FloatArray
from npend_gym._version import __version__
from npend_gym.chain import Chain, check_chain
from npend_gym.compiled.sincos import MAX_ANGLE
from npend_gym.physics import energy as _energy
from npend_gym.physics.equations import joint_torques
from npend_gym.physics.kernels.dop853 import dop853_frames, new_solver
from npend_gym.physics.kernels.dynamics import Rods, new_work
from npend_gym.physics.kernels.lanes import MAX_SPEED
from npend_gym.physics.kernels.rk4 import STAGE_ROWS, rk4_frames
from npend_gym.physics.pivot import cart_motion, checked_pivot, rods_on

METHODS = ("dop853", "rk4")
MIN_RTOL = 1e-14
MAX_FRAME_BYTES = 2**33  # of the angles and velocities of a trajectory
_MAX_STEPS = 10**12  # between two times
_RODS_PER_CALL = (
    500_000  # rods times steps in one compiled call: about a second, then Ctrl-C is heard
)


class IntegrationError(RuntimeError):
    """The integration cannot go on: the state has diverged, or the tolerance is out of reach."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The motion of a chain at given times.

    Attributes
    ----------
    chain : Chain
    times : ndarray, shape (T,)
        Instants [s].
    theta, omega : ndarray, shape (T, n)
        Angles [rad], unwrapped, and angular velocities [rad/s].
    provenance : dict
        What made it: package version, method, tolerances, torque, motion of the pivot.

    Notes
    -----
    Positions, velocities and energy are those relative to the pivot, also where it moves.
    """

    chain: Chain
    times: FloatArray
    theta: FloatArray
    omega: FloatArray
    provenance: dict[str, Any] = field(default_factory=dict[str, Any])

    def positions(self) -> FloatArray:
        """Return the positions of the bobs [m], shape (T, n, 2)."""
        return _energy.positions(self.chain, self.theta)

    def velocities(self) -> FloatArray:
        """Return the velocities of the bobs [m/s], shape (T, n, 2)."""
        return _energy.velocities(self.chain, self.theta, self.omega)

    def energy(self) -> FloatArray:
        """Return the energy above hanging at rest [J], shape (T,)."""
        return _energy.energy(self.chain, self.theta, self.omega)

    def cart(self, position: float = 0.0, velocity: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Return position [m] and velocity [m/s] of the cart, shape (T,) each.

        Parameters
        ----------
        position, velocity : float
            Those at ``times[0]``. The motion of the chain does not depend on them.

        Raises
        ------
        ValueError, TypeError
            If there is no cart, or an argument is no number.
        """
        if "cart_mass" not in self.provenance:
            raise ValueError("cart() needs a trajectory made by simulate(..., cart_mass=...)")
        start = _checks.number("position", position), _checks.number("velocity", velocity)
        return cart_motion(self.chain, self.times, self.theta, self.omega, self.provenance, start)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the trajectory to `path` as an npz archive, whole or not at all.

        Raises
        ------
        OSError
            If `path` cannot be written.
        """
        about = json.dumps({"chain": self.chain.as_dict(), "provenance": self.provenance})
        with _files.replacing(Path(path), binary=True) as file:
            np.savez_compressed(
                file, about=np.array(about), times=self.times, theta=self.theta, omega=self.omega
            )

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
            return cls(*_read(Path(path)))
        except (KeyError, ValueError, TypeError, RecursionError) as error:
            raise ValueError(
                f"path must name a trajectory made by save(); {path}: {error}"
            ) from error


def _read(path: Path) -> tuple[Chain, FloatArray, FloatArray, FloatArray, dict[str, Any]]:
    """Return the fields of the trajectory in an npz archive, each of them checked."""
    data = _files.read_arrays(path, 2 * MAX_FRAME_BYTES)
    about = json.loads(str(data["about"]))
    times, theta, omega = (_checks.array(name, data[name]) for name in ("times", "theta", "omega"))
    chain = Chain(**about["chain"])
    shape = (times.size, chain.n)
    if times.ndim != 1 or theta.shape != shape or omega.shape != shape:
        raise ValueError(f"theta and omega must have the shape {shape}")
    if not isinstance(about["provenance"], dict):
        raise TypeError("its provenance must be a dict")
    return chain, times, theta, omega, about["provenance"]


def simulate(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike,
    times: ArrayLike,
    *,
    torque: ArrayLike | None = None,
    pivot_acceleration: ArrayLike | None = None,
    cart_mass: float | None = None,
    force: float = 0.0,
    method: str = "dop853",
    rtol: float = 1e-10,
    atol: float = 1e-12,
    dt: float | None = None,
) -> Trajectory:
    """Integrate the equations of motion and return the state at the given times.

    Parameters
    ----------
    chain : Chain
    theta, omega : array_like, shape (n,)
        Angles [rad] and angular velocities [rad/s] at ``times[0]``; one number stands for all.
    times : array_like, shape (T,)
        Instants at which the state is wanted [s], increasing.
    torque : float or array_like, shape (n,), optional
        Constant torque [N m]: a number acts on joint 0, an array on every joint.
    pivot_acceleration : array_like, shape (2,), optional
        Constant acceleration of the pivot [m/s^2], sideways and up. A motion that depends on time
        is made of segments: one call for each, begun with the last ``theta[-1]`` and
        ``omega[-1]``; the error of taking the mean acceleration of each falls with the square of
        their length.
    cart_mass : float, optional
        Mass [kg] of a cart that carries the pivot along a horizontal rail without friction; see
        `Trajectory.cart`. The rail bears the reaction of a torque at joint 0.
    force : float
        Constant horizontal force [N] on the cart; one that depends on time in segments, as above.
    method : {"dop853", "rk4"}
        "dop853": order 8(5,3), its step chosen to meet `rtol` and `atol`. "rk4": order 4, equal
        steps, the fewest between two times that are no longer than `dt`.
    rtol, atol : float
        Relative and absolute tolerance of each step (for "dop853").
    dt : float, optional
        Longest step [s] (for "rk4", and needed there).

    Returns
    -------
    Trajectory

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.
    IntegrationError
        If the state diverges, or no step is small enough for the tolerance.

    Notes
    -----
    The equations are the paper's Eq. (eom), solved in O(n) through the rod tensions, see
    `npend_gym.physics.kernels.dynamics`; docs/extensions.md has what drag and a moving pivot add to
    them. Chains with drag want a pivot at rest: elsewhere the drag would depend on the pivot's
    velocity too. Results are the same bits on every machine.
    """
    n = check_chain(chain).n
    y = np.concatenate(
        [
            _checks.within("theta", _checks.vector("theta", theta, n), MAX_ANGLE),
            _checks.within("omega", _checks.vector("omega", omega, n), MAX_SPEED),
        ]
    )
    times = _checks.array("times", times)
    if times.ndim != 1 or times.size == 0 or np.any(np.diff(times) <= 0.0):
        raise ValueError(f"times must be a list of increasing instants, got {_checks.show(times)}")
    if 16 * n * times.size > MAX_FRAME_BYTES:
        raise ValueError(
            f"times must hold at most {MAX_FRAME_BYTES // (16 * n)} instants for {n} rods, "
            f"got {times.size}: simulate them in segments"
        )
    method = _checks.choice("method", method, METHODS)
    couple = _checks.vector("torque", joint_torques(torque, n), n)
    provenance: dict[str, Any] = {
        "npend_gym": __version__,
        "method": method,
        "torque": couple.tolist(),
    }
    pivot = checked_pivot(chain, pivot_acceleration, cart_mass, force)
    provenance |= pivot
    rods = rods_on(chain, pivot)
    frames = np.empty((times.size, 2 * n))
    if method == "rk4":
        if dt is None:
            raise ValueError('dt must be given with method "rk4": the longest step in seconds')
        dt = _checks.positive_number("dt", dt)
        if times.size > 1 and float(np.diff(times).max()) / dt > _MAX_STEPS:
            raise ValueError(
                f"dt must make at most {_MAX_STEPS:g} steps between two times, got {dt:g}"
            )
        provenance["dt"] = dt
        _run_rk4(rods, y, times, dt, couple, frames)
    else:
        if dt is not None:
            raise ValueError(
                f'dt must be None with method "dop853", which chooses its own, got {dt}'
            )
        rtol = check_rtol(rtol)
        atol = _checks.positive_number("atol", atol)
        provenance |= {"rtol": rtol, "atol": atol}
        _run_dop853(rods, y, times, couple, rtol, atol, frames)
    return Trajectory(chain, times, frames[:, :n].copy(), frames[:, n:].copy(), provenance)


def check_rtol(rtol: float) -> float:
    """Return `rtol`, refused where float64 cannot meet it."""
    rtol = _checks.number("rtol", rtol)
    if rtol < MIN_RTOL:
        raise ValueError(
            f"rtol must be at least {MIN_RTOL:g}, for float64 resolves no less, got {rtol:g}"
        )
    return rtol


def _run_rk4(
    rods: Rods,
    y: FloatArray,
    times: FloatArray,
    dt: float,
    torque: FloatArray,
    frames: FloatArray,
) -> None:
    n = torque.size
    work, stages = new_work(n), np.zeros((STAGE_ROWS, n))
    frames[0] = y
    done, step, steps = 1, 0, max(1, _RODS_PER_CALL // n)
    while 0 < done < times.size:
        done, step = rk4_frames(y, times, dt, done, step, steps, torque, rods, work, stages, frames)
        refuse_lost_angles(y[:n], times[abs(done) - 1])
    if done < 0:
        raise IntegrationError(
            f"the state diverged between t = {times[-done - 1]:g} s and {times[-done]:g} s: "
            f'dt = {dt:g} is too long for this chain; shorten it or use method "dop853"'
        )


def refuse_lost_angles(theta: FloatArray, time: float) -> None:
    """Raise an error where rods have turned so often that sines lose digits."""
    if np.any(np.abs(theta) > MAX_ANGLE):
        raise IntegrationError(
            f"a rod has turned by more than {MAX_ANGLE:g} rad soon after t = {time:g} s: "
            "go on in segments, each begun with the last angles less whole turns"
        )


def _run_dop853(
    rods: Rods,
    y: FloatArray,
    times: FloatArray,
    torque: FloatArray,
    rtol: float,
    atol: float,
    frames: FloatArray,
) -> None:
    solver = new_solver(float(times[0]), y)
    frames[0] = y
    done, starting = 1, True
    steps = max(1, _RODS_PER_CALL // torque.size)
    while done < times.size:
        done = dop853_frames(solver, starting, times, done, steps, rods, torque, rtol, atol, frames)
        starting = False
        refuse_lost_angles(solver.y[: torque.size], float(solver.clock[1]))
        if done < 0:
            raise IntegrationError(
                f"no step is small enough at t = {solver.clock[1]:g} s for rtol = {rtol:g} and "
                f"atol = {atol:g}: loosen them, or check the state and parameters"
            )
