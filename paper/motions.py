"""Random chains in motion, on which formulas of the paper are compared with the truth."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from npend_gym import Chain
from npend_gym.physics import accelerations
from npend_gym.tools import FloatArray
from paper.registry import Outcome, check, holds_if, slip_if

EXACT = 1e-11  # relative: what rounding may leave of an identity

Array = Any  # formulas are evaluated at complex angles too, see `slope`
Term = Callable[["Motion"], Array]


class Motion:
    """A chain of `n` unequal rods in some state, in the paper's letters."""

    def __init__(
        self, chain: Chain, theta: Array, omega: Array, alpha: Array | None = None
    ) -> None:
        self.chain, self.n, self.g = chain, chain.n, chain.gravity
        self.m, self.l = chain.masses, chain.lengths
        self.theta, self.omega = theta, omega
        self.alpha = accelerations(chain, theta, omega) if alpha is None else alpha
        self.mu = chain.carried_masses  # sum_{j >= i} m_j
        self.xi: FloatArray = np.tri(self.n).T  # the paper's xi_ij: 1 where i <= j, else 0
        self.between = theta[:, None] - theta[None, :]  # theta_i - theta_j
        below, sine, cosine = np.tri(self.n), np.sin(theta), np.cos(theta)
        self.y = -below @ (self.l * cosine)  # heights of the bobs, and their velocities
        self.x_dot = below @ (self.l * omega * cosine)
        self.y_dot = below @ (self.l * omega * sine)
        self.x_ddot = below @ (self.l * (self.alpha * cosine - omega**2 * sine))  # by Eq. (11)
        self.y_ddot = below @ (self.l * (self.alpha * sine + omega**2 * cosine))

    def carried(self, rule: str) -> FloatArray:
        """Return sum_{k >= pi_ij} m_k with pi_ij = max(i, j) or, as Eq. (16) has it, min(i, j)."""
        pick = np.minimum if rule == "max" else np.maximum  # mu falls along the chain
        return pick.outer(self.mu, self.mu)

    def moved(self, **change: Array) -> "Motion":
        """Return this motion with `theta` or `omega` changed, and the same accelerations."""
        state = {"theta": self.theta, "omega": self.omega, "alpha": self.alpha}
        return Motion(self.chain, **(state | change))


@cache
def samples(n: int) -> tuple[Motion, ...]:
    """Return chains of `n` unequal rods in random states, with the accelerations they have."""
    rng = np.random.default_rng(n)
    motions: list[Motion] = []
    for _ in range(20):
        chain = Chain(rng.uniform(0.3, 3.0, n), rng.uniform(0.3, 3.0, n))
        motions.append(Motion(chain, rng.uniform(-np.pi, np.pi, n), rng.normal(0.0, 3.0, n)))
    return tuple(motions)


def lagrangian(motion: Motion) -> Array:
    """Return L = T - V [J], with the masses in T that Eq. (6) leaves out."""
    kinetic = 0.5 * np.sum(motion.m * (motion.x_dot**2 + motion.y_dot**2))
    return kinetic - motion.g * np.sum(motion.m * motion.y)


def slope(f: Term, motion: Motion, name: str) -> FloatArray:
    """Return the derivatives of `f` by each component of `name`, the first axis being theirs.

    By a complex step, f(x + ih) = f(x) + ih f'(x) + O(h^2): exact to rounding.
    """
    x, step = getattr(motion, name), 1e-20
    rows = [f(motion.moved(**{name: x + 1j * step * e})) for e in np.eye(motion.n)]
    return np.array([np.imag(row) / step for row in rows])


def along_the_motion(f: Term, motion: Motion) -> FloatArray:
    """Return the time derivative of `f` as `motion` continues."""
    step = 1e-20j
    theta, omega = motion.theta + step * motion.omega, motion.omega + step * motion.alpha
    return np.imag(f(motion.moved(theta=theta, omega=omega))) / step.imag


def partial_rates(motion: Motion, name: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the derivatives of x'_j, y'_j and y_j by "theta" or "omega" of rod i, as (i, j)."""
    terms = slope(lambda at: np.array([at.x_dot, at.y_dot, at.y]), motion, name)
    return terms[:, 0], terms[:, 1], terms[:, 2]


def largest_error(truth: Term, term: Term, n: int = 4) -> float:
    """Return the largest error of `term` on all samples, relative to the truth's largest entry."""
    errors: list[float] = []
    for motion in samples(n):
        expected = truth(motion)
        scale = np.max(np.abs(expected))
        error = np.max(np.abs(term(motion) - expected))
        errors.append(float(error / (scale if scale > 0.0 else 1.0)))
    return max(errors)


def compare(
    truth: Term, as_printed: Term, corrected: Term | None = None, *, n: int = 4,
    tolerance: float = EXACT, **numbers: float,
) -> Outcome:  # fmt: skip
    """Judge a formula on random chains of `n` rods, by what it stands for; `numbers` are added."""
    off = largest_error(truth, as_printed, n)
    if corrected is None:
        return holds_if(off < tolerance, off=off, **numbers)
    mended = largest_error(truth, corrected, n)
    judge = holds_if if off < tolerance else slip_if
    return judge(min(off, mended) < tolerance, off=off, mended=mended, **numbers)


def formula(
    key: str, truth: Term, as_printed: Term, corrected: Term | None = None, **options: int
) -> None:
    """Register the comparison of a formula, see `compare`, as the check of the claim `key`."""

    def judge() -> Outcome:
        return compare(truth, as_printed, corrected, **options)

    judge.__module__ = as_printed.__module__  # it belongs to the group of the formula
    check(key)(judge)
