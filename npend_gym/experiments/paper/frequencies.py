"""Section 3: characteristic frequencies and the pseudo-period T(N) that follows from them."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from npend_gym import theory
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.experiments.paper.finding import Finding, Verdict
from npend_gym.experiments.paper.fits import show
from npend_gym.experiments.paper.formula import uneven_chains
from npend_gym.experiments.paper.linear import paper_matrices


def paper_frequencies(chain: Chain) -> FloatArray:
    """Return omega_j = sqrt(g m_j / (l_j M)) [rad/s] of the text after Eq. (24), in rod order."""
    total = chain.masses.sum()
    return np.sqrt(chain.gravity * chain.masses / (chain.lengths * total))


def diagonal_frequencies(chain: Chain) -> FloatArray:
    """Return the roots of Eq. (24) [rad/s], before M replaces the mass that each rod carries."""
    return np.sqrt(chain.gravity * chain.masses / (chain.lengths * chain.carried_masses))


def period_ratio(chain: Chain) -> float:
    """Return the paper's T(N), Eq. (25), by the period of the slowest mode."""
    return theory.ideal_period(chain) / theory.fundamental_period(chain)


def generalised_roots(stiffness: FloatArray, mass: FloatArray) -> FloatArray:
    """Return the omega [rad/s] with det(stiffness - omega^2 mass) = 0, increasing."""
    squares = np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real.astype(np.float64)
    return np.sqrt(np.sort(squares))


def closest_ratio(chain: Chain) -> float:
    """Return the least ratio of neighbouring normal frequencies: beats need it close to one."""
    omega, _ = theory.normal_modes(chain)
    return float(np.min(omega[1:] / omega[:-1]))


def findings() -> Iterator[Finding]:
    """Yield the findings about the frequencies and T(N)."""
    yield _beats()
    yield from _about_frequencies()
    yield from _about_the_period()


def _beats() -> Finding:
    equal = [closest_ratio(Chain.uniform(n)) for n in (2, 5, 20)]
    light = closest_ratio(Chain([1.0, 0.01], 1.0))
    return Finding(
        "beats", "text", "small oscillations of N bodies exhibit beats", "-",
        f"closest frequencies: ratio {show(equal)} for N = 2, 5, 20 equal rods; {light:.3f} for a "
        "pendulum with a hundredth of its mass below",
        Verdict.of(max(equal) < 1.2, Verdict.CORRECTED),
        "They are sums of N modes; beats, a slow swelling, need two close frequencies, which "
        "equal bobs have only among the fast modes of long chains.",
    )  # fmt: skip


def _about_frequencies() -> Iterator[Finding]:
    chain = uneven_chains()[0]
    mass, stiffness = paper_matrices(chain)
    unit = float(np.max(np.abs(generalised_roots(mass, mass) - 1.0)))  # K is printed equal to M
    expected = np.sort(diagonal_frequencies(chain))
    mended = float(np.max(np.abs(generalised_roots(stiffness, mass) / expected - 1.0)))
    yield Finding(
        "determinant", "Eqs. (23), (24)", "frequencies from det(K - omega^2 M) = 0",
        "K as in Eq. (20), equal to M",
        f"as printed omega = 1 for any chain (to {unit:.0e}); "
        f"with L for K, Eq. (24) to {mended:.0e}",
        Verdict.of(unit > 1e-9, Verdict.CORRECTED if mended < 1e-9 else Verdict.FAILS),
        "The stiffness is L, Eq. (21); Eq. (24) has it right, for the diagonal matrices.",
    )  # fmt: skip
    rows: list[str] = []
    worst = 0.0
    for n in (2, 5, 100):
        uniform = Chain.uniform(n)
        exact, paper = theory.normal_modes(uniform)[0], paper_frequencies(uniform)
        worst = max(worst, float(np.max(np.abs(np.sort(paper) / exact - 1.0))))
        rows.append(f"N={n}: {exact[0]:.3f} to {exact[-1]:.3f}, the paper's {paper[0]:.3f}")
    yield Finding(
        "normal-frequencies", "text after Eq. (24)", "the characteristic frequencies",
        "omega_j = sqrt(g m_j/(l_j M))", f"equal rods [rad/s]: {'; '.join(rows)}",
        Verdict.of(worst < 1e-3),
        "The true ones spread as the zeros of the Laguerre polynomial L_N (their squares times "
        "l/g); the paper's all coincide below them.",
    )  # fmt: skip
    shares = [
        chain.masses.sum() / chain.carried_masses for chain in map(Chain.uniform, (2, 10, 100))
    ]
    yield Finding(
        "carried-mass", "text after Eq. (24)", "every rod carries nearly the whole mass",
        "M ~ sum_{k>=j} m_k",
        "M by the mass carried, mean over rods and last rod: "
        + show((s.mean(), s[-1]) for s in shares) + " for N = 2, 10, 100",
        Verdict.of(all(s.max() < 1.1 for s in shares)),
        "True of the first rod alone; for equal bobs the last one carries M/N.",
    )  # fmt: skip


def _about_the_period() -> Iterator[Finding]:
    grain = period_ratio(Chain([1.0, 1e-6], 1.0))
    ratios = np.array([period_ratio(chain) for chain in uneven_chains()])
    yield Finding(
        "period", "Eq. (25)", "pseudo-period for any masses and lengths",
        "T(N) = 2 pi N / sum sqrt(g m_i/(l_i M))",
        f"T(N)/T1 of 20 chains of 4 unequal rods: {ratios.min():.2f} to {ratios.max():.2f}; of a "
        f"pendulum with a grain hung below: {grain:.2f}",
        Verdict.of(bool(np.all(np.abs(ratios - 1.0) < 0.05))),
        "T1 is the period of the slowest mode. Exact for one rod; for more it averages frequencies "
        "that the chain does not have: a second bob of a millionth of the mass, on an equal rod, "
        "doubles T(N) and changes nothing.",
    )  # fmt: skip
    chains = [Chain.uniform(n, length=0.7) for n in (1, 2, 5, 100)]
    closed = [2.0 * math.pi * math.sqrt(0.7 * c.n / c.gravity) for c in chains]
    algebra = max(
        abs(theory.ideal_period(c) / t - 1.0) for c, t in zip(chains, closed, strict=True)
    )
    yield Finding(
        "period-equal", "Eq. (26)", "the same for equal masses and lengths",
        "T(N) = 2 pi sqrt(l/g) sqrt(N)", f"follows from Eq. (25) to {algebra:.0e}",
        Verdict.of(algebra < 1e-12), 'Algebra alone ("mn" in the printed root is mN).',
    )  # fmt: skip
    counts = (1, 2, 5, 20, 100, 500)
    errors = [abs(period_ratio(Chain.uniform(n)) - 1.0) for n in counts]
    yield Finding(
        "better-with-n", "text after Table 6", "the model approaches the truth as N grows",
        "more closely as N -> infinity",
        f"|T0/T1 - 1| = {show(errors)} for N = {', '.join(map(str, counts))}",
        Verdict.of(errors[-1] < errors[1]),
        "Exact for N = 1, the error grows to j01/2 - 1 = 0.2024, j01 being the first zero of the "
        "Bessel function J0; T1 is the period of the slowest mode.",
    )  # fmt: skip
