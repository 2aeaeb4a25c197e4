"""The tangent of the equations of motion in O(n), by changes of the `virtual_power`."""

# what grows from link to link is a number or a pack, which pyright does not follow
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

from collections.abc import Callable
from typing import Any

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import bare
from npend_gym.compiled.jit import chosen_by_type, inlined_kernel
from npend_gym.physics.kernels.laws import (
    Parameter,
    drag_change,
    drag_slopes,
    friction_change,
    spring_change,
    spring_tension,
)
from npend_gym.physics.kernels.link_terms import AnyArrays, Base, Link, Rotor
from npend_gym.physics.kernels.recursion import LENGTHS
from npend_gym.physics.kernels.tensions import COUPLES, TENSIONS
from npend_gym.physics.kernels.virtual_power import KINDS, joint_slope_of

# Rows that are kept for the tangents of one state, in which a change of theta moves the tip by
# N = r n times as much, and its acceleration by X, a quarter turn of r T; one of omega by
# Y = -2 r omega e. The moment of the forces changes by -PULL. A is the centre's acceleration, FN
# the part across the rod of the force on its tip. Then the velocity of the tip for drag and what
# `drag_slopes` says of it; of links the part across of A, and c / l; the slope of the joint's
# torque; n = (COS, SIN); and of springs x and a quarter turn of x'' e + 2 x' omega n
_NX, _NY, _XX, _XY, _YX, _YY, _PULL, _TX, _TY, _AAX, _AAY, _FN, _UUX, _UUY = range(14)
_SPEED, _DRAG, _GROWTH, _AN, _ARM, _SLOPE, _COS, _SIN, _STRETCH, _SX, _SY = range(14, 25)
POSE_ROWS = 25


def _carry_of(machine: bool, springs: bool) -> Callable[..., None]:
    """Return `carry` for links or machines."""

    @inlined_kernel
    def carry(chain: Any, mass: FloatArray, length: FloatArray, rows: FloatArray) -> None:
        """Write what depends on the forces that each tip carries."""
        fx: Any = 0.0 * rows[_NX][0]
        fy = fx
        for i in range(chain.length.size - 1, -1, -1):
            l, m, ax, ay = length[i], mass[i], rows[_AAX][i], rows[_AAY][i]
            if machine and chain.drag.size > 0:
                factor = rows[_DRAG][i]
                fx, fy = fx + factor * rows[_UUX][i], fy + factor * rows[_UUY][i]
            ce, se = rows[_COS][i], rows[_SIN][i]
            rows[_FN][i], rows[_AN][i] = ce * fx + se * fy, ce * ax + se * ay
            centre = chain.terms[Link.CENTRE, i]
            if springs:
                centre = centre + rows[_STRETCH][i]
            arm = m * centre
            px, py = l * fx + arm * ax, l * fy + arm * ay
            rows[_PULL][i] = se * px - ce * py
            fx, fy = fx + m * ax, fy + m * ay

    return carry


