"""The equations of motion in O(n), through the tensions of the rods.

The paper's system A(theta) theta'' = b (its section 2; Eq. (eom)) couples every angle with every
other. The tensions couple only neighbours. With e_i the unit vector along rod i and n_i across it,
mass i obeys

    m_i a_i = -m_i g y - T_i e_i + f_i n_i + T_{i+1} e_{i+1} - f_{i+1} n_{i+1},

and rod i stays as long as it is: (a_i - a_{i-1}) . e_i = -l_i omega_i^2. Put together:

    (v_i + v_{i+1}) T_i - c_{i+1} v_{i+1} T_{i+1} - c_i v_i T_{i-1}                         (1)
        = l_i omega_i^2 + v_{i+1} f_{i+1} s_{i+1} - v_i f_{i-1} s_i + [i = 0] g c_0

a symmetric tridiagonal system, positive definite. The component across the rod then gives

    l_i alpha_i = v_{i+1} (T_{i+1} s_{i+1} - f_{i+1} c_{i+1} + f_i)                         (2)
                  - v_i (T_{i-1} s_i + f_{i-1} c_i - f_i) - [i = 0] g s_0.

The paper prints pi_ij = min(i, j) in A and b and max(i, j) in its appendix A; these equations
equal the system with max, and with the masses that its kinetic energy leaves out.

Drag and a pivot that moves add terms to the right sides (docs/extensions.md has their derivation).
Drag slows bob i at the rate r_i = v_{i+1} (drag_i + quadratic_drag_i |velocity|); with a_i and b_i
the bob's velocity along e_i and n_i, it adds

    to (1) (r_{i-1} - r_i) a_i,        to (2) (r_{i-1} - r_i) b_i - r_{i-1} l_i omega_i.        (3)

A pivot that accelerates by x'' sideways adds -x'' s_0 to (1) and -x'' c_0 to (2) where i = 0. If
the pivot is a cart of mass M pushed by the force F, then x'' = (F + T_0 s_0 - f_0 c_0) / M; moving
the T_0 term to the left side adds s_0^2 / M to the first diagonal entry of (1).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.compiled.aligned import aligned_zeros, innermost
from npend_gym.compiled.jit import inlined_kernel, inner_kernel, kernel
from npend_gym.compiled.sincos import sincos

WORK_ROWS = 7


class ChainArrays(NamedTuple):
    """The parameters of a chain, or of a pack of chains, as the kernels take them."""

    inverse_mass: FloatArray  # v at joints 0..n, (n + 1,); zero at the pivot
    length: FloatArray  # l, (n,)
    inverse_length: FloatArray  # 1/l, (n,)
    damping: FloatArray  # joints 0..n-1, (n,)
    gravity: FloatArray  # g, (1,)
    drag: FloatArray  # (n,); empty where the air resists no bob
    quadratic_drag: FloatArray  # (n,) or empty, as drag
    pivot: FloatArray  # x'' without the terms of T_0 and f_0, and 1/M, (2,); empty: fixed pivot


def chain_arrays(*chains: Chain) -> ChainArrays:
    """Return the parameters of chains in the form that the kernels take, the lane innermost."""
    resisted = chains if any(chain.has_drag for chain in chains) else ()
    return ChainArrays(
        innermost([np.concatenate([[0.0], 1.0 / chain.masses]) for chain in chains]),
        innermost([chain.lengths for chain in chains]),
        innermost([1.0 / chain.lengths for chain in chains]),
        innermost([chain.damping for chain in chains]),
        innermost([np.array([chain.gravity]) for chain in chains]),
        innermost([chain.drag for chain in resisted]),
        innermost([chain.quadratic_drag for chain in resisted]),
        np.zeros(0),
    )


def new_work(n: int, width: int = 1) -> FloatArray:
    """Return scratch rows for `accelerations`; the guard entries at their ends stay zero."""
    return aligned_zeros(WORK_ROWS, (n + 2) * width)


@inner_kernel
def copy(source: FloatArray, target: FloatArray) -> None:
    """Copy a row; a slice assignment would cost a second of compile time in each kernel."""
    for i in range(source.size):
        target[i] = source[i]


@inlined_kernel
def _tensions(
    v: FloatArray, c: FloatArray, v_0: float, rhs: FloatArray, tension: FloatArray,
    link: FloatArray,
) -> None:  # fmt: skip
    """Solve Eq. (1), from both ends to the middle rod and back.

    Row i is brought to T_i = tension_i + link_i T_next, `next` being its neighbour on the way to
    the middle. Two independent sweeps take half the time of one, as each waits for its divisions.
    Zeros end the chain, q_top and z_top before rod 0 and c_n, so that no row needs a case of its
    own.
    """
    n = rhs.size
    middle = n // 2
    q_top = z_top = q_tip = z_tip = 0.0  # inverse pivot and reduced right side of the last row
    v_here = v_0
    for i in range(middle):
        o = c[i] * v_here
        q_top = 1.0 / ((v_here + v[i + 1]) - (o * o) * q_top)
        z_top = (rhs[i] + o * z_top) * q_top
        tension[i] = z_top
        v_here = v[i + 1]
        link[i] = (c[i + 1] * v_here) * q_top
        j = n - 1 - i
        if j > middle:
            o = c[j + 1] * v[j + 1]
            q_tip = 1.0 / ((v[j] + v[j + 1]) - (o * o) * q_tip)
            z_tip = (rhs[j] + o * z_tip) * q_tip
            tension[j] = z_tip
            link[j] = (c[j] * v[j]) * q_tip
    o = c[middle] * v_here
    o_below = c[middle + 1] * v[middle + 1]
    pivot = ((v_here + v[middle + 1]) - (o * o) * q_top) - (o_below * o_below) * q_tip
    up = down = ((rhs[middle] + o * z_top) + o_below * z_tip) / pivot
    tension[middle] = up
    for i in range(1, middle + 1):
        up = tension[middle - i] + link[middle - i] * up
        tension[middle - i] = up
        if middle + i < n:
            down = tension[middle + i] + link[middle + i] * down
            tension[middle + i] = down


@inlined_kernel
def _add_drag(
    omega: FloatArray, chain: ChainArrays, s: FloatArray, c: FloatArray, along: FloatArray,
    across: FloatArray,
) -> float:  # fmt: skip
    """Add Eq. (3) to `along`, write its other part into `across`; return the power taken [W].

    The velocity of a bob is that of the bob above, turned into the frame of its own rod, and that
    about it: no further sines are needed.
    """
    v, linear, quadratic = chain.inverse_mass[1:], chain.drag, chain.quadratic_drag
    a = b = rate_above = power = 0.0
    for i in range(linear.size):
        about = chain.length[i] * omega[i]
        a, b = c[i] * a + s[i] * b, (c[i] * b - s[i] * a) + about
        square = a * a + b * b
        drag = linear[i] + quadratic[i] * math.sqrt(square)
        rate = v[i] * drag
        along[i] = along[i] + (rate_above - rate) * a
        across[i] = (rate_above - rate) * b - rate_above * about
        rate_above = rate
        power = power + drag * square
    return power


@inlined_kernel
def _free_pivot(
    pivot: FloatArray, f: FloatArray, s: FloatArray, c: FloatArray, rhs: FloatArray
) -> float:
    """Take the motion of the pivot into the first row of Eq. (1); return v_0."""
    if pivot.size == 0:
        return 0.0
    rhs[0] = rhs[0] - (pivot[0] - pivot[1] * (f[0] * c[0])) * s[0]
    return pivot[1] * (s[0] * s[0])


@inlined_kernel
def _move_pivot(
    pivot: FloatArray, t: FloatArray, f: FloatArray, s: FloatArray, c: FloatArray,
    inverse_l: FloatArray, alpha: FloatArray,
) -> None:  # fmt: skip
    """Take the motion of the pivot into Eq. (2) of the first rod."""
    if pivot.size > 0:
        sideways = pivot[0] + pivot[1] * (t[0] * s[0] - f[0] * c[0])
        alpha[0] = alpha[0] - (sideways * c[0]) * inverse_l[0]


@inlined_kernel
def accelerations(
    theta: FloatArray, omega: FloatArray, torque: FloatArray, chain: ChainArrays, work: FloatArray,
    alpha: FloatArray,
) -> float:  # fmt: skip
    """Write the angular accelerations [rad/s^2] of a chain, or of a pack of them, into `alpha`.

    Arrays have shape (n,); `torque` [N m] acts at joints 0..n-1. Return the power that drag takes
    [W]. The long loops are over independent entries, for LLVM to vectorise where there is one
    chain.
    """
    l, inverse_l, damping, g = chain.length, chain.inverse_length, chain.damping, chain.gravity
    n = theta.size
    # Views of one row, so that one index serves for the joint or rod above, here and below
    v, v_below = chain.inverse_mass, chain.inverse_mass[1:]
    s, s_below = work[0], work[0][1:]
    c, c_below = work[1], work[1][1:]
    f_above, f, f_below = work[2], work[2][1:], work[2][2:]
    t_above, t, t_below = work[3], work[3][1:], work[3][2:]
    rhs, link, across = work[4][:n], work[5], work[6]
    theta_below, omega_below = theta[1:], omega[1:]
    torque_below, damping_below = torque[1:], damping[1:]

    s[0], c[0] = sincos(theta[0])
    for i in range(n - 1):
        s_below[i], c_below[i] = sincos(theta_below[i] - theta[i])
    tau = torque[0] - damping[0] * omega[0]
    for i in range(n - 1):
        tau_below = torque_below[i] - damping_below[i] * (omega_below[i] - omega[i])
        f[i] = (tau - tau_below) * inverse_l[i]
        tau = tau_below
    f[n - 1] = tau * inverse_l[n - 1]
    for i in range(n):
        from_below = v_below[i] * (f_below[i] * s_below[i])
        rhs[i] = (l[i] * (omega[i] * omega[i]) + from_below) - v[i] * (f_above[i] * s[i])
    rhs[0] = rhs[0] + g[0] * c[0]
    # _add_drag itself tests for an empty array; a test here would make Numba count references to
    # the views, some ns a call
    power = _add_drag(omega, chain, s, c, rhs, across)
    v_0 = _free_pivot(chain.pivot, f, s, c, rhs)
    _tensions(v, c, v_0, rhs, t, link)
    for i in range(n):
        from_below = (t_below[i] * s_below[i] - f_below[i] * c_below[i]) + f[i]
        from_above = (t_above[i] * s[i] + f_above[i] * c[i]) - f[i]
        alpha[i] = (v_below[i] * from_below - v[i] * from_above) * inverse_l[i]
    alpha[0] = alpha[0] - (g[0] * s[0]) * inverse_l[0]
    for i in range(chain.drag.size):
        alpha[i] = alpha[i] + across[i] * inverse_l[i]
    _move_pivot(chain.pivot, t, f, s, c, inverse_l, alpha)
    return power


@kernel
def derivative(
    y: FloatArray, torque: FloatArray, chain: ChainArrays, work: FloatArray, dydt: FloatArray
) -> None:
    """Write the time derivative of one chain's state y = (theta, omega) into `dydt`."""
    n = y.size // 2
    for i in range(n):
        dydt[i] = y[n + i]
    accelerations(y[:n], y[n:], torque, chain, work, dydt[n:])
