"""What the paper says of integrators: Runge-Kutta of appendix C, Euler's error, odeint."""

import math
from functools import cache
from itertools import count
from typing import Any, cast

import numpy as np
from scipy.integrate import odeint

from npend_gym import Chain, IntegrationError, simulate, theory
from npend_gym.experiments import PAPER_AMPLITUDE, power_law
from npend_gym.physics import accelerations, linearise, right_hand_side, total_energy
from npend_gym.tools import BLUE, ORANGE, FloatArray
from paper.checks.chaos import neighbour_growth
from paper.estimator import LISTING_DURATION
from paper.motions import samples
from paper.registry import Figure, Outcome, check, figure, holds_if, slip_if

CHAIN = Chain([1.0, 0.5, 2.0], [1.0, 0.7, 0.4])
START = np.array([0.9, 0.4, 0.6, 0.5, -0.3, 0.8])  # a generic state: angles, angular velocities
FRAME = 0.01  # s, between the frames of the listing
STABLE = 2.0 * math.sqrt(2.0)  # RK4: longest step of an oscillation times its frequency
STEPS: FloatArray = 0.02 * 0.5 ** np.arange(5.0)  # s


def state_after(chain: Chain, state: FloatArray, span: float, dt: float = 0.0) -> FloatArray:
    """Return the state `span` seconds on, to some fourteen digits, or by RK4 in steps of `dt`."""
    how: dict[str, Any] = {"method": "rk4", "dt": dt} if dt else {"rtol": 1e-14, "atol": 1e-16}
    path = simulate(chain, state[: chain.n], state[chain.n :], [0.0, span], **how)
    return np.concatenate([path.theta[-1], path.omega[-1]])


@cache
def truths() -> FloatArray:
    """Return the true states after one step, a row for every step of `STEPS`."""
    return np.array([state_after(CHAIN, START, tau) for tau in STEPS.tolist()])