def _pose_of(ideal: bool, machine: bool, springs: bool) -> Callable[..., None]:
    """Return `pose` for one kind of chains."""
    joint_slope, carry = joint_slope_of(ideal), _carry_of(machine, springs)

    @inlined_kernel
    def pose(
        u: FloatArray, alpha: FloatArray, chain: Any, mass: FloatArray, stage: FloatArray,
        rows: FloatArray,
    ) -> None:  # fmt: skip
        s, c, length, n = stage[0], stage[1], bare(chain.length), chain.length.size
        if springs:
            length = stage[LENGTHS][n:]
        se, ce = s[0], c[0]
        axial = u.size - n if springs else u.size
        couples, tensions = stage[COUPLES][1:], stage[TENSIONS][1:]  # of massless rods
        resisted = False
        if ideal or machine:
            resisted = chain.drag.size > 0
        jx: Any = 0.0 * u[0]
        ux = uy = jx
        jy = jx + chain.gravity[0]
        if axial > n:
            jx, ux = alpha[n], u[n]
        if axial > n + 1:
            jy, uy = jy + alpha[n + 1], u[n + 1]
        for i in range(n):
            if i > 0:
                se, ce = se * c[i] + ce * s[i], ce * c[i] - se * s[i]
            l, across, along = length[i], alpha[i], u[i] * u[i]
            tx, ty = across * ce - along * se, across * se + along * ce
            rx, ry, nx, ny, turning = l * tx, l * ty, l * ce, l * se, l * (2.0 * u[i])
            rows[_TX][i], rows[_TY][i], rows[_NX][i], rows[_NY][i] = tx, ty, nx, ny
            rows[_XX][i], rows[_XY][i] = -ry, rx
            rows[_YX][i], rows[_YY][i] = -(turning * se), turning * ce
            relative = u[i]
            if i > 0:
                relative = relative - u[i - 1]
            rows[_SLOPE][i] = joint_slope(i, relative, chain)
            if springs:
                gained, swept = alpha[axial + i], 2.0 * (u[axial + i] * u[i])
                sx, sy = gained * se + swept * ce, swept * se - gained * ce
                rows[_SX][i], rows[_SY][i] = -sy, sx
                rows[_STRETCH][i] = l - chain.length[i]
                jx, jy = jx + sx, jy + sy
            if not ideal:
                centre = chain.terms[Link.CENTRE, i]
                if springs:
                    centre = centre + rows[_STRETCH][i]
                rows[_AAX][i], rows[_AAY][i] = jx + centre * tx, jy + centre * ty
                rows[_ARM][i] = centre / l
                rows[_COS][i], rows[_SIN][i] = ce, se
            jx, jy = jx + rx, jy + ry
            if resisted:
                ux, uy = ux + nx * u[i], uy + ny * u[i]
                if springs:
                    ux, uy = ux + u[axial + i] * se, uy - u[axial + i] * ce
                rows[_UUX][i], rows[_UUY][i] = ux, uy
                speed, factor, growth = drag_slopes(chain, i, ux, uy)
                rows[_SPEED][i], rows[_DRAG][i], rows[_GROWTH][i] = speed, factor, growth
            if ideal:
                rows[_AAX][i], rows[_AAY][i] = jx, jy
                rows[_FN][i], rows[_PULL][i] = couples[i], -(l * tensions[i])
        if not ideal:
            carry(chain, mass, length, rows)

    return pose


def _changes_of_points(ideal: bool, springs: bool) -> Callable[..., None]:
    """The tangent's way down the chain, compiled for a kind."""

    @inlined_kernel
    def change_points(
        u: FloatArray, turned: FloatArray, sped: FloatArray, changed: FloatArray, chain: Any,
        rows: FloatArray, out: FloatArray, resisted: bool,
    ) -> None:  # fmt: skip
        """Write the changes of A, and of the velocities of the tips where air resists them."""
        n = chain.length.size
        axial = u.size - n if springs else u.size
        jx: Any = 0.0 * sped[0]
        jy = ux = uy = further = faster = se = ce = jx
        if changed.size > 0:
            jy = jy + changed[Parameter.gravity, 0]
        if axial > n:
            ux = sped[n]
        if axial > n + 1:
            uy = sped[n + 1]
        for i in range(n):
            dt, dw = turned[i], sped[i]
            tx, ty = rows[_XX][i] * dt + rows[_YX][i] * dw, rows[_XY][i] * dt + rows[_YY][i] * dw
            if springs:
                further, faster, ce, se = (
                    turned[axial + i], sped[axial + i], rows[_COS][i], rows[_SIN][i]
                )  # fmt: skip
                swept = 2.0 * (u[i] * faster + u[axial + i] * dw)
                jx = jx + (rows[_SX][i] * dt + (further * rows[_TX][i] + swept * ce))
                jy = jy + (rows[_SY][i] * dt + (further * rows[_TY][i] + swept * se))
            ax, ay = jx, jy
            if not ideal:
                share = rows[_ARM][i]
                ax, ay = jx + share * tx, jy + share * ty
            jx, jy = jx + tx, jy + ty
            if changed.size > 0:
                if not ideal:
                    shifted = changed[Parameter.centres, i]
                    if shifted != 0.0:
                        ax, ay = ax + shifted * rows[_TX][i], ay + shifted * rows[_TY][i]
                longer = changed[Parameter.lengths, i]
                if longer != 0.0:
                    jx, jy = jx + longer * rows[_TX][i], jy + longer * rows[_TY][i]
            if ideal:
                ax, ay = jx, jy
            out[0][i], out[1][i] = ax, ay
            if resisted:
                ux = ux + (rows[_NX][i] * dw + 0.5 * (rows[_YX][i] * dt))
                uy = uy + (rows[_NY][i] * dw + 0.5 * (rows[_YY][i] * dt))
                if springs:
                    across = u[axial + i] * dt + u[i] * further
                    ux, uy = ux + (faster * se + across * ce), uy + (across * se - faster * ce)
                if changed.size > 0 and changed[Parameter.lengths, i] != 0.0:
                    grown = changed[Parameter.lengths, i] * u[i]
                    if ideal:
                        grown = grown / chain.length[i]
                        ux, uy = ux + grown * rows[_NX][i], uy + grown * rows[_NY][i]
                    else:
                        ux, uy = ux + grown * rows[_COS][i], uy + grown * rows[_SIN][i]
                out[2][i], out[3][i] = ux, uy

    return change_points


