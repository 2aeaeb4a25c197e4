"""The mass matrix of any chain, its momenta, and how they change with the state."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import MAX_DENSE, Chain, check_chain
from npend_gym.chain.inertia import link_inertia, rotor_inertia
from npend_gym.physics.arguments import check_states
from npend_gym.physics.equations import states_of
from npend_gym.physics.mechanism import check_axial_start

_STEP = 1e-30


def mass_matrix(chain: Chain, theta: ArrayLike, *, stretch: ArrayLike | None = None) -> FloatArray:
    """Return the mass matrix M, with which the kinetic energy is u^T M u / 2.

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
        Stretch of springs [m]; by default the stretch at rest at these angles.

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
    if chain.stiffness is None:
        (angles,) = check_states(n, theta=theta)
        check_axial_start(chain, stretch, None, angles.shape)
        return _mass(chain, angles, None)
    states = states_of(chain, theta, 0.0, stretch=stretch)
    return _mass(chain, states.q[..., :n], states.q[..., -n:])


def _mass(chain: Chain, angles: Any, stretch: Any) -> Any:
    """Return the mass matrix, which may be complex, of angles and stretches (..., n)."""
    n, m, turned = chain.n, chain.coordinates, differences(angles)
    first = n + (chain.base is not None)
    whole = np.zeros((*angles.shape[:-1], m, m), angles.dtype)
    carried, extent = chain.carried_masses, chain.lift
    if stretch is None:
        whole[..., :n, :n] = link_inertia(chain) * np.cos(turned) + rotor_inertia(chain)
    else:
        lengths: FloatArray = chain.lengths + stretch
        centres: FloatArray = chain.centres + stretch
        below = np.append(carried[1:], 0.0)
        extent = chain.masses * centres + lengths * below
        # rod j moves what hangs on rod k by its length, or where that is not below it by `extent`
        is_below = np.arange(n)[:, None] < np.arange(n)
        pairs = np.where(is_below, lengths[..., :, None] * extent[..., None, :], 0.0)
        own = chain.inertias + chain.masses * centres**2 + lengths**2 * below
        pairs = pairs + pairs.swapaxes(-1, -2) + own[..., None] * np.eye(n)
        whole[..., :n, :n] = pairs * np.cos(turned) + rotor_inertia(chain)
        moved: FloatArray = lengths[..., :, None] * carried
        moved = np.where(is_below, moved, np.expand_dims(extent, -1))
        # d position / d stretch is along the rod, d position / d theta across it
        mixed: FloatArray = -moved * np.sin(turned)
        whole[..., :n, first:], whole[..., first:, :n] = mixed, mixed.swapaxes(-1, -2)
        whole[..., first:, first:] = np.minimum(carried[:, None], carried) * np.cos(turned)
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
    mass = _mass(chain, theta, None if chain.stiffness is None else q[..., first:])
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
        by_q = np.empty_like(mass)
        for k in range(chain.coordinates):  # complex steps take no differences
            near = q + 1j * _STEP * np.eye(chain.coordinates)[k]
            turned = _mass(chain, near[..., :n], near[..., first:])
            by_q[..., k] = (turned @ u[..., None])[..., 0].imag / _STEP
    return np.concatenate([by_q, mass], axis=-1)


def differences(theta: FloatArray) -> FloatArray:
    """Return theta_i - theta_j, shape (..., n, n)."""
    return theta[..., :, None] - theta[..., None, :]
