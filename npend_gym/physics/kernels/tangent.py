"""The tangent of the equations of motion in O(n), by changes of the `virtual_power`."""

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
from npend_gym.physics.kernels.springs import AXIAL_DAMPING, LENGTHS, STIFFNESS, SpringArrays
from npend_gym.physics.kernels.tensions import COUPLES, TENSIONS, ChainArrays
from npend_gym.physics.kernels.virtual_power import count_rods_of, friction_slopes, slopes_of_drag

# Rows that are kept for the tangents of one state, in which a change of theta moves the tip by
# N = l n times as much, and its acceleration by X, a quarter turn of R; one of omega by
# Y = 2 (x' n - l omega e). The moment of the forces changes by -PULL. T is l's share in R, A the
# centre's acceleration, FN the part across the rod of the force on its tip. Then the velocity of
# the tip for drag and what `drag_slopes` says of it; of links the part across of A and c / l; of
# machines `friction_slopes`; of springs x; and n = (COS, SIN)
_NX, _NY, _XX, _XY, _YX, _YY, _PULL, _TX, _TY, _AAX, _AAY, _FN, _UUX, _UUY = range(14)
_SPEED, _DRAG, _GROWTH, _AN, _ARM, _TURN, _SLOPE, _STRETCH, _COS, _SIN = range(14, 24)
POSE_ROWS = 24


def _carry_of(machine: bool) -> Callable[..., None]:
    """Return `carry` for links or machines."""

    @inlined_kernel
    def carry(chain: Any, mass: FloatArray, rows: FloatArray) -> None:
        """Write what depends on the forces that each tip carries."""
        fx: Any = 0.0 * rows[_NX][0]
        fy = fx
        for i in range(chain.length.size - 1, -1, -1):
            l, m, ax, ay = chain.length[i], mass[i], rows[_AAX][i], rows[_AAY][i]
            if machine:
                factor = rows[_DRAG][i]
                fx, fy = fx + factor * rows[_UUX][i], fy + factor * rows[_UUY][i]
            ce, se, arm = rows[_COS][i], rows[_SIN][i], m * chain.terms[Link.CENTRE, i]
            rows[_FN][i], rows[_AN][i] = ce * fx + se * fy, ce * ax + se * ay
            px, py = l * fx + arm * ax, l * fy + arm * ay
            rows[_PULL][i] = se * px - ce * py
            fx, fy = fx + m * ax, fy + m * ay

    return carry


def _pose_of(links: bool, machine: bool, springs: bool) -> Callable[..., None]:
    """Return `pose` for one kind of chains."""
    drag_slopes, count_rods = slopes_of_drag(links, machine), count_rods_of(links or springs)
    oblique, carry = links or springs, _carry_of(machine)

    @inlined_kernel
    def pose(
        u: FloatArray, alpha: FloatArray, chain: Any, mass: FloatArray, stage: FloatArray,
        rows: FloatArray,
    ) -> None:  # fmt: skip
        s, c, length = stage[0], stage[1], bare(chain.length)
        if springs:
            length = stage[LENGTHS]
        n, se, ce = count_rods(u, chain), s[0], c[0]
        axial = u.size - n if springs else u.size
        couples, tensions = stage[COUPLES][1:], stage[TENSIONS][1:]  # of massless rods
        resisted = machine
        if not links:
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
            yx, yy = -(turning * se), turning * ce
            if springs:
                gained, sliding = alpha[axial + i], 2.0 * u[axial + i]
                rx, ry = rx + gained * se, ry - gained * ce
                rx, ry = rx + (sliding * u[i]) * ce, ry + (sliding * u[i]) * se
                yx, yy = yx + sliding * ce, yy + sliding * se
                rows[_STRETCH][i] = l - chain.length[i]
            if links:
                centre = chain.terms[Link.CENTRE, i]
                rows[_AAX][i], rows[_AAY][i] = jx + centre * tx, jy + centre * ty
                rows[_ARM][i] = centre / l
            if machine:
                relative = u[i]
                if i > 0:
                    relative = relative - u[i - 1]
                rows[_TURN][i], rows[_SLOPE][i] = friction_slopes(chain.joints, i, relative)
            jx, jy = jx + rx, jy + ry
            rows[_TX][i], rows[_TY][i], rows[_NX][i], rows[_NY][i] = tx, ty, nx, ny
            rows[_XX][i], rows[_XY][i], rows[_YX][i], rows[_YY][i] = -ry, rx, yx, yy
            if resisted:
                ux, uy = ux + nx * u[i], uy + ny * u[i]
                if springs:
                    ux, uy = ux + u[axial + i] * se, uy - u[axial + i] * ce
                rows[_UUX][i], rows[_UUY][i] = ux, uy
                speed, factor, growth = drag_slopes(chain, i, ux, uy)
                rows[_SPEED][i], rows[_DRAG][i], rows[_GROWTH][i] = speed, factor, growth
            if oblique:
                rows[_COS][i], rows[_SIN][i] = ce, se
            if not links:
                rows[_AAX][i], rows[_AAY][i] = jx, jy
                rows[_FN][i], rows[_PULL][i] = couples[i], -(l * tensions[i])
        if links:
            carry(chain, mass, rows)

    return pose


