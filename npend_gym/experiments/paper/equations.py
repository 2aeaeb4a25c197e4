"""Section 2 of the paper: energies, Lagrangians, and the Euler-Lagrange system A theta'' = b."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import Any, cast

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.chain import STANDARD_GRAVITY, Chain
from npend_gym.experiments.paper.finding import Finding
from npend_gym.experiments.paper.formula import (
    Array,
    Formula,
    Motion,
    Term,
    along_the_motion,
    judge,
    lagrangian,
    slope,
)
from npend_gym.physics import energy
from npend_gym.physics.kane import sympy_and_mechanics


def system(motion: Motion, rule: str = "max") -> tuple[FloatArray, FloatArray]:
    """Return A (n, n) and b (n,) of Eq. (16), with pi_ij as the `rule` "max" or "min" has it."""
    l, between, carried = motion.l, motion.between, motion.carried(rule)
    a = l * np.cos(between) * carried
    b = -motion.g * np.sin(motion.theta) * motion.mu
    return a, b - (np.sin(between) * carried) @ (l * motion.omega**2)


def accelerations(motion: Motion, rule: str) -> FloatArray:
    """Return the accelerations [rad/s^2] of Eqs. (15) and (16)."""
    return np.linalg.solve(*system(motion, rule)).astype(np.float64, copy=False)


def printed_determinant() -> float:
    """Return det A for two unit bodies hanging at rest, with pi_ij as printed."""
    rest = Motion(np.ones(2), np.ones(2), STANDARD_GRAVITY, np.zeros(2), np.zeros(2), np.zeros(2))
    return float(np.linalg.det(system(rest, "min")[0]))


@cache
def lagrange_accelerations(n: int) -> Callable[[Motion], FloatArray]:
    """Return a function of a motion that solves the Euler-Lagrange equations, Eq. (10).

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
    evaluate = sympy.lambdify([q, u, m, l, g], (matrix, rest), cse=True)

    def accelerations(motion: Motion) -> FloatArray:
        mass, force = cast(
            "tuple[FloatArray, FloatArray]",
            evaluate(motion.theta, motion.omega, motion.m, motion.l, motion.g),
        )
        return np.linalg.solve(mass, -force)[:, 0].astype(np.float64, copy=False)

    return accelerations


def expanded_sides(motion: Motion, *, as_printed: bool) -> tuple[FloatArray, FloatArray]:
    """Return both sides of Eq. (14): equal along a motion, if the equation holds.

    As printed a sum is multiplied by itself, and pi_ij is the min of Eq. (16).
    """
    l, omega, carried = motion.l, motion.omega, motion.carried("min" if as_printed else "max")
    sines = np.sin(motion.between)
    twist = (sines * carried) @ (l * omega)
    if as_printed:
        twist = twist * (sines @ (l * omega))
    left = -motion.g * np.sin(motion.theta) * motion.mu - omega * twist
    gyro = omega[None, :] ** 2 - omega[:, None] * omega[None, :]
    right = ((motion.alpha * np.cos(motion.between) + gyro * sines) * carried) @ l
    return left, right


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


def _second_order(motion: Motion) -> Array:
    """Return the terms of second order of L in angles and velocities, by a small step."""
    step = 1e-4
    near = [
        lagrangian(motion.moved(theta=k * motion.theta, omega=k * motion.omega))
        for k in (step, 0.0, -step)
    ]
    return (near[0] - 2.0 * near[1] + near[2]) / (2.0 * step**2)


def small_angle_growth() -> float:
    """Return the rate of growth [1/s] that Eq. (9) as printed gives two unit bodies at rest."""
    mass = np.array([[2.0, 1.0], [1.0, 1.0]])
    stiffness = STANDARD_GRAVITY * np.diag([2.0, -1.0])
    return float(np.sqrt(np.max(-np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real)))


def _velocity_and_acceleration(motion: Motion) -> Array:
    """Return x'' and y'' as Eq. (11) prints them."""
    q, u, a, below = motion.theta, motion.omega, motion.alpha, np.tri(motion.n)
    x = below @ (motion.l * (a * np.cos(q) - u**2 * np.sin(q)))
    y = below @ (motion.l * (a * np.sin(q) + u**2 * np.cos(q)))
    return np.array([x, y])


def _rates_of_velocity(motion: Motion) -> Array:
    terms: tuple[Term, ...] = (lambda at: at.x_dot, lambda at: at.y_dot)
    return np.array([along_the_motion(term, motion) for term in terms])


