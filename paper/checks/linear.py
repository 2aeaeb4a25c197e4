"""Section 3 and appendix B: the linearised system, as the paper has it and as it is."""

import math

import numpy as np

from npend_gym import Chain, simulate, theory
from npend_gym.experiments import power_law
from npend_gym.physics import accelerations, linearise, mass_matrix
from npend_gym.tools import FloatArray
from paper.motions import largest_error, samples
from paper.registry import Outcome, Verdict, check, holds_if

SMALL = 1e-5  # rad: where the dynamics are linear to ten digits


def paper_matrices(chain: Chain) -> tuple[FloatArray, FloatArray]:
    """Return the diagonal matrices M = K and L of Eqs. (19)-(21), shape (n, n) each."""
    return np.diag(chain.lengths * chain.carried_masses), np.diag(chain.gravity * chain.masses)


def full_matrices(chain: Chain) -> tuple[FloatArray, FloatArray]:
    """Return M and L of the equations of motion to first order, M theta'' + L theta = 0."""
    mu = chain.carried_masses
    return np.minimum.outer(mu, mu) * chain.lengths, np.diag(chain.gravity * mu)


def acceleration_error(matrices: tuple[FloatArray, FloatArray], chain: Chain) -> float:
    """Return how far -M^-1 L theta is off the true accelerations near rest (relative)."""
    theta = SMALL * np.random.default_rng(chain.n).normal(size=chain.n)
    mass, stiffness = matrices
    truth = accelerations(chain, theta, 0.0)
    error = -np.linalg.solve(mass, stiffness @ theta) - truth
    return float(np.max(np.abs(error)) / np.max(np.abs(truth)))


@check("matrices")
def _matrices() -> Outcome:
    chain = samples(4)[0].chain
    printed, full = (acceleration_error(f(chain), chain) for f in (paper_matrices, full_matrices))
    return holds_if(printed < 1e-6, printed=printed, full=full)


@check("by-row")
def _by_row() -> Outcome:
    off = acceleration_error(paper_matrices(Chain.uniform(2)), Chain.uniform(2))
    return holds_if(off < 1e-6, off=off)


@check("quadratic-term")
def _quadratic_term() -> Outcome:
    odd = largest_error(  # how far the accelerations are from changing sign with the state
        lambda at: at.alpha, lambda at: -accelerations(at.chain, -at.theta, -at.omega)
    )
    return holds_if(odd > 1e-9, odd=odd)


@check("initial-conditions")
def _initial_conditions() -> Outcome:
    matrices = [mass_matrix(motion.chain, motion.theta) for motion in samples(4)]
    least = min(float(np.linalg.eigvalsh(matrix)[0]) for matrix in matrices)
    return holds_if(least > 0.0, least=least)


@check("modes")
def _modes() -> Outcome:
    chain = Chain([1.0, 0.5, 2.0], [1.0, 0.7, 0.4])
    omega, modes = theory.normal_modes(chain)
    error = 0.0
    for k, shape in enumerate(modes.T):  # each is released alone
        rate = float(omega[k])
        times = np.linspace(0.0, 20.0 * np.pi / rate, 101)
        path = simulate(chain, SMALL * shape, 0.0, times, rtol=1e-12, atol=1e-16)
        expected = SMALL * shape * np.cos(rate * times)[:, None]
        error = max(error, float(np.max(np.abs(path.theta - expected)) / SMALL))
    return holds_if(error < 1e-6, error=error)


@check("jacobian")
def _jacobian() -> Outcome:
    chain = samples(4)[0].chain
    a = linearise(chain, 0.0).A[chain.n :, : chain.n]
    mass, stiffness = full_matrices(chain)
    off = float(np.max(np.abs(a + np.linalg.solve(mass, stiffness))) / np.max(np.abs(a)))
    return holds_if(off < 1e-12, off=off)


@check("expansions")
def _expansions() -> Outcome:
    cosine, sine = abs(math.cos(0.1) - 0.1), abs(math.sin(0.1) - 1.0)
    swapped = {"cosine_swapped": 1.0 - math.cos(0.1), "sine_swapped": 0.1 - math.sin(0.1)}
    holds = max(cosine, sine) < 0.01
    return holds_if(holds, Verdict.SLIP, cosine=cosine, sine=sine, **swapped)


@check("linearised")
def _linearised() -> Outcome:
    # The order in the amplitude of what Eq. (51) misses, with its terms theta'_j^2 and without
    sizes, motion = np.geomspace(0.01, 0.1, 5), samples(4)[0]
    mass, stiffness = full_matrices(motion.chain)
    errors: dict[str, list[float]] = {"kept": [], "dropped": []}
    for size in sizes.tolist():
        theta: FloatArray = size * motion.theta
        omega: FloatArray = size * motion.omega
        truth, between = accelerations(motion.chain, theta, omega), size * motion.between
        squares = (between * motion.carried("max")) @ (motion.l * omega**2)
        for name, force in (("kept", stiffness @ theta + squares), ("dropped", stiffness @ theta)):
            residual = np.linalg.solve(mass, -force) - truth
            errors[name].append(float(np.max(np.abs(residual))))
    orders = {name: power_law(sizes, error).value for name, error in errors.items()}
    otherwise = Verdict.SLIP if orders["kept"] > 2.9 else Verdict.FAILS
    return holds_if(abs(orders["kept"] - 1.0) < 0.1, otherwise, **orders)
