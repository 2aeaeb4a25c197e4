"""How the period of a released rope begins to grow with the angle, by Bessel integrals.

Lengths are in units of the rope's L, times of sqrt(L/g), s is the height above the free end, and x
its square root. With phi_k = J1(j_k x)/x the angles of first order in the start a are

    theta = sum_k 4 phi_k cos(omega_k t) / (j_k^2 J1(j_k)),      omega_k = j_k/2.

The inertia of the rope is the integral operator W with the kernel min(s, s'). phi_k are its modes:
W phi_k = s phi_k / omega_k^2. They are orthogonal under s ds, with the norm J1(j_k)^2. Angles of
order a^3 are driven, as in `paper.third_order`, by

    F = W(theta^2 theta''/2 + theta theta'^2) - theta W(theta theta'' + theta'^2) - s theta^3/3,

where W theta'' = -s theta has been used. Only the second term needs W, as two running integrals.
The integral of phi_k F drives mode k, and b follows from the momentum at T(0).
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import j1, jn_zeros

from npend_gym import theory
from npend_gym.tools import FloatArray

_POINTS = 16  # of Gauss's quadrature in a panel
_PANEL = 6.0  # rad of the fastest term in a panel: fourfold the fastest mode
_AT_ONCE = 400  # instants


class _Gauss:
    """Gauss's quadrature from 0 to `end`, in panels."""

    def __init__(self, end: float, panels: int) -> None:
        nodes, weights = np.polynomial.legendre.leggauss(_POINTS)
        self.half = 0.5 * end / panels
        self.nodes: FloatArray = (
            self.half * (2.0 * np.arange(panels)[:, None] + 1.0 + nodes)
        ).ravel()
        self.weights: FloatArray = np.tile(self.half * weights, panels)
        # a polynomial through the nodes of a panel, integrated from -1 to each of them
        powers = np.polynomial.legendre.legvander(nodes, _POINTS - 1)
        integrals = [
            np.polynomial.legendre.legval(nodes, np.polynomial.legendre.legint(one, lbnd=-1))
            for one in np.eye(_POINTS)
        ]
        self._inner: FloatArray = self.half * np.column_stack(integrals) @ np.linalg.inv(powers)

    def running(self, values: FloatArray) -> FloatArray:
        """Return the integrals of `values`, (nodes, T), from 0 to each node."""
        whole = (values * self.weights[:, None]).reshape(-1, _POINTS, values.shape[1])
        before = np.cumsum(whole.sum(axis=1), axis=0) - whole.sum(axis=1)
        inner = self._inner @ values.reshape(whole.shape)
        return (inner + before[:, None]).reshape(values.shape)


def growth(modes: int) -> float:
    """Return b of T(a) = T(0) (1 + b a^2), with the first `modes` modes of the rope [1/rad^2].

    Examples
    --------
    >>> from paper.period.rope import growth
    >>> round(growth(10), 3)
    0.069
    """
    zeros: FloatArray = jn_zeros(0, modes)
    omega, norm = 0.5 * zeros, j1(zeros) ** 2
    period = theory.com_ratio() * 2.0 * math.pi / float(omega[0])
    space = _Gauss(1.0, math.ceil(4.0 * zeros[-1] / _PANEL))
    time = _Gauss(period, math.ceil(4.0 * omega[-1] * period / _PANEL))
    x = space.nodes[:, None]
    s, ds = x**2, 2.0 * x * space.weights[:, None]
    phi: FloatArray = j1(x * zeros) / x
    first = phi * (4.0 / (zeros**2 * j1(zeros)))
    rate = np.zeros(modes)  # of the modes, of order a^3, at T(0)
    for begin in range(0, time.nodes.size, _AT_ONCE):
        t, dt = (one[begin : begin + _AT_ONCE] for one in (time.nodes, time.weights))
        theta, speed, bend = _motion(first, omega, t)
        inner = (theta * bend + speed**2) * (2.0 * x)
        below, all_of_it = space.running(inner), space.weights @ inner
        carried = space.running(s * inner) + s * (all_of_it - below)  # W
        force = phi.T @ ((-theta * carried - s * theta**3 / 3.0) * ds) * (omega**2)[:, None]
        force += phi.T @ (s * (0.5 * theta**2 * bend + theta * speed**2) * ds)
        rate += (force * np.cos(np.outer(omega, period - t))) @ dt / norm
    theta, speed, bend = _motion(first, omega, np.array([period]))
    weight = (s * ds)[:, 0]
    third = (weight @ phi) @ rate - 0.5 * float(weight @ (theta**2 * speed)[:, 0])
    return -float(third) / float(weight @ bend[:, 0]) / period


def _motion(
    first: FloatArray, omega: FloatArray, t: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return angles, angular velocities and accelerations of first order, (nodes, T)."""
    phase = np.outer(omega, t)
    cosine = np.cos(phase)
    return first @ cosine, -(first * omega) @ np.sin(phase), -(first * omega**2) @ cosine
