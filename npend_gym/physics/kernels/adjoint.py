"""The adjoint of the equations of motion in O(n), by the derivatives of the `virtual_power`."""

# ruff: noqa: ARG001  all kinds of chains share the parameters of a kernel
from __future__ import annotations

from collections.abc import Callable
from typing import Any

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import bare
from npend_gym.compiled.jit import chosen_by_type, inlined_kernel
from npend_gym.physics.kernels.bob_adjoint import BOB_ADJOINT_ROWS, adjoint_of_bobs
from npend_gym.physics.kernels.dynamics import FEATURES
from npend_gym.physics.kernels.laws import (
    Parameter,
    drag_return,
    drag_slopes,
    spring_return,
    spring_tension,
)
from npend_gym.physics.kernels.link_terms import AnyArrays, Base, ChainArrays, Link, Rotor
from npend_gym.physics.kernels.recursion import LENGTHS
from npend_gym.physics.kernels.virtual_power import joint_adjoint_of

# Rows for one pass of the adjoint: e = (SIN, -COS), A and V; the velocity of each tip under drag
_SIN, _COS, _AX, _AY, _VX, _VY, _UX, _UY = range(8)
ADJOINT_ROWS = max(8, BOB_ADJOINT_ROWS)


def _places_of(machine: bool, springs: bool) -> Callable[..., None]:
    """The adjoint's way down the chain, compiled for a kind."""

    @inlined_kernel
    def place(
        u: FloatArray, axial: int, alpha: FloatArray, lam: FloatArray, chain: Any,
        stage: FloatArray, rows: FloatArray,
    ) -> None:  # fmt: skip
        """Write A and V of the centres, and the velocities of the tips where air resists them."""
        s, c, length = stage[0], stage[1], bare(chain.length)
        n, se, ce = chain.length.size, s[0], c[0]
        jx: Any = 0.0 * u[0]
        wx = wy = ux = uy = jx
        jy = jx + chain.gravity[0]
        if axial > n:
            jx, wx, ux = alpha[n], lam[n], u[n]
        if axial > n + 1:
            jy, uy = jy + alpha[n + 1], u[n + 1]
        for i in range(n):
            if i > 0:
                se, ce = se * c[i] + ce * s[i], ce * c[i] - se * s[i]
            rows[_SIN][i], rows[_COS][i] = se, ce
            l, across, along = length[i], alpha[i], u[i] * u[i]
            tx, ty = across * ce - along * se, across * se + along * ce
            vx, vy = lam[i] * ce, lam[i] * se
            centre = chain.terms[Link.CENTRE, i]
            if springs:
                l = stage[LENGTHS][n + i]
                centre = centre + (l - length[i])
                gained, swept = alpha[axial + i], 2.0 * (u[axial + i] * u[i])
                jx, jy = jx + (gained * se + swept * ce), jy + (swept * se - gained * ce)
                wx, wy = wx + lam[axial + i] * se, wy - lam[axial + i] * ce
            rows[_AX][i], rows[_AY][i] = jx + centre * tx, jy + centre * ty
            rows[_VX][i], rows[_VY][i] = wx + centre * vx, wy + centre * vy
            jx, jy, wx, wy = jx + l * tx, jy + l * ty, wx + l * vx, wy + l * vy
            if machine and chain.drag.size > 0:
                ux, uy = ux + l * (u[i] * ce), uy + l * (u[i] * se)
                if springs:
                    ux, uy = ux + u[axial + i] * se, uy - u[axial + i] * ce
                rows[_UX][i], rows[_UY][i] = ux, uy

    return place


@inlined_kernel
def _add_rotors(alpha: FloatArray, lam: FloatArray, chain: Any, chain_bar: FloatArray) -> None:
    """Add the derivatives by the inertia of the rotors and by their gears."""
    rotors, armature, gear = (
        bare(chain.rotors), chain_bar[Parameter.armature], chain_bar[Parameter.gear]
    )  # fmt: skip
    for i in range(chain.length.size):
        al, la = alpha[i], lam[i]
        if i > 0:
            ratio, inverse = rotors[Rotor.RATIO, i], rotors[Rotor.RATIO, i] + 1.0
            al, la = al + ratio * alpha[i - 1], la + ratio * lam[i - 1]
            by_ratio = rotors[Rotor.ARMATURE, i] * (alpha[i - 1] * la + al * lam[i - 1])
            gear[i] = gear[i] + (inverse * inverse) * by_ratio
        armature[i] = armature[i] - al * la


