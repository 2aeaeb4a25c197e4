"""Section 1 and what else the paper says of one pendulum: T0, isochrony, the small angle."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.special import ellipj, ellipk

from npend_gym import theory
from npend_gym.chain import STANDARD_GRAVITY, Chain
from npend_gym.experiments.paper.finding import Finding, Verdict
from npend_gym.experiments.paper.fits import exponent, show
from npend_gym.experiments.paper.formula import our_accelerations
from npend_gym.period import pseudo_periods
from npend_gym.physics import simulate
from npend_gym.physics.energy import potential_energy

PENDULUM = Chain(masses=1.3, lengths=0.7)  # not of unit size, so that no factor can hide
ANGLES = np.linspace(-3.0, 3.0, 25)  # rad
QUARTER = math.pi / 4  # rad, the paper's release


def measured_period(theta0: float, chain: Chain = PENDULUM) -> float:
    """Return the period [s] of one pendulum released from `theta0` [rad], by simulation."""
    return float(pseudo_periods(chain, theta0, reading="link", rtol=1e-13)[0])


def torque_error() -> float:
    """Return how far -m g l sin(theta) is off the slope of the potential energy, relatively."""
    m, l = float(PENDULUM.masses[0]), float(PENDULUM.lengths[0])
    step = 1e-5
    energy = [potential_energy(PENDULUM, (ANGLES + s)[:, None]) for s in (step, -step)]
    slope = (energy[0] - energy[1]) / (2.0 * step)
    weight = m * PENDULUM.gravity * l
    return float(np.max(np.abs(slope - weight * np.sin(ANGLES))) / weight)


def equation_error() -> float:
    """Return how far Eq. (1) is off the package's dynamics [relative to g/l]."""
    rate = PENDULUM.gravity / float(PENDULUM.lengths[0])
    ours = [our_accelerations(PENDULUM, np.array([a]), np.zeros(1))[0] for a in ANGLES.tolist()]
    return float(np.max(np.abs(np.array(ours) + rate * np.sin(ANGLES))) / rate)


def cosine_error(theta0: float = 1e-3, periods: float = 5.0) -> float:
    """Return how far theta0 cos(sqrt(g/l) t), Eq. (4), is off a simulated swing, by theta0."""
    rate = math.sqrt(PENDULUM.gravity / float(PENDULUM.lengths[0]))
    times = np.linspace(0.0, periods * 2.0 * math.pi / rate, 301)
    path = simulate(PENDULUM, theta0, 0.0, times, rtol=1e-12, atol=1e-16)
    return float(np.max(np.abs(path.theta[:, 0] - theta0 * np.cos(rate * times))) / theta0)


def elliptic_error(theta0: float = 2.0) -> float:
    """Return how far the exact solution by Jacobi's sn is off a simulated swing [rad].

    sin(theta/2) = k sn(K(k) + sqrt(g/l) t, k), k = sin(theta0/2): at rest at theta0 for t = 0.
    """
    rate = math.sqrt(PENDULUM.gravity / float(PENDULUM.lengths[0]))
    times = np.linspace(0.0, 10.0, 301)
    k = math.sin(0.5 * theta0)
    sn = ellipj(ellipk(k * k) + rate * times, k * k)[0]
    path = simulate(PENDULUM, theta0, 0.0, times, rtol=1e-13, atol=1e-14)
    return float(np.max(np.abs(path.theta[:, 0] - 2.0 * np.arcsin(k * sn))))


def third_harmonic(theta0: float = QUARTER) -> float:
    """Return the share of the third harmonic in a free swing, relative to the first."""
    period = measured_period(theta0)
    times = np.linspace(0.0, period, 257)
    path = simulate(PENDULUM, theta0, 0.0, times, rtol=1e-12, atol=1e-13)
    spectrum = np.abs(np.fft.rfft(path.theta[:-1, 0]))
    return float(spectrum[3] / spectrum[1])


def error_orders() -> dict[str, float]:
    """Return the exponents in theta with which the small-angle errors grow, measured.

    "torque": of sin(theta) - theta; "relative torque": the same by theta; "period": of T/T0 - 1
    from simulated swings.
    """
    angles = np.geomspace(0.02, 0.2, 5)
    torque = angles - np.sin(angles)
    t0 = theory.single_period(float(PENDULUM.lengths[0]))
    period = np.array([measured_period(a) / t0 - 1.0 for a in angles.tolist()])
    return {
        "torque": exponent(angles, torque),
        "relative torque": exponent(angles, torque / angles),
        "period": exponent(angles, period),
    }


def findings() -> Iterator[Finding]:
    """Yield the findings about one pendulum."""
    yield from _about_the_equation()
    yield from _about_the_period()
    yield from _about_the_conclusion()


