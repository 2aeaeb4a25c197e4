"""The canonical momenta of a chain without friction, and the forces that change them, in O(n).

With the Lagrangian L(q, u), in the coordinates of `recursion`,

    p = dL/du = N(q) u,        p' = F = dL/dq + loads,                                      (1)

N being the mass matrix. Centre i moves at the velocity V_i, and G_i is the sum of m V below it:

    p_i = n_i . (l_i G_i + c_i m_i V_i) + I_i omega_i + rotors,
    F_i = -omega_i e_i . (l_i G_i + c_i m_i V_i) - g (l_i M_i + c_i m_i) sin theta_i
          + tau_i - tau_{i+1},

with the mass M_i below. A spring x has l + x and c + x for l and c, and the rates x' e_i in V; then
F_i has x' n_i . (G_i + m_i V_i) more, and

    p_x = e_i . (G_i + m_i V_i),
    F_x = omega_i n_i . (G_i + m_i V_i) + g cos theta_i (M_i + m_i) - T_i.

The same text has the change of p and F with the state, the loads and the parameters. Numbers are
complex then: a change is so small an imaginary part that its square vanishes beside the number.
"""

# numbers are floats, packs or complex, which pyright does not follow
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from npend_gym._checks import FloatArray
from npend_gym.compiled.jit import chosen_by_type, inlined_kernel, outlined_kernel
from npend_gym.compiled.sincos import sincos
from npend_gym.physics.kernels.laws import STIFFNESS, Parameter
from npend_gym.physics.kernels.link_terms import AnyArrays, Base, Link, Rotor
from npend_gym.physics.kernels.virtual_power import KINDS

_SMALL = 2.0**-400  # the part of a change that is added to a number
SWEEP_ROWS = 4  # of the work space: momenta of each link, each as two parts


class Change(NamedTuple):
    """A change of what p and F depend on."""

    q: FloatArray
    u: FloatArray
    loads: FloatArray  # n or more
    parameters: FloatArray  # rows of `Parameter`, or none


_Q, _U, _LOAD, _PARAMETER = range(4)


def _numbers_of(changed: bool) -> tuple[Any, Any, Any, Any]:
    """Return how numbers are read, kept for a while, taken again and written: they or changes."""

    @inlined_kernel
    def number(x: Any, change: Any, which: int, row: int, i: int, scale: Any) -> Any:
        """Return a number that may change: an entry of q, u or the loads, or of parameters."""
        value = x
        if changed:
            grown = 0.0
            if which == _Q:
                grown = change.q[i]
            elif which == _U:
                grown = change.u[i]
            elif which == _LOAD:
                grown = change.loads[i]
            elif change.parameters.shape[0] > row:
                grown = change.parameters[row, i]
            value = complex(x, _SMALL * (scale * grown))
        return value

    @inlined_kernel
    def keep(x: Any, row: FloatArray, more: FloatArray, i: int) -> None:
        if changed:
            row[i], more[i] = x.real, x.imag
        else:
            row[i] = x

    @inlined_kernel
    def kept(row: FloatArray, more: FloatArray, i: int) -> Any:
        value = row[i]
        if changed:
            value = complex(row[i], more[i])
        return value

    @inlined_kernel
    def write(x: Any, out: FloatArray, i: int) -> None:
        if changed:
            out[i] = x.imag / _SMALL
        else:
            out[i] = x

    return number, keep, kept, write


def _rod_of(ideal: bool, number: Any) -> Callable[..., Any]:
    """Return `rod` for one kind of chains."""

    @inlined_kernel
    def rod(chain: Any, change: Any, i: int) -> Any:
        """Return mass, length, place of the centre, and inertia of link `i`."""
        length = number(chain.length[i], change, _PARAMETER, Parameter.lengths, i, 1.0)
        if ideal:
            mass = 1.0 / chain.inverse_mass[i + 1]
            mass = number(mass, change, _PARAMETER, Parameter.masses, i, 1.0)
            return mass, length, length, 0.0 * mass
        terms = chain.terms
        mass = number(terms[Link.MASS, i], change, _PARAMETER, Parameter.masses, i, 1.0)
        centre = number(terms[Link.CENTRE, i], change, _PARAMETER, Parameter.centres, i, 1.0)
        inertia = number(terms[Link.INERTIA, i], change, _PARAMETER, Parameter.inertias, i, 1.0)
        return mass, length, centre, inertia

    return rod


