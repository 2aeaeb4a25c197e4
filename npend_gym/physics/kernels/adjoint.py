"""The adjoint of the equations of motion in O(n), by the derivatives of the `virtual_power`."""

# ruff: noqa: ARG001  all kinds of chains share the parameters of a kernel
from __future__ import annotations

from collections.abc import Callable
from typing import Any

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import bare
from npend_gym.compiled.jit import chosen_by_type, inlined_kernel
from npend_gym.physics.kernels.dynamics import AnyArrays
from npend_gym.physics.kernels.link_terms import (
    Base,
    Joint,
    Link,
    LinkArrays,
    MachineArrays,
    Parameter,
)
from npend_gym.physics.kernels.spring_derivatives import springs_adjoint
from npend_gym.physics.kernels.springs import SpringArrays
from npend_gym.physics.kernels.tensions import COUPLES, TENSIONS, ChainArrays
from npend_gym.physics.kernels.virtual_power import friction_slopes, slopes_of_drag

# Rows for one pass of the adjoint: e = (SIN, -COS), A and V; the velocity of each tip under drag
_SIN, _COS, _AX, _AY, _VX, _VY, _UX, _UY = range(8)
ADJOINT_ROWS = 8


def _joint_adjoint(machine: bool) -> Callable[..., Any]:
    """Return `add_joint` for chains with friction or without."""

    @inlined_kernel
    def add_joint(
        i: int, relative: Any, turn: Any, chain: Any, torque_bar: FloatArray, chain_bar: FloatArray
    ) -> Any:
        """Add the part of the torque at joint `i`; return the derivative by its speed."""
        torque_bar[i] = torque_bar[i] + turn
        slope = chain.damping[i]
        if machine:
            joints = bare(chain.joints)
            share, rubbing = friction_slopes(joints, i, relative)
            slope = slope + rubbing
            if chain_bar.size > 0:
                row, speed = chain_bar[Parameter.friction], chain_bar[Parameter.friction_speed]
                row[i] = row[i] - share * turn
                scaled = relative * joints[Joint.PER_SPEED, i]
                speed[i] = speed[i] + (rubbing * scaled) * turn
        if chain_bar.size > 0:
            row = chain_bar[Parameter.damping]
            row[i] = row[i] - relative * turn
        return slope * turn

    return add_joint


