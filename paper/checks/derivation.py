"""Appendix A of the paper: the derivatives of the Lagrangian, line by line."""

import numpy as np

from paper.checks.equations import expanded_left, expanded_right, force, momentum
from paper.motions import Array, Motion, along_the_motion, formula, partial_rates


def force_as_printed(motion: Motion) -> Array:
    """Return the fourth line of Eq. (43), which has l_j where l_k belongs."""
    l, omega, weight = motion.l, motion.omega, motion.xi * motion.m
    twist = (np.sin(motion.between) * omega) @ motion.xi  # (i, j): sum over k <= j
    gravity = motion.g * np.sin(motion.theta) * np.sum(weight, axis=1)
    return -l * (omega * np.sum(weight * l * twist, axis=1) + gravity)


def last_momentum(motion: Motion) -> Array:
    """Return dL/domega_i, the last line of Eq. (48)."""
    reached = (np.cos(motion.between) * motion.l * motion.omega) @ motion.xi
    return motion.l * np.sum(motion.xi * motion.m * reached, axis=1)


def momentum_as_printed(motion: Motion) -> Array:
    """Return the second line of Eq. (48), whose sines have l_j where l_k belongs."""
    q, u, xi = motion.theta, motion.omega, motion.xi
    sines = motion.m * motion.l * (xi.T @ (u * np.sin(q)))
    cosines = motion.m * (xi.T @ (motion.l * u * np.cos(q)))
    return motion.l * (np.sin(q) * (xi @ sines) + np.cos(q) * (xi @ cosines))


def momentum_by_speeds(motion: Motion, lengths: Array) -> Array:
    """Return the line after Eq. (48), whose factor is l_j as printed and should be l_i."""
    along = np.outer(np.cos(motion.theta), motion.x_dot)
    along = along + np.outer(np.sin(motion.theta), motion.y_dot)
    return (motion.xi * lengths * along) @ motion.m


def momentum_rate_as_printed(motion: Motion) -> Array:
    """Return the first line of Eq. (49), which sums over all j where j >= i is meant."""
    q, spin = motion.theta[:, None], motion.omega[:, None]
    x = motion.x_ddot * np.cos(q) - motion.x_dot * spin * np.sin(q)
    y = motion.y_ddot * np.sin(q) + motion.y_dot * spin * np.cos(q)
    return motion.l * ((x + y) @ motion.m)


formula("rate-x-by-angle", lambda at: partial_rates(at, "theta")[0],
        lambda at: -at.xi * np.outer(at.l * np.sin(at.theta), at.omega),
        lambda at: -at.xi * (at.l * at.omega * np.sin(at.theta))[:, None])  # fmt: skip
formula("rate-y-by-angle", lambda at: partial_rates(at, "theta")[1],
        lambda at: at.xi * (at.l * at.omega * np.cos(at.theta))[:, None])  # fmt: skip
formula("height-by-angle", lambda at: partial_rates(at, "theta")[2],
        lambda at: -at.xi * (at.l * np.sin(at.theta))[:, None],  # its second line
        lambda at: at.xi * (at.l * np.sin(at.theta))[:, None])  # fmt: skip
formula("force", force, force_as_printed, lambda at: at.l * expanded_left(at, "max"))
formula("pi-max", lambda at: (at.xi * at.m) @ at.xi.T, lambda at: at.carried("max"))
formula(
    "rates-by-velocity",
    lambda at: np.array(partial_rates(at, "omega")[:2]),
    lambda at: at.xi * (at.l * np.array([np.cos(at.theta), np.sin(at.theta)]))[:, :, None],
)
formula("height-by-velocity", lambda at: partial_rates(at, "omega")[2], lambda at: 0.0 * at.xi)
formula("momentum", momentum, momentum_as_printed, last_momentum)
formula("momentum-by-speeds", momentum, lambda at: momentum_by_speeds(at, at.l[None, :]),
        lambda at: momentum_by_speeds(at, at.l[:, None]))  # fmt: skip
formula("momentum-rate", lambda at: along_the_motion(last_momentum, at), momentum_rate_as_printed,
        lambda at: at.l * expanded_right(at))  # fmt: skip