def _joint_torque_of(ideal: bool) -> Callable[..., Any]:
    """Return `joint_torque` for chains with friction or without."""

    @inlined_kernel
    def joint_torque(
        i: int, u: FloatArray, sped: FloatArray, pushed: FloatArray, changed: FloatArray,
        chain: Any, rows: FloatArray,
    ) -> Any:  # fmt: skip
        """Return the change of the torque at joint `i`, damping and friction included."""
        speed, change = u[i], sped[i]
        if i > 0:
            speed, change = speed - u[i - 1], change - sped[i - 1]
        torque = pushed[i] - rows[_SLOPE][i] * change
        if changed.size > 0:
            torque = torque - changed[Parameter.damping, i] * speed
            if not ideal and chain.friction.shape[0] > 0:
                torque = torque - friction_change(chain.friction, i, speed, changed)
        return torque

    return joint_torque


@inlined_kernel
def _turn_rotors(alpha: FloatArray, changed: FloatArray, chain: Any, force: FloatArray) -> None:
    """Add what changes of the rotors' inertia and gears do."""
    rotors = bare(chain.rotors)
    for i in range(chain.length.size):
        grown = changed[Parameter.armature, i]
        if grown == 0.0 and changed[Parameter.gear, i] == 0.0:
            continue
        if i == 0:
            force[0] = force[0] - grown * alpha[0]
        else:
            ratio, inverse = rotors[Rotor.RATIO, i], rotors[Rotor.RATIO, i] + 1.0
            geared = -(inverse * inverse) * changed[Parameter.gear, i]
            spin = alpha[i] + ratio * alpha[i - 1]
            held = rotors[Rotor.ARMATURE, i] * geared
            moment = grown * spin + held * alpha[i - 1]
            force[i] = force[i] - moment
            above = ratio * moment + (rotors[Rotor.ARMATURE, i] * spin) * geared
            force[i - 1] = force[i - 1] - above


@inlined_kernel
def _change_of_drag(
    i: int, changed: FloatArray, rows: FloatArray, out: FloatArray
) -> tuple[Any, Any]:
    """Return the change of the force that overcomes the drag on tip `i`."""
    ux, uy, dux, duy = rows[_UUX][i], rows[_UUY][i], out[2][i], out[3][i]
    factor, along = rows[_DRAG][i], rows[_GROWTH][i] * (ux * dux + uy * duy)
    if changed.size > 0:
        along = along + drag_change(i, rows[_SPEED][i], changed)
    return factor * dux + along * ux, factor * duy + along * uy


