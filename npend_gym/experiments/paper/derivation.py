"""Appendix A of the paper: the derivatives of the Lagrangian, line by line."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from npend_gym.experiments.paper.equations import partial_rates
from npend_gym.experiments.paper.finding import Finding
from npend_gym.experiments.paper.formula import (
    Array,
    Formula,
    Motion,
    along_the_motion,
    judge,
    lagrangian,
    slope,
)


def force(motion: Motion) -> Array:
    """Return dL/dtheta_i, the last line of Eq. (43), with pi_ij = max(i, j)."""
    l, omega = motion.l, motion.omega
    twist = (np.sin(motion.between) * motion.carried("max")) @ (l * omega)
    return -motion.g * l * np.sin(motion.theta) * motion.mu - l * omega * twist


def force_as_printed(motion: Motion) -> Array:
    """Return the fourth line of Eq. (43), which has l_j where l_k belongs."""
    m, l, omega = motion.m, motion.l, motion.omega
    twist = (np.sin(motion.between) * omega) @ motion.xi  # (i, j): sum over k <= j
    weight = motion.xi * m
    return -l * (omega * np.sum(weight * l * twist, axis=1)
                 + motion.g * np.sin(motion.theta) * np.sum(weight, axis=1))  # fmt: skip


def momentum(motion: Motion) -> Array:
    """Return dL/domega_i, the last line of Eq. (48)."""
    reached = (np.cos(motion.between) * motion.l * motion.omega) @ motion.xi
    return motion.l * np.sum(motion.xi * motion.m * reached, axis=1)


def momentum_as_printed(motion: Motion) -> Array:
    """Return the second line of Eq. (48), whose sines have l_j where l_k belongs."""
    q, u, below = motion.theta, motion.omega, motion.xi
    sines = motion.l * (below.T @ (u * np.sin(q)))
    cosines = below.T @ (motion.l * u * np.cos(q))
    return motion.l * (np.sin(q) * (below @ (motion.m * sines))
                       + np.cos(q) * (below @ (motion.m * cosines)))  # fmt: skip


def momentum_by_speeds(motion: Motion, *, as_printed: bool) -> Array:
    """Return the line after Eq. (48), whose factor l_j should be l_i."""
    along = (np.outer(np.cos(motion.theta), motion.x_dot)
             + np.outer(np.sin(motion.theta), motion.y_dot))  # fmt: skip
    lengths = motion.l[None, :] if as_printed else motion.l[:, None]
    return (motion.xi * lengths * along) @ motion.m


def momentum_rate(motion: Motion) -> Array:
    """Return the last line of Eq. (49), with pi_ij = max(i, j)."""
    u = motion.omega
    gyro = (u[None, :] ** 2 - u[:, None] * u[None, :]) * np.sin(motion.between)
    turning = motion.alpha * np.cos(motion.between)
    return motion.l * (((turning + gyro) * motion.carried("max")) @ motion.l)


def momentum_rate_as_printed(motion: Motion) -> Array:
    """Return the first line of Eq. (49), which sums over all j where j >= i is meant."""
    q, u, a, below = motion.theta, motion.omega, motion.alpha, motion.xi.T
    x = below @ (motion.l * (a * np.cos(q) - u**2 * np.sin(q)))
    y = below @ (motion.l * (a * np.sin(q) + u**2 * np.cos(q)))
    sine, cosine, spin = np.sin(q)[:, None], np.cos(q)[:, None], u[:, None]
    terms = x * cosine - motion.x_dot * spin * sine + y * sine + motion.y_dot * spin * cosine
    return motion.l * (terms @ motion.m)


def _momentum_true(motion: Motion) -> Array:
    return slope(lagrangian, motion, "omega")


FORMULAS = (
    Formula(
        "rate-x-by-angle", "Eqs. (39), (40)", "dx'_j/dtheta_i",
        "d/dtheta_i sum_{k<=j} l_k theta'_j cos theta_k = -xi_ij l_i theta'_i sin theta_i",
        "The first line has theta'_j for theta'_k; the result is right.",
        truth=lambda at: partial_rates(at, "theta")[0],
        as_printed=lambda at: -at.xi * np.outer(at.l * np.sin(at.theta), at.omega),
        corrected=lambda at: -at.xi * (at.l * at.omega * np.sin(at.theta))[:, None],
    ),
    Formula(
        "rate-y-by-angle", "Eq. (41)", "dy'_j/dtheta_i", "xi_ij l_i theta'_i cos theta_i", "",
        truth=lambda at: partial_rates(at, "theta")[1],
        as_printed=lambda at: at.xi * (at.l * at.omega * np.cos(at.theta))[:, None],
    ),
    Formula(
        "height-by-angle", "Eq. (42)", "dy_j/dtheta_i", "xi_ij l_i sin theta_i",
        'The result; the "-=" of the first line is meant as "= -".',
        truth=lambda at: partial_rates(at, "theta")[2],
        as_printed=lambda at: at.xi * (at.l * np.sin(at.theta))[:, None],
    ),
    Formula(
        "force", "Eq. (43)", "dL/dtheta_i",
        "fourth line: ... theta' sum_{k<=j} l_j theta'_k sin(theta_i - theta_k) ...",
        "It has l_j for l_k and lacks the index of theta'_i; the fifth line is right again, and "
        "so is the last one, with the pi_ij = max(i, j) of Eq. (44).",
        truth=lambda at: slope(lagrangian, at, "theta"),
        as_printed=force_as_printed, corrected=force,
    ),
    Formula(
        "pi-max", "Eq. (44)", "which masses two rods share", "pi_ij = i if j <= i, else j",
        "sum_j m_j xi_ij xi_kj, summed as it stands. Eq. (16) prints the opposite.",
        truth=lambda at: (at.xi * at.m) @ at.xi.T, as_printed=lambda at: at.carried("max"),
    ),
    Formula(
        "rates-by-velocity", "Eq. (46)", "dx'_j/dtheta'_i and dy'_j/dtheta'_i",
        "xi_ij l_i cos theta_i, xi_ij l_i sin theta_i", "",
        truth=lambda at: np.array(partial_rates(at, "omega")[:2]),
        as_printed=lambda at: np.array([at.xi * (at.l * f(at.theta))[:, None]
                                        for f in (np.cos, np.sin)]),
    ),
    Formula(
        "height-by-velocity", "Eq. (47)", "dy_j/dtheta'_i", "0",
        'The right side is to be differentiated by theta\'_i (printed: "theta_I").',
        truth=lambda at: partial_rates(at, "omega")[2],
        as_printed=lambda at: np.zeros((at.n, at.n)),
    ),
    Formula(
        "momentum", "Eq. (48)", "dL/dtheta'_i",
        "second line: sum_{k<=j} l_j theta'_k sin theta_k sin theta_i + ...",
        "It has l_j for l_k in the sines; the third line is right.",
        truth=_momentum_true, as_printed=momentum_as_printed, corrected=momentum,
    ),
    Formula(
        "momentum-by-speeds", "text after Eq. (48)", "the same by the speeds of the bobs",
        "sum m_j l_j xi_ij [y'_j sin theta_i + x'_j cos theta_i]",
        "l_j should be l_i, as in the next line.",
        truth=_momentum_true, as_printed=lambda at: momentum_by_speeds(at, as_printed=True),
        corrected=lambda at: momentum_by_speeds(at, as_printed=False),
    ),
    Formula(
        "momentum-rate", "Eq. (49)", "d/dt dL/dtheta'_i",
        "first line: l_i sum_{j=1}^N m_j (x''_j cos theta_i - ...)",
        "The first two lines sum from j = 1 where the xi_ij before them leaves j >= i (the third "
        "line does, but has theta''_j for theta''_k); the last line is right with the max.",
        truth=lambda at: along_the_motion(momentum, at),
        as_printed=momentum_rate_as_printed, corrected=momentum_rate,
    ),
)  # fmt: skip


def findings() -> Iterator[Finding]:
    """Yield the findings about appendix A."""
    yield from map(judge, FORMULAS)
