"""The mass matrix of any chain, its momenta, and how they change with the state."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import MAX_DENSE, Chain, check_chain
from npend_gym.compiled.sincos import MAX_ANGLE
from npend_gym.physics.arguments import check_states
from npend_gym.physics.equations import states_of
from npend_gym.physics.kernels.states import momenta_of_states, new_momenta_scratch
from npend_gym.physics.mechanism import Mechanism, mechanism_of


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
    _checks.count("n", check_chain(chain).n, high=MAX_DENSE)
    states = states_of(chain, theta, 0.0, stretch=stretch)
    mass = _momenta(states.mechanism, states.q, states.u, states.mechanism.size)
    return 0.5 * (mass + mass.swapaxes(-1, -2))  # symmetric to the last bit


def _momenta(mechanism: Mechanism, q: FloatArray, u: FloatArray, count: int) -> FloatArray:
    """Return the derivatives of p = M u by the last `count` of q and u, (..., m, count)."""
    m = mechanism.size
    columns, work = np.empty((*q.shape, count)), new_momenta_scratch(m)
    rows = q.reshape(-1, m), u.reshape(-1, m)
    momenta_of_states(*rows, mechanism.arrays(), work, columns.reshape(-1, m, count))
    return columns


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
    _checks.within("q", q[..., :n], MAX_ANGLE)
    return _momenta(mechanism_of([chain]), q, u, 2 * chain.coordinates)
