"""The equations of motion linearised, exactly, about any state, for any leading axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import MAX_DENSE, Chain, check_chain
from npend_gym.chain.inertia import link_inertia, rotor_inertia
from npend_gym.physics.arguments import check_states, check_torque
from npend_gym.physics.equations import accelerations, differences


class Linearisation(NamedTuple):
    """d/dt (delta theta, delta omega) = A (delta theta, delta omega) + B delta torque."""

    A: FloatArray  # (..., 2n, 2n)
    B: FloatArray  # (..., 2n, number of joints)


def linearise(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike = 0.0,
    torque: ArrayLike | None = None,
    joints: Sequence[int] = (0,),
) -> Linearisation:
    r"""Return the derivatives of d/dt (theta, omega) with respect to the state and to torques.

    Parameters
    ----------
    chain : Chain
    theta, omega : array_like, shape (..., n)
        Angles [rad] and angular velocities [rad/s], at rest or in motion; one number stands for
        all rods, and leading axes (instants of a trajectory, say) stand for as many states.
    torque : float or array_like, shape (..., n), optional
        Torque on the joints [N m]: a number acts on joint 0, an array on every joint.
    joints : sequence of int
        Joints whose torques are the inputs; B has a column for each.

    Returns
    -------
    A : ndarray, shape (..., 2n, 2n)
        Derivatives with respect to (theta, omega).
    B : ndarray, shape (..., 2n, len(joints))
        Derivatives with respect to the torques [N m] on `joints`.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.

    Notes
    -----
    The paper's system (its Eq. (eom)), with row i multiplied by l_i, and with links, rotors,
    damping, friction, drag and torques, is (N + C) alpha = f, ::

        N = W * cos(D),  D_ij = theta_i - theta_j,  S = W * sin(D),
        f = Q - F(omega) - S omega^2 - g h sin(theta) + R,

    where the products with W are entry by entry; W and C are the constant matrices of
    `mass_matrix`, and h is `Chain.lift`. Its solution alpha(theta, omega) comes from
    `accelerations`. The system differentiated along this solution is::

        (N + C) dalpha/dtheta = diag(S alpha - N omega^2 - g h cos(theta))
                                - S diag(alpha) + N diag(omega^2) + dR/dtheta,
        (N + C) dalpha/domega = -2 S diag(omega) - dF/domega + dR/domega.

    F has damping and dry friction of the joints. With u = v / friction_speed, v being the speed of
    a joint, the slope of its friction is friction / friction_speed / (1 + u^2)^(3/2).

    Drag adds R_i = l_i n_i . sum_{k >= i} D_k, where D_k is its force on bob k,
    D_k = -(drag_k + quadratic_drag_k \|v_k\|) v_k with v_k = sum_{i <= k} l_i omega_i n_i.

    One factorisation of M gives all columns, in O(n^3) operations.
    """
    n = _checks.count("n", check_chain(chain).n, high=MAX_DENSE)
    theta, omega, torque = check_states(n, theta=theta, omega=omega, torque=check_torque(torque, n))
    at_joint = np.eye(n) - np.eye(n, k=1)  # column j: torque on joint j acts on rods j and j - 1
    damping = (at_joint * joint_damping(chain, omega)[..., None, :]) @ at_joint.T
    straight, turned = link_inertia(chain), differences(theta)
    mass, gyro = straight * np.cos(turned), straight * np.sin(turned)
    stiffness = chain.gravity * chain.lift * np.cos(theta)
    alpha, square = accelerations(chain, theta, omega, torque), omega**2

    diagonal = _apply(gyro, alpha) - _apply(mass, square) - stiffness
    by_theta = diagonal[..., None] * np.eye(n) - gyro * alpha[..., None, :]
    by_theta += mass * square[..., None, :]
    by_omega = -2.0 * gyro * omega[..., None, :] - damping
    if chain.has_drag:
        drag_by_theta, drag_by_omega = _drag_derivatives(chain, theta, omega)
        by_theta, by_omega = by_theta + drag_by_theta, by_omega + drag_by_omega
    columns = [_checks.count("joint", joint, low=0, high=n - 1) for joint in joints]
    by_torque = np.broadcast_to(at_joint[:, columns], (*theta.shape, len(columns)))
    right_sides = np.concatenate([by_theta, by_omega, by_torque], axis=-1)
    solved = np.linalg.solve(mass + rotor_inertia(chain), right_sides).astype(
        np.float64, copy=False
    )

    of_theta = np.broadcast_to(np.eye(n, solved.shape[-1], k=n), solved.shape)  # theta' = omega
    whole = np.concatenate([of_theta, solved], axis=-2)
    return Linearisation(whole[..., : 2 * n], whole[..., 2 * n :])


def joint_damping(chain: Chain, omega: FloatArray) -> FloatArray:
    """Return the slope of the joints' resistance, damping and friction [N m s/rad], (..., n)."""
    speed = np.diff(omega, axis=-1, prepend=0.0) / chain.friction_speed
    slope = chain.friction / chain.friction_speed
    return chain.damping + slope / (1.0 + speed**2) ** 1.5


def _drag_derivatives(
    chain: Chain, theta: FloatArray, omega: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return dR/dtheta and dR/domega of the generalised forces R of drag, (..., n, n) each."""
    l = chain.lengths[:, None]
    along = l * np.stack([np.sin(theta), -np.cos(theta)], axis=-1)  # l e, (..., n, 2)
    across = l * np.stack([np.cos(theta), np.sin(theta)], axis=-1)  # l n
    above = np.tri(chain.n)  # bob k hangs on the rods i <= k
    velocity = above @ (across * omega[..., None])
    speed = np.linalg.norm(velocity, axis=-1, keepdims=True)
    factor = chain.drag[:, None] + chain.quadratic_drag[:, None] * speed
    direction = velocity / np.where(speed > 0.0, speed, 1.0)
    growth = (factor - chain.drag[:, None]) * direction
    by_velocity = factor[..., None] * np.eye(2) + growth[..., None] * direction[..., None, :]

    # How rod j, which moves bob k, changes the force of bob k on rod i
    to_bobs = above[..., None] * across[..., None, :, :]  # dv_k/domega_i, (..., k, i, 2)
    on_rods = np.einsum("...kia,...kab->...kib", to_bobs, by_velocity)
    by_omega = -np.einsum("...kib,...kjb->...ij", on_rods, to_bobs)
    # Turning a rod turns the velocity that it gives the bobs, and its own lever: dn/dtheta = -e
    turned = above[..., None] * (along * omega[..., None])[..., None, :, :]
    by_theta = np.einsum("...kib,...kjb->...ij", on_rods, turned)
    force = above.T @ (factor * velocity)  # minus the drag of all bobs that hang on each rod
    by_theta += np.sum(force * along, axis=-1)[..., None] * np.eye(chain.n)
    return by_theta, by_omega


def _apply(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    return np.einsum("...ij,...j->...i", matrices, vectors)