def _adjoint_of_links(machine: bool) -> Callable[..., None]:
    """Return the adjoint of links or of machines: one text, two compiled versions."""
    drag_slopes = slopes_of_drag(links=True, machine=machine)

    add_joint = _joint_adjoint(machine)

    @inlined_kernel
    def descend(
        u: FloatArray, alpha: FloatArray, lam: FloatArray, chain: Any, stage: FloatArray,
        rows: FloatArray,
    ) -> None:  # fmt: skip
        """Write A and V of the centres, and the velocities of the tips where air resists them."""
        s, c, length = stage[0], stage[1], bare(chain.length)
        n, se, ce = chain.length.size, s[0], c[0]
        jx: Any = 0.0 * u[0]
        wx = wy = ux = uy = jx
        jy = jx + chain.gravity[0]
        if machine and u.size > n:
            jx, wx, ux = alpha[n], lam[n], u[n]
        if machine and u.size > n + 1:
            jy, uy = jy + alpha[n + 1], u[n + 1]
        for i in range(n):
            if i > 0:
                se, ce = se * c[i] + ce * s[i], ce * c[i] - se * s[i]
            rows[_SIN][i], rows[_COS][i] = se, ce
            l, across, along = length[i], alpha[i], u[i] * u[i]
            tx, ty = across * ce - along * se, across * se + along * ce
            vx, vy = lam[i] * ce, lam[i] * se
            centre = chain.terms[Link.CENTRE, i]
            rows[_AX][i], rows[_AY][i] = jx + centre * tx, jy + centre * ty
            rows[_VX][i], rows[_VY][i] = wx + centre * vx, wy + centre * vy
            jx, jy, wx, wy = jx + l * tx, jy + l * ty, wx + l * vx, wy + l * vy
            if machine:
                ux, uy = ux + l * (u[i] * ce), uy + l * (u[i] * se)
                rows[_UX][i], rows[_UY][i] = ux, uy

    @inlined_kernel
    def adjoint(
        u: FloatArray, alpha: FloatArray, lam: FloatArray, chain: Any, mass: FloatArray,
        stage: FloatArray, answer: FloatArray, rows: FloatArray, theta_bar: FloatArray,
        omega_bar: FloatArray, torque_bar: FloatArray, chain_bar: FloatArray,
    ) -> None:  # fmt: skip
        length, n = bare(chain.length), chain.length.size
        wanted = chain_bar.size > 0
        descend(u, alpha, lam, chain, stage, rows)
        fx: Any = 0.0 * u[0]
        fy = gx = gy = kx = ky = fx  # k: derivatives by the velocity of the tip, summed
        below = fx  # derivative by the speed of the joint below
        for i in range(n - 1, -1, -1):
            se, ce, l, m = rows[_SIN][i], rows[_COS][i], length[i], mass[i]
            ax, ay, vx, vy = rows[_AX][i], rows[_AY][i], rows[_VX][i], rows[_VY][i]
            la, al, om = lam[i], alpha[i], u[i]
            if machine:
                rest = (l - chain.terms[Link.CENTRE, i]) * la
                wx, wy = vx + rest * ce, vy + rest * se
                ux, uy = rows[_UX][i], rows[_UY][i]
                speed, factor, growth = drag_slopes(chain, i, ux, uy)
                power = ux * wx + uy * wy
                fx, fy = fx + factor * ux, fy + factor * uy
                kx = kx + (factor * wx + (growth * power) * ux)
                ky = ky + (factor * wy + (growth * power) * uy)
                if wanted:
                    row, square = chain_bar[Parameter.drag], chain_bar[Parameter.quadratic_drag]
                    row[i] = row[i] - power
                    square[i] = square[i] - speed * power
            arm = chain.terms[Link.CENTRE, i] * m
            px, py = l * fx + arm * ax, l * fy + arm * ay
            hx, hy = l * gx + arm * vx, l * gy + arm * vy
            pull, along, across = se * px - ce * py, se * hx - ce * hy, ce * hx + se * hy
            square = om * om
            by_theta = la * pull + (al * along + square * across)
            by_omega = 2.0 * (om * along)
            if machine:
                by_theta = by_theta + (l * om) * (se * kx - ce * ky)
                by_omega = by_omega - l * (ce * kx + se * ky)
            turn, relative = la, om
            if i > 0:
                turn, relative = la - lam[i - 1], om - u[i - 1]
            slope = add_joint(i, relative, turn, chain, torque_bar, chain_bar)
            theta_bar[i] = by_theta
            omega_bar[i] = omega_bar[i] + ((by_omega - slope) + below)
            below = slope
            if wanted:
                row = chain_bar[Parameter.masses]
                row[i] = row[i] - (ax * vx + ay * vy)
                row = chain_bar[Parameter.lengths]
                by_length = la * (ce * fx + se * fy) + (
                    al * (ce * gx + se * gy) - square * (se * gx - ce * gy)
                )
                if machine:
                    by_length = by_length + om * (ce * kx + se * ky)
                row[i] = row[i] - by_length
                row = chain_bar[Parameter.centres]
                tx, ty = al * ce - square * se, al * se + square * ce
                row[i] = row[i] - m * (la * (ce * ax + se * ay) + (tx * vx + ty * vy))
                row = chain_bar[Parameter.inertias]
                row[i] = row[i] - al * la
            fx, fy, gx, gy = fx + m * ax, fy + m * ay, gx + m * vx, gy + m * vy
        if wanted:
            row = chain_bar[Parameter.gravity]
            row[0] = row[0] - gy
        if machine:
            if wanted:
                add_rotors(alpha, lam, chain, chain_bar)
            if u.size > n:
                theta_bar[n] = 0.0 * fx
                omega_bar[n] = omega_bar[n] - (kx + chain.base[Base.DAMPING, 0] * lam[n])
                torque_bar[n] = torque_bar[n] + lam[n]
            if u.size > n + 1:
                theta_bar[n + 1] = 0.0 * fx
                omega_bar[n + 1] = omega_bar[n + 1] - ky

    @inlined_kernel
    def add_rotors(
        alpha: FloatArray, lam: FloatArray, chain: MachineArrays, chain_bar: FloatArray
    ) -> None:
        """Add the derivatives by the inertia of the rotors and by their gears."""
        joints, armature, gear = (
            bare(chain.joints), chain_bar[Parameter.armature], chain_bar[Parameter.gear]
        )  # fmt: skip
        for i in range(chain.length.size):
            al, la = alpha[i], lam[i]
            if i > 0:
                ratio, inverse = joints[Joint.RATIO, i], joints[Joint.RATIO, i] + 1.0
                al, la = al + ratio * alpha[i - 1], la + ratio * lam[i - 1]
                by_ratio = joints[Joint.ARMATURE, i] * (alpha[i - 1] * la + al * lam[i - 1])
                gear[i] = gear[i] + (inverse * inverse) * by_ratio
            armature[i] = armature[i] - al * la

    return adjoint


_add_plain_joint, _bob_drag_slopes = _joint_adjoint(machine=False), slopes_of_drag(False, False)