def _changes_of_points(links: bool, springs: bool) -> Callable[..., None]:
    """Return what a tangent does on its way down the chain."""
    count_rods, rigid = count_rods_of(links or springs), not springs

    @inlined_kernel
    def change_points(
        u: FloatArray, turned: FloatArray, sped: FloatArray, changed: FloatArray, chain: Any,
        rows: FloatArray, out: FloatArray, resisted: bool,
    ) -> None:  # fmt: skip
        """Write the changes of A, and of the velocities of the tips where air resists them."""
        n = count_rods(u, chain)
        axial = u.size - n if springs else u.size
        jx: Any = 0.0 * sped[0]
        jy = ux = uy = ce = se = stretched = jx
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
                ce, se, stretched = rows[_COS][i], rows[_SIN][i], turned[axial + i]
                if changed.size > 0:
                    stretched = stretched + changed[Parameter.lengths, i]
                swept = (2.0 * u[i]) * sped[axial + i]
                tx = tx + (stretched * rows[_TX][i] + swept * ce)
                ty = ty + (stretched * rows[_TY][i] + swept * se)
            ax, ay = jx, jy
            if links:
                share = rows[_ARM][i]
                ax, ay = jx + share * tx, jy + share * ty
            jx, jy = jx + tx, jy + ty
            if changed.size > 0:
                if links:
                    shifted = changed[Parameter.centres, i]
                    if shifted != 0.0:
                        ax, ay = ax + shifted * rows[_TX][i], ay + shifted * rows[_TY][i]
                if rigid:
                    longer = changed[Parameter.lengths, i]
                    if longer != 0.0:
                        jx, jy = jx + longer * rows[_TX][i], jy + longer * rows[_TY][i]
            if not links:
                ax, ay = jx, jy
            out[0][i], out[1][i] = ax, ay
            if resisted:
                ux = ux + (rows[_NX][i] * dw + 0.5 * (rows[_YX][i] * dt))
                uy = uy + (rows[_NY][i] * dw + 0.5 * (rows[_YY][i] * dt))
                if springs:
                    spun = stretched * u[i]
                    ux = ux + (sped[axial + i] * se + spun * ce)
                    uy = uy + (spun * se - sped[axial + i] * ce)
                if rigid and changed.size > 0 and changed[Parameter.lengths, i] != 0.0:
                    faster = changed[Parameter.lengths, i] * u[i] / chain.length[i]
                    ux, uy = ux + faster * rows[_NX][i], uy + faster * rows[_NY][i]
                out[2][i], out[3][i] = ux, uy

    return change_points


def _joint_torque_of(machine: bool) -> Callable[..., Any]:
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

    return joint_torque


