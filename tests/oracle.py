"""The slow, obvious dynamics: the paper's dense system A theta'' = b, with its errors mended.

A_ij = l_i l_j cos(theta_i - theta_j) sum_{k >= max(i, j)} m_k, row i being multiplied by l_i so
that the right side is the generalised force on angle i. Nothing here is shared with the package.
Numbers drawn by NumPy are at the end.
"""

from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

TINY = 1e-30  # of a complex step: its error is of the order of its square


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


def dense_rk4(rates, y, times, dt):
    """Return the states at the times, by equal steps of dt at most between two of them."""
    frames = [y]
    for span in np.diff(times):
        steps = int(np.ceil(span / dt - 1e-9))
        h = span / steps
        for _ in range(steps):
            y = rk4_step(rates, y, h)
        frames.append(y)
    return np.array(frames)


def complex_slopes(f, size):
    """Return df/dx at zero changes, by complex steps: `size` entries of x along the last axis."""
    return np.stack([f(1j * TINY * e).imag / TINY for e in np.eye(size)], axis=-1)


def trajectory(chain, theta, omega, times, torque=None, tolerance=1e-12, breaks=()):
    """SciPy's DOP853 on the dense system; it begins anew at `breaks`, where the torque jumps.

    The torque is (n,), or a function of time and angles.
    """
    n, times = chain.n, np.asarray(times)
    couple = torque if callable(torque) else lambda _t, _theta: 0.0 if torque is None else torque

    def rhs(t, y):
        alpha = accelerations(
            chain.masses, chain.lengths, chain.gravity, chain.damping, y[:n], y[n:],
            np.broadcast_to(couple(t, y[:n]), n),
        )  # fmt: skip
        return np.concatenate([y[n:], alpha])

    y, shown = np.concatenate([np.broadcast_to(theta, n), np.broadcast_to(omega, n)]), []
    for a, b in pairwise(np.unique([times[0], *breaks, times[-1]])):
        inside = lambda t, y, a=a, b=b: rhs(np.clip(t, a + 1e-12, b - 1e-12), y)  # noqa: E731
        at = np.append(times[(a <= times) & (times < b)], b)
        found = solve_ivp(inside, (a, b), y, "DOP853", at, rtol=tolerance, atol=tolerance).y.T
        y, shown = found[-1], [*shown, found[:-1]]
    found = np.vstack([*shown, y])
    return found[:, :n], found[:, n:]


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


def link_rates(chain, torque):
    """Return the function y -> y' of states (theta, omega) of links, for `dense_rk4`."""

    def rates(y):
        theta, omega = np.split(y, 2)
        return np.concatenate([omega, link_accelerations(chain, theta, omega, torque)])

    return rates


def dense_step(chain, theta, omega, torque, dt, substeps):
    """Return the state of links after equal Runge-Kutta steps, of complex numbers too."""
    start = np.concatenate([theta, omega])
    return dense_rk4(link_rates(chain, torque), start, [0.0, dt], dt / substeps)[-1]


def numpys_philox(seed, step=0, purpose=0, episode=0):
    """Return NumPy's stream of random words for these; a seed has 128 bits at most."""
    return np.random.Philox(
        key=np.array([seed % 2**64, seed >> 64], np.uint64),
        counter=np.array([0, step, purpose, episode], np.uint64),
    )


def box_muller(u, v):
    """Return two normally distributed numbers for two uniform ones."""
    radius = np.sqrt(-2.0 * np.log1p(-u))
    return radius * np.cos(2.0 * np.pi * v), radius * np.sin(2.0 * np.pi * v)