def _canonical_of(
    ideal: bool, machine: bool, springs: bool, *, changed: bool
) -> Callable[..., None]:
    """Return `canonical` for one kind of chains, or how it changes."""
    number, keep, kept, write = _numbers_of(changed)
    rod = _rod_of(ideal, number)

    @outlined_kernel
    def canonical(
        q: FloatArray, u: FloatArray, loads: FloatArray, chain: Any, change: Any,
        rows: FloatArray, p: FloatArray, force: FloatArray,
    ) -> None:  # fmt: skip
        n, geared, axial = chain.length.size, False, u.size
        if machine:
            geared = chain.rotors.shape[0] > 0
        if springs:
            axial = u.size - n
        vx = 0.0 * number(u[0], change, _U, 0, 0, 1.0)
        vy = gx = gy = below = push = pull = spin = rotor = stretch = rate = vx
        if axial > n:
            vx = vx + number(u[n], change, _U, 0, n, 1.0)
        for i in range(n):
            sine, cosine = sincos(q[i])
            s = number(sine, change, _Q, 0, i, cosine)
            c = number(cosine, change, _Q, 0, i, -sine)
            w = number(u[i], change, _U, 0, i, 1.0)
            m, l, centre, _ = rod(chain, change, i)
            if springs:
                stretch = number(q[axial + i], change, _Q, 0, axial + i, 1.0)
                rate = number(u[axial + i], change, _U, 0, axial + i, 1.0)
                l, centre = l + stretch, centre + stretch
                vx, vy = vx + rate * s, vy - rate * c
            keep(m * (vx + centre * (w * c)), rows[0], rows[1], i)
            keep(m * (vy + centre * (w * s)), rows[2], rows[3], i)
            vx, vy = vx + l * (w * c), vy + l * (w * s)
        gravity = number(chain.gravity[0], change, _PARAMETER, Parameter.gravity, 0, 1.0)
        for i in range(n - 1, -1, -1):
            sine, cosine = sincos(q[i])
            s = number(sine, change, _Q, 0, i, cosine)
            c = number(cosine, change, _Q, 0, i, -sine)
            w = number(u[i], change, _U, 0, i, 1.0)
            m, l, centre, inertia = rod(chain, change, i)
            mx, my = kept(rows[0], rows[1], i), kept(rows[2], rows[3], i)
            if springs:
                stretch = number(q[axial + i], change, _Q, 0, axial + i, 1.0)
                rate = number(u[axial + i], change, _U, 0, axial + i, 1.0)
                l, centre = l + stretch, centre + stretch
            across = l * (c * gx + s * gy) + centre * (c * mx + s * my)
            along = l * (s * gx - c * gy) + centre * (s * mx - c * my)
            turning = across + inertia * w
            torque = number(loads[i], change, _LOAD, 0, i, 1.0)
            # dampers have no torque, but its derivative by them
            relative = u[i] - u[i - 1] if i > 0 else u[i]
            damping = number(0.0 * u[i], change, _PARAMETER, Parameter.damping, i, relative)
            torque = torque - damping
            moving = -(w * along) - gravity * ((l * below + centre * m) * s) + (torque - push)
            push = torque
            gx, gy, below = gx + mx, gy + my, below + m
            if springs:
                swept = c * gx + s * gy
                moving = moving + rate * swept
                stiffness = number(chain.springs[0, i], change, _PARAMETER, STIFFNESS, i, 1.0)
                write(s * gx - c * gy, p, axial + i)
                pull = gravity * (c * below) - stiffness * stretch
                damping = number(0.0 * u[i], change, _PARAMETER, STIFFNESS + 1, i, u[axial + i])
                write((w * swept + pull) - damping, force, axial + i)
            if machine and geared:
                turning = turning + rotor
                own = number(
                    chain.rotors[Rotor.ARMATURE, i], change, _PARAMETER, Parameter.armature, i, 1.0
                )
                ratio = chain.rotors[Rotor.RATIO, i]
                grown = -(1.0 + ratio) * (1.0 + ratio)
                k = number(ratio, change, _PARAMETER, Parameter.gear, i, grown)
                spin = own * w
                if i > 0:
                    spin = own * (w + k * number(u[i - 1], change, _U, 0, i - 1, 1.0))
                turning, rotor = turning + spin, k * spin
            write(turning, p, i)
            write(moving, force, i)
        if not ideal and axial > n:
            cart = 1.0 / chain.base[Base.INVERSE_MASS, 0]
            write(gx + cart * number(u[n], change, _U, 0, n, 1.0), p, n)
            write(number(loads[n], change, _LOAD, 0, n, 1.0) + 0.0 * gx, force, n)

    return canonical


def _of_each_kind(*, changed: bool) -> dict[Any, Callable[..., None]]:
    return {kind: _canonical_of(*flags, changed=changed) for kind, flags in KINDS.items()}


@chosen_by_type("chain", _of_each_kind(changed=False))
def canonical(
    q: FloatArray, u: FloatArray, loads: FloatArray, chain: AnyArrays, change: None,
    rows: FloatArray, p: FloatArray, force: FloatArray,
) -> None:  # fmt: skip
    """Write the momenta `p` and the forces F of Eq. (1); `rows` are SWEEP_ROWS for work."""
    raise NotImplementedError


@chosen_by_type("chain", _of_each_kind(changed=True))
def change_canonical(
    q: FloatArray, u: FloatArray, loads: FloatArray, chain: AnyArrays, change: Change,
    rows: FloatArray, p: FloatArray, force: FloatArray,
) -> None:  # fmt: skip
    """Write how the momenta and the forces change."""
    raise NotImplementedError
