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
from npend_gym.physics.kernels.spring_derivatives import springs_pose, springs_tangent
from npend_gym.physics.kernels.springs import SpringArrays
from npend_gym.physics.kernels.tensions import COUPLES, TENSIONS, ChainArrays
from npend_gym.physics.kernels.virtual_power import friction_slopes, slopes_of_drag

# Rows that are kept for the tangents of one state, in which a change of theta moves the tip by
# N = l n times as much, and its acceleration by X = -l (alpha e + omega^2 n); one of omega by
# Y = -2 l omega e. The moment of the forces changes by -PULL. What follows is for parameters: T, A,
# the parts across of A and of the force F on the tip. Then the velocity of the tip for drag, what
# `drag_slopes` says of it and `friction_slopes` of the joint, and c / l
_NX, _NY, _XX, _XY, _YX, _YY, _PULL, _TX, _TY, _AAX, _AAY, _AN, _FN, _UUX, _UUY = range(15)
_SPEED, _DRAG, _GROWTH, _TURN, _SLOPE, _ARM = range(15, 21)
POSE_ROWS = 21


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


def _tangent(links: bool, machine: bool) -> tuple[Callable[..., None], Callable[..., None]]:
    """Return pose and tangent for one kind of chains: one text, three compiled versions."""
    drag_slopes, count_rods = slopes_of_drag(links, machine), _count_rods(links)

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
        if machine and u.size > n + 1:
            jy, uy = jy + alpha[n + 1], u[n + 1]
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
                rows[_TURN][i], rows[_SLOPE][i] = friction_slopes(chain.joints, i, relative)
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
        if machine and sped.size > n + 1:
            uy = sped[n + 1]
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
            if u.size > n + 1:
                force[n + 1] = 0.0 * fy

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
    "chain",
    {
        ChainArrays: _bobs[0],
        LinkArrays: _plain_links[0],
        MachineArrays: _machines[0],
        SpringArrays: springs_pose,
    },
)
def pose(
    u: FloatArray, alpha: FloatArray, chain: AnyArrays, mass: FloatArray, stage: FloatArray,
    rows: FloatArray,
) -> None:  # fmt: skip
    """Write into `rows`, POSE_ROWS, what the tangents of one state have in common."""
    raise NotImplementedError


@chosen_by_type(
    "chain",
    {
        ChainArrays: _bobs[1],
        LinkArrays: _plain_links[1],
        MachineArrays: _machines[1],
        SpringArrays: springs_tangent,
    },
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
