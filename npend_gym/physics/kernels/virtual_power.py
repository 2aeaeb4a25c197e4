"""The derivatives of the equations of motion in O(n): their tangent and their adjoint.

With N the mass matrix and f all other moments on the rods, N alpha = f. For any numbers lambda,

    P = lambda . (N alpha - f)                                                              (1)

is the virtual power of what is left of the equations when the rods turn at the rates lambda; it is
zero in every motion. A small change of the state, of a torque or of a parameter changes alpha by

    d alpha = -N^-1 d(N alpha - f), alpha held,                                             (2)

and if a function of alpha has the derivatives a, it changes by a . d alpha = -dP for the lambda
that solves N lambda = a: the same system once more, with the factors that are there, because N is
symmetric. Tangent and adjoint therefore need no more than P, which is a sum over points: with e_i
along rod i and n_i across it, the centre of link i accelerates by A_i, less gravity, and moves at
the virtual velocity V_i,

    T_i = alpha_i n_i - omega_i^2 e_i,
    A_i = J_i + c_i T_i,           J_{i+1} = J_i + l_i T_i,           J_0 = (0, g),
    V_i = W_i + c_i lambda_i n_i,  W_{i+1} = W_i + l_i lambda_i n_i,  W_0 = 0,

    P = sum_i [m_i A_i . V_i + I_i alpha_i lambda_i + K_i . W_{i+1}
               - tau_i (lambda_i - lambda_{i-1})
               + r_i (alpha_i + k_i alpha_{i-1}) (lambda_i + k_i lambda_{i-1})],            (3)

with the torques tau_i of the joints less damping and friction, the forces K_i that overcome drag on
the tips, and rotors of inertia r_i that turn with the link above by k_i. A pass down the chain
gives A and V, a pass up the forces F and G on each joint, F being the sum of m A + K below and G
that of m V; one link has (with F and G of the joint at its tip, and e . = scalar product)

    dP/dtheta_i = -lambda_i e_i . (l_i F + c_i m_i A_i)
                  - (alpha_i e_i + omega_i^2 n_i) . (l_i G + c_i m_i V_i)                   (4)

and so on. Point masses are c = l, I = 0. docs/explanation/derivatives.md has all of it.
"""

# ruff: noqa: ARG001  all kinds of chains share the parameters of a kernel
from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import bare
from npend_gym.compiled.jit import chosen_by_type, inlined_kernel
from npend_gym.compiled.packs import where
from npend_gym.physics.kernels.dynamics import AnyArrays
from npend_gym.physics.kernels.link_terms import (
    Base,
    Joint,
    Link,
    LinkArrays,
    MachineArrays,
    Parameter,
)
from npend_gym.physics.kernels.tensions import COUPLES, TENSIONS, ChainArrays

# Rows for one pass of the adjoint: e = (SIN, -COS), A and V; the velocity of each tip under drag
_SIN, _COS, _AX, _AY, _VX, _VY, _UX, _UY = range(8)
ADJOINT_ROWS = 8
# Rows that are kept for the tangents of one state, in which a change of theta moves the tip by
# N = l n times as much, and its acceleration by X = -l (alpha e + omega^2 n); one of omega by
# Y = -2 l omega e. The moment of the forces changes by -PULL. What follows is for parameters: T, A,
# the parts across of A and of the force F on the tip. Then the velocity of the tip for drag, what
# `drag_slopes` says of it and `_friction_slopes` of the joint, and c / l
_NX, _NY, _XX, _XY, _YX, _YY, _PULL, _TX, _TY, _AAX, _AAY, _AN, _FN, _UUX, _UUY = range(15)
_SPEED, _DRAG, _GROWTH, _TURN, _SLOPE, _ARM = range(15, 21)
POSE_ROWS = 21


@inlined_kernel
def _friction_slopes(joints: FloatArray, i: int, relative: Any) -> tuple[Any, Any]:
    """Return the torque of friction at joint `i` per N m of its own, and the slope by speed."""
    u = relative * joints[Joint.PER_SPEED, i]
    root = math.sqrt(1.0 + u * u)
    slope = (joints[Joint.FRICTION, i] * joints[Joint.PER_SPEED, i]) / (root * root * root)
    return u / root, slope


def _count_rods(links: bool) -> Callable[..., int]:
    """Return `count_rods` for one kind of chains."""

    @inlined_kernel
    def count_rods(u: FloatArray, chain: Any) -> int:
        """Return the number of rods: a cart has an entry in `u`, and `length` one to spare."""
        n = u.size
        if links:
            n = chain.length.size
        return n

    return count_rods


