"""Section 2 of the paper: energies, Lagrangians, and the Euler-Lagrange system A theta'' = b."""

from collections.abc import Callable
from functools import cache
from typing import Any, cast

import numpy as np

from npend_gym import Chain
from npend_gym.chain import STANDARD_GRAVITY
from npend_gym.physics import kinetic_energy, positions
from npend_gym.tools import FloatArray
from paper import motions
from paper.kane import sympy_and_mechanics
from paper.motions import Array, Motion, compare, formula, lagrangian, partial_rates
from paper.registry import Outcome, check


def two_bodies(motion: Motion) -> Array:
    """Return the Lagrangian of two bodies as Eq. (8) prints it."""
    (m1, m2), (l1, l2), g = motion.m, motion.l, motion.g
    (q1, q2), (u1, u2) = motion.theta, motion.omega
    kinetic = (m1 + m2) * l1**2 * u1**2 / 2 + m2 * l2**2 * u2**2 / 2
    kinetic += m2 * l1 * l2 * u1 * u2 * np.cos(q1 - q2)
    return kinetic + (m1 + m2) * g * l1 * np.cos(q1) + m2 * g * l2 * np.cos(q2)


def two_bodies_small(motion: Motion, last_sign: float) -> Array:
    """Return the Lagrangian of Eq. (9) with the sign of its last term, +1 as printed."""
    (m1, m2), (l1, l2), g = motion.m, motion.l, motion.g
    (q1, q2), (u1, u2) = motion.theta, motion.omega
    kinetic = (m1 + m2) * l1**2 * u1**2 / 2 + m2 * l2**2 * u2**2 / 2 + m2 * l1 * l2 * u1 * u2
    return kinetic - (m1 + m2) * g * l1 * q1**2 / 2 + last_sign * m2 * g * l2 * q2**2 / 2


def second_order(motion: Motion, step: float = 1e-4) -> Array:
    """Return the terms of second order of L in angles and velocities, by a small `step`."""
    high, middle, low = (
        lagrangian(motion.moved(theta=k * motion.theta, omega=k * motion.omega))
        for k in (step, 0.0, -step)
    )
    return (high - 2.0 * middle + low) / (2.0 * step**2)


@check("two-bodies-small")
def _two_bodies_small() -> Outcome:
    mass = np.array([[2.0, 1.0], [1.0, 1.0]])  # of two unit bodies, with the printed stiffness
    stiffness = STANDARD_GRAVITY * np.diag([2.0, -1.0])
    growth = float(np.sqrt(np.max(-np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real)))
    return compare(second_order, lambda at: two_bodies_small(at, 1.0),
                   lambda at: two_bodies_small(at, -1.0), n=2, tolerance=1e-6,
                   growth=growth)  # fmt: skip


def force(motion: Motion) -> Array:
    """Return dL/dtheta_i by differentiation."""
    return motions.slope(lagrangian, motion, "theta")


def momentum(motion: Motion) -> Array:
    """Return dL/domega_i by differentiation."""
    return motions.slope(lagrangian, motion, "omega")


def left_side(motion: Motion, y_factor: Array) -> Array:
    """Return dL/dtheta_i by Eq. (12), whose second line has y_j where its rate belongs."""
    by_x, by_y, by_height = partial_rates(motion, "theta")
    return by_x @ (motion.m * motion.x_dot) + (by_y * y_factor - motion.g * by_height) @ motion.m


def right_side(motion: Motion, last: int) -> Array:
    """Return dL/domega_i by Eq. (13), whose `last` term has the rate of y_j where y_j belongs."""
    rates = partial_rates(motion, "omega")
    return (rates[0] * motion.x_dot + rates[1] * motion.y_dot - motion.g * rates[last]) @ motion.m


def expanded_left(motion: Motion, rule: str) -> Array:
    """Return the left side of Eq. (14), with the `rule` "max", or "min" and a sum too many."""
    l, omega, sines = motion.l, motion.omega, np.sin(motion.between)
    twist = (sines * motion.carried(rule)) @ (l * omega)
    if rule == "min":  # as printed
        twist = twist * (sines @ (l * omega))
    return -motion.g * np.sin(motion.theta) * motion.mu - omega * twist