def _tangent_of(ideal: bool, machine: bool, springs: bool) -> Callable[..., None]:
    """Return `tangent` for one kind of chains."""
    change_points, joint_torque = _changes_of_points(ideal, springs), _joint_torque_of(ideal)

    @inlined_kernel
    def tangent(
        u: FloatArray, alpha: FloatArray, turned: FloatArray, sped: FloatArray, pushed: FloatArray,
        changed: FloatArray, chain: Any, mass: FloatArray, rows: FloatArray, out: FloatArray,
        force: FloatArray,
    ) -> None:  # fmt: skip
        n, resisted = chain.length.size, False
        axial = u.size - n if springs else u.size
        if ideal or machine:
            resisted = chain.drag.size > 0
        change_points(u, turned, sped, changed, chain, rows, out, resisted)
        fx: Any = 0.0 * sped[0]
        fy = torque_below = fx
        for i in range(n - 1, -1, -1):
            if resisted:
                by_drag = _change_of_drag(i, changed, rows, out)
                fx, fy = fx + by_drag[0], fy + by_drag[1]
            gx, gy = mass[i] * out[0][i], mass[i] * out[1][i]
            if changed.size > 0:
                heavier = changed[Parameter.masses, i]
                if heavier != 0.0:  # most parameters stay as they are in one direction
                    gx, gy = gx + heavier * rows[_AAX][i], gy + heavier * rows[_AAY][i]
            px, py = fx + gx, fy + gy
            if not ideal:
                share = rows[_ARM][i]
                px, py = fx + share * gx, fy + share * gy
            fx, fy = fx + gx, fy + gy
            moment = (rows[_NX][i] * px + rows[_NY][i] * py) - rows[_PULL][i] * turned[i]
            if springs:
                further, faster = turned[axial + i], sped[axial + i]
                across = rows[_FN][i] + mass[i] * rows[_AN][i]
                moment = moment + further * across
                pull = spring_tension(chain.springs, i, further, faster)
                if changed.size > 0:
                    pull = pull + spring_change(i, rows[_STRETCH][i], u[axial + i], changed)
                along = rows[_SIN][i] * fx - rows[_COS][i] * fy
                force[axial + i] = -((pull + along) + across * turned[i])
            if changed.size > 0:
                longer = changed[Parameter.lengths, i]
                if longer != 0.0:
                    moment = moment + longer * rows[_FN][i]
                if not ideal:
                    shifted, fuller = changed[Parameter.centres, i], changed[Parameter.inertias, i]
                    if shifted != 0.0:
                        moment = moment + (shifted * mass[i]) * rows[_AN][i]
                    if fuller != 0.0:
                        moment = moment + fuller * alpha[i]
            torque = joint_torque(i, u, sped, pushed, changed, chain, rows)
            force[i] = (torque - torque_below) - moment
            torque_below = torque
        if machine and changed.size > 0 and chain.rotors.shape[0] > 0:
            _turn_rotors(alpha, changed, chain, force)
        if not ideal:
            if axial > n:
                force[n] = pushed[n] - (fx + chain.base[Base.DAMPING, 0] * sped[n])
            if axial > n + 1:
                force[n + 1] = 0.0 * fy

    return tangent


@chosen_by_type("chain", {kind: _pose_of(*flags) for kind, flags in KINDS.items()})
def pose(
    u: FloatArray, alpha: FloatArray, chain: AnyArrays, mass: FloatArray, stage: FloatArray,
    rows: FloatArray,
) -> None:  # fmt: skip
    """Write into `rows`, POSE_ROWS, what the tangents of one state have in common."""
    raise NotImplementedError


@chosen_by_type("chain", {kind: _tangent_of(*flags) for kind, flags in KINDS.items()})
def tangent(
    u: FloatArray, alpha: FloatArray, turned: FloatArray, sped: FloatArray, pushed: FloatArray,
    changed: FloatArray, chain: AnyArrays, mass: FloatArray, rows: FloatArray, out: FloatArray,
    force: FloatArray,
) -> None:  # fmt: skip
    """Write into `force` the change of f - N alpha, alpha held, of which Eq. (2) takes the answer.

    The changes are `turned` of the coordinates, `sped` of `u`, `pushed` of the torques and, unless
    it is empty, `changed` of the parameters (rows of `Parameter`): numbers, the same for all chains
    of a pack. `rows` are as `pose` left them; `out` is four rows for work.
    """
    raise NotImplementedError
