"""What the paper says of integrators: Runge-Kutta of appendix C, Euler's error, Kane's method."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import cast

import numpy as np
from scipy.integrate import odeint

from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.experiments.paper.chaos import neighbour_growth
from npend_gym.experiments.paper.finding import Finding, Verdict
from npend_gym.experiments.paper.fits import exponent, show
from npend_gym.experiments.paper.formula import our_accelerations, samples, uneven_chains
from npend_gym.physics import linearise, simulate
from npend_gym.physics.energy import energy
from npend_gym.physics.kernels.dynamics import derivative, new_work, pack_rods

Rates = Callable[[float, FloatArray], FloatArray]
CHAIN = Chain([1.0, 0.5, 2.0], [1.0, 0.7, 0.4])
START = np.array([0.9, 0.4, 0.6, 0.5, -0.3, 0.8])  # a generic state: angles, angular velocities
STEPS: FloatArray = 0.02 * 0.5 ** np.arange(5.0)  # s


def rates(chain: Chain) -> Rates:
    """Return the function (t, state) -> d/dt (theta, omega) of Eq. (32)."""
    rods, work, torque = pack_rods(chain), new_work(chain.n), np.zeros(chain.n)

    def f(_t: float, state: FloatArray) -> FloatArray:
        out = np.empty(state.size)
        derivative(state, torque, rods, work, out)
        return out

    return f


def runge_kutta_step(f: Rates, t: float, state: FloatArray, tau: float) -> FloatArray:
    """Return the state one step on, by Eqs. (56) and (57); their Y_4 is K_4."""
    k1 = tau * f(t, state)
    k2 = tau * f(t + 0.5 * tau, state + 0.5 * k1)
    k3 = tau * f(t + 0.5 * tau, state + 0.5 * k2)
    k4 = tau * f(t + tau, state + k3)
    return state + (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0


def exact(chain: Chain, state: FloatArray, span: float) -> FloatArray:
    """Return the state `span` seconds on, to some fourteen digits."""
    n = chain.n
    path = simulate(chain, state[:n], state[n:], [0.0, span], rtol=1e-14, atol=1e-16)
    return np.concatenate([path.theta[-1], path.omega[-1]])


@cache
def runge_kutta_errors(span: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """Return the errors of one step, and after `span` seconds, for every step of `STEPS`."""
    f = rates(CHAIN)
    local: list[float] = []
    after: list[float] = []
    for tau in STEPS.tolist():
        local.append(_distance(runge_kutta_step(f, 0.0, START, tau), exact(CHAIN, START, tau)))
        state = START
        for k in range(round(span / tau)):
            state = runge_kutta_step(f, k * tau, state, tau)
        after.append(_distance(state, exact(CHAIN, START, span)))
    return np.array(local), np.array(after)


def taylor_remainders() -> FloatArray:
    """Return what Theta0 + tau Theta' + tau^2 Theta''/2, Eq. (33), leaves for every step."""
    velocity = rates(CHAIN)(0.0, START)
    bend = linearise(CHAIN, START[:3], START[3:]).A @ velocity  # second derivative of the state
    steps = STEPS.tolist()
    return np.array(
        [
            _distance(START + s * velocity + 0.5 * s * s * bend, exact(CHAIN, START, s))
            for s in steps
        ]
    )


def euler_ratios() -> FloatArray:
    """Return the error of one Euler step by tau^2 |Theta''| / 2, Eq. (34), for every step."""
    omega, alpha = START[3:], rates(CHAIN)(0.0, START)[3:]
    errors = [_distance(START[:3] + s * omega, exact(CHAIN, START, s)[:3]) for s in STEPS.tolist()]
    return np.array(errors) / (0.5 * STEPS**2 * np.linalg.norm(alpha))


def signs_by_curvature(tau: float = 1e-3) -> tuple[float, float]:
    """Return how often the error of an angle has the sign of its curvature: Euler's, RK4's.

    Shares of all rods of random chains in random states, after one step of `tau` seconds.
    """
    euler: list[FloatArray] = []
    runge_kutta: list[FloatArray] = []
    for motion in samples(4):
        chain = Chain(motion.m, motion.l)
        state = np.concatenate([motion.theta, motion.omega])
        f = rates(chain)
        truth = exact(chain, state, tau)[:4]
        bend = np.sign(motion.alpha)
        euler.append(np.sign(truth - (state + tau * f(0.0, state))[:4]) == bend)
        step = runge_kutta_step(f, 0.0, state, 10.0 * tau)[:4]  # longer, to be above rounding
        runge_kutta.append(np.sign(exact(chain, state, 10.0 * tau)[:4] - step) == bend)
    return float(np.mean(euler)), float(np.mean(runge_kutta))


@cache
def odeint_errors(n: int, length: float) -> tuple[float, float]:
    """Return the error of the paper's integrator, `odeint` by default, after 10 s from pi/4.

    The largest error of an angle [rad], and of the energy relative to its start, over all frames
    of the paper, for `n` rods of `length` [m].
    """
    chain = Chain.uniform(n, length=length)
    times = np.linspace(0.0, 10.0, 1000)
    start = np.concatenate([np.full(n, np.pi / 4), np.zeros(n)])
    state = cast("FloatArray", odeint(rates(chain), start, times, tfirst=True))
    reference = simulate(chain, np.pi / 4, 0.0, times, rtol=1e-13, atol=1e-14)
    kept = energy(chain, state[:, :n], state[:, n:])
    drift = float(np.max(np.abs(kept / kept[0] - 1.0)))
    return float(np.max(np.abs(state[:, :n] - reference.theta))), drift


