"""The equations of motion: accelerations, tensions and mass matrix of any state of a chain.

In M(theta) alpha = f (the paper's Eq. (eom)) every rod is coupled to every other, but the tension
of a rod is coupled to those of its neighbours only. `accelerations` and `tensions` therefore solve
a tridiagonal system, in O(n) operations a state and without M, which
`npend_gym.physics.kernels.tensions` derives. Links with inertia are articulated bodies, solved in
as few operations by `npend_gym.physics.kernels.links`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import MAX_DENSE, Chain, check_chain
from npend_gym.chain.inertia import link_inertia, rotor_inertia
from npend_gym.physics.arguments import check_limits, check_states, check_torque
from npend_gym.physics.kernels.dynamics import arrays_of, new_work
from npend_gym.physics.kernels.states import solve_states


def accelerations(
    chain: Chain, theta: ArrayLike, omega: ArrayLike, torque: ArrayLike | None = None
) -> FloatArray:
    """Return the angular accelerations of the rods [rad/s^2], in O(n) operations a state.

    Parameters
    ----------
    chain : Chain
    theta, omega : array_like, shape (..., n)
        Angles [rad] and angular velocities [rad/s]; one number stands for all rods, and leading
        axes (instants of a trajectory, say) stand for as many states.
    torque : float or array_like, shape (..., n), optional
        Torque on the joints [N m]: a number acts on joint 0, an array on every joint.

    Returns
    -------
    ndarray, shape (..., n)

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.

    Examples
    --------
    >>> from npend_gym import Chain, physics
    >>> physics.accelerations(Chain.uniform(3), [0.1, 0.2, 0.3], 0.0).round(4).tolist()
    [0.9035, -1.9112, -1.8829]
    """
    return _solve(chain, theta, omega, torque)[0]


def tensions(
    chain: Chain, theta: ArrayLike, omega: ArrayLike, torque: ArrayLike | None = None
) -> FloatArray:
    """Return the tensions of the rods [N], positive where a rod pulls, in O(n) operations a state.

    Parameters and shapes are those of `accelerations`.

    Returns
    -------
    ndarray, shape (..., n)

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, or the chain is not one of point masses on massless rods,
        the only ones on which all force is along the rod.

    Examples
    --------
    >>> from npend_gym import Chain, physics
    >>> physics.tensions(Chain.uniform(3), 0.0, 0.0).round(2).tolist()
    [29.43, 19.62, 9.81]
    """
    if not check_chain(chain).is_ideal:
        raise ValueError(
            "tensions are those of massless rods with bobs at their ends and no dry friction: "
            f"links have forces across as well; got {chain}"
        )
    return _solve(chain, theta, omega, torque)[1]


def mass_matrix(chain: Chain, theta: ArrayLike) -> FloatArray:
    """Return the mass matrix M [kg m^2]: omega . M omega / 2 is the kinetic energy.

    M_ij = l_i l_j cos(theta_i - theta_j) sum_{k >= max(i, j)} m_k: symmetric, positive definite.
    With links, M_ij = l_i h_j cos(theta_i - theta_j) where link j is below link i, h being
    `Chain.lift`, and M_ii = I_i + m_i c_i^2 + l_i^2 sum_{k > i} m_k. Rotor j adds armature_j to
    M_jj, (1/gear_j - 1) times as much to M_j,j-1, and the square of it to M_j-1,j-1.

    Parameters
    ----------
    chain : Chain
        Of at most 10 000 rods.
    theta : array_like, shape (..., n)
        Angles [rad]; one number stands for all rods.

    Returns
    -------
    ndarray, shape (..., n, n)

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.

    Examples
    --------
    >>> from npend_gym import Chain, physics
    >>> physics.mass_matrix(Chain.uniform(2), [0.0, 0.0]).tolist()
    [[2.0, 1.0], [1.0, 1.0]]
    """
    n = _checks.count("n", check_chain(chain).n, high=MAX_DENSE)
    (angles,) = check_states(n, theta=theta)
    return link_inertia(chain) * np.cos(differences(angles)) + rotor_inertia(chain)


def momentum_jacobian(chain: Chain, theta: ArrayLike, omega: ArrayLike) -> FloatArray:
    """Return the derivatives of the canonical momenta p = M(theta) omega by theta and omega.

    Parameters
    ----------
    chain : Chain
        Of at most 10 000 rods.
    theta, omega : array_like, shape (..., n)
        Angles [rad] and angular velocities [rad/s]; one number stands for all rods.

    Returns
    -------
    ndarray, shape (..., n, 2n)
        By theta [kg m^2/s]: S_ik omega_k, less sum_j S_ij omega_j on the diagonal, S being M with
        the sine of theta_i - theta_j in place of its cosine. By omega: M [kg m^2].

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
    angles, speeds = check_states(n, theta=theta, omega=omega)
    turned = link_inertia(chain) * np.sin(differences(angles))
    by_theta = turned * speeds[..., None, :] - np.eye(n) * (turned @ speeds[..., None])
    return np.concatenate([by_theta, mass_matrix(chain, angles)], axis=-1)


def differences(theta: FloatArray) -> FloatArray:
    """Return theta_i - theta_j, shape (..., n, n)."""
    return theta[..., :, None] - theta[..., None, :]


def _solve(
    chain: Chain, theta: ArrayLike, omega: ArrayLike, torque: ArrayLike | None
) -> tuple[FloatArray, FloatArray]:
    """Return accelerations and tensions, (..., n) each: one compiled call for all states."""
    n = check_chain(chain).n
    states = check_states(n, theta=theta, omega=omega, torque=check_torque(torque, n))
    check_limits(*states[:2])
    result = np.empty((2, *states[0].shape))
    theta, omega, torque = (value.reshape(-1, n) for value in states)
    alpha, tension = result.reshape(2, -1, n)
    solve_states(theta, omega, torque, arrays_of(chain.repeated(1)), new_work(n), alpha, tension)
    return result[0], result[1]
