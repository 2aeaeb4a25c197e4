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


def rk4_step(rates, y, h):
    """The classical Runge-Kutta method; y may be complex."""
    k1 = rates(y)
    k2 = rates(y + 0.5 * h * k1)
    k3 = rates(y + 0.5 * h * k2)
    k4 = rates(y + h * k3)
    return y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


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


def link_system(chain, theta, omega, torque):
    """Return M and f of M alpha = f for links, from the Jacobians of their centres and tips.

    State and parameters may be complex, for derivatives by complex steps.
    """
    n = chain.n
    along = np.stack([np.sin(theta), -np.cos(theta)])  # unit vectors of the links, (2, n)
    across = np.stack([np.cos(theta), np.sin(theta)])
    matrix, force = np.diag(chain.inertias), np.zeros(n)
    for i in range(n):
        for lever, is_centre in ((chain.centres[i], True), (chain.lengths[i], False)):
            reach = np.concatenate([chain.lengths[:i], [lever], np.zeros(n - i - 1)])
            jacobian = reach * across
            if is_centre:
                mass = chain.masses[i]
                matrix = matrix + mass * jacobian.T @ jacobian
                # without the accelerations of the angles; gravity accelerates the frame
                spin = np.array([0.0, chain.gravity]) - (reach * along) @ omega**2
                force = force - mass * jacobian.T @ spin
            else:
                v = jacobian @ omega
                drag = chain.drag[i] + chain.quadratic_drag[i] * np.sqrt(v @ v)
                force = force - jacobian.T @ (drag * v)
        joint, ratio = np.eye(n)[i], 1.0 / chain.gear[i] - 1.0
        above = np.eye(n)[i - 1] if i > 0 else np.zeros(n)
        joint, rotor = joint - above, joint + ratio * above
        matrix = matrix + chain.armature[i] * np.outer(rotor, rotor)
        speed = joint @ omega
        u = speed / chain.friction_speed[i]
        held = chain.damping[i] * speed + chain.friction[i] * u / np.sqrt(1.0 + u**2)
        force = force + joint * (torque[i] - held)
    return matrix, force


def link_accelerations(chain, theta, omega, torque):
    return np.linalg.solve(*link_system(chain, theta, omega, torque))
