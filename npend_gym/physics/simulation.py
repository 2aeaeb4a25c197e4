"""`simulate`: the equations of motion integrated in time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._provenance import provenance
from npend_gym.chain import Chain, check_chain
from npend_gym.physics.arguments import check_limits, check_settings, check_torque
from npend_gym.physics.integration import (
    check_adaptive_steps,
    check_fixed_steps,
    check_times,
    count_steps,
    ended_rod,
)
from npend_gym.physics.kernels.dop853 import Problem, dop853_frames, new_solver
from npend_gym.physics.kernels.dynamics import AnyArrays, arrays_of
from npend_gym.physics.kernels.rk4 import new_rk4_scratch, rk4_frames
from npend_gym.physics.pivot import check_pivot
from npend_gym.physics.springs import axial_start, check_springs, check_vibrations
from npend_gym.physics.trajectory import AXIAL, OF_PIVOT, Integration, Trajectory

# Rods times steps in one compiled call: about a second, after which Ctrl-C is heard
_RODS_PER_CALL = 500_000
_NOWHERE = np.zeros((0, 0))  # steps are not recorded


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
    rail_damping: float = 0.0,
    pivot_velocity: ArrayLike = 0.0,
    stiffness: ArrayLike | None = None,
    axial_damping: ArrayLike = 0.0,
    stretch: ArrayLike | None = None,
    stretch_rate: ArrayLike | None = None,
    method: str = "dop853",
    rtol: float = 1e-10,
    atol: float = 1e-12,
    dt: float | None = None,
    device: str = "cpu",
) -> Trajectory:
    """Integrate the equations of motion and return the state at the given times.

    Parameters
    ----------
    chain : Chain
    theta, omega : array_like, shape (n,)
        Angles [rad] and angular velocities [rad/s] at ``times[0]``; one number stands for all
        rods. With `device` "cuda" also (B, n): B motions, and `theta` of the result is (B, T, n).
    times : array_like, shape (T,)
        Instants at which the state is wanted [s], increasing.
    torque : float or array_like, shape (n,), optional
        Constant torque [N m]: a number acts on joint 0, an array on every joint.
    pivot_acceleration : array_like, shape (2,), optional
        Constant acceleration of the pivot [m/s^2], sideways and up. Where it depends on time,
        call `simulate` once for each segment of time, from the ``theta[-1]`` and ``omega[-1]`` of
        the last call. With the mean acceleration of each segment, the error decreases as the
        square of their length.
    cart_mass : float, optional
        Mass [kg] of a cart that carries the pivot along a horizontal rail; see `Trajectory.cart`.
        The rail bears the reaction of a torque at joint 0.
    force : float
        Constant horizontal force [N] on the cart. Where it depends on time, use segments, as above.
    rail_damping : float
        Viscous damping of the cart on its rail [N s/m].
    pivot_velocity : float or array_like, shape (2,)
        Velocity of the pivot at ``times[0]`` [m/s], sideways and up; a number: sideways. The motion
        of the chain depends on it where there is drag, or damping on the rail.
    stiffness : float or array_like, shape (n,), optional
        Of rods that stretch [N/m]: massless springs between point masses, for a pivot at rest. By
        default rods are rigid, which is the limit of stiff ones; they take fewer steps.
    axial_damping : float or array_like, shape (n,)
        Viscous damping of the springs along their length [N s/m].
    stretch, stretch_rate : float or array_like, shape (n,), optional
        How much longer than ``chain.lengths`` the springs are at ``times[0]`` [m], and its rate
        [m/s], zero where only `stretch` is given. By default springs carry the tensions of rigid
        rods, and so follow them without vibration.
    method : {"dop853", "rk4"}
        "dop853": order 8(5,3), with steps chosen to meet `rtol` and `atol`. "rk4": order 4, with
        equal steps between two times, as few as possible but none longer than `dt`.
    rtol, atol : float
        Relative and absolute tolerance of each step (for "dop853").
    dt : float, optional
        Longest step [s]; "rk4" requires it. By default "dop853" takes steps of any length: at rest,
        where the motion has no error, very long ones.
    device : {"cpu", "cuda"}
        "cuda": many motions side by side on a GPU, by method "rk4", of rigid rods on a pivot at
        rest. `torque` may then have the shape (B, n) too. Needs the extra "cuda".

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
    The equations are the paper's Eq. (eom), solved in O(n) through the rod tensions, or those of
    links, friction, rotors and a pivot that moves, solved in O(n) as articulated bodies; see
    `npend_gym.physics.accelerations` and docs/extensions.md. Results are the same bits on every
    machine.
    """
    n = check_chain(chain).n
    if _checks.choice("device", device, ("cpu", "cuda")) == "cuda":
        beyond = pivot_acceleration, cart_mass, stiffness, stretch, stretch_rate
        if method != "rk4" or any(value is not None for value in beyond):
            raise ValueError(
                'device "cuda" takes method "rk4" and rigid rods on a pivot at rest: '
                f'use device "cpu" for anything else, got method {method!r}'
            )
        from npend_gym.physics.gpu_simulation import simulate_many

        settings = check_settings(method, rtol, atol, dt)
        return simulate_many(chain, theta, omega, check_times(times, n), torque, **settings)
    theta = _checks.vector("theta", theta, n)
    omega = _checks.vector("omega", omega, n)
    check_limits(theta, omega)
    times = check_times(times, n)
    torque = _checks.vector("torque", check_torque(torque, n), n)
    pivot = check_pivot(pivot_acceleration, cart_mass, force, rail_damping, pivot_velocity)
    settings = check_settings(method, rtol, atol, dt)
    springs = check_springs(chain, stiffness, axial_damping, stretch, stretch_rate, pivot)
    forces = torque
    # what stands after the angles in the state, and after their rates
    names, place, rate = (), np.zeros(0), np.zeros(0)
    if springs is not None:
        check_vibrations(chain, springs, float(times[-1] - times[0]))
        rods, names = springs.arrays(chain, 1), AXIAL
        place, rate = axial_start(chain, springs, theta, omega, torque, stretch, stretch_rate)
    else:
        rods = arrays_of(chain.repeated(1), pivot.base)
        if pivot.moves:
            names, place, rate = OF_PIVOT, np.zeros(2), np.array(pivot.velocity)
            forces = np.concatenate([torque, [pivot.force, 0.0]])
    state = np.concatenate([theta, place, omega, rate])
    if method == "rk4":
        frames = _run_rk4(rods, state, times, forces, n, **settings)
    else:
        problem = Problem(rods, forces, settings["rtol"], settings["atol"])
        frames = _run_dop853(problem, state, times, n, settings.get("dt", math.inf))
    made_by = provenance(
        {"method": method, **settings, "torque": torque.tolist(), "pivot": pivot.as_dict()}
        | ({} if springs is None else {"springs": springs.as_dict()})
    )
    half = n + place.size
    columns = slice(n), slice(n, half), slice(half, half + n), slice(half + n, None)
    theta, place, omega, rate = (frames[:, part].copy() for part in columns)
    beyond = dict(zip(names, (place, rate), strict=False))  # no names: rigid rods, pivot at rest
    how = Integration(method, torque, settings)
    return Trajectory(
        chain, times, theta, omega, made_by, pivot, springs=springs, integration=how, **beyond
    )


def _run_rk4(
    chain: AnyArrays, state: FloatArray, times: FloatArray, torque: FloatArray, n: int, dt: float
) -> FloatArray:
    """Return the state at each time, a row each, by steps no longer than `dt`."""
    steps = count_steps(times, dt)
    frames = np.empty((times.size, state.size))
    frames[0] = state
    progress, scratch = np.array([1, 0, 0]), new_rk4_scratch(state.size // 2)
    while progress[0] < times.size:
        progress[2] = max(1, _RODS_PER_CALL // n)
        sound = rk4_frames(state, times, steps, progress, torque, chain, scratch, frames, _NOWHERE)
        check_fixed_steps(sound, state[:n], times, int(progress[0]), dt, ended_rod(chain))
    return frames


def _run_dop853(
    problem: Problem, state: FloatArray, times: FloatArray, n: int, longest: float
) -> FloatArray:
    """Return the state at each time, a row each, by steps that meet the tolerances."""
    frames = np.empty((times.size, state.size))
    frames[0] = state
    solver = new_solver(float(times[0]), state)
    done, starting, steps = 1, True, max(1, _RODS_PER_CALL // n)
    while done < times.size:
        done = dop853_frames(
            solver, problem, starting, times, done, steps, longest, frames, _NOWHERE
        )
        starting = False
        check_adaptive_steps(done, solver, problem, n)
    return frames