@inlined_kernel
def _bob_drag_adjoint(
    u: FloatArray, lam: FloatArray, chain: ChainArrays, stage: FloatArray, rows: FloatArray,
    theta_bar: FloatArray, omega_bar: FloatArray, chain_bar: FloatArray,
) -> None:  # fmt: skip
    """Add what depends on the velocities of the bobs; write the drag on each, along and across.

    Both velocities, the true and the virtual one, are in the frame of the bob's own rod.
    """
    n, s, c, l = chain.drag.size, stage[0], stage[1], chain.length
    a: Any = 0.0 * u[0]
    b = va = vb = k_along = k_across = a
    for i in range(n):
        a, b = c[i] * a + s[i] * b, (c[i] * b - s[i] * a) + l[i] * u[i]
        va, vb = c[i] * va + s[i] * vb, (c[i] * vb - s[i] * va) + l[i] * lam[i]
        rows[_AX][i], rows[_AY][i], rows[_VX][i], rows[_VY][i] = a, b, va, vb
    for i in range(n - 1, -1, -1):
        a, b, va, vb = rows[_AX][i], rows[_AY][i], rows[_VX][i], rows[_VY][i]
        speed, factor, growth = _bob_drag_slopes(chain, i, a, b)
        power = a * va + b * vb
        k_along = k_along + (factor * va + (growth * power) * a)
        k_across = k_across + (factor * vb + (growth * power) * b)
        theta_bar[i] = theta_bar[i] + (l[i] * u[i]) * k_along
        omega_bar[i] = omega_bar[i] - l[i] * k_across
        rows[_AX][i], rows[_AY][i] = factor * a, factor * b
        if chain_bar.size > 0:
            row = chain_bar[Parameter.drag]
            row[i] = row[i] - power
            row = chain_bar[Parameter.quadratic_drag]
            row[i] = row[i] - speed * power
            row = chain_bar[Parameter.lengths]
            row[i] = row[i] - u[i] * k_across
        k_along, k_across = c[i] * k_along - s[i] * k_across, s[i] * k_along + c[i] * k_across


@inlined_kernel
def _bob_parameters_adjoint(
    u: FloatArray, alpha: FloatArray, lam: FloatArray, chain: ChainArrays, stage: FloatArray,
    answer: FloatArray, rows: FloatArray, chain_bar: FloatArray,
) -> None:  # fmt: skip
    """Add the derivatives by masses, lengths and gravity, from forces and their answers."""
    s, c, v_below = stage[0][1:], stage[1][1:], chain.inverse_mass[1:]
    f, t, f_below, t_below = (
        stage[COUPLES][1:], stage[TENSIONS][1:], stage[COUPLES][2:], stage[TENSIONS][2:]
    )  # fmt: skip
    h, r, h_below, r_below = answer[0][1:], answer[1][1:], answer[0][2:], answer[1][2:]
    masses, lengths = chain_bar[Parameter.masses], chain_bar[Parameter.lengths]
    for i in range(u.size):
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
    row = chain_bar[Parameter.gravity]
    row[0] = row[0] - (h[0] * stage[0][0] + r[0] * stage[1][0])


@inlined_kernel
def _adjoint_of_bobs(
    u: FloatArray, alpha: FloatArray, lam: FloatArray, chain: ChainArrays, mass: FloatArray,
    stage: FloatArray, answer: FloatArray, rows: FloatArray, theta_bar: FloatArray,
    omega_bar: FloatArray, torque_bar: FloatArray, chain_bar: FloatArray,
) -> None:  # fmt: skip
    """As `adjoint`: F and G of a massless rod are its tension and force couple, and their answers.

    They are there already, so that no pass along the chain is needed.
    """
    n, l = u.size, chain.length
    t, h, r = stage[TENSIONS][1:], answer[0][1:], answer[1][1:]
    below: Any = 0.0 * u[0]
    for i in range(n - 1, -1, -1):
        om, la = u[i], lam[i]
        square = om * om
        theta_bar[i] = l[i] * (square * h[i] - (la * t[i] + alpha[i] * r[i]))
        turn, relative = la, om
        if i > 0:
            turn, relative = la - lam[i - 1], om - u[i - 1]
        slope = _add_plain_joint(i, relative, turn, chain, torque_bar, chain_bar)
        by_omega = -(l[i] * (2.0 * om)) * r[i]
        omega_bar[i] = omega_bar[i] + ((by_omega - slope) + below)
        below = slope
    if chain.drag.size > 0:
        _bob_drag_adjoint(u, lam, chain, stage, rows, theta_bar, omega_bar, chain_bar)
    if chain_bar.size > 0:
        _bob_parameters_adjoint(u, alpha, lam, chain, stage, answer, rows, chain_bar)


@chosen_by_type(
    "chain",
    {
        ChainArrays: _adjoint_of_bobs,
        LinkArrays: _adjoint_of_links(machine=False),
        MachineArrays: _adjoint_of_links(machine=True),
        SpringArrays: springs_adjoint,
    },
)
def adjoint(
    u: FloatArray, alpha: FloatArray, lam: FloatArray, chain: AnyArrays, mass: FloatArray,
    stage: FloatArray, answer: FloatArray, rows: FloatArray, theta_bar: FloatArray,
    omega_bar: FloatArray, torque_bar: FloatArray, chain_bar: FloatArray,
) -> None:  # fmt: skip
    """Take the derivatives of a function of `alpha` back to what `alpha` depends on, Eq. (2).

    `lam` solves N lam = a, a being the derivatives by `alpha`. Those by the angles are written into
    `theta_bar`; added are those by `u` to `omega_bar`, by the torques to `torque_bar`, and, unless
    it is empty, by the parameters to `chain_bar` (rows of `Parameter`). `stage` is as
    `accelerations_kept` left it, `answer` as `respond` did for `lam`; `rows` are ADJOINT_ROWS for
    work.
    """
    raise NotImplementedError