def partial_rates(motion: Motion, name: str) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the derivatives of x'_j, y'_j and y_j by "theta" or "omega" of rod i, as (i, j)."""
    terms: tuple[Term, ...] = (lambda at: at.x_dot, lambda at: at.y_dot, lambda at: at.y)
    by_x, by_y, by_height = (slope(term, motion, name) for term in terms)
    return by_x, by_y, by_height


def left_side(motion: Motion, *, as_printed: bool) -> Array:
    """Return dL/dtheta_i by Eq. (12), whose second line has y_j where its rate belongs."""
    by_x, by_y, by_height = partial_rates(motion, "theta")
    factor = motion.y if as_printed else motion.y_dot
    return by_x @ (motion.m * motion.x_dot) + (by_y * factor - motion.g * by_height) @ motion.m


def right_side(motion: Motion, *, as_printed: bool) -> Array:
    """Return dL/domega_i by Eq. (13), whose last term has the rate of y_j where y_j belongs."""
    by_x, by_y, by_height = partial_rates(motion, "omega")
    last = by_y if as_printed else by_height
    return (by_x * motion.x_dot + by_y * motion.y_dot - motion.g * last) @ motion.m


FORMULAS = (
    Formula(
        "coordinates", "text before Eq. (6)", "positions of the bobs",
        "x_i = sum l_k sin theta_k, y_i = -sum l_k cos theta_k",
        "Compared with the positions that the package draws and measures.",
        truth=lambda at: energy.positions(Chain(at.m, at.l), at.theta),
        as_printed=lambda at: np.array([np.tri(at.n) @ (at.l * np.sin(at.theta)), at.y]).T,
    ),
    Formula(
        "kinetic-energy", "Eqs. (6), (7)", "kinetic energy of the chain",
        "T = 1/2 sum (x'^2 + y'^2)",
        "The masses are missing, and with them the unit of energy. With bobs of 1 kg the values "
        "agree; Eq. (8) and all later equations have the masses.",
        truth=lambda at: energy.kinetic_energy(Chain(at.m, at.l), at.theta, at.omega),
        as_printed=lambda at: 0.5 * np.sum(at.x_dot**2 + at.y_dot**2),
        corrected=lambda at: 0.5 * np.sum(at.m * (at.x_dot**2 + at.y_dot**2)),
    ),
    Formula(
        "two-bodies", "Eq. (8)", "Lagrangian of two bodies", "as Eq. (8)",
        "Compared with T - V summed over the bobs.",
        truth=lagrangian, as_printed=two_bodies, n=2,
    ),
    Formula(
        "two-bodies-small", "Eq. (9)", "the same for small angles",
        "... - (m1 + m2) g l1 theta1^2/2 + m2 g l2 theta2^2/2",
        "The sign of the last term is wrong (and a constant, without effect, is dropped): as "
        "printed the lower body would be repelled from its rest, which two unit bodies would "
        f"leave at the rate of {small_angle_growth():.2f} 1/s.",
        truth=_second_order, tolerance=1e-6, n=2,
        as_printed=lambda at: two_bodies_small(at, 1.0),
        corrected=lambda at: two_bodies_small(at, -1.0),
    ),
    Formula(
        "velocities", "Eq. (11)", "velocities and accelerations of the bobs", "as Eq. (11)",
        "Differentiated by a complex step, exact to rounding, like all derivatives below.",
        truth=_rates_of_velocity, as_printed=_velocity_and_acceleration,
    ),
    Formula(
        "lagrange-left", "Eq. (12), also (38)", "dL/dtheta_i by the chain rule",
        "sum m_j/2 [2 x'_j dx'_j/dtheta_i + 2 y_j dy'_j/dtheta_i] - ...",
        "A dot is missing on y_j in the second line; the third line has it.",
        truth=lambda at: slope(lagrangian, at, "theta"),
        as_printed=lambda at: left_side(at, as_printed=True),
        corrected=lambda at: left_side(at, as_printed=False),
    ),
    Formula(
        "lagrange-right", "Eq. (13), also (45)", "dL/dtheta'_i by the chain rule",
        "sum m_j [x'_j dx'_j/dtheta'_i + y'_j dy'_j/dtheta'_i - g dy'_j/dtheta'_i]",
        "The last term has a dot too many, on y_j (it should vanish), and the sum runs over j, "
        "not i.",
        truth=lambda at: slope(lagrangian, at, "omega"),
        as_printed=lambda at: right_side(at, as_printed=True),
        corrected=lambda at: right_side(at, as_printed=False),
    ),
    Formula(
        "expanded", "Eq. (14)", "the Euler-Lagrange equations written out",
        "-g sin theta_i sum m_j - theta'_i sum_j l_j theta'_j sin() sum_j l_j theta'_j sin() "
        "sum_{k >= pi_ij} m_k = ...",
        "The sum over j stands twice; appendix A has it once. pi_ij must be the max of appendix "
        "A, Eq. (44). Corrected, both sides agree on every motion.",
        truth=lambda at: expanded_sides(at, as_printed=False)[1],
        as_printed=lambda at: expanded_sides(at, as_printed=True)[0],
        corrected=lambda at: expanded_sides(at, as_printed=False)[0],
    ),
    Formula(
        "eom", "Eqs. (15), (16), (17)", "A theta'' = b for any masses and lengths",
        "pi_ij = i if i <= j, else j",
        "That is min(i, j); max(i, j), as in Eq. (44), is right. Accelerations are compared with "
        "those of L = T - V differentiated by SymPy. With the min, A is no mass matrix: "
        f"for two unit bodies at rest its determinant is {printed_determinant():+.0f}. LU "
        "decomposition is one way to solve it.",
        truth=lambda at: lagrange_accelerations(at.n)(at),
        as_printed=lambda at: accelerations(at, "min"),
        corrected=lambda at: accelerations(at, "max"),
    ),
    Formula(
        "ours", "Eq. (17)", "our O(N) dynamics solve the same equations", "-",
        "The tridiagonal system of the rod tensions, against SymPy's Lagrangian.",
        truth=lambda at: lagrange_accelerations(at.n)(at), as_printed=lambda at: at.alpha,
    ),
)  # fmt: skip


def findings() -> Iterator[Finding]:
    """Yield the findings about section 2."""
    yield from map(judge, FORMULAS)
