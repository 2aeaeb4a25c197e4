"""How pseudo-periods begin to grow with the amplitude: the third order of the equations of motion.

With M_ij = W_ij cos(theta_i - theta_j) + C_ij, theta = a theta1 + a^3 theta3 + ... and H = diag(h),
h being `Chain.lift`, the equations of order a and a^3 are

    (W + C) theta1'' + g H theta1 = 0,
    (W + C) theta3'' + g H theta3 = F,
    F_i = sum_j W_ij [d_ij^2 theta1_j'' / 2 - d_ij theta1_j'^2] + g h_i theta1_i^3 / 6,

with d_ij = theta1_i - theta1_j. theta1 is the sum of modes of `theory.com_period`, and theta3
follows from F mode by mode. Nothing is fitted, and no step is integrated.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import Chain
from npend_gym.chain import check_hung, link_inertia
from npend_gym.theory import normal_modes
from npend_gym.tools import FloatArray, count, show, vector
from paper.swings import reversals

MAX_THIRD_ORDER = 400  # rods: the work grows as n^3
_NO_MOMENTUM = 1e-12  # of a mode, over the sum of what its rods have of it
_POINTS = 16  # of Gauss's quadrature in a panel
_PANEL = 2.0  # rad of the fastest mode: of the eight that the fastest term of F turns by
_PANELS = 40  # worked on together


class AmplitudeGrowth(NamedTuple):
    """Coefficients of a^2 [1/rad^2] in periods, T(a) = T(0) (1 + b a^2 + ...).

    Attributes
    ----------
    com : float
        b of the pseudo-period of the centre of mass. 1/16 for one pendulum.
    shape, inertia : float
        b of the slowest mode alone, with the amplitude that it has in a straight release, is
        `shape` - `inertia`. The first is 1/16 times <phi^4> / <phi^2>, where phi is the angle of
        each rod over a and the mean is weighted by `Chain.lift`: gravity turns the rods that swing
        wide less than a spring would. The second comes from the cosines in the mass matrix: a bent
        chain is easier to move.
    """

    com: float
    shape: float
    inertia: float


def amplitude_growth(chain: Chain, shape: ArrayLike = 1.0) -> AmplitudeGrowth:
    """Return how the periods of a chain that is released at rest begin to grow with the angle.

    Parameters
    ----------
    chain : Chain
        Any chain that hangs straight at rest. Damping and drag do not enter.
    shape : array_like
        Angle of each rod at the start, over a, shape (n,). One number stands for all rods.

    Raises
    ------
    ValueError
        If the chain has more than 400 rods, no gravity, or a link that rests upright, or if the
        start gives it no momentum.

    Notes
    -----
    The centre of mass reverses at T(0) + a^2 T2 where its momentum h . (theta' cos theta) is zero,
    which is T2 = -P3 / P1' at T(0), with P1 and P3 the momentum of order a and a^3.

    Examples
    --------
    >>> from npend_gym import Chain
    >>> from paper.third_order import amplitude_growth
    >>> round(amplitude_growth(Chain.uniform(1)).com, 4)  # 1/16 for one pendulum
    0.0625
    """
    check_hung(chain, "amplitude_growth")
    n = count("n", chain.n, high=MAX_THIRD_ORDER)
    lift, gravity, inertia = chain.lift, chain.gravity, link_inertia(chain)
    if gravity == 0.0 or np.any(lift <= 0.0):
        raise ValueError(f"chain must hang straight at rest, under gravity; got {chain}")
    omega, modes = normal_modes(chain)
    weight = lift @ modes**2
    start = vector("shape", shape, n)
    columns = modes * ((modes.T @ (lift * start)) / weight)  # the angles of each mode, over a
    if np.all(np.abs(lift @ columns) <= _NO_MOMENTUM * (lift @ np.abs(columns))):
        raise ValueError(f"shape must give the chain a momentum, got {show(shape)}")
    period = float(reversals(omega, (lift @ columns) * omega, 2)[1])
    q, rate = np.zeros((2, n))  # of the modes, of order a^3
    parts = math.ceil(period * omega[-1] / _PANEL)
    nodes, weights = np.polynomial.legendre.leggauss(_POINTS)
    for first in range(0, parts, _PANELS):
        panels = np.arange(first, min(first + _PANELS, parts))
        t = ((panels[:, None] + 0.5 * (nodes + 1.0)) * (period / parts)).ravel()
        dt = np.tile(weights, panels.size) * (0.5 * period / parts)
        force = _cubic_force(inertia, gravity * lift, *_motion(omega, columns, t))
        drive = (modes.T @ force) * (omega**2 / (gravity * weight))[:, None] * dt
        ahead = np.outer(omega, period - t)
        q += np.sum(drive * np.sin(ahead), axis=1) / omega
        rate += np.sum(drive * np.cos(ahead), axis=1)
    x, v, a = (part[:, 0] for part in _motion(omega, columns, np.array([period])))
    third = lift @ (modes @ rate) - 0.5 * (lift * x**2) @ v
    return AmplitudeGrowth(
        -float(third / (lift @ a)) / period,
        *_of_slowest_mode(lift, gravity, inertia, float(omega[0]), columns[:, 0]),
    )


def _motion(
    omega: FloatArray, columns: FloatArray, t: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return angles, angular velocities and accelerations of order a, (n, T)."""
    phase = np.outer(omega, t)
    c = np.cos(phase)
    speeds, accelerations = columns * omega, columns * omega**2
    return columns @ c, -(speeds @ np.sin(phase)), -(accelerations @ c)


def _cubic_force(
    inertia: FloatArray, stiffness: FloatArray, x: FloatArray, v: FloatArray, a: FloatArray
) -> FloatArray:
    """Return F of the module's head, (n, T)."""
    bend = 0.5 * (x**2 * (inertia @ a) + inertia @ (x**2 * a)) - x * (inertia @ (x * a))
    turn = x * (inertia @ v**2) - inertia @ (x * v**2)
    return bend - turn + stiffness[:, None] * x**3 / 6.0


def _of_slowest_mode(
    lift: FloatArray, gravity: float, inertia: FloatArray, omega: float, phi: FloatArray
) -> tuple[float, float]:
    """Return `shape` and `inertia` of `AmplitudeGrowth`, from the Lagrangian's mean over a swing.

    With phi cos(omega t) in it, the energies of fourth order are -K4/24 <cos^4> of gravity and
    -C4/2 omega^2 <cos^2 sin^2>, C4 = sum_ij W_ij (phi_i - phi_j)^2 phi_i phi_j / 2, of motion.
    """
    second, fourth = lift @ phi**2, lift @ phi**4
    bent = 0.5 * phi @ ((inertia * np.subtract.outer(phi, phi) ** 2) @ phi)
    return float(fourth / second) / 16.0, omega**2 * float(bent / second) / (4.0 * gravity)