def _about_the_equation() -> Iterator[Finding]:
    yield Finding(
        "history", "text", "Galileo's discovery, Newton's and geodesy's use of it", "-", "-",
        Verdict.UNDECIDABLE, "History: no computation speaks to it.",
    )  # fmt: skip
    off = torque_error()
    yield Finding(
        "torque", "text", "restoring torque", "tau = -m g l sin theta ~ -m g l theta",
        f"slope of the potential energy: equal to {off:.0e}; the linear form is "
        f"{1.0 / math.sin(1.0) - 1.0:.0%} too strong at 1 rad",
        Verdict.of(off < 1e-8),
    )  # fmt: skip
    off = equation_error()
    yield Finding(
        "pendulum-equation", "Eq. (1)", "equation of motion of one pendulum",
        "theta'' + (g/l) sin theta = 0", f"off by {off:.0e} of g/l at 25 angles",
        Verdict.of(off < 1e-12),
    )  # fmt: skip
    off = cosine_error()
    yield Finding(
        "small-swing", "Eqs. (2), (3), (4)", "solution for small angles",
        "theta0 cos(sqrt(g/l) t)", f"from 0.001 rad, after 5 periods: off by {off:.0e} of theta0",
        Verdict.of(off < 1e-5),
    )  # fmt: skip
    excess = measured_period(1.0) / theory.single_period(float(PENDULUM.lengths[0])) - 1.0
    yield Finding(
        "one-radian", "text before Eq. (2)", "what is sufficiently small", "less than 1 radian",
        f"T/T0 - 1 = {excess:.2%} at 1 rad", Verdict.of(excess < 0.01, Verdict.CORRECTED),
        "A matter of the accuracy wanted: theta0^2/16 < 1 % needs theta0 < 0.4 rad.",
    )  # fmt: skip
    share = third_harmonic()
    yield Finding(
        "nonlinear", "text after the list",
        "oscillations are non-linear, depending on the amplitude", '"for driven harmonic motion"',
        f"free swing from pi/4: third harmonic {share:.2%} of the first",
        Verdict.of(share < 1e-6, Verdict.CORRECTED),
        "It needs no drive: the paper's chains are free, and non-linear.",
    )  # fmt: skip
    off = elliptic_error()
    yield Finding(
        "elliptic", "text before Eq. (27)", "exact solution by Jacobi's elliptic sine",
        "of Eq. (17)", f"N = 1, from 2 rad, 10 s: off by {off:.0e} rad",
        Verdict.CORRECTED if off < 1e-9 else Verdict.FAILS,
        "Of Eq. (1), one pendulum. Longer chains have no such solution, see `no-solution`.",
    )  # fmt: skip


def _about_the_period() -> Iterator[Finding]:
    t0 = theory.single_period(float(PENDULUM.lengths[0]))
    off = abs(measured_period(1e-3) / t0 - 1.0)
    yield Finding(
        "single-period", "Eq. (5)", "period for small angles", "T0 = 2 pi sqrt(l/g)",
        f"measured from 0.001 rad: T/T0 - 1 = {off:.1e}", Verdict.of(off < 1e-6),
    )  # fmt: skip
    ratios = [measured_period(a) / t0 for a in (0.1, QUARTER, 1.5)]
    yield Finding(
        "isochrony", "text after Eq. (5), conclusion", "the simple pendulum is isochronous",
        "T independent of theta0", f"T/T0 = {show(ratios, 6)} at 0.1, pi/4, 1.5 rad",
        Verdict.of(max(ratios) < 1.0 + 1e-6, Verdict.CORRECTED),
        "In the limit of small angles; from pi/4 a swing takes 4 % longer.",
    )  # fmt: skip
    orders = error_orders()
    yield Finding(
        "cubic-error", "text after Eq. (5)", "how the error of the approximation grows",
        "like theta^3",
        f"torque: theta^{orders['torque']:.2f}; its relative error: "
        f"theta^{orders['relative torque']:.2f}; period: theta^{orders['period']:.2f}",
        Verdict.of(abs(orders["period"] - 3.0) < 0.1, Verdict.CORRECTED),
        "theta^3/6 is the error of the torque. The text speaks of the period and its isochrony, "
        "whose relative error grows like theta^2/16.",
    )  # fmt: skip


def _about_the_conclusion() -> Iterator[Finding]:
    one = Chain.uniform(1)
    ours = measured_period(QUARTER, one)
    formula = float(theory.pendulum_period(QUARTER))
    yield Finding(
        "one-pendulum", "last equation", "period of one pendulum from pi/4",
        "2 pi sqrt(1/g) [1 + sum ((2n)!/(2^(2 pi) (n!)^2))^2 sin^(2n)(pi/8)]",
        f"measured {ours:.8f} s; the formula with 2^(2n) {formula:.8f} s; as printed it diverges",
        Verdict.CORRECTED if abs(ours - formula) < 1e-8 else Verdict.FAILS,
        "With l = 1 m and g = 9.81 m/s^2; the factor is that of Eq. (27).",
    )  # fmt: skip
    alpha = float(our_accelerations(one, np.array([math.pi / 2]), np.zeros(1))[0])
    yield Finding(
        "right-angle", "text", "theta0 = pi/2 would be an unstable equilibrium", "pi/2",
        f"acceleration there: {alpha:.2f} rad/s^2, that is {alpha / STANDARD_GRAVITY:+.0f} g/l",
        Verdict.of(abs(alpha) < 1e-9),
        "At pi/2 gravity pulls hardest. The unstable equilibrium is upright, at pi.",
    )  # fmt: skip
    two = Chain.uniform(2)
    off_one = measured_period(0.01, one) / theory.ideal_period(one) - 1.0
    off_two = theory.fundamental_period(two) / theory.ideal_period(two) - 1.0
    yield Finding(
        "third-order", "text", "T0 is accurate", "up to third order in a Taylor series",
        f"as theta0 -> 0, T/T0 - 1 tends to {off_two:+.3f} for N = 2; for N = 1 it is "
        f"{off_one / 0.01**2:.4f} theta0^2",
        Verdict.of(abs(off_two) < 1e-6),
        "For one pendulum it is accurate to first order, the error being theta0^2/16; for more "
        "not even to order zero.",
    )  # fmt: skip
