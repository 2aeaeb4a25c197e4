"""Section 3: characteristic frequencies and the pseudo-period T(N) that follows from them."""

import math

import numpy as np

from npend_gym import Chain, theory
from npend_gym.tools import FloatArray
from paper.checks.linear import paper_matrices
from paper.motions import samples
from paper.registry import Outcome, check, holds_if, slip_if


@check("beats")
def _beats() -> Outcome:
    def closest(chain: Chain) -> float:  # ratio of neighbouring frequencies: near one, they beat
        omega, _ = theory.normal_modes(chain)
        return float(np.min(omega[1:] / omega[:-1]))

    equal, light = [closest(Chain.uniform(n)) for n in (2, 5, 20)], closest(Chain([1.0, 0.01], 1.0))
    return holds_if(max(equal) < 1.2, equal=equal, light=light)


def diagonal_frequencies(chain: Chain) -> FloatArray:
    """Return the roots of Eq. (24) [rad/s], before M replaces the mass that each rod carries."""
    return np.sqrt(chain.gravity * chain.masses / (chain.lengths * chain.carried_masses))


def generalised_roots(stiffness: FloatArray, mass: FloatArray) -> FloatArray:
    """Return the omega [rad/s] with det(stiffness - omega^2 mass) = 0, increasing."""
    return np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real))


@check("determinant")
def _determinant() -> Outcome:
    chain = samples(4)[0].chain
    mass, stiffness = paper_matrices(chain)
    unit = float(np.max(np.abs(generalised_roots(mass, mass) - 1.0)))  # K is printed equal to M
    expected = np.sort(diagonal_frequencies(chain))
    mended = float(np.max(np.abs(generalised_roots(stiffness, mass) / expected - 1.0)))
    judge = holds_if if unit > 1e-9 else slip_if
    return judge(unit > 1e-9 or mended < 1e-9, unit=unit, mended=mended)


def paper_frequencies(chain: Chain) -> FloatArray:
    """Return omega_j = sqrt(g m_j / (l_j M)) [rad/s] of the text after Eq. (24), in rod order."""
    return np.sqrt(chain.gravity * chain.masses / (chain.lengths * chain.masses.sum()))


@check("normal-frequencies")
def _normal_frequencies() -> Outcome:
    spectra: list[str] = []
    worst = 0.0
    for n in (2, 5, 100):
        exact, _ = theory.normal_modes(Chain.uniform(n))
        paper = paper_frequencies(Chain.uniform(n))
        worst = max(worst, float(np.max(np.abs(np.sort(paper) / exact - 1.0))))
        spectra.append(f"N={n}: {exact[0]:.3f} to {exact[-1]:.3f}, the paper's {paper[0]:.3f}")
    return holds_if(worst < 1e-3, spectra="; ".join(spectra))


@check("mean-frequency")
def _mean_frequency(n_values: tuple[int, ...] = (10, 100, 1000)) -> Outcome:
    # The zeros of L_N have the density sqrt((4N - x)/x)/(2 pi N): the mean of their square roots
    # is 8 sqrt(N)/(3 pi)
    ratios, fundamental = list[float](), list[float]()
    for n in n_values:
        omega, unit = theory.uniform_frequencies(n), theory.single_period()
        period = 2.0 * math.pi / float(omega.mean())
        ratios.append(period / (3.0 * math.pi / 8.0 * unit / math.sqrt(n)))
        fundamental.append(period * float(omega[0]) / (2.0 * math.pi))
    return holds_if(abs(fundamental[-1] - 1.0) < 0.1, ratios=ratios, fundamental=fundamental)


@check("without-replacement")
def _without_replacement(n_values: tuple[int, ...] = (5, 100, 10_000)) -> Outcome:
    chains = [Chain.uniform(n) for n in n_values]
    periods = np.array([2.0 * math.pi / diagonal_frequencies(one).mean() for one in chains])
    ratios = periods / np.array([*map(theory.ideal_period, chains)])
    return holds_if(abs(float(ratios[-1]) - 1.0) < 0.05, ratios=ratios)


@check("carried-mass")
def _carried_mass() -> Outcome:
    ratios = [one.masses.sum() / one.carried_masses for one in map(Chain.uniform, (2, 10, 100))]
    shown = [(float(ratio.mean()), float(ratio[-1])) for ratio in ratios]
    return holds_if(all(ratio.max() < 1.1 for ratio in ratios), shares=shown)


def period_ratio(chain: Chain) -> float:
    """Return the paper's T(N), Eq. (25), by the period of the slowest mode."""
    return theory.ideal_period(chain) / theory.fundamental_period(chain)


@check("period")
def _period() -> Outcome:
    ratios = np.array([period_ratio(motion.chain) for motion in samples(4)])
    least, greatest = ratios.min(), ratios.max()
    grain = period_ratio(Chain([1.0, 1e-6], 1.0))
    holds = bool(least > 0.95 and greatest < 1.05)
    return holds_if(holds, least=least, greatest=greatest, grain=grain)


@check("period-equal")
def _period_equal() -> Outcome:
    chains = [Chain.uniform(n, length=0.7) for n in (1, 2, 5, 100)]
    closed = [2.0 * math.pi * math.sqrt(0.7 * chain.n / chain.gravity) for chain in chains]
    algebra = np.max(np.abs(np.array([*map(theory.ideal_period, chains)]) / closed - 1.0))
    return holds_if(bool(algebra < 1e-12), algebra=algebra)


@check("better-with-n")
def _better_with_n() -> Outcome:
    errors = [abs(period_ratio(Chain.uniform(n)) - 1.0) for n in (1, 2, 5, 20, 100, 500)]
    return holds_if(errors[-1] < errors[1], errors=errors, last=errors[-1])
