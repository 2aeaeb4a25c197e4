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
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.physics.kernels.jit import inlined_kernel, kernel
from npend_gym.physics.kernels.sincos import sincos

WORK_ROWS = 8


class Rods(NamedTuple):
    """The parameters of some chains as the kernels take them, flat with the lane innermost."""

    inverse_mass: FloatArray  # v at joints 0..n, ((n + 1) lanes,); zero at the pivot
    length: FloatArray  # l, (n lanes,)
    inverse_length: FloatArray  # 1/l, (n lanes,)
    damping: FloatArray  # joints 0..n-1, (n lanes,)
    gravity: FloatArray  # g, (lanes,)


def pack_rods(chain: Chain) -> Rods:
    """Return the parameters of `chain` in the form the kernels take."""
    return Rods(
        np.concatenate([[0.0], 1.0 / chain.masses]),
        chain.lengths.copy(),
        1.0 / chain.lengths,
        chain.damping.copy(),
        np.array([chain.gravity]),
    )


def new_work(n: int, lanes: int = 1) -> FloatArray:
    """Return scratch rows for `accelerations`; the guard entries at their ends stay zero."""
    return np.zeros((WORK_ROWS, (n + 2) * lanes))


@kernel
def copy(source: FloatArray, target: FloatArray) -> None:
    """Copy a row; slice assignment would do, at a second of compile time a kernel."""
    for i in range(source.size):
        target[i] = source[i]


@inlined_kernel
def _tensions(
    v: FloatArray, c: FloatArray, rhs: FloatArray, tension: FloatArray, link: FloatArray
) -> None:
    """Solve Eq. (1) for one chain, from both ends to the middle rod and back.

    Row i is brought to T_i = tension_i + link_i T_next, `next` being its neighbour on the way to
    the middle. Two independent sweeps take half the time of one, as each waits for its divisions.
    The guards v_0 = 0 and c_n = 0 end the chain, so that no row needs a case of its own.
    """
    n = rhs.size
    middle = n // 2
    q_top = z_top = q_tip = z_tip = 0.0  # inverse pivot and reduced right side of the last row
    for i in range(middle):
        o = c[i] * v[i]
        q_top = 1.0 / ((v[i] + v[i + 1]) - (o * o) * q_top)
        z_top = (rhs[i] + o * z_top) * q_top
        tension[i] = z_top
        link[i] = (c[i + 1] * v[i + 1]) * q_top
        j = n - 1 - i
        if j > middle:
            o = c[j + 1] * v[j + 1]
            q_tip = 1.0 / ((v[j] + v[j + 1]) - (o * o) * q_tip)
            z_tip = (rhs[j] + o * z_tip) * q_tip
            tension[j] = z_tip
            link[j] = (c[j] * v[j]) * q_tip
    o = c[middle] * v[middle]
    o_below = c[middle + 1] * v[middle + 1]
    pivot = ((v[middle] + v[middle + 1]) - (o * o) * q_top) - (o_below * o_below) * q_tip
    up = down = ((rhs[middle] + o * z_top) + o_below * z_tip) / pivot
    tension[middle] = up
    for i in range(1, middle + 1):
        up = tension[middle - i] + link[middle - i] * up
        tension[middle - i] = up
        if middle + i < n:
            down = tension[middle + i] + link[middle + i] * down
            tension[middle + i] = down


@kernel
def _eliminate(
    v: FloatArray, c: FloatArray, rhs: FloatArray, tension: FloatArray, link: FloatArray,
    pivot: FloatArray, i: int, lanes: int, downward: bool,
) -> None:  # fmt: skip
    """Bring row `i` of Eq. (1) to T_i = tension_i + link_i T_next in every lane."""
    from_joint, to_joint = (i, i + 1) if downward else (i + 1, i)
    before = i if downward else i + 2  # row done before this one, counted with its guard
    d, d_below = v[i * lanes :], v[(i + 1) * lanes :]
    c_from, v_from = c[from_joint * lanes :], v[from_joint * lanes :]
    c_to, v_to = c[to_joint * lanes :], v[to_joint * lanes :]
    q_before, q = pivot[before * lanes :], pivot[(i + 1) * lanes :]
    t_before, t = tension[before * lanes :], tension[(i + 1) * lanes :]
    b, e = rhs[i * lanes :], link[i * lanes :]
    for k in range(lanes):
        o = c_from[k] * v_from[k]
        q[k] = 1.0 / ((d[k] + d_below[k]) - (o * o) * q_before[k])
    for k in range(lanes):
        t[k] = (b[k] + (c_from[k] * v_from[k]) * t_before[k]) * q[k]
    for k in range(lanes):
        e[k] = (c_to[k] * v_to[k]) * q[k]


@kernel
def _substitute(tension: FloatArray, link: FloatArray, i: int, known: int, lanes: int) -> None:
    """Put the tensions of row `known` (counted with its guard) into row `i`, in every lane."""
    t, t_known, e = tension[(i + 1) * lanes :], tension[known * lanes :], link[i * lanes :]
    for k in range(lanes):
        t[k] += e[k] * t_known[k]


