"""The adjoint of the equations of motion in O(n), by the derivatives of the `virtual_power`."""

# ruff: noqa: ARG001  all kinds of chains share the parameters of a kernel
from __future__ import annotations

from collections.abc import Callable
from typing import Any

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import bare
from npend_gym.compiled.jit import chosen_by_type, inlined_kernel
from npend_gym.physics.kernels.bob_adjoint import BOB_ADJOINT_ROWS, adjoint_of_bobs
from npend_gym.physics.kernels.dynamics import AnyArrays
from npend_gym.physics.kernels.link_terms import (
    Base,
    Joint,
    Link,
    LinkArrays,
    MachineArrays,
    Parameter,
)
from npend_gym.physics.kernels.springs import SpringArrays
from npend_gym.physics.kernels.tensions import ChainArrays
from npend_gym.physics.kernels.virtual_power import joint_adjoint_of, slopes_of_drag

# Rows for one pass of the adjoint: e = (SIN, -COS), A and V; the velocity of each tip under drag
_SIN, _COS, _AX, _AY, _VX, _VY, _UX, _UY = range(8)
ADJOINT_ROWS = max(8, BOB_ADJOINT_ROWS)


def _places_of_links(machine: bool) -> Callable[..., None]:
    """Return what the adjoint of links does on its way down the chain."""

    @inlined_kernel
    def place(
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

    return place


@inlined_kernel
def _add_rotors(
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


def _adjoint_of_links(machine: bool) -> Callable[..., None]:
    """Return the adjoint of links or of machines: one text, two compiled versions."""
    drag_slopes = slopes_of_drag(links=True, machine=machine)
    place, add_joint = _places_of_links(machine), joint_adjoint_of(machine)

    @inlined_kernel
    def adjoint(
        u: FloatArray, alpha: FloatArray, lam: FloatArray, chain: Any, mass: FloatArray,
        stage: FloatArray, answer: FloatArray, rows: FloatArray, theta_bar: FloatArray,
        omega_bar: FloatArray, torque_bar: FloatArray, chain_bar: FloatArray,
    ) -> None:  # fmt: skip
        length, n = bare(chain.length), chain.length.size
        wanted = chain_bar.size > 0
        place(u, alpha, lam, chain, stage, rows)
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
                    chain_bar[Parameter.drag, i] -= power
                    chain_bar[Parameter.quadratic_drag, i] -= speed * power
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
                chain_bar[Parameter.masses, i] -= ax * vx + ay * vy
                by_length = la * (ce * fx + se * fy) + (
                    al * (ce * gx + se * gy) - square * (se * gx - ce * gy)
                )
                if machine:
                    by_length = by_length + om * (ce * kx + se * ky)
                chain_bar[Parameter.lengths, i] -= by_length
                tx, ty = al * ce - square * se, al * se + square * ce
                by_centre = m * (la * (ce * ax + se * ay) + (tx * vx + ty * vy))
                chain_bar[Parameter.centres, i] -= by_centre
                chain_bar[Parameter.inertias, i] -= al * la
            fx, fy, gx, gy = fx + m * ax, fy + m * ay, gx + m * vx, gy + m * vy
        if wanted:
            chain_bar[Parameter.gravity, 0] -= gy
        if machine:
            if wanted:
                _add_rotors(alpha, lam, chain, chain_bar)
            if u.size > n:
                theta_bar[n] = 0.0 * fx
                omega_bar[n] = omega_bar[n] - (kx + chain.base[Base.DAMPING, 0] * lam[n])
                torque_bar[n] = torque_bar[n] + lam[n]
            if u.size > n + 1:
                theta_bar[n + 1] = 0.0 * fx
                omega_bar[n + 1] = omega_bar[n + 1] - ky

    return adjoint


@chosen_by_type(
    "chain",
    {
        ChainArrays: adjoint_of_bobs(springs=False),
        LinkArrays: _adjoint_of_links(machine=False),
        MachineArrays: _adjoint_of_links(machine=True),
        SpringArrays: adjoint_of_bobs(springs=True),
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
