"""The equations of motion by Kane's method, in SymPy: the paper's appendix D (extra "paper").

An independent derivation to check the others by; for speed use `npend_gym.physics.accelerations`.
Two things differ from the printed listing: common subexpressions are evaluated once, and gravity is
an argument.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from npend_gym.tools import FloatArray, count, number, require, vector

MAX_N = 100  # takes a day; the time grows as the cube of n

Matrices = tuple[FloatArray, FloatArray]
Accelerations = Callable[[ArrayLike, ArrayLike, ArrayLike, ArrayLike, float], FloatArray]


class KaneEquations(NamedTuple):
    """Symbols and equations, mass_matrix u' = forcing, as SymPy objects."""

    q: list[Any]
    u: list[Any]
    masses: tuple[Any, ...]
    lengths: tuple[Any, ...]
    gravity: Any
    mass_matrix: Any  # (n, n)
    forcing: Any  # (n, 1)


def derive(n: int) -> KaneEquations:
    """Return the equations of motion of `n` rods, derived by Kane's method.

    Raises
    ------
    ImportError
        If SymPy is not installed.
    ValueError, TypeError
        If `n` is not a positive integer.
    """
    n = count("n", n, high=MAX_N)
    sympy, mechanics = sympy_and_mechanics()
    q = mechanics.dynamicsymbols(f"q:{n}")
    u = mechanics.dynamicsymbols(f"u:{n}")
    masses, lengths = sympy.symbols(f"m:{n}"), sympy.symbols(f"l:{n}")
    gravity = sympy.Symbol("g")
    down = mechanics.ReferenceFrame("A")  # x points down, as angles are counted from there
    above = mechanics.Point("P")
    above.set_vel(down, 0)
    particles, forces, kinematics = [], [], []
    for i in range(n):
        along = down.orientnew(f"A{i}", "Axis", [q[i], down.z])
        along.set_ang_vel(down, u[i] * down.z)
        bob = above.locatenew(f"P{i}", lengths[i] * along.x)
        bob.v2pt_theory(above, down, along)
        particles.append(mechanics.Particle(f"Pa{i}", bob, masses[i]))
        forces.append((bob, masses[i] * gravity * down.x))
        kinematics.append(q[i].diff() - u[i])
        above = bob
    kane = mechanics.KanesMethod(down, q_ind=q, u_ind=u, kd_eqs=kinematics)
    kane.kanes_equations(particles, forces)
    rates = kane.kindiffdict()
    return KaneEquations(
        q, u, masses, lengths, gravity, kane.mass_matrix.subs(rates), kane.forcing.subs(rates)
    )


def kane_accelerations(n: int) -> Accelerations:
    """Return a function (theta, omega, masses, lengths, gravity) -> angular accelerations.

    Parameters
    ----------
    n : int
        Number of rods. The derivation takes a second for 5, and much longer for more.

    Returns
    -------
    callable
        Takes arrays of shape (n,), or single numbers for all rods, in SI units, and the
        gravity; gives the accelerations [rad/s^2], shape (n,).

    Raises
    ------
    ImportError, ValueError, TypeError
        As `derive` does.
    """
    equations = derive(n)
    sympy, _ = sympy_and_mechanics()
    symbols = (equations.q, equations.u, equations.masses, equations.lengths)
    plain = [[sympy.Dummy() for _ in range(n)] for _ in symbols]
    names = {
        old: new
        for group, dummies in zip(symbols, plain, strict=True)
        for old, new in zip(group, dummies, strict=True)
    }
    matrices = equations.mass_matrix.subs(names), equations.forcing.subs(names)
    evaluate = sympy.lambdify([*plain, equations.gravity], matrices, cse=True)

    def accelerations(
        theta: ArrayLike, omega: ArrayLike, masses: ArrayLike, lengths: ArrayLike, gravity: float
    ) -> FloatArray:
        vectors = [
            vector(name, value, n)
            for name, value in (
                ("theta", theta), ("omega", omega), ("masses", masses), ("lengths", lengths)
            )
        ]  # fmt: skip
        system: Matrices = evaluate(*vectors, number("gravity", gravity))
        return np.linalg.solve(*system)[:, 0].astype(np.float64, copy=False)

    return accelerations


def sympy_and_mechanics() -> tuple[Any, Any]:
    """Return the modules `sympy` and `sympy.physics.mechanics`, or say how to install them."""
    purpose = "derivations by Kane's method"
    return (
        require("sympy", "paper", purpose),
        require("sympy.physics.mechanics", "paper", purpose),
    )