def _slopes_of_drag(links: bool, machine: bool) -> Callable[..., tuple[Any, Any, Any]]:
    """Return `drag_slopes` for one kind of chains."""

    @inlined_kernel
    def drag_slopes(chain: Any, i: int, x: Any, y: Any) -> tuple[Any, Any, Any]:
        """Return the speed, drag over velocity, and the growth of that along the velocity."""
        linear: Any = 0.0 * x
        quadratic = linear
        if machine:
            linear = chain.joints[Joint.DRAG, i]
            quadratic = chain.joints[Joint.QUADRATIC_DRAG, i]
        if not links:
            linear, quadratic = chain.drag[i], chain.quadratic_drag[i]
        speed = math.sqrt(x * x + y * y)
        moving = speed > 0.0
        growth = where(moving, quadratic / where(moving, speed, 1.0), 0.0)
        return speed, linear + quadratic * speed, growth

    return drag_slopes


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
            share, rubbing = _friction_slopes(joints, i, relative)
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
    drag_slopes = _slopes_of_drag(links=True, machine=machine)

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


_add_plain_joint, _bob_drag_slopes = _joint_adjoint(machine=False), _slopes_of_drag(False, False)


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


def _tangent(links: bool, machine: bool) -> tuple[Callable[..., None], Callable[..., None]]:
    """Return pose and tangent for one kind of chains: one text, three compiled versions."""
    drag_slopes, count_rods = _slopes_of_drag(links, machine), _count_rods(links)

    @inlined_kernel
    def pose(
        u: FloatArray, alpha: FloatArray, chain: Any, mass: FloatArray, stage: FloatArray,
        rows: FloatArray,
    ) -> None:  # fmt: skip
        s, c, length = stage[0], stage[1], bare(chain.length)
        n, se, ce = count_rods(u, chain), s[0], c[0]
        couples, tensions = stage[COUPLES][1:], stage[TENSIONS][1:]  # of massless rods
        resisted = machine
        if not links:
            resisted = chain.drag.size > 0
        jx: Any = 0.0 * u[0]
        ux = uy = jx
        jy = jx + chain.gravity[0]
        if machine and u.size > n:
            jx, ux = alpha[n], u[n]
        for i in range(n):
            if i > 0:
                se, ce = se * c[i] + ce * s[i], ce * c[i] - se * s[i]
            l, across, along = length[i], alpha[i], u[i] * u[i]
            tx, ty = across * ce - along * se, across * se + along * ce
            if links:
                centre = chain.terms[Link.CENTRE, i]
                rows[_AAX][i], rows[_AAY][i] = jx + centre * tx, jy + centre * ty
                rows[_ARM][i] = centre / l
            if machine:
                relative = u[i]
                if i > 0:
                    relative = relative - u[i - 1]
                rows[_TURN][i], rows[_SLOPE][i] = _friction_slopes(chain.joints, i, relative)
            jx, jy = jx + l * tx, jy + l * ty
            if not links:
                rows[_AAX][i], rows[_AAY][i] = jx, jy
            nx, ny, turning = l * ce, l * se, l * (2.0 * u[i])
            rows[_TX][i], rows[_TY][i], rows[_NX][i], rows[_NY][i] = tx, ty, nx, ny
            rows[_XX][i], rows[_XY][i] = -(across * ny + along * nx), across * nx - along * ny
            rows[_YX][i], rows[_YY][i] = -(turning * se), turning * ce
            if resisted:
                ux, uy = ux + nx * u[i], uy + ny * u[i]
                rows[_UUX][i], rows[_UUY][i] = ux, uy
                speed, factor, growth = drag_slopes(chain, i, ux, uy)
                rows[_SPEED][i], rows[_DRAG][i], rows[_GROWTH][i] = speed, factor, growth
            if links:
                rows[_AN][i], rows[_FN][i] = ce, se  # until the way back
            else:
                rows[_FN][i], rows[_PULL][i] = couples[i], -(l * tensions[i])
        if links:
            ascend(chain, mass, rows)

    @inlined_kernel
    def ascend(chain: Any, mass: FloatArray, rows: FloatArray) -> None:
        """Write what depends on the forces that each tip carries."""
        fx: Any = 0.0 * rows[_NX][0]
        fy = fx
        for i in range(chain.length.size - 1, -1, -1):
            l, m, ax, ay = chain.length[i], mass[i], rows[_AAX][i], rows[_AAY][i]
            if machine:
                factor = rows[_DRAG][i]
                fx, fy = fx + factor * rows[_UUX][i], fy + factor * rows[_UUY][i]
            arm = m * chain.terms[Link.CENTRE, i]
            ce, se = rows[_AN][i], rows[_FN][i]
            rows[_FN][i], rows[_AN][i] = ce * fx + se * fy, ce * ax + se * ay
            px, py = l * fx + arm * ax, l * fy + arm * ay
            rows[_PULL][i] = se * px - ce * py
            fx, fy = fx + m * ax, fy + m * ay

    @inlined_kernel
    def descend(
        u: FloatArray, turned: FloatArray, sped: FloatArray, changed: FloatArray, chain: Any,
        rows: FloatArray, out: FloatArray, resisted: bool,
    ) -> None:  # fmt: skip
        """Write the changes of A, and of the velocities of the tips where air resists them."""
        n = count_rods(u, chain)
        jx: Any = 0.0 * sped[0]
        jy = ux = uy = jx
        if changed.size > 0:
            jy = jy + changed[Parameter.gravity, 0]
        if machine and sped.size > n:
            ux = sped[n]
        for i in range(n):
            dt, dw = turned[i], sped[i]
            tx, ty = rows[_XX][i] * dt + rows[_YX][i] * dw, rows[_XY][i] * dt + rows[_YY][i] * dw
            ax, ay = jx, jy
            if links:
                share = rows[_ARM][i]
                ax, ay = jx + share * tx, jy + share * ty
            jx, jy = jx + tx, jy + ty
            if changed.size > 0:
                longer = changed[Parameter.lengths, i]
                if links:
                    shifted = changed[Parameter.centres, i]
                    if shifted != 0.0:
                        ax, ay = ax + shifted * rows[_TX][i], ay + shifted * rows[_TY][i]
                if longer != 0.0:
                    jx, jy = jx + longer * rows[_TX][i], jy + longer * rows[_TY][i]
            if not links:
                ax, ay = jx, jy
            out[0][i], out[1][i] = ax, ay
            if resisted:
                ux = ux + (rows[_NX][i] * dw + 0.5 * (rows[_YX][i] * dt))
                uy = uy + (rows[_NY][i] * dw + 0.5 * (rows[_YY][i] * dt))
                if changed.size > 0 and changed[Parameter.lengths, i] != 0.0:
                    faster = changed[Parameter.lengths, i] * u[i] / chain.length[i]
                    ux, uy = ux + faster * rows[_NX][i], uy + faster * rows[_NY][i]
                out[2][i], out[3][i] = ux, uy

    @inlined_kernel
    def joint_torque(
        i: int, u: FloatArray, sped: FloatArray, pushed: FloatArray, changed: FloatArray,
        chain: Any, rows: FloatArray,
    ) -> Any:  # fmt: skip
        """Return the change of the torque at joint `i`, damping and friction included."""
        speed, change = u[i], sped[i]
        if i > 0:
            speed, change = speed - u[i - 1], change - sped[i - 1]
        slope = chain.damping[i]
        if machine:
            slope = slope + rows[_SLOPE][i]
        torque = pushed[i] - slope * change
        if changed.size > 0:
            torque = torque - changed[Parameter.damping, i] * speed
            if machine:
                scaled = speed * chain.joints[Joint.PER_SPEED, i]
                torque = torque - changed[Parameter.friction, i] * rows[_TURN][i]
                torque = torque + changed[Parameter.friction_speed, i] * (rows[_SLOPE][i] * scaled)
        return torque

    @inlined_kernel
    def tangent(
        u: FloatArray, alpha: FloatArray, turned: FloatArray, sped: FloatArray, pushed: FloatArray,
        changed: FloatArray, chain: Any, mass: FloatArray, rows: FloatArray, out: FloatArray,
        force: FloatArray,
    ) -> None:  # fmt: skip
        n, resisted = count_rods(u, chain), machine
        if not links:
            resisted = chain.drag.size > 0
        descend(u, turned, sped, changed, chain, rows, out, resisted)
        fx: Any = 0.0 * sped[0]
        fy = torque_below = fx
        for i in range(n - 1, -1, -1):
            m = mass[i]
            if resisted:
                ux, uy, dux, duy = rows[_UUX][i], rows[_UUY][i], out[2][i], out[3][i]
                factor, along = rows[_DRAG][i], rows[_GROWTH][i] * (ux * dux + uy * duy)
                if changed.size > 0:
                    along = along + changed[Parameter.drag, i]
                    along = along + changed[Parameter.quadratic_drag, i] * rows[_SPEED][i]
                fx, fy = fx + (factor * dux + along * ux), fy + (factor * duy + along * uy)
            gx, gy = m * out[0][i], m * out[1][i]
            if changed.size > 0:
                heavier = changed[Parameter.masses, i]
                if heavier != 0.0:  # most parameters stay as they are in one direction
                    gx, gy = gx + heavier * rows[_AAX][i], gy + heavier * rows[_AAY][i]
            px, py = fx + gx, fy + gy
            if links:
                share = rows[_ARM][i]
                px, py = fx + share * gx, fy + share * gy
            fx, fy = fx + gx, fy + gy
            moment = (rows[_NX][i] * px + rows[_NY][i] * py) - rows[_PULL][i] * turned[i]
            if changed.size > 0:
                longer = changed[Parameter.lengths, i]
                if longer != 0.0:
                    moment = moment + longer * rows[_FN][i]
                if links:
                    shifted, fuller = changed[Parameter.centres, i], changed[Parameter.inertias, i]
                    if shifted != 0.0:
                        moment = moment + (shifted * m) * rows[_AN][i]
                    if fuller != 0.0:
                        moment = moment + fuller * alpha[i]
            torque = joint_torque(i, u, sped, pushed, changed, chain, rows)
            force[i] = (torque - torque_below) - moment
            torque_below = torque
        if machine:
            if changed.size > 0:
                turn_rotors(alpha, changed, chain, force)
            if u.size > n:
                force[n] = pushed[n] - (fx + chain.base[Base.DAMPING, 0] * sped[n])

    @inlined_kernel
    def turn_rotors(
        alpha: FloatArray, changed: FloatArray, chain: MachineArrays, force: FloatArray
    ) -> None:
        """Add what changes of the rotors' inertia and gears do."""
        joints = bare(chain.joints)
        for i in range(chain.length.size):
            grown = changed[Parameter.armature, i]
            if grown == 0.0 and changed[Parameter.gear, i] == 0.0:
                continue
            if i == 0:
                force[0] = force[0] - grown * alpha[0]
            else:
                ratio, inverse = joints[Joint.RATIO, i], joints[Joint.RATIO, i] + 1.0
                geared = -(inverse * inverse) * changed[Parameter.gear, i]
                spin = alpha[i] + ratio * alpha[i - 1]
                held = joints[Joint.ARMATURE, i] * geared
                moment = grown * spin + held * alpha[i - 1]
                force[i] = force[i] - moment
                above = ratio * moment + (joints[Joint.ARMATURE, i] * spin) * geared
                force[i - 1] = force[i - 1] - above

    return pose, tangent


