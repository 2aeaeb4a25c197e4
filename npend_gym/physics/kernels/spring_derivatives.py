"""The derivatives of the equations of motion of springs in O(n): their tangent and their adjoint.

Nothing is solved for in `springs`, so that these are derivatives of formulas, in fixed axes. Rod i
pulls with P_i = T_i e_i - f_i n_i at what it hangs from. Bob i moves at U_i and accelerates by B_i
less gravity,

    B_i = v_{i+1} (P_{i+1} - P_i - D_i),   D_i = (drag_i + quadratic_drag_i |U_i|) U_i,         (1)
    R_i = B_i - B_{i-1} = (x_i'' - r_i omega_i^2) e_i + (r_i alpha_i + 2 x_i' omega_i) n_i,     (2)
    U_i = U_{i-1} + x_i' e_i + r_i omega_i n_i,

where B_{-1} is the acceleration of the base, plus g upwards, and U_{-1} its velocity. As
de = n dtheta and dn = -e dtheta, a change is

    dP_i = (dT_i + f_i dtheta_i) e_i + (T_i dtheta_i - df_i) n_i,
    dx_i'' = dR_i . e_i + R_i . n_i dtheta_i + d(r_i omega_i^2),                                (3)
    d(r_i alpha_i) = dR_i . n_i - R_i . e_i dtheta_i - 2 d(x_i' omega_i).

On the way back, with the derivatives a_i by alpha_i and b_i by x_i'',

    Q_i = b_i e_i + (a_i / r_i) n_i,    Y_i = v_{i+1} (Q_i - Q_{i+1}),    Y_{i-1} - Y_i,        (4)

are those by R_i, by the force on bob i, and by P_i. Y_{-1} is the derivative by the force on a cart
along its rail, and zero where the base rests or moves as prescribed.
"""

# ruff: noqa: ARG001  all kinds of chains share the parameters of a kernel
from __future__ import annotations

from typing import Any

from npend_gym._checks import FloatArray
from npend_gym.compiled.jit import inlined_kernel
from npend_gym.physics.kernels.link_terms import Base, Parameter
from npend_gym.physics.kernels.springs import AXIAL_DAMPING, STIFFNESS, SpringArrays
from npend_gym.physics.kernels.tensions import COUPLES, TENSIONS
from npend_gym.physics.kernels.virtual_power import slopes_of_drag

_LENGTH, _INVERSE = 4, 5  # rows in which `solve_springs` leaves r and 1/r

# Rows that `_place` writes: e = (SIN, -COS), B and U. For these two an adjoint puts Y and what U
# counts; a tangent keeps behind them r, 1/r, T and f, R along and across the rod, and what
# `drag_slopes` says of U
_SIN, _COS, _BX, _BY, _UX, _UY = range(6)
_R, _OVER_R, _T, _F, _ALONG, _ACROSS, _SPEED, _DRAG, _GROWTH = range(6, 15)

_drag_slopes = slopes_of_drag(links=False, machine=False)


@inlined_kernel
def _place(
    u: FloatArray, alpha: FloatArray, chain: SpringArrays, stage: FloatArray, rows: FloatArray
) -> None:
    """Write e, B and U."""
    n, axial = chain.length.size, u.size - chain.length.size
    s, c = stage[0], stage[1]
    se, ce = s[0], c[0]
    bx: Any = 0.0 * u[0]
    ux = uy = bx
    by = bx + chain.gravity[0]
    if axial > n:
        bx, ux = alpha[n], u[n]
    if axial > n + 1:
        by, uy = by + alpha[n + 1], u[n + 1]
    for i in range(n):
        if i > 0:
            se, ce = se * c[i] + ce * s[i], ce * c[i] - se * s[i]
        r, omega, rate = stage[_LENGTH][i], u[i], u[axial + i]
        turning, along = r * omega, alpha[axial + i] - r * (omega * omega)
        across = r * alpha[i] + 2.0 * (rate * omega)
        bx, by = bx + (along * se + across * ce), by + (across * se - along * ce)
        ux, uy = ux + (rate * se + turning * ce), uy + (turning * se - rate * ce)
        rows[_SIN][i], rows[_COS][i] = se, ce
        rows[_BX][i], rows[_BY][i], rows[_UX][i], rows[_UY][i] = bx, by, ux, uy


