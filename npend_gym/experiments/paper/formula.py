"""Formulas of the paper tested on random chains in motion: as printed, and as they must read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.experiments.paper.finding import Finding, Verdict
from npend_gym.physics.kernels.dynamics import derivative, new_work, pack_rods

SAMPLES = 20
EXACT = 1e-11  # relative: what rounding may leave of an identity

# Formulas are evaluated at complex angles too, see `slope`
Array = Any
Term = Callable[["Motion"], Array]


@dataclass(frozen=True, eq=False)
class Motion:
    """A chain of `n` unequal rods in some state, in the paper's letters."""

    m: FloatArray
    l: FloatArray
    g: float
    theta: Array
    omega: Array
    alpha: Array  # angular accelerations

    @property
    def n(self) -> int:
        """Number of rods."""
        return self.m.size

    @property
    def mu(self) -> FloatArray:
        """Masses carried, sum_{j >= i} m_j."""
        return np.cumsum(self.m[::-1])[::-1]

    @property
    def xi(self) -> FloatArray:
        """The paper's xi_ij: 1 where i <= j, else 0."""
        return np.tri(self.n).T

    @property
    def between(self) -> Array:
        """theta_i - theta_j."""
        return self.theta[:, None] - self.theta[None, :]

    @property
    def x_dot(self) -> Array:
        """Horizontal velocities of the bobs."""
        return np.tri(self.n) @ (self.l * self.omega * np.cos(self.theta))

    @property
    def y_dot(self) -> Array:
        """Vertical velocities of the bobs."""
        return np.tri(self.n) @ (self.l * self.omega * np.sin(self.theta))

    @property
    def y(self) -> Array:
        """Heights of the bobs."""
        return -np.tri(self.n) @ (self.l * np.cos(self.theta))

    def carried(self, rule: str) -> FloatArray:
        """Return sum_{k >= pi_ij} m_k with pi_ij = max(i, j) or, as Eq. (16) has it, min(i, j)."""
        pick = np.minimum if rule == "max" else np.maximum  # mu falls along the chain
        return pick.outer(self.mu, self.mu)

    def moved(self, **change: Array) -> Motion:
        """Return this motion with some of its values changed."""
        return Motion(**{**vars(self), **change})


def lagrangian(motion: Motion) -> Array:
    """Return L = T - V [J], with the masses in T that Eq. (6) leaves out."""
    kinetic = 0.5 * np.sum(motion.m * (motion.x_dot**2 + motion.y_dot**2))
    return kinetic - motion.g * np.sum(motion.m * motion.y)


def slope(f: Term, motion: Motion, name: str) -> FloatArray:
    """Return the derivatives of `f` by each component of `name`, the first axis being theirs.

    By a complex step, f(x + ih) = f(x) + ih f'(x) + O(h^2): exact to rounding.
    """
    step = 1e-20
    x = getattr(motion, name)
    rows = [f(motion.moved(**{name: x + 1j * step * e})) for e in np.eye(motion.n)]
    return np.array([np.imag(row) / step for row in rows])


def along_the_motion(f: Term, motion: Motion) -> FloatArray:
    """Return the time derivative of `f` as `motion` goes on."""
    step = 1e-20j
    ahead = motion.moved(
        theta=motion.theta + step * motion.omega, omega=motion.omega + step * motion.alpha
    )
    return np.imag(f(ahead)) / step.imag


def our_accelerations(chain: Chain, theta: FloatArray, omega: FloatArray) -> FloatArray:
    """Return the accelerations [rad/s^2], shape (n,), of the package's O(N) dynamics."""
    rates = np.empty(2 * chain.n)
    state = np.concatenate([theta, omega])
    derivative(state, np.zeros(chain.n), pack_rods(chain), new_work(chain.n), rates)
    return rates[chain.n :]


@cache
def samples(n: int, count: int = SAMPLES) -> tuple[Motion, ...]:
    """Return chains of `n` unequal rods in random states, with the accelerations they have."""
    rng = np.random.default_rng(n)
    motions: list[Motion] = []
    for _ in range(count):
        chain = Chain(rng.uniform(0.3, 3.0, n), rng.uniform(0.3, 3.0, n))
        theta, omega = rng.uniform(-np.pi, np.pi, n), rng.normal(0.0, 3.0, n)
        alpha = our_accelerations(chain, theta, omega)
        motions.append(Motion(chain.masses, chain.lengths, chain.gravity, theta, omega, alpha))
    return tuple(motions)


def uneven_chains(count: int = SAMPLES) -> list[Chain]:
    """Return random chains of four unequal rods."""
    return [Chain(motion.m, motion.l) for motion in samples(4, count)]


@dataclass(frozen=True, eq=False)
class Formula:
    """A formula of the paper: what it stands for, as it is printed, and as it must read."""

    key: str
    place: str
    claim: str
    printed: str
    note: str
    truth: Term
    as_printed: Term
    corrected: Term | None = None
    n: int = 4
    tolerance: float = EXACT

    def off(self, term: Term) -> float:
        """Return the largest error of `term`, relative to the largest entry of the truth."""
        return max(_off(self.truth(motion), term(motion)) for motion in samples(self.n))


def judge(formula: Formula) -> Finding:
    """Return what random chains in motion say about `formula`."""
    off = formula.off(formula.as_printed)
    verdict, ours = Verdict.of(off < formula.tolerance), f"off by {off:.0e}"
    if formula.corrected is not None:
        mended = formula.off(formula.corrected)
        ours = f"as printed: {ours}; corrected: {mended:.0e}"
        if verdict is Verdict.FAILS and mended < formula.tolerance:
            verdict = Verdict.CORRECTED
    return Finding(
        formula.key, formula.place, formula.claim, formula.printed, ours, verdict, formula.note
    )


def _off(truth: FloatArray, value: FloatArray) -> float:
    scale = np.max(np.abs(truth))
    return float(np.max(np.abs(value - truth)) / (scale if scale > 0.0 else 1.0))
