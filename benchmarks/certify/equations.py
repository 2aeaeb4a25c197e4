"""The equations of motion of a chain, from Lagrange's equations with a dense mass matrix.

Coordinates are q = (theta, position of the cart, stretch of the springs), as far as the chain has
them. Angles are absolute, zero where a rod hangs. Numbers may be of any type that NumPy holds in an
array: floats, numbers of many digits, or the expressions of heyoka.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

Array = Any  # of numbers of any type


class Mechanism(NamedTuple):
    """The parameters of a chain, as arrays (n,) or numbers of one type; units are SI."""

    gravity: Any
    masses: Array
    lengths: Array
    centres: Array  # of mass, from the upper joint
    inertias: Array  # about the centre of mass
    damping: Array  # of the joints
    drag: Array  # viscous, on the lower end of a link
    stiffness: Array | None  # of springs in place of rods
    axial_damping: Array
    cart_mass: Any | None
    cart_damping: Any

    @property
    def size(self) -> int:
        """Number of coordinates."""
        n = len(self.masses)
        return n + (self.cart_mass is not None) + n * (self.stiffness is not None)

    @classmethod
    def of(cls, chain: Mapping[str, Any], number: Callable[[str], Any] = float) -> Mechanism:
        """Return the mechanism of a chain in the file; `number` makes a number of its digits."""

        def made(value: Any) -> Any:
            if isinstance(value, list):
                return np.array([number(text) for text in value])
            return None if value is None else number(value)

        return cls(**{name: made(chain[name]) for name in cls._fields})


class Motion(NamedTuple):
    """What links do at an instant: n points and m coordinates."""

    x: Array  # d(points)/d(coordinates), sideways, (n, m)
    y: Array  # upwards
    x_bias: Array  # accelerations of the points where no coordinate accelerates, (n,)
    y_bias: Array
    heights: Array  # of the points, (n,)


def motion(chain: Mechanism, q: Array, u: Array, reach: Array, functions: Any = np) -> Motion:
    """Return the motion of the points that are `reach` along their links, the ends by default."""
    n, springs, cart = len(chain.masses), chain.stiffness is not None, chain.cart_mass is not None
    theta, omega = q[:n], u[:n]
    sin, cos = functions.sin(theta), functions.cos(theta)
    zero = 0 * theta[0]
    lengths = chain.lengths + q[-n:] if springs else chain.lengths
    # arms[k, i]: how much of link i lies between the pivot and point k
    arms = np.array(
        [[lengths[i] if i < k else zero for i in range(n)] for k in range(n)], dtype=theta.dtype
    )
    np.fill_diagonal(arms, lengths if springs else reach)
    x, y = [arms * cos], [arms * sin]
    x_bias, y_bias = -arms @ (sin * omega * omega), arms @ (cos * omega * omega)
    if cart:
        x.append(np.full((n, 1), zero + 1))
        y.append(np.full((n, 1), zero))
    if springs:
        above = np.array([[zero + (i <= k) for i in range(n)] for k in range(n)], theta.dtype)
        x.append(above * sin)
        y.append(-above * cos)
        x_bias = x_bias + 2 * above @ (cos * omega * u[-n:])
        y_bias = y_bias + 2 * above @ (sin * omega * u[-n:])
    return Motion(np.hstack(x), np.hstack(y), x_bias, y_bias, -arms @ cos)


def system(
    chain: Mechanism, q: Array, u: Array, torque: Array, functions: Any = np
) -> tuple[Array, Array]:
    """Return the mass matrix M and the force f of M u' = f."""
    n, m = len(chain.masses), chain.masses
    at = motion(chain, q, u, chain.centres, functions)
    matrix = (at.x.T * m) @ at.x + (at.y.T * m) @ at.y
    force = -(at.x.T @ (m * at.x_bias)) - at.y.T @ (m * (at.y_bias + chain.gravity))
    for i in range(n):
        matrix[i, i] = matrix[i, i] + chain.inertias[i]
    if chain.cart_mass is not None:
        matrix[n, n] = matrix[n, n] + chain.cart_mass
        force[n] = force[n] - chain.cart_damping * u[n]
    if chain.stiffness is not None:
        force[-n:] = force[-n:] - chain.stiffness * q[-n:] - chain.axial_damping * u[-n:]
    for i in range(n):  # a joint acts on the link below it, and back on the link above
        held = torque[i] - chain.damping[i] * (u[i] - u[i - 1] if i > 0 else u[i])
        force[i] = force[i] + held
        if i > 0:
            force[i - 1] = force[i - 1] - held
    if any(one != 0 for one in chain.drag):
        ends = motion(chain, q, u, chain.lengths, functions)
        for jacobian in (ends.x, ends.y):
            force = force - jacobian.T @ (chain.drag * (jacobian @ u))
    return matrix, force


def accelerations(
    chain: Mechanism, q: Array, u: Array, torque: Array, functions: Any = np
) -> Array:
    """Return u'."""
    return solve(*system(chain, q, u, torque, functions))


def solve(matrix: Array, right: Array) -> Array:
    """Return the solution of a positive definite system, by elimination for numbers of any type."""
    if matrix.dtype == float:
        return np.linalg.solve(matrix, right)
    a, x = matrix.copy(), right.copy()
    for k in range(len(x)):
        factors = a[k + 1 :, k] / a[k, k]
        a[k + 1 :, k + 1 :] = a[k + 1 :, k + 1 :] - np.outer(factors, a[k, k + 1 :])
        x[k + 1 :] = x[k + 1 :] - factors * x[k]
    for k in reversed(range(len(x))):
        x[k] = (x[k] - a[k, k + 1 :] @ x[k + 1 :] if k + 1 < len(x) else x[k]) / a[k, k]
    return x


def energy(chain: Mechanism, q: Array, u: Array) -> Any:
    """Return the energy [J], which is zero at rest with all links at the height of the pivot."""
    n, m = len(chain.masses), chain.masses
    at = motion(chain, q, u, chain.centres)
    vx, vy, turning = at.x @ u, at.y @ u, u[:n]
    moving = m @ (vx * vx + vy * vy) + chain.inertias @ (turning * turning)
    if chain.cart_mass is not None:
        moving = moving + chain.cart_mass * u[n] * u[n]
    if chain.stiffness is not None:
        moving = moving + chain.stiffness @ (q[-n:] * q[-n:])
    return moving / 2 + chain.gravity * (m @ at.heights)