def expanded_right(motion: Motion) -> Array:
    """Return the right side of Eq. (14): equal to the left one along a motion."""
    gyro = motion.omega[None, :] ** 2 - motion.omega[:, None] * motion.omega[None, :]
    turning = motion.alpha * np.cos(motion.between) + gyro * np.sin(motion.between)
    return (turning * motion.carried("max")) @ motion.l


def system(motion: Motion, rule: str) -> FloatArray:
    """Return A (n, n) of Eq. (16), with pi_ij as the `rule` "max" or "min" has it."""
    return motion.l * np.cos(motion.between) * motion.carried(rule)


def accelerations(motion: Motion, rule: str) -> FloatArray:
    """Return the accelerations [rad/s^2] of Eqs. (15) and (16)."""
    twist = (np.sin(motion.between) * motion.carried(rule)) @ (motion.l * motion.omega**2)
    b = -motion.g * np.sin(motion.theta) * motion.mu - twist
    return cast("FloatArray", np.linalg.solve(system(motion, rule), b))


@cache
def _lagrange_equations(n: int) -> Callable[..., Any]:
    """Return a function that evaluates mass matrix and forces of `n` rods, by SymPy."""
    # Given the positions of the bobs alone: no formula of the paper after Eq. (7), and none of ours
    sympy, _ = sympy_and_mechanics()
    q, u, a = (sympy.symbols(f"{name}:{n}") for name in ("q", "u", "a"))
    m, l, g = sympy.symbols(f"m:{n}"), sympy.symbols(f"l:{n}"), sympy.Symbol("g")

    def rate(f: Any) -> Any:
        return sum(sympy.diff(f, q[k]) * u[k] + sympy.diff(f, u[k]) * a[k] for k in range(n))

    lagrange = x = y = sympy.Integer(0)
    for k in range(n):
        x, y = x + l[k] * sympy.sin(q[k]), y - l[k] * sympy.cos(q[k])
        lagrange += m[k] * (rate(x) ** 2 + rate(y) ** 2) / 2 - m[k] * g * y
    sides: Any = sympy.Matrix([rate(lagrange.diff(u[k])) - lagrange.diff(q[k]) for k in range(n)])
    matrix, rest = sides.jacobian(a), sides.subs(dict.fromkeys(a, 0))
    return sympy.lambdify([q, u, m, l, g], (matrix, rest), cse=True)


def lagrange_accelerations(motion: Motion) -> FloatArray:
    """Return the accelerations [rad/s^2] that solve the Euler-Lagrange equations, Eq. (10)."""
    evaluate = _lagrange_equations(motion.n)
    mass, rest = evaluate(motion.theta, motion.omega, motion.m, motion.l, motion.g)
    return cast("FloatArray", np.linalg.solve(mass, -rest)[:, 0])


@check("eom")
def _equations_of_motion() -> Outcome:
    hanging = Motion(Chain.uniform(2), np.zeros(2), np.zeros(2))
    determinant = float(np.linalg.det(system(hanging, "min")))
    return compare(lagrange_accelerations, lambda at: accelerations(at, "min"),
                   lambda at: accelerations(at, "max"), determinant=determinant)  # fmt: skip


formula("coordinates", lambda at: positions(at.chain, at.theta),
        lambda at: np.array([np.tri(at.n) @ (at.l * np.sin(at.theta)), at.y]).T)  # fmt: skip
formula("kinetic-energy", lambda at: kinetic_energy(at.chain, at.theta, at.omega),
        lambda at: 0.5 * np.sum(at.x_dot**2 + at.y_dot**2),
        lambda at: 0.5 * np.sum(at.m * (at.x_dot**2 + at.y_dot**2)))  # fmt: skip
formula("two-bodies", lagrangian, two_bodies, n=2)
formula("velocities",
        lambda at: motions.along_the_motion(lambda a: np.array([a.x_dot, a.y_dot]), at),
        lambda at: np.array([at.x_ddot, at.y_ddot]))  # fmt: skip
formula("lagrange-left", force, lambda at: left_side(at, at.y), lambda at: left_side(at, at.y_dot))
formula("lagrange-right", momentum, lambda at: right_side(at, 1), lambda at: right_side(at, 2))
formula("expanded", expanded_right, lambda at: expanded_left(at, "min"),
        lambda at: expanded_left(at, "max"))  # fmt: skip
formula("ours", lagrange_accelerations, lambda at: at.alpha)