@cache
def runge_kutta_errors(span: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """Return the errors of one step, and after `span` seconds, for every step of `STEPS`."""
    steps, end = STEPS.tolist(), state_after(CHAIN, START, span)
    local = np.array([state_after(CHAIN, START, tau, dt=tau) for tau in steps]) - truths()
    after = np.array([state_after(CHAIN, START, span, dt=tau) for tau in steps]) - end
    return np.linalg.norm(local, axis=1), np.linalg.norm(after, axis=1)


@check("rk4-orders")
def _orders() -> Outcome:
    errors = runge_kutta_errors()
    local, after = (power_law(STEPS, error).value for error in errors)
    halving = float(errors[1][-2] / errors[1][-1])
    holds = abs(local - 5.0) < 0.2 and abs(after - 4.0) < 0.2 and abs(halving - 16.0) < 1.6
    return holds_if(holds, local=local, after=after, halving=halving, frame=FRAME, limit=STABLE,
                    unstable=first_unstable(), diverging=first_diverging())  # fmt: skip


def first_unstable() -> int:
    """Return the least n whose n rods of 1/n m, near rest, RK4 cannot follow by `FRAME` seconds."""
    return next(n for n in count(1) if _listed(n)[1] * FRAME > STABLE)


def first_diverging() -> int:
    """Return the least n whose release from pi/4 does not stay finite for the listing's 10 s."""
    return next(n for n in count(first_unstable() // 2) if not _stays_finite(_listed(n)[0]))


def _listed(n: int) -> tuple[Chain, float]:
    """Return n rods of 1/n m, and their fastest frequency [rad/s]."""
    chain = Chain.uniform(n, length=1.0 / n)
    return chain, theory.fastest_frequency(chain)


def _stays_finite(chain: Chain) -> bool:
    try:
        simulate(chain, PAPER_AMPLITUDE, 0.0, [0.0, LISTING_DURATION], method="rk4", dt=FRAME)
    except IntegrationError:
        return False
    return True


@figure(
    "runge_kutta", "rk4-orders", "Errors of Runge-Kutta after one step and after one second.",
    size=(5.0, 3.6), data=lambda: (STEPS, *runge_kutta_errors()),
)  # fmt: skip
def _draw_errors(figure: Figure, data: Any) -> None:
    from matplotlib.ticker import FixedLocator, NullLocator, StrMethodFormatter

    steps, local, after = data
    axes = figure.subplots()
    for errors, order, marker, color, label in (
        (local, 5, "o", BLUE, "after one step"), (after, 4, "s", ORANGE, "after 1 s"),
    ):  # fmt: skip
        axes.plot(1e3 * steps, errors, marker, color=color, label=label)
        guide = errors[0] * (steps / steps[0]) ** order
        axes.plot(1e3 * steps, guide, "--", color=color, linewidth=0.9, label=f"slope {order}")
    axes.set(xscale="log", yscale="log", title="Runge-Kutta, three unequal rods")
    axes.set(xlabel="step [ms]", ylabel="error of the state [rad, rad/s]")
    axes.xaxis.set(major_locator=FixedLocator((1e3 * steps).tolist()), minor_locator=NullLocator())
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.legend()


@check("rk4-formula")
def _formula() -> Outcome:
    f, tau = right_hand_side(CHAIN), 0.01
    k1 = tau * f(0.0, START)  # Eqs. (56) and (57); their Y_4 is K_4
    k2 = tau * f(0.5 * tau, START + 0.5 * k1)
    k3 = tau * f(0.5 * tau, START + 0.5 * k2)
    k4 = tau * f(tau, START + k3)
    step = START + (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0
    off = float(np.linalg.norm(step - state_after(CHAIN, START, tau, dt=tau)))
    return slip_if(off < 1e-13, off=off)


@check("taylor")
def _taylor() -> Outcome:
    velocity = right_hand_side(CHAIN)(0.0, START)
    bend = linearise(CHAIN, START[:3], START[3:]).A @ velocity  # second derivative of the state
    series = START + np.multiply.outer(STEPS, velocity) + np.multiply.outer(0.5 * STEPS**2, bend)
    order = power_law(STEPS, np.linalg.norm(series - truths(), axis=1)).value
    return holds_if(abs(order - 3.0) < 0.2, order=order)


@check("local-error")
def _local_error() -> Outcome:
    omega, alpha = np.split(right_hand_side(CHAIN)(0.0, START), 2)
    euler = START[:3] + np.multiply.outer(STEPS, omega)
    errors = np.linalg.norm(euler - truths()[:, :3], axis=1)
    ratios = errors / (0.5 * STEPS**2 * np.linalg.norm(alpha))  # by Eq. (34)
    return holds_if(abs(ratios[-1] + 1.0) < 0.01, ratios=ratios[[0, 2, 4]])


@check("curvature")
def _curvature() -> Outcome:
    # How often the error of an angle has the sign of its curvature, on random chains
    found: dict[str, list[Any]] = {"euler": [], "runge_kutta": []}
    for motion in samples(4):
        state, bend = np.concatenate([motion.theta, motion.omega]), np.sign(motion.alpha)
        for name, tau in (("euler", 1e-3), ("runge_kutta", 1e-2)):  # to be above rounding
            end = motion.theta + tau * motion.omega
            if name == "runge_kutta":
                end = state_after(motion.chain, state, tau, dt=tau)[:4]
            found[name].append(np.sign(state_after(motion.chain, state, tau)[:4] - end) == bend)
    shares = {name: float(np.mean(signs)) for name, signs in found.items()}
    return holds_if(min(shares.values()) > 0.99, **shares)


@check("first-order-system")
def _first_order_system() -> Outcome:
    chain = samples(4)[0].chain
    theta = np.full(chain.n, 0.01)
    truth = accelerations(chain, theta, 0.0)
    as_printed = -chain.gravity * chain.masses * theta
    off = float(np.linalg.norm(as_printed - truth) / np.linalg.norm(truth))
    return holds_if(off < 0.01, off=off)


def odeint_errors(n: int, length: float) -> tuple[float, float]:
    """Return the largest errors of the paper's odeint within 10 s: angle [rad], relative energy."""
    chain, times = Chain.uniform(n, length=length), np.linspace(0.0, 10.0, 1000)
    start = np.concatenate([np.full(n, PAPER_AMPLITUDE), np.zeros(n)])
    state = cast("FloatArray", odeint(right_hand_side(chain), start, times, tfirst=True))
    reference = simulate(chain, PAPER_AMPLITUDE, 0.0, times, rtol=1e-13, atol=1e-14)
    kept = total_energy(chain, state[:, :n], state[:, n:])
    drift = float(np.max(np.abs(kept / kept[0] - 1.0)))
    return float(np.max(np.abs(state[:, :n] - reference.theta))), drift


@check("truncation")
def _truncation() -> Outcome:
    metre, drifts = zip(*(odeint_errors(n, 1.0) for n in (5, 20, 100)), strict=True)
    short, others = zip(*(odeint_errors(n, 1.0 / n) for n in (5, 20, 100)), strict=True)
    grows = [errors[-1] > 100.0 * errors[0] for errors in (metre, short)]
    growth = neighbour_growth(100, length=0.01)
    return holds_if(all(grows), metre=[*metre], largest=max(metre), short=[*short],
                    worst=max(*drifts, *others), growth=growth)  # fmt: skip