@inlined_kernel
def _turn_rotors(
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


@inlined_kernel
def _change_of_drag(
    i: int, changed: FloatArray, rows: FloatArray, out: FloatArray
) -> tuple[Any, Any]:
    """Return the change of the force that overcomes the drag on tip `i`."""
    ux, uy, dux, duy = rows[_UUX][i], rows[_UUY][i], out[2][i], out[3][i]
    factor, along = rows[_DRAG][i], rows[_GROWTH][i] * (ux * dux + uy * duy)
    if changed.size > 0:
        along = along + changed[Parameter.drag, i]
        along = along + changed[Parameter.quadratic_drag, i] * rows[_SPEED][i]
    return factor * dux + along * ux, factor * duy + along * uy


def _tangent_of(links: bool, machine: bool, springs: bool) -> Callable[..., None]:
    """Return `tangent` for one kind of chains."""
    change_points, joint_torque = (
        _changes_of_points(links, springs),
        _joint_torque_of(machine),
    )
    count_rods, moving = count_rods_of(links or springs), machine or springs

    @inlined_kernel
    def tangent(
        u: FloatArray, alpha: FloatArray, turned: FloatArray, sped: FloatArray, pushed: FloatArray,
        changed: FloatArray, chain: Any, mass: FloatArray, rows: FloatArray, out: FloatArray,
        force: FloatArray,
    ) -> None:  # fmt: skip
        n, resisted = count_rods(u, chain), machine
        axial = u.size - n if springs else u.size
        if not links:
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
            if links:
                share = rows[_ARM][i]
                px, py = fx + share * gx, fy + share * gy
            fx, fy = fx + gx, fy + gy
            moment = (rows[_NX][i] * px + rows[_NY][i] * py) - rows[_PULL][i] * turned[i]
            if springs:
                moment = moment + turned[axial + i] * rows[_FN][i]
                pull = chain.stiffness[i] * turned[axial + i]
                pull = pull + chain.axial_damping[i] * sped[axial + i]
                if changed.size > 0 and changed.shape[0] > AXIAL_DAMPING:
                    pull = pull + changed[STIFFNESS, i] * rows[_STRETCH][i]
                    pull = pull + changed[AXIAL_DAMPING, i] * u[axial + i]
                along = rows[_SIN][i] * px - rows[_COS][i] * py
                force[axial + i] = -((pull + along) + rows[_FN][i] * turned[i])
            if changed.size > 0:
                longer = changed[Parameter.lengths, i]
                if longer != 0.0:
                    moment = moment + longer * rows[_FN][i]
                if links:
                    shifted, fuller = changed[Parameter.centres, i], changed[Parameter.inertias, i]
                    if shifted != 0.0:
                        moment = moment + (shifted * mass[i]) * rows[_AN][i]
                    if fuller != 0.0:
                        moment = moment + fuller * alpha[i]
            torque = joint_torque(i, u, sped, pushed, changed, chain, rows)
            force[i] = (torque - torque_below) - moment
            torque_below = torque
        if machine and changed.size > 0:
            _turn_rotors(alpha, changed, chain, force)
        if moving:
            if axial > n:
                force[n] = pushed[n] - (fx + chain.base[Base.DAMPING, 0] * sped[n])
            if axial > n + 1:
                force[n + 1] = 0.0 * fy

    return tangent


_KINDS = {  # links, machine, springs
    ChainArrays: (False, False, False),
    LinkArrays: (True, False, False),
    MachineArrays: (True, True, False),
    SpringArrays: (False, False, True),
}


@chosen_by_type("chain", {kind: _pose_of(*flags) for kind, flags in _KINDS.items()})
def pose(
    u: FloatArray, alpha: FloatArray, chain: AnyArrays, mass: FloatArray, stage: FloatArray,
    rows: FloatArray,
) -> None:  # fmt: skip
    """Write into `rows`, POSE_ROWS, what the tangents of one state have in common."""
    raise NotImplementedError


@chosen_by_type("chain", {kind: _tangent_of(*flags) for kind, flags in _KINDS.items()})
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