@kernel
def _tensions_in_lanes(
    v: FloatArray, c: FloatArray, rhs: FloatArray, tension: FloatArray, link: FloatArray,
    pivot: FloatArray, n: int, lanes: int,
) -> None:  # fmt: skip
    """Solve Eq. (1) for many chains: `_tensions`, the same bits, with the lane innermost.

    One chain is faster with its last row in registers, many with loops over lanes for LLVM to
    vectorise: each stores to one row, for it gives up on proving that more do not overlap.
    `tension` and `pivot` (the inverse pivots) have a guard rod of zeros at each end, so that
    entry j is the rod above, j + lanes the rod itself, j + 2 lanes the rod below.
    """
    middle = n // 2
    for i in range(middle):
        _eliminate(v, c, rhs, tension, link, pivot, i, lanes, True)
    for i in range(n - 1, middle, -1):
        _eliminate(v, c, rhs, tension, link, pivot, i, lanes, False)
    row = middle * lanes
    for k in range(lanes):
        j = row + k
        o, o_below = c[j] * v[j], c[j + lanes] * v[j + lanes]
        d = (v[j] + v[j + lanes]) - (o * o) * pivot[j]
        z = (rhs[j] + o * tension[j]) + o_below * tension[j + 2 * lanes]
        tension[j + lanes] = z / (d - (o_below * o_below) * pivot[j + 2 * lanes])
    for i in range(middle - 1, -1, -1):
        _substitute(tension, link, i, i + 2, lanes)
    for i in range(middle + 1, n):
        _substitute(tension, link, i, i, lanes)


@inlined_kernel
def accelerations(
    theta: FloatArray, omega: FloatArray, torque: FloatArray, rods: Rods, work: FloatArray,
    alpha: FloatArray, lanes: int,
) -> None:  # fmt: skip
    """Write the angular accelerations [rad/s^2] of `lanes` chains into `alpha`.

    Arrays are flat, (n lanes,): entry i lanes + k belongs to rod i of lane k, the rod above is
    `lanes` entries before, the rod below as many after. `torque` [N m] acts at joints 0..n-1.
    Every loop here is over independent entries, and so vectorised; the recurrences are in
    `_tensions`. No result depends on the number of lanes.
    """
    l, inverse_l, damping, g = rods.length, rods.inverse_length, rods.damping, rods.gravity
    end = theta.size
    tau, rhs = work[0], work[1][:end]
    # Views of one row, so that one index serves for the joint or rod above, here and below
    v, v_below = rods.inverse_mass, rods.inverse_mass[lanes:]
    s, s_below = work[2], work[2][lanes:]
    c, c_below = work[3], work[3][lanes:]
    tau_below = tau[lanes:]
    f_above, f, f_below = work[4], work[4][lanes:], work[4][2 * lanes :]
    t_above, t, t_below = work[5], work[5][lanes:], work[5][2 * lanes :]
    theta_below, omega_below = theta[lanes:], omega[lanes:]
    torque_below, damping_below = torque[lanes:], damping[lanes:]

    for k in range(lanes):
        s[k], c[k] = sincos(theta[k])
        tau[k] = torque[k] - damping[k] * omega[k]
    for j in range(end - lanes):
        s_below[j], c_below[j] = sincos(theta_below[j] - theta[j])
    for j in range(end - lanes):
        tau_below[j] = torque_below[j] - damping_below[j] * (omega_below[j] - omega[j])
    for j in range(end):
        f[j] = (tau[j] - tau_below[j]) * inverse_l[j]
    for j in range(end):
        from_below = v_below[j] * (f_below[j] * s_below[j])
        rhs[j] = (l[j] * (omega[j] * omega[j]) + from_below) - v[j] * (f_above[j] * s[j])
    for k in range(lanes):
        rhs[k] += g[k] * c[k]
    if lanes == 1:
        _tensions(v, c, rhs, t[:end], work[6])
    else:
        _tensions_in_lanes(v, c, rhs, work[5], work[6], work[7], end // lanes, lanes)
    for j in range(end):
        from_below = (t_below[j] * s_below[j] - f_below[j] * c_below[j]) + f[j]
        from_above = (t_above[j] * s[j] + f_above[j] * c[j]) - f[j]
        alpha[j] = (v_below[j] * from_below - v[j] * from_above) * inverse_l[j]
    for k in range(lanes):
        alpha[k] -= (g[k] * s[k]) * inverse_l[k]


@kernel
def derivative(
    y: FloatArray, torque: FloatArray, rods: Rods, work: FloatArray, dydt: FloatArray
) -> None:
    """Write the time derivative of one chain's state y = (theta, omega) into `dydt`."""
    n = y.size // 2
    for i in range(n):
        dydt[i] = y[n + i]
    accelerations(y[:n], y[n:], torque, rods, work, dydt[n:], 1)
