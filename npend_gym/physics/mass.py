"""The mass matrix of any chain, its momenta, and how they change with the state."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import MAX_DENSE, Chain, check_chain
from npend_gym.chain.inertia import link_inertia, rotor_inertia
from npend_gym.physics.arguments import check_states
from npend_gym.physics.equations import states_of
from npend_gym.physics.mechanism import check_axial_start


def mass_matrix(chain: Chain, theta: ArrayLike, *, stretch: ArrayLike | None = None) -> FloatArray:
    """Return the mass matrix M: u . M u / 2 is the kinetic energy.

    M_ij = l_i l_j cos(theta_i - theta_j) sum_{k >= max(i, j)} m_k: symmetric, positive definite.
    With links, M_ij = l_i h_j cos(theta_i - theta_j) where link j is below link i, h being
    `Chain.lift`, and M_ii = I_i + m_i c_i^2 + l_i^2 sum_{k > i} m_k. Rotor j adds armature_j to
    M_jj, (1/gear_j - 1) times as much to M_j,j-1, and the square of it to M_j-1,j-1. A cart and
    springs add rows and columns, in the order of `accelerations`.

    Parameters
    ----------
    chain : Chain
        Of at most 10 000 rods.
    theta : array_like, shape (..., n)
        Angles [rad]; one number stands for all rods.
    stretch : array_like, shape (..., n), optional
        Of springs [m]; by default that at rest in these angles.

    Returns
    -------
    ndarray, shape (..., m, m)

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.

    Examples
    --------
    >>> from npend_gym import Cart, Chain, physics
    >>> physics.mass_matrix(Chain.uniform(2), [0.0, 0.0]).tolist()
    [[2.0, 1.0], [1.0, 1.0]]
    >>> physics.mass_matrix(Chain.uniform(1, base=Cart(3.0)), 0.0).tolist()
    [[1.0, 1.0], [1.0, 4.0]]
    """
    n = _checks.count("n", check_chain(chain).n, high=MAX_DENSE)
    m, first = chain.coordinates, n + (chain.base is not None)
    if chain.stiffness is None:
        (angles,) = check_states(n, theta=theta)
        check_axial_start(chain, stretch, None, angles.shape)
        whole, extent = np.zeros((*angles.shape[:-1], m, m)), chain.lift
        own = link_inertia(chain) * np.cos(differences(angles))
        whole[..., :n, :n] = own + rotor_inertia(chain)
    else:
        states = states_of(chain, theta, 0.0, stretch=stretch)
        angles, lengths = states.q[..., :n], chain.lengths + states.q[..., -n:]
        carried = chain.carried_masses
        whole, extent = np.zeros((*angles.shape[:-1], m, m)), carried * lengths
        both, turned = np.minimum(carried[:, None], carried), differences(angles)
        along = both * np.cos(turned)
        whole[..., :n, :n] = along * lengths[..., :, None] * lengths[..., None, :]
        whole[..., first:, first:] = along
        # d position / d stretch is along the rod, d position / d theta across it
        mixed = both * np.sin(turned) * lengths[..., None, :]
        whole[..., first:, :n], whole[..., :n, first:] = mixed, mixed.swapaxes(-1, -2)
        if chain.base is not None:
            whole[..., n, first:] = whole[..., first:, n] = carried * np.sin(angles)
    if chain.base is not None:
        whole[..., n, n] = chain.base.mass + chain.masses.sum()
        whole[..., n, :n] = whole[..., :n, n] = extent * np.cos(angles)
    return whole


def momentum_jacobian(chain: Chain, q: ArrayLike, u: ArrayLike) -> FloatArray:
    """Return the derivatives of the canonical momenta p = M(q) u by coordinates and rates.

    Parameters
    ----------
    chain : Chain
        Of at most 10 000 rods.
    q, u : array_like, shape (..., m)
        All coordinates, in the order of `accelerations`, and their rates; one number stands for
        all.

    Returns
    -------
    ndarray, shape (..., m, 2m)
        By q; then by u: M. Of rigid rods on a pivot at rest, by theta [kg m^2/s]: S_ik omega_k,
        less sum_j S_ij omega_j on the diagonal, S being M with the sine of theta_i - theta_j in
        place of its cosine.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.

    Examples
    --------
    >>> from npend_gym import Chain, physics
    >>> physics.momentum_jacobian(Chain.uniform(2), 0.0, 1.0)[:, 2:].tolist()  # M
    [[2.0, 1.0], [1.0, 1.0]]
    """
    n = _checks.count("n", check_chain(chain).n, high=MAX_DENSE)
    q, u = check_states(chain.coordinates, q=q, u=u)
    theta, omega, first = q[..., :n], u[..., :n], n + (chain.base is not None)
    own = {} if chain.stiffness is None else {"stretch": q[..., first:]}
    mass = mass_matrix(chain, theta, **own)
    if chain.stiffness is None:
        turned = link_inertia(chain) * np.sin(differences(theta))
        by_q = np.zeros_like(mass)
        by_theta = turned * omega[..., None, :] - np.eye(n) * (turned @ omega[..., None])
        by_q[..., :n, :n] = by_theta
        if chain.base is not None:  # p_x has the terms h_i cos(theta_i) omega_i, p_i v times those
            falling = -chain.lift * np.sin(theta)
            by_q[..., n, :n] = falling * omega
            by_q[..., range(n), range(n)] += falling * u[..., n, None]
    else:
        by_q = _spring_momenta(chain, q, u, first)
    return np.concatenate([by_q, mass], axis=-1)


def _spring_momenta(chain: Chain, q: FloatArray, u: FloatArray, first: int) -> FloatArray:
    """Return the derivatives of the momenta of springs by their coordinates, (..., m, m).

    Let C_ij be the mass that hangs on both rods, a_ij = theta_i - theta_j, and r the lengths. The
    momentum of an angle is sum_j C_ij r_i (r_j cos a_ij omega_j - sin a_ij r_j'). The momentum of a
    stretch is sum_j C_ij (r_j sin a_ij omega_j + cos a_ij r_j').
    """
    n, carried = chain.n, chain.carried_masses
    both, a = np.minimum(carried[:, None], carried), differences(q[..., :n])
    c, s = both * np.cos(a), both * np.sin(a)
    r, omega, rate = chain.lengths + q[..., first:], u[..., :n], u[..., first:]
    out = np.zeros((*q.shape, q.shape[-1]))
    diagonal, row = range(n), r[..., :, None]
    # by theta_j, of which theta_i has the opposite
    moved = row * (s * (r * omega)[..., None, :] + c * rate[..., None, :])
    out[..., :n, :n] = moved
    out[..., diagonal, diagonal] -= moved.sum(axis=-1)
    pulled = s * rate[..., None, :] - c * (r * omega)[..., None, :]
    out[..., first:, :n] = pulled
    out[..., range(first, first + n), diagonal] -= pulled.sum(axis=-1)
    out[..., :n, first:] = row * c * omega[..., None, :]
    of_angle = (c * (r * omega)[..., None, :] - s * rate[..., None, :]).sum(axis=-1)
    out[..., diagonal, range(first, first + n)] += of_angle
    out[..., first:, first:] = s * omega[..., None, :]
    if chain.base is not None:
        sine, cosine, v = np.sin(q[..., :n]), np.cos(q[..., :n]), u[..., n, None]
        out[..., n, :n] = carried * (cosine * rate - r * sine * omega)
        out[..., n, first:] = carried * cosine * omega
        out[..., diagonal, diagonal] -= carried * r * sine * v
        out[..., diagonal, range(first, first + n)] += carried * cosine * v
        out[..., range(first, first + n), diagonal] += carried * cosine * v
    return out


def differences(theta: FloatArray) -> FloatArray:
    """Return theta_i - theta_j, shape (..., n, n)."""
    return theta[..., :, None] - theta[..., None, :]
