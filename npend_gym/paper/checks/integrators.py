"""What the paper says of integrators: Runge-Kutta of appendix C, Euler's error, odeint."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from npend_gym import Chain, simulate
from npend_gym._checks import FloatArray
from npend_gym._palette import BLUE, ORANGE
from npend_gym.experiments.fits import power_law
from npend_gym.paper.checks.chaos import neighbour_growth
from npend_gym.paper.motions import samples
from npend_gym.paper.registry import Outcome, Verdict, check, corrected_if, figure, holds_if
from npend_gym.physics import accelerations, linearise
from npend_gym.physics.energy import energy
from npend_gym.physics.kernels.dynamics import derivative, new_work, pack_rods

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CHAIN = Chain([1.0, 0.5, 2.0], [1.0, 0.7, 0.4])
START = np.array([0.9, 0.4, 0.6, 0.5, -0.3, 0.8])  # a generic state: angles, angular velocities
STEPS: FloatArray = 0.02 * 0.5 ** np.arange(5.0)  # s


def state_after(chain: Chain, state: FloatArray, span: float, dt: float = 0.0) -> FloatArray:
    """Return the state `span` seconds on, to some fourteen digits, or by RK4 in steps of `dt`."""
    theta, omega = np.split(state, 2)
    if dt:
        path = simulate(chain, theta, omega, [0.0, span], method="rk4", dt=dt)
    else:
        path = simulate(chain, theta, omega, [0.0, span], rtol=1e-14, atol=1e-16)
    return np.concatenate([path.theta[-1], path.omega[-1]])


def rates(chain: Chain) -> Callable[[float, FloatArray], FloatArray]:
    """Return the function (t, state) -> d/dt (theta, omega) of Eq. (32).

    It calls the kernel, without the checks of `accelerations`: odeint calls it 100 000 times.
    """
    rods, work, torque = pack_rods(chain), new_work(chain.n), np.zeros(chain.n)

    def f(_t: float, state: FloatArray) -> FloatArray:
        out = np.empty(state.size)
        derivative(state, torque, rods, work, out)
        return out

    return f


def _distances(ends: list[FloatArray], truths: list[FloatArray]) -> FloatArray:
    return np.linalg.norm(np.array(ends) - truths, axis=1)


@cache
def truths() -> list[FloatArray]:
    """Return the true states after one step, for every step of `STEPS`."""
    return [state_after(CHAIN, START, tau) for tau in STEPS.tolist()]


@cache
def runge_kutta_errors(span: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """Return the errors of one step, and after `span` seconds, for every step of `STEPS`."""
    steps, end = STEPS.tolist(), state_after(CHAIN, START, span)
    local = _distances([state_after(CHAIN, START, tau, dt=tau) for tau in steps], truths())
    after = [state_after(CHAIN, START, span, dt=tau) for tau in steps]
    return local, _distances(after, [end] * len(steps))


@check("rk4-orders")
def _orders() -> Outcome:
    errors = runge_kutta_errors()
    local, after = (power_law(STEPS, error).value for error in errors)
    halving = float(errors[1][-2] / errors[1][-1])
    holds = abs(local - 5.0) < 0.2 and abs(after - 4.0) < 0.2 and abs(halving - 16.0) < 1.6
    return holds_if(holds, local=local, after=after, halving=halving)


@figure("runge_kutta", "rk4-orders", size=(5.0, 3.6), data=lambda: (STEPS, *runge_kutta_errors()))
def _draw_errors(figure: Figure, data: Any) -> None:
    """Draw RK4's errors: `data` is the steps [s], the errors of one step, those after 1 s."""
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
    f, tau = rates(CHAIN), 0.01
    k1 = tau * f(0.0, START)  # Eqs. (56) and (57); their Y_4 is K_4
    k2 = tau * f(0.5 * tau, START + 0.5 * k1)
    k3 = tau * f(0.5 * tau, START + 0.5 * k2)
    k4 = tau * f(tau, START + k3)
    step = START + (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0
    off = float(np.linalg.norm(step - state_after(CHAIN, START, tau, dt=tau)))
    return corrected_if(off < 1e-13, off=off)


def taylor_remainders() -> FloatArray:
    """Return what Theta0 + tau Theta' + tau^2 Theta''/2, Eq. (33), leaves for every step."""
    velocity = rates(CHAIN)(0.0, START)
    bend = linearise(CHAIN, START[:3], START[3:]).A @ velocity  # second derivative of the state
    ends = [START + s * velocity + 0.5 * s * s * bend for s in STEPS.tolist()]
    return _distances(ends, truths())


@check("taylor")
def _taylor() -> Outcome:
    order = power_law(STEPS, taylor_remainders()).value
    return holds_if(abs(order - 3.0) < 0.2, order=order)


def euler_ratios() -> FloatArray:
    """Return the error of one Euler step by tau^2 |Theta''| / 2, Eq. (34), for every step."""
    omega, alpha = np.split(rates(CHAIN)(0.0, START), 2)
    ends = [START[:3] + s * omega for s in STEPS.tolist()]
    errors = _distances(ends, [truth[:3] for truth in truths()])
    return errors / (0.5 * STEPS**2 * np.linalg.norm(alpha))


@check("local-error")
def _local_error() -> Outcome:
    ratios = euler_ratios()
    return corrected_if(abs(ratios[-1] - 1.0) < 0.01, ratios=ratios[[0, 2, 4]])


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
    return holds_if(min(shares.values()) > 0.99, Verdict.CORRECTED, **shares)


@check("first-order-system")
def _first_order_system() -> Outcome:
    chain = samples(4)[0].chain
    theta = np.full(chain.n, 0.01)
    truth = accelerations(chain, theta, 0.0)
    error = np.linalg.norm(-chain.gravity * chain.masses * theta - truth)
    off = float(error / np.linalg.norm(truth))
    return holds_if(off < 0.01, off=off)


def odeint_errors(n: int, length: float) -> tuple[float, float]:
    """Return the error of the paper's integrator, `odeint` by default, after 10 s from pi/4.

    The largest error of an angle [rad], and of the energy relative to its start, over all frames
    of the paper, for `n` rods of `length` [m].
    """
    from scipy.integrate import odeint

    chain, times = Chain.uniform(n, length=length), np.linspace(0.0, 10.0, 1000)
    start = np.concatenate([np.full(n, np.pi / 4), np.zeros(n)])
    state = cast("FloatArray", odeint(rates(chain), start, times, tfirst=True))
    reference = simulate(chain, np.pi / 4, 0.0, times, rtol=1e-13, atol=1e-14)
    kept = energy(chain, state[:, :n], state[:, n:])
    drift = float(np.max(np.abs(kept / kept[0] - 1.0)))
    return float(np.max(np.abs(state[:, :n] - reference.theta))), drift


@check("truncation")
def _truncation() -> Outcome:
    metre, drifts = zip(*(odeint_errors(n, 1.0) for n in (5, 20, 100)), strict=True)
    short, others = zip(*(odeint_errors(n, 1.0 / n) for n in (5, 20, 100)), strict=True)
    grows = [errors[-1] > 100.0 * errors[0] for errors in (metre, short)]
    return holds_if(
        all(grows), Verdict.CORRECTED if any(grows) else Verdict.FAILS, metre=[*metre],
        short=[*short], worst=max(*drifts, *others), growth=neighbour_growth(100, length=0.01),
    )  # fmt: skip
