"""The driven pendulum of textbooks, and tangent vectors that SciPy integrates along equations.

These give exponents, and the multipliers of periodic motions. Nothing is shared with the package.
"""

import numpy as np
import oracle
from scipy.integrate import solve_ivp

from npend_gym import Cart, Chain, Signal

# theta'' + theta' / 2 + sin theta = a cos(2 t / 3): G. L. Baker and J. P. Gollub, Chaotic Dynamics
PENDULUM, PERIOD = Chain.uniform(1, gravity=1.0, damping=0.5), 3.0 * np.pi


def cosine(size, rate=2.0 / 3.0):
    return lambda t: size * np.cos(rate * t)


def pendulum_rates(size):
    return lambda t, y: np.array([y[1], size * np.cos(2.0 * t / 3.0) - 0.5 * y[1] - np.sin(y[0])])


# Every kind of chain, and every kind of drive
TWO = {"masses": [1.0, 0.6], "lengths": [0.8, 0.5]}
LINKS = {"centres": [0.4, 0.3], "inertias": [0.05, 0.02]}
SPRINGS = {"stiffness": [60.0, 40.0], "axial_damping": 0.5}
TORQUES = {"torque": lambda t: np.array([3.0 * np.sin(5.0 * t), 1.0])}
SHAKEN = {"pivot_acceleration": lambda t: (2.0 * np.cos(9.0 * t), 5.0 * np.sin(9.0 * t))}
LINE = Signal([0.0, 1.0], [3.0, -2.0], "linear")
KINDS = {
    "points": (Chain(**TWO), TORQUES),
    "drag": (Chain(**TWO, damping=0.1, drag=0.05, quadratic_drag=0.02), TORQUES),
    "drag, shaken": (Chain(**TWO, drag=0.05, quadratic_drag=0.02), TORQUES | SHAKEN),
    "links, constant": (Chain(**TWO, **LINKS), {"torque": [2.0, -1.0]}),
    "friction, rotors": (
        Chain(**TWO, **LINKS, friction=0.2, friction_speed=0.3, armature=0.01, gear=6.0), TORQUES
    ),
    "springs": (Chain(**TWO, **SPRINGS), {"torque": LINE}),
    "springs, shaken": (Chain(**TWO, **SPRINGS), SHAKEN),
    "cart": (Chain(**TWO, base=Cart(1.5, 0.2)), {"force": lambda t: 4.0 * np.cos(6.0 * t)}),
    "links, cart": (Chain(**TWO, **LINKS, base=Cart(1.5)), {"torque": LINE, "force": LINE}),
    "springs, cart": (
        Chain(**TWO, **SPRINGS, base=Cart(1.5)), {"force": 3.0, "torque": lambda t: 2.0 * t}
    ),
}  # fmt: skip


def flow(rates, start, period, periods, turning=1):
    """Yield the state, and its derivative by the state a period before, for each of the periods.

    The first `turning` coordinates are angles, of which whole turns are taken.
    """
    y, size = np.array(start, float), len(start)

    def both(t, whole):
        state, changes = whole[:size], whole[size:].reshape(size, size)
        slopes = oracle.complex_slopes(lambda change: rates(t, state + change), size)
        return np.append(rates(t, state), slopes @ changes)

    for k in range(periods):
        span, whole = (k * period, (k + 1) * period), np.append(y, np.eye(size))
        end = solve_ivp(both, span, whole, "DOP853", rtol=1e-9, atol=1e-10).y[:, -1]
        y = end[:size].copy()
        y[:turning] -= 2.0 * np.pi * np.rint(y[:turning] / (2.0 * np.pi))
        yield y, end[size:].reshape(size, size)


def exponents_of(rates, start, period, periods, discard, turning=1):
    """Return exponents by QR in each period, and the standard errors of these."""
    basis, logarithms = np.eye(len(start)), []
    for _, changed in flow(rates, start, period, periods, turning):
        basis, triangle = np.linalg.qr(changed @ basis)
        logarithms.append(np.log(np.abs(np.diag(triangle))))
    each = np.array(logarithms[discard:]) / period
    blocks = np.array([block.mean(axis=0) for block in np.array_split(each, 8)])
    return each.mean(axis=0), blocks.std(axis=0, ddof=1) / np.sqrt(8.0)