def findings() -> Iterator[Finding]:
    """Yield the findings about integrators."""
    yield from _about_runge_kutta()
    yield from _about_euler()
    yield from _about_truncation()


def _about_truncation() -> Iterator[Finding]:
    counts = (5, 20, 100)
    metre = [odeint_errors(n, 1.0) for n in counts]
    short = [odeint_errors(n, 1.0 / n) for n in counts]
    worst = max(drift for _, drift in (*metre, *short))
    grows = [errors[-1][0] > 100.0 * errors[0][0] for errors in (metre, short)]
    yield Finding(
        "truncation", "text after the figures", "accuracy falls as pendulums are added",
        "global truncation error increases as N -> infinity",
        f"odeint as in the listing, N = 5, 20, 100: angles off by {show(e for e, _ in metre)} rad "
        f"after 10 s on rods of 1 m, by {show(e for e, _ in short)} rad on rods of 1/n m; energy "
        f"kept to {worst:.0e} in all six; there a change of the start by 1e-8 rad grows "
        f"{neighbour_growth(100, length=0.01):.0e}-fold for N = 100",
        Verdict.of(all(grows), Verdict.CORRECTED if any(grows) else Verdict.FAILS),
        "On the rods of the text it does not grow. On the listing's it does, because that motion "
        "is chaotic for N = 100 and any error grows with it: no method could do better for long.",
    )  # fmt: skip
    chain = uneven_chains()[0]
    theta = np.full(chain.n, 0.01)
    truth = our_accelerations(chain, theta, np.zeros(chain.n))
    off = _distance(-chain.gravity * chain.masses * theta, truth) / float(np.linalg.norm(truth))
    yield Finding(
        "first-order-system", "Eqs. (31), (32)", "the system as one of first order",
        "F = -K Theta'^T Theta' - L Theta", f"accelerations of a small motion: off by {off:.0%}",
        Verdict.of(off < 0.01),
        "M^-1 is missing, and units with it; and it is the full Eq. (17) that the listing "
        "integrates. To set alpha = (Theta, Theta') and integrate that, Eq. (32), is right.",
    )  # fmt: skip


def _about_runge_kutta() -> Iterator[Finding]:
    local, after = runge_kutta_errors()
    orders = exponent(STEPS, local), exponent(STEPS, after)
    halving = float(after[-2] / after[-1])
    right = abs(orders[0] - 5.0) < 0.2 and abs(orders[1] - 4.0) < 0.2
    yield Finding(
        "rk4-orders", "text after Eq. (32)", "truncation errors of RK4",
        "local O(tau^5), global O(tau^4), halving tau divides it by 16",
        f"local tau^{orders[0]:.2f}, global tau^{orders[1]:.2f}; halving divides by {halving:.1f}",
        Verdict.of(right and abs(halving - 16.0) < 1.6),
        "Measured on three unequal rods against the adaptive integrator at 1e-14.",
    )  # fmt: skip
    ours = simulate(CHAIN, START[:3], START[3:], [0.0, 0.01], method="rk4", dt=0.01)
    step = runge_kutta_step(rates(CHAIN), 0.0, START, 0.01)
    off = _distance(step, np.concatenate([ours.theta[-1], ours.omega[-1]]))
    yield Finding(
        "rk4-formula", "Eqs. (54)-(57)", "the Runge-Kutta step", "(K1 + 2 K2 + 2 K3 + Y4)/6",
        f"with K4 for Y4 it is the package's step to {off:.0e}",
        Verdict.CORRECTED if off < 1e-13 and right else Verdict.FAILS,
        "Y4 is defined nowhere. Two vectors of N numbers each start it.",
    )  # fmt: skip


def _about_euler() -> Iterator[Finding]:
    order = exponent(STEPS, taylor_remainders())
    yield Finding(
        "taylor", "Eq. (33)", "Taylor series of the motion", "remainder O(tau^3)",
        f"tau^{order:.2f}", Verdict.of(abs(order - 3.0) < 0.2),
    )  # fmt: skip
    ratios = euler_ratios()
    yield Finding(
        "local-error", "Eqs. (34), (35)", "local truncation error of the simulation",
        "e = |Theta_1 - Theta(t0 + tau)| = -tau^2 |Theta''|/2, for Theta_1 = Theta0 + tau F",
        f"Euler's step Theta0 + tau Theta': e by tau^2 |Theta''|/2 = {show(ratios[[0, 2, 4]])} as "
        "tau falls",
        Verdict.CORRECTED if abs(ratios[-1] - 1.0) < 0.01 else Verdict.FAILS,
        "A norm is not negative, F of Eq. (31) is an acceleration, no velocity, and the error is "
        "that of Euler's method, which neither the listing (odeint) nor RK4 is.",
    )  # fmt: skip
    euler, runge_kutta = signs_by_curvature()
    yield Finding(
        "curvature", "text after Eq. (35)", "the sign of the error is that of the curvature",
        "concavity and convexity of the integral curve",
        f"true of {euler:.0%} of Euler's steps, {runge_kutta:.0%} of RK4's",
        Verdict.of(euler > 0.99 and runge_kutta > 0.99, Verdict.CORRECTED),
        "Of Euler's method alone; the error of RK4 has the sign of a fifth derivative.",
    )  # fmt: skip


def _distance(a: FloatArray, b: FloatArray) -> float:
    return float(np.linalg.norm(a - b))
