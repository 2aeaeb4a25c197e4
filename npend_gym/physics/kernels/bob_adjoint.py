"""The adjoint of point masses on rigid rods or on springs, from forces and their answers."""

# ruff: noqa: ARG001  all kinds of chains share the parameters of a kernel
from __future__ import annotations

from collections.abc import Callable
from typing import Any

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import bare
from npend_gym.compiled.jit import inlined_kernel
from npend_gym.physics.kernels.link_terms import Base, Parameter
from npend_gym.physics.kernels.springs import AXIAL_DAMPING, LENGTHS, STIFFNESS
from npend_gym.physics.kernels.tensions import COUPLES, TENSIONS
from npend_gym.physics.kernels.virtual_power import (
    count_rods_of,
    joint_adjoint_of,
    slopes_of_drag,
)

# Rows for work, under drag alone: the velocity of each bob, later its drag, and the virtual one
_AX, _AY, _VX, _VY = range(4)
BOB_ADJOINT_ROWS = 4


def _drag_adjoint(springs: bool) -> Callable[..., None]:
    """Return `add_drag` for point masses on rigid rods or on springs."""
    drag_slopes = slopes_of_drag(links=False, machine=False)

    @inlined_kernel
    def add_drag(
        u: FloatArray, lam: FloatArray, chain: Any, stage: FloatArray, rows: FloatArray,
        theta_bar: FloatArray, omega_bar: FloatArray, chain_bar: FloatArray,
    ) -> None:  # fmt: skip
        """Add what depends on the velocities of the bobs; write the drag on each, along and across.

        Both velocities, the true and the virtual one, are in the frame of the bob's own rod.
        """
        n, s, c, l = chain.drag.size, stage[0], stage[1], bare(chain.length)
        axial = u.size
        if springs:
            l, axial = stage[LENGTHS], u.size - n
        a: Any = 0.0 * u[0]
        b = va = vb = k_along = k_across = a
        if axial > n:
            b, vb = u[n], lam[n]
        if axial > n + 1:
            a = -u[n + 1]  # the axes of the base have e downwards
        for i in range(n):
            a, b = c[i] * a + s[i] * b, (c[i] * b - s[i] * a) + l[i] * u[i]
            va, vb = c[i] * va + s[i] * vb, (c[i] * vb - s[i] * va) + l[i] * lam[i]
            if springs:
                a, va = a + u[axial + i], va + lam[axial + i]
            rows[_AX][i], rows[_AY][i], rows[_VX][i], rows[_VY][i] = a, b, va, vb
        for i in range(n - 1, -1, -1):
            a, b, va, vb = rows[_AX][i], rows[_AY][i], rows[_VX][i], rows[_VY][i]
            speed, factor, growth = drag_slopes(chain, i, a, b)
            power = a * va + b * vb
            k_along = k_along + (factor * va + (growth * power) * a)
            k_across = k_across + (factor * vb + (growth * power) * b)
            theta_bar[i] = theta_bar[i] + (l[i] * u[i]) * k_along
            omega_bar[i] = omega_bar[i] - l[i] * k_across
            if springs:
                theta_bar[i] = theta_bar[i] - u[axial + i] * k_across
                theta_bar[axial + i] = theta_bar[axial + i] - u[i] * k_across
                omega_bar[axial + i] = omega_bar[axial + i] - k_along
            rows[_AX][i], rows[_AY][i] = factor * a, factor * b
            if chain_bar.size > 0:
                chain_bar[Parameter.drag, i] -= power
                chain_bar[Parameter.quadratic_drag, i] -= speed * power
                chain_bar[Parameter.lengths, i] -= u[i] * k_across
            k_along, k_across = c[i] * k_along - s[i] * k_across, s[i] * k_along + c[i] * k_across
        if axial > n:
            omega_bar[n] = omega_bar[n] - k_across
        if axial > n + 1:
            omega_bar[n + 1] = omega_bar[n + 1] + k_along

    return add_drag


def _parameters_adjoint(springs: bool) -> Callable[..., None]:
    """Return `add_parameters` for point masses on rigid rods or on springs."""

    @inlined_kernel
    def add_parameters(
        u: FloatArray, alpha: FloatArray, lam: FloatArray, chain: Any, stage: FloatArray,
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
        if springs and chain_bar.shape[0] > AXIAL_DAMPING:
            n = chain.length.size
            stiffness, damping = chain_bar[STIFFNESS], chain_bar[AXIAL_DAMPING]
            for i in range(n):
                k, virtual = u.size - n + i, lam[u.size - n + i]
                stretch = stage[LENGTHS][i] - chain.length[i]
                stiffness[i] = stiffness[i] - virtual * stretch
                damping[i] = damping[i] - virtual * u[k]

    return add_parameters


def adjoint_of_bobs(springs: bool) -> Callable[..., None]:
    """Return the adjoint of point masses on rigid rods or on springs.

    F and G of a massless rod are its tension and force couple, and their answers: they are there
    already, so that no pass along the chain is needed.
    """
    count_rods, add_joint = count_rods_of(springs), joint_adjoint_of(machine=False)
    add_drag, add_parameters = _drag_adjoint(springs), _parameters_adjoint(springs)

    @inlined_kernel
    def adjoint(
        u: FloatArray, alpha: FloatArray, lam: FloatArray, chain: Any, mass: FloatArray,
        stage: FloatArray, answer: FloatArray, rows: FloatArray, theta_bar: FloatArray,
        omega_bar: FloatArray, torque_bar: FloatArray, chain_bar: FloatArray,
    ) -> None:  # fmt: skip
        n, l = count_rods(u, chain), bare(chain.length)
        if springs:
            l = stage[LENGTHS]
        axial = u.size - n if springs else u.size
        f, t, h, r = stage[COUPLES][1:], stage[TENSIONS][1:], answer[0][1:], answer[1][1:]
        below: Any = 0.0 * u[0]
        for i in range(n - 1, -1, -1):
            om, la = u[i], lam[i]
            square = om * om
            by_theta = l[i] * (square * h[i] - (la * t[i] + alpha[i] * r[i]))
            by_omega = -(l[i] * (2.0 * om)) * r[i]
            if springs:
                k, rate, virtual = axial + i, 2.0 * u[axial + i], lam[axial + i]
                by_theta = by_theta - ((virtual * f[i] + alpha[k] * h[i]) + (rate * om) * r[i])
                by_omega = by_omega - rate * h[i]
                by_length = (la * f[i] + square * r[i]) + alpha[i] * h[i]
                theta_bar[k] = -(chain.stiffness[i] * virtual + by_length)
                by_rate = chain.axial_damping[i] * virtual + (2.0 * om) * h[i]
                omega_bar[k] = omega_bar[k] - by_rate
            theta_bar[i] = by_theta
            turn, relative = la, om
            if i > 0:
                turn, relative = la - lam[i - 1], om - u[i - 1]
            slope = add_joint(i, relative, turn, chain, torque_bar, chain_bar)
            omega_bar[i] = omega_bar[i] + ((by_omega - slope) + below)
            below = slope
        if springs:
            if axial > n:
                theta_bar[n] = 0.0 * below
                omega_bar[n] = omega_bar[n] - chain.base[Base.DAMPING, 0] * lam[n]
                torque_bar[n] = torque_bar[n] + lam[n]
            if axial > n + 1:
                theta_bar[n + 1] = 0.0 * below
        if chain.drag.size > 0:
            add_drag(u, lam, chain, stage, rows, theta_bar, omega_bar, chain_bar)
        if chain_bar.size > 0:
            add_parameters(u, alpha, lam, chain, stage, answer, rows, chain_bar)

    return adjoint