def _adjoint_of(machine: bool, springs: bool) -> Callable[..., None]:
    """Return the adjoint of links with these features."""
    place, add_joint = _places_of(machine, springs), joint_adjoint_of(ideal=False)

    @inlined_kernel
    def adjoint(
        u: FloatArray, alpha: FloatArray, lam: FloatArray, chain: Any, mass: FloatArray,
        stage: FloatArray, answer: FloatArray, rows: FloatArray, theta_bar: FloatArray,
        omega_bar: FloatArray, torque_bar: FloatArray, chain_bar: FloatArray,
    ) -> None:  # fmt: skip
        length, n = bare(chain.length), chain.length.size
        wanted, resisted = chain_bar.size > 0, False
        axial = u.size - n if springs else u.size
        if machine:
            resisted = chain.drag.size > 0
        place(u, axial, alpha, lam, chain, stage, rows)
        fx: Any = 0.0 * u[0]
        fy = gx = gy = kx = ky = fx  # k: derivatives by the velocity of the tip, summed
        below = fx  # derivative by the speed of the joint below
        for i in range(n - 1, -1, -1):
            se, ce, l, m = rows[_SIN][i], rows[_COS][i], length[i], mass[i]
            ax, ay, vx, vy = rows[_AX][i], rows[_AY][i], rows[_VX][i], rows[_VY][i]
            la, al, om, centre = lam[i], alpha[i], u[i], chain.terms[Link.CENTRE, i]
            rest = l - centre
            if springs:
                l = stage[LENGTHS][n + i]
                centre = l - rest
            if resisted:
                wx, wy = vx + (rest * la) * ce, vy + (rest * la) * se
                ux, uy = rows[_UX][i], rows[_UY][i]
                speed, factor, growth = drag_slopes(chain, i, ux, uy)
                power = ux * wx + uy * wy
                fx, fy = fx + factor * ux, fy + factor * uy
                kx = kx + (factor * wx + (growth * power) * ux)
                ky = ky + (factor * wy + (growth * power) * uy)
                if wanted:
                    drag_return(i, speed, power, chain_bar)
            arm = centre * m
            px, py = l * fx + arm * ax, l * fy + arm * ay
            hx, hy = l * gx + arm * vx, l * gy + arm * vy
            pull, along, across = se * px - ce * py, se * hx - ce * hy, ce * hx + se * hy
            square = om * om
            by_theta = la * pull + (al * along + square * across)
            by_omega = 2.0 * (om * along)
            if resisted:
                by_theta = by_theta + (l * om) * (se * kx - ce * ky)
                by_omega = by_omega - l * (ce * kx + se * ky)
            if wanted:
                chain_bar[Parameter.masses, i] -= ax * vx + ay * vy
                by_length = la * (ce * fx + se * fy) + (
                    al * (ce * gx + se * gy) - square * (se * gx - ce * gy)
                )
                if resisted:
                    by_length = by_length + om * (ce * kx + se * ky)
                chain_bar[Parameter.lengths, i] -= by_length
                tx, ty = al * ce - square * se, al * se + square * ce
                by_centre = m * (la * (ce * ax + se * ay) + (tx * vx + ty * vy))
                chain_bar[Parameter.centres, i] -= by_centre
                chain_bar[Parameter.inertias, i] -= al * la
            fx, fy, gx, gy = fx + m * ax, fy + m * ay, gx + m * vx, gy + m * vy
            if springs:
                # Eq. (5), and what theta and omega do to the two terms of the stretch
                k, stretch, rate, virtual = axial + i, l - length[i], u[axial + i], lam[axial + i]
                gained, g_across = alpha[k], ce * gx + se * gy
                g_along, f_across = se * gx - ce * gy, ce * fx + se * fy
                by_theta = by_theta - (virtual * f_across + gained * g_across)
                by_theta = by_theta + (2.0 * (rate * om)) * g_along
                by_omega = by_omega - (2.0 * rate) * g_across
                by_stretch = la * f_across + (al * g_across - square * g_along)
                by_rate = (2.0 * om) * g_across
                if resisted:
                    by_theta = by_theta - rate * (ce * kx + se * ky)
                    by_stretch = by_stretch + om * (ce * kx + se * ky)
                    by_rate = by_rate + (se * kx - ce * ky)
                stiff = spring_tension(chain.springs, i, virtual, 0.0 * virtual)
                damped = spring_tension(chain.springs, i, 0.0 * virtual, virtual)
                theta_bar[k] = -(by_stretch + stiff)
                omega_bar[k] = omega_bar[k] - (by_rate + damped)
                if wanted:
                    spring_return(i, stretch, rate, virtual, chain_bar)
            turn, relative = la, om
            if i > 0:
                turn, relative = la - lam[i - 1], om - u[i - 1]
            slope = add_joint(i, relative, turn, chain, torque_bar, chain_bar)
            theta_bar[i] = by_theta
            omega_bar[i] = omega_bar[i] + ((by_omega - slope) + below)
            below = slope
        if wanted:
            chain_bar[Parameter.gravity, 0] -= gy
        if machine and wanted and chain.rotors.shape[0] > 0:
            _add_rotors(alpha, lam, chain, chain_bar)
        if axial > n:
            theta_bar[n] = 0.0 * fx
            omega_bar[n] = omega_bar[n] - (kx + chain.base[Base.DAMPING, 0] * lam[n])
            torque_bar[n] = torque_bar[n] + lam[n]
        if axial > n + 1:
            theta_bar[n + 1] = 0.0 * fx
            omega_bar[n + 1] = omega_bar[n + 1] - ky

    return adjoint


@chosen_by_type(
    "chain",
    {
        ChainArrays: adjoint_of_bobs(),
        **{kind: _adjoint_of(*flags[:2]) for kind, flags in FEATURES.items()},
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
