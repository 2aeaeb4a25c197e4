"""Section 2 of the paper: energies, Lagrangians, and the Euler-Lagrange system A theta'' = b."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, cast

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.chain import STANDARD_GRAVITY, Chain
from npend_gym.paper.motions import (
    Array,
    Motion,
    along_the_motion,
    compare,
    formula,
    lagrangian,
    partial_rates,
    slope,
)
from npend_gym.paper.registry import Outcome, check
from npend_gym.physics.energy import kinetic_energy, positions
from npend_gym.physics.kane import sympy_and_mechanics

formula(
    "coordinates",
    lambda at: positions(at.chain, at.theta),
    lambda at: np.array([np.tri(at.n) @ (at.l * np.sin(at.theta)), at.y]).T,
)
formula(
    "kinetic-energy",
    lambda at: kinetic_energy(at.chain, at.theta, at.omega),
    lambda at: 0.5 * np.sum(at.x_dot**2 + at.y_dot**2),
    lambda at: 0.5 * np.sum(at.m * (at.x_dot**2 + at.y_dot**2)),
)


def two_bodies(motion: Motion) -> Array:
    """Return the Lagrangian of two bodies as Eq. (8) prints it."""
    (m1, m2), (l1, l2), g = motion.m, motion.l, motion.g
    (q1, q2), (u1, u2) = motion.theta, motion.omega
    kinetic = (m1 + m2) * l1**2 * u1**2 / 2 + m2 * l2**2 * u2**2 / 2
    kinetic += m2 * l1 * l2 * u1 * u2 * np.cos(q1 - q2)
    return kinetic + (m1 + m2) * g * l1 * np.cos(q1) + m2 * g * l2 * np.cos(q2)


formula("two-bodies", lagrangian, two_bodies, n=2)


def two_bodies_small(motion: Motion, last_sign: float) -> Array:
    """Return the Lagrangian of Eq. (9) with the sign of its last term, +1 as printed."""
    (m1, m2), (l1, l2), g = motion.m, motion.l, motion.g
    (q1, q2), (u1, u2) = motion.theta, motion.omega
    kinetic = (m1 + m2) * l1**2 * u1**2 / 2 + m2 * l2**2 * u2**2 / 2 + m2 * l1 * l2 * u1 * u2
    return kinetic - (m1 + m2) * g * l1 * q1**2 / 2 + last_sign * m2 * g * l2 * q2**2 / 2


def second_order(motion: Motion) -> Array:
    """Return the terms of second order of L in angles and velocities, by a small step."""
    step = 1e-4
    near = [
        lagrangian(motion.moved(theta=k * motion.theta, omega=k * motion.omega))
        for k in (step, 0.0, -step)
    ]
    return (near[0] - 2.0 * near[1] + near[2]) / (2.0 * step**2)


@check("two-bodies-small")
def _two_bodies_small() -> Outcome:
    mass = np.array([[2.0, 1.0], [1.0, 1.0]])  # of two unit bodies, with the printed stiffness
    stiffness = STANDARD_GRAVITY * np.diag([2.0, -1.0])
    growth = float(np.sqrt(np.max(-np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real)))
    return compare(
        second_order, lambda at: two_bodies_small(at, 1.0), lambda at: two_bodies_small(at, -1.0),
        n=2, tolerance=1e-6, growth=growth,
    )  # fmt: skip


formula(
    "velocities",
    lambda at: np.array([along_the_motion(lambda a: a.x_dot, at),
                         along_the_motion(lambda a: a.y_dot, at)]),
    lambda at: np.array([at.x_ddot, at.y_ddot]),
)  # fmt: skip


def left_side(motion: Motion, y_factor: Array) -> Array:
    """Return dL/dtheta_i by Eq. (12), whose second line has y_j where its rate belongs."""
    by_x, by_y, by_height = partial_rates(motion, "theta")
    return by_x @ (motion.m * motion.x_dot) + (by_y * y_factor - motion.g * by_height) @ motion.m


formula(
    "lagrange-left",
    lambda at: slope(lagrangian, at, "theta"),
    lambda at: left_side(at, at.y),
    lambda at: left_side(at, at.y_dot),
)


def right_side(motion: Motion, *, as_printed: bool) -> Array:
    """Return dL/domega_i by Eq. (13), whose last term has the rate of y_j where y_j belongs."""
    by_x, by_y, by_height = partial_rates(motion, "omega")
    last = by_y if as_printed else by_height
    return (by_x * motion.x_dot + by_y * motion.y_dot - motion.g * last) @ motion.m


formula(
    "lagrange-right",
    lambda at: slope(lagrangian, at, "omega"),
    lambda at: right_side(at, as_printed=True),
    lambda at: right_side(at, as_printed=False),
)


def expanded_left(motion: Motion, *, as_printed: bool) -> Array:
    """Return the left side of Eq. (14).

    As printed a sum is multiplied by itself, and pi_ij is the min of Eq. (16).
    """
    l, omega, carried = motion.l, motion.omega, motion.carried("min" if as_printed else "max")
    sines = np.sin(motion.between)
    twist = (sines * carried) @ (l * omega)
    if as_printed:
        twist = twist * (sines @ (l * omega))
    return -motion.g * np.sin(motion.theta) * motion.mu - omega * twist


def expanded_right(motion: Motion) -> Array:
    """Return the right side of Eq. (14): equal to the left one along a motion."""
    gyro = motion.omega[None, :] ** 2 - motion.omega[:, None] * motion.omega[None, :]
    turning = motion.alpha * np.cos(motion.between) + gyro * np.sin(motion.between)
    return (turning * motion.carried("max")) @ motion.l


formula(
    "expanded",
    expanded_right,
    lambda at: expanded_left(at, as_printed=True),
    lambda at: expanded_left(at, as_printed=False),
)


def system(motion: Motion, rule: str) -> tuple[FloatArray, FloatArray]:
    """Return A (n, n) and b (n,) of Eq. (16), with pi_ij as the `rule` "max" or "min" has it."""
    l, between, carried = motion.l, motion.between, motion.carried(rule)
    b = -motion.g * np.sin(motion.theta) * motion.mu
    return l * np.cos(between) * carried, b - (np.sin(between) * carried) @ (l * motion.omega**2)


def lagrange_accelerations(motion: Motion) -> FloatArray:
    """Return the accelerations [rad/s^2] that solve the Euler-Lagrange equations, Eq. (10)."""
    mass, force = cast(
        "tuple[FloatArray, FloatArray]",
        _lagrange_equations(motion.n)(motion.theta, motion.omega, motion.m, motion.l, motion.g),
    )
    return np.linalg.solve(mass, -force)[:, 0].astype(np.float64, copy=False)


@cache
def _lagrange_equations(n: int) -> Callable[..., Any]:
    """Return a function that evaluates mass matrix and forces of `n` rods.

    SymPy differentiates L = T - V, given the positions of the bobs alone: no formula of the paper
    after Eq. (7) is used, and none of ours.
    """
    sympy, _ = sympy_and_mechanics()
    q, u, a = (sympy.symbols(f"{name}:{n}") for name in ("q", "u", "a"))
    m, l, g = sympy.symbols(f"m:{n}"), sympy.symbols(f"l:{n}"), sympy.Symbol("g")

    def rate(f: Any) -> Any:
        return sum(sympy.diff(f, q[k]) * u[k] + sympy.diff(f, u[k]) * a[k] for k in range(n))

    kinetic = potential = x = y = sympy.Integer(0)
    for k in range(n):
        x, y = x + l[k] * sympy.sin(q[k]), y - l[k] * sympy.cos(q[k])
        kinetic += m[k] * (rate(x) ** 2 + rate(y) ** 2) / 2
        potential += m[k] * g * y
    lagrange = kinetic - potential
    rows: list[Any] = [
        rate(sympy.diff(lagrange, u[k])) - sympy.diff(lagrange, q[k]) for k in range(n)
    ]
    matrix: Any = sympy.Matrix(rows).jacobian(a)
    rest = sympy.Matrix(rows).subs(dict.fromkeys(a, 0))
    return sympy.lambdify([q, u, m, l, g], (matrix, rest), cse=True)


def accelerations(motion: Motion, rule: str) -> FloatArray:
    """Return the accelerations [rad/s^2] of Eqs. (15) and (16)."""
    return np.linalg.solve(*system(motion, rule)).astype(np.float64, copy=False)


@check("eom")
def _equations_of_motion() -> Outcome:
    hanging = Motion(Chain.uniform(2), np.zeros(2), np.zeros(2))
    determinant = float(np.linalg.det(system(hanging, "min")[0]))
    return compare(
        lagrange_accelerations, lambda at: accelerations(at, "min"),
        lambda at: accelerations(at, "max"), determinant=determinant,
    )  # fmt: skip


formula("ours", lagrange_accelerations, lambda at: at.alpha)