_bobs, _plain_links, _machines = (
    _tangent(links=False, machine=False),
    _tangent(links=True, machine=False),
    _tangent(links=True, machine=True),
)


@chosen_by_type(
    "chain", {ChainArrays: _bobs[0], LinkArrays: _plain_links[0], MachineArrays: _machines[0]}
)
def pose(
    u: FloatArray, alpha: FloatArray, chain: AnyArrays, mass: FloatArray, stage: FloatArray,
    rows: FloatArray,
) -> None:  # fmt: skip
    """Write into `rows`, POSE_ROWS, what the tangents of one state have in common."""
    raise NotImplementedError


@chosen_by_type(
    "chain", {ChainArrays: _bobs[1], LinkArrays: _plain_links[1], MachineArrays: _machines[1]}
)
def tangent(
    u: FloatArray, alpha: FloatArray, turned: FloatArray, sped: FloatArray, pushed: FloatArray,
    changed: FloatArray, chain: AnyArrays, mass: FloatArray, rows: FloatArray, out: FloatArray,
    force: FloatArray,
) -> None:  # fmt: skip
    """Write into `force` the change of f - N alpha, alpha held, of which Eq. (2) takes the answer.

    The changes are `turned` of the angles, `sped` of `u`, `pushed` of the torques and, unless it is
    empty, `changed` of the parameters (rows of `Parameter`): numbers, the same for all chains of a
    pack. `rows` are as `pose` left them; `out` is four rows for work.
    """
    raise NotImplementedError
