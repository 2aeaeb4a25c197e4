"""The adjoint of point masses on rigid rods, from forces and their answers."""

# ruff: noqa: ARG001  all kinds of chains share the parameters of a kernel
from __future__ import annotations

from collections.abc import Callable
from typing import Any

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import bare
from npend_gym.compiled.jit import inlined_kernel
from npend_gym.physics.kernels.laws import Parameter, drag_return, drag_slopes
from npend_gym.physics.kernels.tensions import COUPLES, TENSIONS, ChainArrays
from npend_gym.physics.kernels.virtual_power import joint_adjoint_of

# Rows for work, under drag alone: the velocity of each bob, later its drag, and the virtual one
_AX, _AY, _VX, _VY = range(4)
BOB_ADJOINT_ROWS = 4


@inlined_kernel
def _add_drag(
    u: FloatArray, lam: FloatArray, chain: ChainArrays, stage: FloatArray, rows: FloatArray,
    theta_bar: FloatArray, omega_bar: FloatArray, chain_bar: FloatArray,
) -> None:  # fmt: skip
    """Add what depends on the velocities of the bobs; write the drag on each, along and across.

    Both velocities, the true and the virtual one, are in the frame of the bob's own rod.
    """
    n, s, c, l = chain.drag.size, stage[0], stage[1], bare(chain.length)
    a: Any = 0.0 * u[0]
    b = va = vb = k_along = k_across = a
    for i in range(n):
        a, b = c[i] * a + s[i] * b, (c[i] * b - s[i] * a) + l[i] * u[i]
        va, vb = c[i] * va + s[i] * vb, (c[i] * vb - s[i] * va) + l[i] * lam[i]
        rows[_AX][i], rows[_AY][i], rows[_VX][i], rows[_VY][i] = a, b, va, vb
    for i in range(n - 1, -1, -1):
        a, b, va, vb = rows[_AX][i], rows[_AY][i], rows[_VX][i], rows[_VY][i]
        speed, factor, growth = drag_slopes(chain, i, a, b)
        power = a * va + b * vb
        k_along = k_along + (factor * va + (growth * power) * a)
        k_across = k_across + (factor * vb + (growth * power) * b)
        theta_bar[i] = theta_bar[i] + (l[i] * u[i]) * k_along
        omega_bar[i] = omega_bar[i] - l[i] * k_across
        rows[_AX][i], rows[_AY][i] = factor * a, factor * b
        if chain_bar.size > 0:
            drag_return(i, speed, power, chain_bar)
            chain_bar[Parameter.lengths, i] -= u[i] * k_across
        k_along, k_across = c[i] * k_along - s[i] * k_across, s[i] * k_along + c[i] * k_across


@inlined_kernel
def _add_parameters(
    u: FloatArray, alpha: FloatArray, lam: FloatArray, chain: ChainArrays, stage: FloatArray,
    answer: FloatArray, rows: FloatArray, chain_bar: FloatArray,
) -> None:  # fmt: skip
    """Add the derivatives by the parameters, from forces and their answers."""
    s, c, v_below = stage[0][1:], stage[1][1:], chain.inverse_mass[1:]
    f, t, f_below, t_below = (
        stage[COUPLES][1:], stage[TENSIONS][1:], stage[COUPLES][2:], stage[TENSIONS][2:]
    )  # fmt: skip
    h, r, h_below, r_below = answer[0][1:], answer[1][1:], answer[0][2:], answer[1][2:]
    masses, lengths = chain_bar[Parameter.masses], chain_bar[Parameter.lengths]
    for i in range(v_below.size):
        # m A and m V: what the rod above carries more than the rod below, whose frame is turned
        ae = (t_below[i] * c[i] + f_below[i] * s[i]) - t[i]
        an = (t_below[i] * s[i] - f_below[i] * c[i]) + f[i]
        if chain.drag.size > 0:
            ae, an = ae - rows[_AX][i], an - rows[_AY][i]
        ve = (r_below[i] * c[i] + h_below[i] * s[i]) - r[i]
        vn = (r_below[i] * s[i] - h_below[i] * c[i]) + h[i]
        masses[i] = masses[i] - (ae * ve + an * vn) * (v_below[i] * v_below[i])
        square = u[i] * u[i]
        lengths[i] = lengths[i] - (lam[i] * f[i] + (alpha[i] * h[i] + square * r[i]))
    chain_bar[Parameter.gravity, 0] -= h[0] * stage[0][0] + r[0] * stage[1][0]


def adjoint_of_bobs() -> Callable[..., None]:
    """Return the adjoint of point masses on rigid rods.

    F and G of a massless rod are its tension and force couple, and their answers: they are there
    already, so that no pass along the chain is needed.
    """
    add_joint = joint_adjoint_of(ideal=True)

    @inlined_kernel
    def adjoint(
        u: FloatArray, alpha: FloatArray, lam: FloatArray, chain: Any, mass: FloatArray,
        stage: FloatArray, answer: FloatArray, rows: FloatArray, theta_bar: FloatArray,
        omega_bar: FloatArray, torque_bar: FloatArray, chain_bar: FloatArray,
    ) -> None:  # fmt: skip
        l, t, h, r = bare(chain.length), stage[TENSIONS][1:], answer[0][1:], answer[1][1:]
        below: Any = 0.0 * u[0]
        for i in range(u.size - 1, -1, -1):
            om, la = u[i], lam[i]
            square = om * om
            theta_bar[i] = l[i] * (square * h[i] - (la * t[i] + alpha[i] * r[i]))
            by_omega = -(l[i] * (2.0 * om)) * r[i]
            turn, relative = la, om
            if i > 0:
                turn, relative = la - lam[i - 1], om - u[i - 1]
            slope = add_joint(i, relative, turn, chain, torque_bar, chain_bar)
            omega_bar[i] = omega_bar[i] + ((by_omega - slope) + below)
            below = slope
        if chain.drag.size > 0:
            _add_drag(u, lam, chain, stage, rows, theta_bar, omega_bar, chain_bar)
        if chain_bar.size > 0:
            _add_parameters(u, alpha, lam, chain, stage, answer, rows, chain_bar)

    return adjoint