@inlined_kernel
def springs_pose(
    u: FloatArray, alpha: FloatArray, chain: SpringArrays, mass: FloatArray, stage: FloatArray,
    rows: FloatArray,
) -> None:  # fmt: skip
    """See `npend_gym.physics.kernels.tangent.pose`."""
    n, axial = chain.length.size, u.size - chain.length.size
    f, t = stage[COUPLES][1:], stage[TENSIONS][1:]
    _place(u, alpha, chain, stage, rows)
    for i in range(n):
        r, omega = stage[_LENGTH][i], u[i]
        rows[_R][i], rows[_OVER_R][i], rows[_T][i], rows[_F][i] = r, stage[_INVERSE][i], t[i], f[i]
        rows[_ALONG][i] = alpha[axial + i] - r * (omega * omega)
        rows[_ACROSS][i] = r * alpha[i] + 2.0 * (u[axial + i] * omega)
        if chain.drag.size > 0:
            speed, factor, growth = _drag_slopes(chain, i, rows[_UX][i], rows[_UY][i])
            rows[_SPEED][i], rows[_DRAG][i], rows[_GROWTH][i] = speed, factor, growth


@inlined_kernel
def _change_velocities(
    u: FloatArray, turned: FloatArray, sped: FloatArray, changed: FloatArray, chain: SpringArrays,
    rows: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Write the changes of U into the last two rows of `out`."""
    n, axial = chain.length.size, u.size - chain.length.size
    ux: Any = 0.0 * sped[0]
    uy = ux
    if axial > n:
        ux = sped[n]
    if axial > n + 1:
        uy = sped[n + 1]
    for i in range(n):
        se, ce, r, omega, dt = rows[_SIN][i], rows[_COS][i], rows[_R][i], u[i], turned[i]
        longer = turned[axial + i]
        if changed.size > 0:
            longer = longer + changed[Parameter.lengths, i]
        along = sped[axial + i] - (r * omega) * dt
        across = (longer * omega + r * sped[i]) + u[axial + i] * dt
        ux, uy = ux + (along * se + across * ce), uy + (across * se - along * ce)
        out[2][i], out[3][i] = ux, uy


@inlined_kernel
def _change_pulls(
    u: FloatArray, turned: FloatArray, sped: FloatArray, pushed: FloatArray, changed: FloatArray,
    chain: SpringArrays, rows: FloatArray, out: FloatArray,
) -> Any:  # fmt: skip
    """Write the changes of B into the first two rows of `out`; return that of P_0 sideways."""
    n, axial, v_below = chain.length.size, u.size - chain.length.size, chain.inverse_mass[1:]
    px: Any = 0.0 * sped[0]  # change of P, of the rod below
    py = torque_below = px
    for back in range(n):
        i = n - 1 - back
        se, ce, dt, longer = rows[_SIN][i], rows[_COS][i], turned[i], turned[axial + i]
        relative, change = u[i], sped[i]
        if i > 0:
            relative, change = relative - u[i - 1], change - sped[i - 1]
        torque = pushed[i] - chain.damping[i] * change
        pull = chain.stiffness[i] * longer + chain.axial_damping[i] * sped[axial + i]
        fx: Any = 0.0 * px  # change of the force that bob i needs beyond its pulls
        fy = fx
        if chain.drag.size > 0:
            ux, uy, dux, duy = rows[_UX][i], rows[_UY][i], out[2][i], out[3][i]
            factor, along = rows[_DRAG][i], rows[_GROWTH][i] * (ux * dux + uy * duy)
            if changed.size > 0:
                along = along + changed[Parameter.drag, i]
                along = along + changed[Parameter.quadratic_drag, i] * rows[_SPEED][i]
            fx, fy = factor * dux + along * ux, factor * duy + along * uy
        if changed.size > 0:
            torque = torque - changed[Parameter.damping, i] * relative
            longer = longer + changed[Parameter.lengths, i]
            heavier = changed[Parameter.masses, i]
            fx, fy = fx + heavier * rows[_BX][i], fy + heavier * rows[_BY][i]
            if changed.shape[0] > AXIAL_DAMPING:
                stretch = rows[_R][i] - chain.length[i]
                pull = pull + changed[STIFFNESS, i] * stretch
                pull = pull + changed[AXIAL_DAMPING, i] * u[axial + i]
        couple = ((torque - torque_below) - rows[_F][i] * longer) * rows[_OVER_R][i]
        torque_below = torque
        along, across = pull + rows[_F][i] * dt, rows[_T][i] * dt - couple
        above_x, above_y = along * se + across * ce, across * se - along * ce
        out[0][i] = v_below[i] * ((px - above_x) - fx)
        out[1][i] = v_below[i] * ((py - above_y) - fy)
        px, py = above_x, above_y
    return px


@inlined_kernel
def springs_tangent(
    u: FloatArray, alpha: FloatArray, turned: FloatArray, sped: FloatArray, pushed: FloatArray,
    changed: FloatArray, chain: SpringArrays, mass: FloatArray, rows: FloatArray, out: FloatArray,
    force: FloatArray,
) -> None:  # fmt: skip
    """Write the changes of the accelerations themselves, Eq. (3), into `force`.

    See `npend_gym.physics.kernels.tangent.tangent`.
    """
    n, axial = chain.length.size, u.size - chain.length.size
    if chain.drag.size > 0:
        _change_velocities(u, turned, sped, changed, chain, rows, out)
    pull = _change_pulls(u, turned, sped, pushed, changed, chain, rows, out)
    bx: Any = 0.0 * pull
    by = bx
    if axial > n:
        base = chain.base
        held = (pushed[n] - base[Base.DAMPING, 0] * sped[n]) + pull
        bx = base[Base.INVERSE_MASS, 0] * held
        force[n] = bx
    if axial > n + 1:
        force[n + 1] = by
    if changed.size > 0:
        by = by + changed[Parameter.gravity, 0]
    for i in range(n):
        se, ce, omega, dt, dw = rows[_SIN][i], rows[_COS][i], u[i], turned[i], sped[i]
        longer = turned[axial + i]
        if changed.size > 0:
            longer = longer + changed[Parameter.lengths, i]
        x, y = out[0][i] - bx, out[1][i] - by
        bx, by = out[0][i], out[1][i]
        along, across = x * se - y * ce, x * ce + y * se
        spun = longer * (omega * omega) + (2.0 * (rows[_R][i] * omega)) * dw
        force[axial + i] = (along + rows[_ACROSS][i] * dt) + spun
        swept = 2.0 * (sped[axial + i] * omega + u[axial + i] * dw)
        across = (across - rows[_ALONG][i] * dt) - swept
        force[i] = (across - alpha[i] * longer) * rows[_OVER_R][i]


@inlined_kernel
def _weigh_bobs(
    u: FloatArray, lam: FloatArray, chain: SpringArrays, stage: FloatArray, rows: FloatArray,
    chain_bar: FloatArray,
) -> tuple[Any, Any]:  # fmt: skip
    """Put Y, Eq. (4), where B stood and what U counts where it stood; return Q_0.

    Added are the derivatives by masses and drag.
    """
    n, axial, v_below = chain.length.size, u.size - chain.length.size, chain.inverse_mass[1:]
    qx: Any = 0.0 * lam[0]
    qy = kx = ky = qx
    for back in range(n):
        i = n - 1 - back
        se, ce, along = rows[_SIN][i], rows[_COS][i], lam[axial + i]
        across = lam[i] * stage[_INVERSE][i]
        above_x, above_y = along * se + across * ce, across * se - along * ce
        yx, yy = v_below[i] * (above_x - qx), v_below[i] * (above_y - qy)
        qx, qy = above_x, above_y
        if chain_bar.size > 0:
            row = chain_bar[Parameter.masses]
            row[i] = row[i] - (rows[_BX][i] * yx + rows[_BY][i] * yy)
        if chain.drag.size > 0:
            ux, uy = rows[_UX][i], rows[_UY][i]
            speed, factor, growth = _drag_slopes(chain, i, ux, uy)
            power = ux * yx + uy * yy
            kx = kx + (factor * yx + (growth * power) * ux)
            ky = ky + (factor * yy + (growth * power) * uy)
            if chain_bar.size > 0:
                row, square = chain_bar[Parameter.drag], chain_bar[Parameter.quadratic_drag]
                row[i] = row[i] - power
                square[i] = square[i] - speed * power
        rows[_BX][i], rows[_BY][i], rows[_UX][i], rows[_UY][i] = yx, yy, kx, ky
    return qx, qy


@inlined_kernel
def springs_adjoint(
    u: FloatArray, alpha: FloatArray, lam: FloatArray, chain: SpringArrays, mass: FloatArray,
    stage: FloatArray, answer: FloatArray, rows: FloatArray, theta_bar: FloatArray,
    omega_bar: FloatArray, torque_bar: FloatArray, chain_bar: FloatArray,
) -> None:  # fmt: skip
    """See `npend_gym.physics.kernels.adjoint.adjoint`."""
    n, axial = chain.length.size, u.size - chain.length.size
    f, t, wanted = stage[COUPLES][1:], stage[TENSIONS][1:], chain_bar.size > 0
    _place(u, alpha, chain, stage, rows)
    qx, qy = _weigh_bobs(u, lam, chain, stage, rows, chain_bar)
    above_x: Any = 0.0 * qx  # Y of what the rod hangs from
    above_y = above = above_x
    if axial > n:
        above_x = chain.base[Base.INVERSE_MASS, 0] * (lam[n] - qx)
        torque_bar[n] = torque_bar[n] + above_x
        held = chain.base[Base.DAMPING, 0] * above_x
        theta_bar[n] = 0.0 * qx
        omega_bar[n] = omega_bar[n] - (held + rows[_UX][0])
    if axial > n + 1:
        theta_bar[n + 1] = 0.0 * qx
        omega_bar[n + 1] = omega_bar[n + 1] - rows[_UY][0]
    if wanted:
        row = chain_bar[Parameter.gravity]
        row[0] = row[0] - qy
    for i in range(n):
        se, ce, r, over_r = rows[_SIN][i], rows[_COS][i], stage[_LENGTH][i], stage[_INVERSE][i]
        omega, rate, by_stretch, by_turn = u[i], u[axial + i], lam[axial + i], lam[i] * over_r
        x, y = above_x - rows[_BX][i], above_y - rows[_BY][i]
        above_x, above_y = rows[_BX][i], rows[_BY][i]
        pull, push = x * se - y * ce, x * ce + y * se  # what T and -f count
        k_along = rows[_UX][i] * se - rows[_UY][i] * ce
        k_across = rows[_UX][i] * ce + rows[_UY][i] * se
        along = alpha[axial + i] - r * (omega * omega)
        across = r * alpha[i] + 2.0 * (rate * omega)
        by_theta = (pull * f[i] + push * t[i]) + (by_stretch * across - by_turn * along)
        theta_bar[i] = by_theta + ((r * omega) * k_along - rate * k_across)
        by_length = (push * f[i]) * over_r + (by_stretch * (omega * omega) - by_turn * alpha[i])
        by_length = by_length - omega * k_across
        theta_bar[axial + i] = chain.stiffness[i] * pull + by_length
        by_rate = chain.axial_damping[i] * pull - (2.0 * (by_turn * omega) + k_along)
        omega_bar[axial + i] = omega_bar[axial + i] + by_rate
        by_omega = 2.0 * (by_stretch * (r * omega) - by_turn * rate) - r * k_across
        couple, relative = -(push * over_r), omega
        turn = couple - above
        above = couple
        torque_bar[i] = torque_bar[i] + turn
        slope = chain.damping[i] * turn
        omega_bar[i] = omega_bar[i] + (by_omega - slope)
        if i > 0:
            omega_bar[i - 1] = omega_bar[i - 1] + slope
            relative = relative - u[i - 1]
        if wanted:
            row = chain_bar[Parameter.lengths]
            row[i] = row[i] + by_length
            row = chain_bar[Parameter.damping]
            row[i] = row[i] - relative * turn
            if chain_bar.shape[0] > AXIAL_DAMPING:
                row = chain_bar[STIFFNESS]
                row[i] = row[i] + pull * (r - chain.length[i])
                row = chain_bar[AXIAL_DAMPING]
                row[i] = row[i] + pull * rate
