"""Section 3 and appendix B: the linearised system, as the paper has it and as it is."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from npend_gym import theory
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.experiments.paper.finding import Finding, Verdict
from npend_gym.experiments.paper.fits import exponent
from npend_gym.experiments.paper.formula import (
    Motion,
    our_accelerations,
    samples,
    uneven_chains,
)
from npend_gym.physics import linearise, simulate

SMALL = 1e-5  # rad: where the dynamics are linear to ten digits


def paper_matrices(chain: Chain) -> tuple[FloatArray, FloatArray]:
    """Return the diagonal matrices M = K and L of Eqs. (19)-(21), shape (n, n) each."""
    return np.diag(chain.lengths * chain.carried_masses), np.diag(chain.gravity * chain.masses)


def full_matrices(chain: Chain) -> tuple[FloatArray, FloatArray]:
    """Return M and L of the equations of motion to first order, M theta'' + L theta = 0.

    M_ij = l_j sum_{k >= max(i, j)} m_k is full, and L = diag(g sum_{k >= i} m_k).
    """
    mu = chain.carried_masses
    return np.minimum.outer(mu, mu) * chain.lengths, np.diag(chain.gravity * mu)


def acceleration_error(matrices: tuple[FloatArray, FloatArray], chain: Chain) -> float:
    """Return how far -M^-1 L theta is off the true accelerations near rest (relative)."""
    theta = SMALL * np.random.default_rng(chain.n).normal(size=chain.n)
    mass, stiffness = matrices
    truth = our_accelerations(chain, theta, np.zeros(chain.n))
    error = -np.linalg.solve(mass, stiffness @ theta) - truth
    return float(np.max(np.abs(error)) / np.max(np.abs(truth)))


def mode_error(chain: Chain) -> float:
    """Return how far the normal modes are off a simulated small motion, relative to its start.

    Every mode is released alone and followed for ten of its periods.
    """
    omega, modes = theory.normal_modes(chain)
    errors: list[float] = []
    for k, shape in enumerate(modes.T):
        rate = float(omega[k])
        times = np.linspace(0.0, 20.0 * np.pi / rate, 101)
        path = simulate(chain, SMALL * shape, 0.0, times, rtol=1e-12, atol=1e-16)
        expected = SMALL * shape * np.cos(rate * times)[:, None]
        errors.append(float(np.max(np.abs(path.theta - expected)) / SMALL))
    return max(errors)


def order_of_nonlinearity(*, with_squares: bool) -> float:
    """Return the order in the amplitude of what Eq. (51) misses of the true accelerations.

    `with_squares` keeps its terms theta'_j^2 (theta_i - theta_j), otherwise they are dropped.
    """
    sizes = np.geomspace(0.01, 0.1, 5)
    motion = samples(4)[0]
    chain = Chain(motion.m, motion.l)
    mass, stiffness = full_matrices(chain)
    errors: list[float] = []
    for size in sizes.tolist():
        theta: FloatArray = size * motion.theta
        omega: FloatArray = size * motion.omega
        force = stiffness @ theta
        if with_squares:
            between = theta[:, None] - theta[None, :]
            weight = np.minimum.outer(motion.mu, motion.mu)
            force = force + (between * weight) @ (chain.lengths * omega**2)
        residual = np.linalg.solve(mass, -force) - our_accelerations(chain, theta, omega)
        errors.append(float(np.max(np.abs(residual))))
    return exponent(sizes, np.array(errors))


def oddness(motion: Motion) -> float:
    """Return how far the accelerations are from changing sign with the state (relative)."""
    chain = Chain(motion.m, motion.l)
    mirrored = our_accelerations(chain, -motion.theta, -motion.omega)
    return float(np.max(np.abs(mirrored + motion.alpha)) / np.max(np.abs(motion.alpha)))


def swapped_expansions(theta: float = 0.1) -> tuple[float, float]:
    """Return the errors of cos theta ~ theta and sin theta ~ 1, Eq. (50), at `theta` [rad]."""
    return abs(math.cos(theta) - theta), abs(math.sin(theta) - 1.0)


def smallest_mass_eigenvalue() -> float:
    """Return the least eigenvalue of the mass matrix on random chains and states [kg m^2]."""
    least: list[float] = []
    for motion in samples(4):
        weight = np.outer(motion.l, motion.l) * motion.carried("max")
        least.append(float(np.linalg.eigvalsh(weight * np.cos(motion.between))[0]))
    return min(least)


def findings() -> Iterator[Finding]:
    """Yield the findings about section 3 and appendix B."""
    yield from _about_the_system()
    yield from _about_appendix_b()


def _about_the_system() -> Iterator[Finding]:
    chain = uneven_chains()[0]
    printed, full = (acceleration_error(f(chain), chain) for f in (paper_matrices, full_matrices))
    yield Finding(
        "matrices", "Eqs. (19)-(21) and M Theta'' + L Theta = 0", "the linearised system",
        "M = diag(l_j sum_{k>=j} m_k), L = diag(g m_j)",
        f"accelerations of a small motion: off by {printed:.0%}; full matrices: {full:.0e}",
        Verdict.of(printed < 1e-6, Verdict.FAILS),
        "To first order M_ij = l_j sum_{k>=max(i,j)} m_k is full, since rods that hang on each "
        "other move together, and L carries all the mass below, g sum_{k>=i} m_k. The diagonal "
        "system is n separate pendulums.",
    )  # fmt: skip
    odd = max(map(oddness, samples(4)))
    yield Finding(
        "quadratic-term", "M Theta'' + K Theta'^T Theta' + L Theta = 0, Eq. (53)",
        "a term quadratic in the velocities", "K Theta'^T Theta'",
        f"accelerations change sign with (theta, omega) to {odd:.0e}",
        Verdict.of(odd > 1e-9),
        "So no term of even order exists; the quadratic terms of Eq. (17) come with "
        "sin(theta_i - theta_j) and are of third order. As printed the term is a matrix added to "
        "a vector, and not even one pendulum has it. The next step drops it, rightly.",
    )  # fmt: skip
    least = smallest_mass_eigenvalue()
    yield Finding(
        "initial-conditions", "text before Eq. (27)",
        "2N initial conditions fix the motion (Picard-Lindeloef)", "2N",
        f"least eigenvalue of the mass matrix in 20 random states: {least:.3f} kg m^2",
        Verdict.of(least > 0.0),
        "The mass matrix is positive definite (kinetic energy is), so that the right side is "
        'smooth. It is Eq. (17) itself that is meant, though the text calls it "linearized".',
    )  # fmt: skip
    error = mode_error(Chain([1.0, 0.5, 2.0], [1.0, 0.7, 0.4]))
    yield Finding(
        "modes", "Eq. (22)", "small motions are made of N normal modes", "Re(H exp(i omega t))",
        f"each mode of 3 unequal rods, followed for 10 periods: off by {error:.0e}",
        Verdict.of(error < 1e-6),
        'True of the full system; each mode has its own omega, there is no "frequency of the '
        'entire system".',
    )  # fmt: skip
    a = linearise(chain, 0.0).A[chain.n :, : chain.n]
    mass, stiffness = full_matrices(chain)
    off = float(np.max(np.abs(a + np.linalg.solve(mass, stiffness))) / np.max(np.abs(a)))
    yield Finding(
        "jacobian", "text before Eq. (23)", "a Jacobian linearises the system too", "-",
        f"it is -M^-1 L with the full matrices, to {off:.0e}", Verdict.of(off < 1e-12),
    )  # fmt: skip


def _about_appendix_b() -> Iterator[Finding]:
    by_cosine, by_sine = swapped_expansions()
    yield Finding(
        "expansions", "Eq. (50)", "cosine and sine for small angles",
        "cos theta ~ theta, sin theta ~ 1, with 2n! in the cosine",
        f"off by {by_cosine:.2f} and {by_sine:.2f} at 0.1 rad; swapped: "
        f"{1 - math.cos(0.1):.3f} and {0.1 - math.sin(0.1):.4f}",
        Verdict.of(max(by_cosine, by_sine) < 0.01, Verdict.CORRECTED),
        "The right sides are interchanged, and 2n! should be (2n)!; the text after it is right.",
    )  # fmt: skip
    kept, dropped = (order_of_nonlinearity(with_squares=flag) for flag in (True, False))
    yield Finding(
        "linearised", "Eq. (51)", "equations of motion of the linearised Lagrangian",
        "... - sum l_j theta'_j^2 (theta_i - theta_j) sum m_k",
        f"error of order {kept:.2f} in the amplitude; without these terms {dropped:.2f}",
        Verdict.of(abs(kept - 1.0) < 0.1, Verdict.CORRECTED if kept > 2.9 else Verdict.FAILS),
        "Right to second order with pi_ij the max, but the terms in theta'^2 are of third order, "
        "like those left out, and do not belong to a linear system. An index is k, not l.",
    )  # fmt: skip
    chain = Chain.uniform(2)
    off = acceleration_error(paper_matrices(chain), chain)
    yield Finding(
        "by-row", "Eqs. (52), (53)", "the sum over j splits into an equation for each entry (i, j)",
        "M_ij theta''_j = K_ij", f"accelerations of two unit bodies: off by {off:.0%}",
        Verdict.of(off < 1e-6),
        "Equal sums need not have equal terms. With theta_i ~ theta_j the velocity terms vanish; "
        "the text lets them become theta'_j^2 theta_j and then theta'_j^2.",
    )  # fmt: skip
