"""The equations of motion, and steps of them, linearised exactly about any states of a chain."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import MAX_DENSE, Chain, check_chain
from npend_gym.physics.arguments import check_limits, check_states, check_torque
from npend_gym.physics.derivatives import DifferentiableEnsemble

_ENTRIES = 2**21  # of the Jacobians that are made at once: 16 MB


class Linearisation(NamedTuple):
    """Derivatives by the state (theta, omega), and by the torques on some joints.

    Of a rate: d/dt (delta theta, delta omega) = A (delta theta, delta omega) + B delta torque. Of a
    step: what that gives after it.
    """

    A: FloatArray  # (..., 2n, 2n)
    B: FloatArray  # (..., 2n, number of joints)


def jacobian(
    chain: Chain, theta: ArrayLike, omega: ArrayLike = 0.0, torque: ArrayLike | None = None
) -> FloatArray:
    """Return the derivatives of d/dt (theta, omega) by theta, omega and the torques on all joints.

    Parameters
    ----------
    chain : Chain
        Of at most 10 000 rods.
    theta, omega : array_like, shape (..., n)
        Angles [rad] and angular velocities [rad/s], at rest or in motion; one number stands for
        all rods, and leading axes (instants of a trajectory, say) stand for as many states.
    torque : float or array_like, shape (..., n), optional
        Torque on the joints [N m]: a number acts on joint 0, an array on every joint.

    Returns
    -------
    ndarray, shape (..., 2n, 3n)
        The lower half, by which the accelerations change, ends in the inverse mass matrix times
        how torques act on rods.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.

    Notes
    -----
    Each column takes O(n) operations: `npend_gym.physics.kernels.virtual_power` has the equations.
    Dry friction near rest is the damper friction / friction_speed, see `linearise`.

    Examples
    --------
    >>> from npend_gym import Chain, physics
    >>> physics.jacobian(Chain.uniform(1), [0.0]).round(4).tolist()
    [[0.0, 1.0, 0.0], [-9.81, 0.0, 1.0]]
    """
    whole = _by_chunks(_rates, chain, theta, omega, torque, range(check_chain(chain).n))
    return np.concatenate(whole, axis=-1)


def linearise(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike = 0.0,
    torque: ArrayLike | None = None,
    joints: Sequence[int] = (0,),
) -> Linearisation:
    """Return the derivatives of d/dt (theta, omega) with respect to the state and to torques.

    Parameters
    ----------
    chain, theta, omega, torque
        As for `jacobian`, whose columns these are.
    joints : sequence of int
        Joints whose torques are the inputs; B has a column for each.

    Returns
    -------
    Linearisation
        A, shape (..., 2n, 2n), and B, shape (..., 2n, len(joints)).

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.

    Notes
    -----
    The derivatives are exact, and so at rest dry friction is the damper friction / friction_speed:
    0.2 N m s/rad for 0.01 N m. It is that strong only where joints turn more slowly than
    `friction_speed`; a regulator designed with it may have gains of the wrong sign for any faster
    motion. Linearise the chain without friction, ``Chain.from_dict(chain.as_dict() | {"friction":
    0.0})``, or use `npend_gym.rl.lqr`, which weighs friction by the swing that it must catch.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, physics
    >>> A, B = physics.linearise(Chain.uniform(2), np.pi)
    >>> A.shape, B.shape
    ((4, 4), (4, 1))
    >>> float(np.linalg.eigvals(A).real.max().round(4))  # 1/s: how fast it falls from upright
    5.7874
    """
    return _by_chunks(_rates, chain, theta, omega, torque, joints)


def step_jacobian(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike = 0.0,
    torque: ArrayLike | None = None,
    *,
    dt: float,
    substeps: int | None = None,
    joints: Sequence[int] = (0,),
) -> Linearisation:
    """Return the derivatives of the states after a step by those before it and by torques.

    Parameters
    ----------
    chain, theta, omega, torque
        As for `jacobian`.
    dt, substeps
        The step, as `Ensemble.advance` takes it: a Runge-Kutta step for each substep, by default as
        many as resolve the motion.
    joints : sequence of int
        Joints whose torques are the inputs; B has a column for each.

    Returns
    -------
    Linearisation
        A, shape (..., 2n, 2n), and B, shape (..., 2n, len(joints)).

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.
    FloatingPointError
        If a state leaves all bounds in the step.

    Examples
    --------
    >>> from npend_gym import Chain, physics
    >>> A, B = physics.step_jacobian(Chain.uniform(2), 0.1, dt=0.02)
    >>> A.shape, B.shape
    ((4, 4), (4, 1))
    """

    def step(ensemble: DifferentiableEnsemble, loads: FloatArray) -> FloatArray:
        found = ensemble.step_jacobian(loads, dt, substeps)
        return np.concatenate([found.A, found.B], axis=-1)

    return _by_chunks(step, chain, theta, omega, torque, joints)


def _rates(ensemble: DifferentiableEnsemble, loads: FloatArray) -> FloatArray:
    """Return the derivatives of d/dt (theta, omega)."""
    below, n = ensemble.acceleration_jacobian(loads), ensemble.n
    above = np.broadcast_to(np.eye(n, below.shape[-1], k=n), below.shape)  # theta' = omega
    return np.concatenate([above, below], axis=-2)


def _by_chunks(
    jacobian: Callable[[DifferentiableEnsemble, FloatArray], FloatArray],
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike,
    torque: ArrayLike | None,
    joints: Sequence[int],
) -> Linearisation:
    """Return the Jacobians of all states, some of them side by side at a time."""
    n = _checks.count("n", check_chain(chain).n, high=MAX_DENSE)
    states = check_states(n, theta=theta, omega=omega, torque=check_torque(torque, n))
    check_limits(*states[:2])
    wanted = [_checks.count("joint", joint, low=0, high=n - 1) for joint in joints]
    angles, speeds, loads = (value.reshape(-1, n) for value in states)
    # joints whose torques are not asked for, but act
    others = [int(j) for j in np.flatnonzero(np.any(loads, axis=0)) if j not in wanted]
    at, columns = [*wanted, *others], 2 * n + len(wanted)
    size = max(1, min(len(angles), _ENTRIES // (2 * n * (2 * n + len(at)))))
    whole = np.empty((len(angles), 2 * n, columns))
    for first in range(0, len(angles), size):
        span = slice(first, first + size)
        ensemble = DifferentiableEnsemble(chain, len(angles[span]), joints=at)
        ensemble.set_state(slice(None), angles[span], speeds[span])
        whole[span] = jacobian(ensemble, loads[span][:, at])[..., :columns]
    whole = whole.reshape(*states[0].shape[:-1], 2 * n, columns)
    return Linearisation(whole[..., : 2 * n], whole[..., 2 * n :])
