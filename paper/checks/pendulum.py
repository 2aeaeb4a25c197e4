"""Section 1 and what else the paper says of one pendulum: T0, isochrony, the small angle."""

import math
from itertools import product

import numpy as np
from scipy.special import ellipj, ellipk

from npend_gym import Chain, pseudo_periods, simulate, theory
from npend_gym.chain import STANDARD_GRAVITY
from npend_gym.experiments import PAPER_AMPLITUDE, power_law
from npend_gym.physics import accelerations, linearise, potential_energy
from paper.registry import Outcome, Verdict, check, holds_if, slip_if

PENDULUM = Chain(masses=1.3, lengths=0.7)  # not of unit size, so that no factor can hide
LENGTH = float(PENDULUM.lengths[0])
RATE = math.sqrt(PENDULUM.gravity / LENGTH)  # rad/s, of small swings
ANGLES = np.linspace(-3.0, 3.0, 25)  # rad


def measured_period(theta0: float, chain: Chain = PENDULUM) -> float:
    """Return the period [s] of one pendulum released from `theta0` [rad], by simulation."""
    return float(pseudo_periods(chain, theta0, definition="link", rtol=1e-13)[0])


def excess(theta0: float, chain: Chain = PENDULUM) -> float:
    """Return T/T0 - 1 of one pendulum released from `theta0` [rad], by simulation."""
    return measured_period(theta0, chain) / theory.single_period(float(chain.lengths[0])) - 1.0


check("history")(lambda: Outcome(Verdict.UNDECIDABLE, {}))
check("single-period")(lambda: holds_if((off := abs(excess(1e-3))) < 1e-6, off=off))
check("one-radian")(lambda: Outcome(Verdict.UNDECIDABLE, {"excess": excess(1.0)}))


@check("torque")
def _torque() -> Outcome:
    step = 1e-5
    energy = [potential_energy(PENDULUM, (ANGLES + s)[:, None]) for s in (step, -step)]
    slope = (energy[0] - energy[1]) / (2.0 * step)
    weight = float(PENDULUM.masses[0]) * PENDULUM.gravity * LENGTH
    off = float(np.max(np.abs(slope - weight * np.sin(ANGLES))) / weight)
    return holds_if(off < 1e-8, off=off, excess=1.0 / math.sin(1.0) - 1.0)


@check("pendulum-equation")
def _equation() -> Outcome:
    rate = PENDULUM.gravity / LENGTH
    ours = accelerations(PENDULUM, ANGLES[:, None], 0.0)[:, 0]
    off = float(np.max(np.abs(ours + rate * np.sin(ANGLES))) / rate)
    return holds_if(off < 1e-12, off=off)


@check("small-swing")
def _small_swing() -> Outcome:
    times = np.linspace(0.0, 5.0 * 2.0 * math.pi / RATE, 301)
    path = simulate(PENDULUM, 1e-3, 0.0, times, rtol=1e-12, atol=1e-16)
    off = float(np.max(np.abs(path.theta[:, 0] - 1e-3 * np.cos(RATE * times))) / 1e-3)
    return holds_if(off < 1e-5, off=off)


@check("nonlinear")
def _nonlinear() -> Outcome:
    times = np.linspace(0.0, measured_period(PAPER_AMPLITUDE), 257)
    path = simulate(PENDULUM, PAPER_AMPLITUDE, 0.0, times, rtol=1e-12, atol=1e-13)
    spectrum = np.abs(np.fft.rfft(path.theta[:-1, 0]))
    third = float(spectrum[3] / spectrum[1])
    return slip_if(third > 1e-6, third=third)


@check("elliptic")
def _elliptic() -> Outcome:
    # sin(theta/2) = k sn(K(k) + sqrt(g/l) t, k), k = sin(theta0/2): at rest at theta0 for t = 0
    times, k = np.linspace(0.0, 10.0, 301), math.sin(0.5 * 2.0)
    sn = ellipj(ellipk(k * k) + RATE * times, k * k)[0]
    path = simulate(PENDULUM, 2.0, 0.0, times, rtol=1e-13, atol=1e-14)
    off = float(np.max(np.abs(path.theta[:, 0] - 2.0 * np.arcsin(k * sn))))
    return Outcome(Verdict.FAILS if off < 1e-9 else Verdict.UNDECIDABLE, {"off": off})


@check("isochrony")
def _isochrony() -> Outcome:
    ratios = [1.0 + excess(a) for a in (0.001, PAPER_AMPLITUDE, 1.5)]
    return holds_if(ratios[0] < 1.0 + 1e-6, ratios=ratios)


@check("cubic-error")
def _cubic_error() -> Outcome:
    angles = np.geomspace(0.02, 0.2, 5)
    torque = angles - np.sin(angles)
    errors = {"torque": torque, "relative": torque / angles, "period": [*map(excess, angles)]}
    orders = {name: power_law(angles, error).value for name, error in errors.items()}
    return holds_if(abs(orders["torque"] - 3.0) < 0.1, **orders)


@check("one-pendulum")
def _one_pendulum() -> Outcome:
    measured = measured_period(PAPER_AMPLITUDE, Chain.uniform(1))
    exact = float(theory.pendulum_period(PAPER_AMPLITUDE))
    ratio = 16.0 * math.sin(PAPER_AMPLITUDE / 2.0) ** 2  # of successive terms as printed
    return holds_if(ratio < 1.0, measured=measured, formula=exact)


@check("massive-rods")
def _massive_rods() -> Outcome:
    # One rod of the bob's mass, without the bob, and with it
    bare = Chain([1.0], [1.0], centres=[0.5], inertias=[1.0 / 12.0])
    both = Chain([2.0], [1.0], centres=[0.75], inertias=[1.0 / 12.0 + 2.0 * 0.25**2])
    ratios = [theory.fundamental_period(one) / theory.single_period() for one in (bare, both)]
    return slip_if(max(ratios) < 0.99, bare=ratios[0], both=ratios[1])


@check("zero-offset")
def _zero_offset() -> Outcome:
    chain = Chain.uniform(100)
    alpha = float(np.max(np.abs(accelerations(chain, 0.0, 0.0))))
    theta = simulate(chain, PAPER_AMPLITUDE, 0.0, [0.0, 1.0]).theta[0]
    start = float(theta.max() - PAPER_AMPLITUDE)
    return holds_if(alpha > 0.0 or start > 0.0, alpha=alpha, start=start)


@check("right-angle")
def _right_angle() -> Outcome:
    alpha = float(accelerations(Chain.uniform(1), math.pi / 2, 0.0)[0])
    rods, states = 3, list(product((0.0, math.pi), repeat=3))
    matrices = [linearise(Chain.uniform(rods), np.array(state)).A for state in states]
    others = sum(float(np.linalg.eigvals(A).real.max()) > 1e-3 for A in matrices)
    return holds_if(abs(alpha) < 1e-9, alpha=alpha, relative=alpha / STANDARD_GRAVITY,
                    others=others, rods=rods)  # fmt: skip


@check("third-order")
def _third_order() -> Outcome:
    two = Chain.uniform(2)
    off_two = float(pseudo_periods(two, 1e-3).mean()) / theory.ideal_period(two) - 1.0
    second = excess(0.01, Chain.uniform(1)) / 0.01**2
    return holds_if(abs(off_two) < 1e-6, off_two=off_two, second=second)
