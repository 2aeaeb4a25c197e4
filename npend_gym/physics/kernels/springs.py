"""The equations of motion of point masses on massless springs.

A rod that stretches by x_i has the length r_i = l_i + x_i, and its tension is given,

    T_i = k_i x_i + d_i x_i',                                                                   (1)

where a rigid rod's must be solved for. With f_i the torque on rod i by its length, and s and c as
in `tensions`, forces along and across the rods give the accelerations one by one:

    x_i'' = r_i omega_i^2 + v_{i+1} (T_{i+1} c_{i+1} + f_{i+1} s_{i+1} - T_i)                   (2)
            + v_i (T_{i-1} c_i - f_{i-1} s_i - T_i) + [i = 0] g c_0,
    r_i alpha_i = v_{i+1} (T_{i+1} s_{i+1} - f_{i+1} c_{i+1} + f_i)                             (3)
            - v_i (T_{i-1} s_i + f_{i-1} c_i - f_i) - 2 x_i' omega_i - [i = 0] g s_0.

These are Eqs. (1) and (2) of `tensions`, with x_i'' in the first, r_i for l_i, and the
Coriolis term in the second. Drag slows bob i at the rate rho_i = v_{i+1} (drag_i + quadratic_drag_i
|velocity|): it adds rho_{i-1} times the velocity of the bob above less rho_i times that of bob i.

Rod 0 hangs from a base. A moving base accelerates as prescribed. A cart of mass M on a rail
accelerates by its force F, the damping of the rail and rod 0:

    M X'' = F - rail_damping X' + T_0 sin theta_0 - f_0 cos theta_0,                            (4)

and Eqs. (2) and (3) of rod 0 hold in its frame: with g + Y'' for g, with -X'' s_0 and -X'' c_0.

q = (theta_0.., place of the base, x_0..), u = (omega_0.., its velocity, x_0'..): the base has no
number at rest, X on a rail, X and Y where its acceleration is prescribed. The stretch stands there,
not the length. Rounding of the length would be noise in the tension of a stiff rod, and take many
small steps. Nothing has to be solved.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.chain import ChainParameters
from npend_gym.compiled.arrays import innermost
from npend_gym.compiled.jit import inlined_kernel, outlined_kernel
from npend_gym.compiled.packs import where
from npend_gym.compiled.sincos import sincos
from npend_gym.physics.kernels.link_terms import Base, Parameter
from npend_gym.physics.kernels.tensions import COUPLES, TENSIONS, chain_arrays

# Rows of what springs have beside a chain (parameters, n), where their derivatives are asked for
STIFFNESS, AXIAL_DAMPING = len(Parameter), len(Parameter) + 1
LENGTHS, _INVERSE = 4, 5  # rows of the work space in which r and 1/r are left


class SpringArrays(NamedTuple):
    """The parameters of a chain of springs, or of a pack of such chains."""

    inverse_mass: FloatArray  # v at joints 0..n, (n + 1,); zero at the pivot
    length: FloatArray  # l, (n,); of the springs without load
    stiffness: FloatArray  # k, (n,)
    axial_damping: FloatArray  # d, (n,)
    damping: FloatArray  # joints 0..n-1, (n,)
    gravity: FloatArray  # g, (1,)
    drag: FloatArray  # (n,); empty where the air resists no bob
    quadratic_drag: FloatArray  # (n,) or empty, as drag
    base: FloatArray  # (len(Base), 1); (0, 1) where the base rests


def spring_arrays(
    chains: ChainParameters,
    stiffness: FloatArray,
    axial_damping: FloatArray,
    base: FloatArray | None = None,
) -> SpringArrays:
    """Return the parameters of B chains in the form that the kernels take, the lane innermost.

    `stiffness` and `axial_damping` are those of all chains, (n,), or of each, (B, n). `base` holds
    the entries of `Base` where the base moves, (len(Base),) of all or (len(Base), B) of each.
    """
    rigid, shape = chain_arrays(chains), chains.lengths.shape
    stiff, damped = (innermost(np.broadcast_to(x, shape)) for x in (stiffness, axial_damping))
    entries = np.zeros((0, 1)) if base is None else np.reshape(base, (len(base), -1))
    moving = np.broadcast_to(entries, (len(entries), len(chains.masses)))[..., None]
    return SpringArrays(
        rigid.inverse_mass, rigid.length, stiff, damped, rigid.damping, rigid.gravity,
        rigid.drag, rigid.quadratic_drag, innermost(moving),
    )  # fmt: skip


@inlined_kernel
def _add_drag(
    r: FloatArray, omega: FloatArray, velocity: FloatArray, rate: FloatArray, chain: SpringArrays,
    s: FloatArray, c: FloatArray, along: FloatArray, across: FloatArray,
) -> float:  # fmt: skip
    """Add the accelerations by drag to `along` and `across`; return the power that it takes [W].

    `velocity` is that of the base, empty where it rests.
    """
    v, linear, quadratic = chain.inverse_mass[1:], chain.drag, chain.quadratic_drag
    a = b = slowing_above = power = 0.0
    if velocity.size > 0:
        b = velocity[0]
    if velocity.size > 1:
        a = -velocity[1]  # the axes of the base have e downwards
    for i in range(linear.size):
        a, b = c[i] * a + s[i] * b, c[i] * b - s[i] * a  # of the bob above, in this rod's axes
        along[i] = along[i] + slowing_above * a
        across[i] = across[i] + slowing_above * b
        a = a + rate[i]
        b = b + r[i] * omega[i]
        square = a * a + b * b
        drag = linear[i] + quadratic[i] * math.sqrt(square)
        slowing_above = v[i] * drag
        along[i] = along[i] - slowing_above * a
        across[i] = across[i] - slowing_above * b
        power = power + drag * square
    return power


@inlined_kernel
def _accelerate_base(
    velocity: FloatArray, force: FloatArray, chain: SpringArrays, pull: Any, out: FloatArray
) -> None:
    """Write the acceleration of a base that moves, Eq. (4); `force` begins with the force on it."""
    base = chain.base
    held = (force[0] - base[Base.DAMPING, 0] * velocity[0]) + pull
    out[0] = base[Base.ACROSS, 0] + base[Base.INVERSE_MASS, 0] * held
    if out.size > 1:
        out[1] = base[Base.UP, 0] + 0.0 * held


@inlined_kernel
def _pull_bobs(
    couples: FloatArray, tensions: FloatArray, chain: SpringArrays, work: FloatArray,
    along: FloatArray, across: FloatArray,
) -> None:  # fmt: skip
    """Add what force couples and tensions, rows after a zero, do in Eqs. (2) and (3).

    It is added to `along` and written into `across`.
    """
    v, v_below = chain.inverse_mass, chain.inverse_mass[1:]
    s, s_below, c, c_below = work[0], work[0][1:], work[1], work[1][1:]
    f, f_below, t, t_below = couples[1:], couples[2:], tensions[1:], tensions[2:]
    for i in range(chain.length.size):
        pull_below = (t_below[i] * c_below[i] + f_below[i] * s_below[i]) - t[i]
        pull_above = (tensions[i] * c[i] - couples[i] * s[i]) - t[i]
        along[i] = (along[i] + v_below[i] * pull_below) + v[i] * pull_above
        push_below = (t_below[i] * s_below[i] - f_below[i] * c_below[i]) + f[i]
        push_above = (tensions[i] * s[i] + couples[i] * c[i]) - f[i]
        across[i] = v_below[i] * push_below - v[i] * push_above


@outlined_kernel
def solve_springs(
    q: FloatArray, u: FloatArray, torque: FloatArray, chain: SpringArrays, work: FloatArray,
    alpha: FloatArray,
) -> float:  # fmt: skip
    """Write the accelerations of all coordinates [rad/s^2, m/s^2] into `alpha`.

    They are NaN where a rod has no length: no step of an integrator leads beyond. Return the power
    that drag takes [W]. Left in `work` are rows of s, c, f, T, both after a zero, r and 1/r.
    """
    l, damping, g = chain.length, chain.damping, chain.gravity
    n, axial = l.size, q.size - l.size  # where the stretch begins
    theta, stretch, omega, rate = q[:n], q[axial:], u[:n], u[axial:]
    across, along = alpha[:n], alpha[axial:]
    s, c, f, t = work[0], work[1], work[COUPLES][1:], work[TENSIONS][1:]
    r, inverse_r = work[LENGTHS], work[_INVERSE]

    s[0], c[0] = sincos(theta[0])
    for i in range(1, n):
        s[i], c[i] = sincos(theta[i] - theta[i - 1])
    tau = torque[0] - damping[0] * omega[0]
    for i in range(n):
        r[i] = l[i] + stretch[i]
        inverse_r[i] = where(r[i] > 0.0, 1.0 / r[i], np.nan)
        t[i] = chain.stiffness[i] * stretch[i] + chain.axial_damping[i] * rate[i]
        f[i] = tau
        if i < n - 1:
            tau = torque[i + 1] - damping[i + 1] * (omega[i + 1] - omega[i])
            f[i] = f[i] - tau
        f[i] = f[i] * inverse_r[i]
        along[i] = r[i] * (omega[i] * omega[i])
    _pull_bobs(work[COUPLES], work[TENSIONS], chain, work, along, across)
    for i in range(n):
        across[i] = across[i] - 2.0 * (rate[i] * omega[i])
    if axial > n:
        pull = t[0] * s[0] - f[0] * c[0]
        _accelerate_base(u[n:axial], torque[n:], chain, pull, alpha[n:axial])
        x, weight = alpha[n], g[0] + chain.base[Base.UP, 0]
        along[0] = along[0] + (weight * c[0] - x * s[0])
        across[0] = across[0] - (weight * s[0] + x * c[0])
    else:
        along[0] = along[0] + g[0] * c[0]
        across[0] = across[0] - g[0] * s[0]
    power = _add_drag(r, omega, u[n:axial], rate, chain, s, c, along, across)
    for i in range(n):
        across[i] = across[i] * inverse_r[i]
    return power


@inlined_kernel
def springs_respond(
    force: FloatArray, chain: SpringArrays, work: FloatArray, answer: FloatArray, alpha: FloatArray
) -> None:
    """Write how springs at rest answer the moments and forces `force`; see `dynamics.respond`.

    `work` is as `solve_springs` left it. A force along a rod that stretches is a tension less.
    """
    n, inverse_r = chain.length.size, work[_INVERSE]
    axial = force.size - n
    f, t, across, along = answer[0][1:], answer[1][1:], alpha[:n], alpha[axial:]
    for i in range(n):
        f[i], t[i], along[i] = force[i] * inverse_r[i], -force[axial + i], 0.0 * force[i]
    _pull_bobs(answer[0], answer[1], chain, work, along, across)
    if axial > n:
        s, c = work[0][0], work[1][0]
        x = chain.base[Base.INVERSE_MASS, 0] * (force[n] + (t[0] * s - f[0] * c))
        alpha[n] = x
        along[0], across[0] = along[0] - x * s, across[0] - x * c
    if axial > n + 1:
        alpha[n + 1] = 0.0 * f[0]  # a prescribed motion answers nothing
    for i in range(n):
        across[i] = across[i] * inverse_r[i]
