"""The slow, obvious dynamics: the paper's dense system A theta'' = b, with its errors mended.

A_ij = l_i l_j cos(theta_i - theta_j) sum_{k >= max(i, j)} m_k, row i being multiplied by l_i so
that the right side is the generalised force on angle i. Nothing here is shared with the package.
"""

import numpy as np
from scipy.integrate import solve_ivp


def mass_matrix(masses, lengths, theta):
    n = len(masses)
    below = np.array([sum(masses[i:]) for i in range(n)])
    i, j = np.indices((n, n))
    return (
        np.outer(lengths, lengths) * np.cos(theta[:, None] - theta[None]) * below[np.maximum(i, j)]
    )


def accelerations(masses, lengths, gravity, damping, theta, omega, torque):
    n = len(masses)
    below = np.array([sum(masses[i:]) for i in range(n)])
    i, j = np.indices((n, n))
    gyro = np.outer(lengths, lengths) * np.sin(theta[:, None] - theta[None])
    gyro *= below[np.maximum(i, j)]
    relative = omega - np.concatenate([[0.0], omega[:-1]])
    at_joint = torque - damping * relative
    force = at_joint - np.concatenate([at_joint[1:], [0.0]])
    force = force - gyro @ omega**2 - gravity * below * lengths * np.sin(theta)
    return np.linalg.solve(mass_matrix(masses, lengths, theta), force)


def trajectory(chain, theta, omega, times, torque=None, tolerance=1e-12):
    """SciPy's DOP853 on the dense system."""
    n = chain.n
    couple = np.zeros(n) if torque is None else np.asarray(torque, float)

    def rhs(_t, y):
        alpha = accelerations(
            chain.masses, chain.lengths, chain.gravity, chain.damping, y[:n], y[n:], couple
        )
        return np.concatenate([y[n:], alpha])

    start = np.concatenate([np.broadcast_to(theta, n), np.broadcast_to(omega, n)])
    solution = solve_ivp(
        rhs, (times[0], times[-1]), start, "DOP853", t_eval=times, rtol=tolerance, atol=tolerance
    )
    return solution.y[:n].T, solution.y[n:].T
