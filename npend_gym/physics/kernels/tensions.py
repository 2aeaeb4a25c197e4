"""The equations of motion of point masses in O(n), through the tensions of the rods.

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

Drag adds terms to the right sides (docs/extensions.md has their derivation). It slows bob i at the
rate r_i = v_{i+1} (drag_i + quadratic_drag_i |velocity|); with a_i and b_i the bob's velocity along
e_i and n_i, it adds

    to (1) (r_{i-1} - r_i) a_i,        to (2) (r_{i-1} - r_i) b_i - r_{i-1} l_i omega_i.        (3)

Links with inertia, joints with more than viscous damping, and a base that moves are in `links`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from npend_gym._checks import FloatArray
from npend_gym.compiled.jit import inlined_kernel, outlined_kernel
from npend_gym.compiled.packs import any_of, where
from npend_gym.compiled.sincos import sincos

COUPLES, TENSIONS = 2, 3  # rows of the work space in which f and T are left, after a zero
PIVOTS = 7  # the row in which those of the elimination are kept for another right side


class ChainArrays(NamedTuple):
    """The parameters of a chain, or of a pack of chains, as the kernels take them."""

    inverse_mass: FloatArray  # v at joints 0..n, (n + 1,); zero at the pivot
    length: FloatArray  # l, (n,)
    inverse_length: FloatArray  # 1/l, (n,)
    damping: FloatArray  # joints 0..n-1, (n,)
    gravity: FloatArray  # g, (1,)
    drag: FloatArray  # (n,); empty where the air resists no bob
    quadratic_drag: FloatArray  # (n,) or empty, as drag


def _elimination(kept: bool, again: bool) -> Callable[..., None]:
    """Return the solver of Eq. (1): one text, three compiled versions.

    `kept` leaves the pivots for another right side with the same matrix, which `again` solves for.
    """

    @inlined_kernel
    def solve(
        v: FloatArray, c: FloatArray, rhs: FloatArray, tension: FloatArray, link: FloatArray,
        pivots: FloatArray,
    ) -> None:  # fmt: skip
        """Solve Eq. (1), from both ends to the middle rod and back.

        Row i is brought to T_i = tension_i + link_i T_next, `next` being its neighbour on the way
        to the middle. Two independent sweeps take half the time of one, as each waits for its
        divisions. Zeros end the chain, q_top and z_top before rod 0 and c_n, so that no row needs
        a case of its own.
        """
        n = rhs.size
        middle = n // 2
        q_top = z_top = q_tip = z_tip = 0.0  # inverse pivot and reduced right side of the last row
        v_here = v[0]
        for i in range(middle):
            o = c[i] * v_here
            if again:
                q_top = pivots[i]
            else:
                q_top = 1.0 / ((v_here + v[i + 1]) - (o * o) * q_top)
            z_top = (rhs[i] + o * z_top) * q_top
            tension[i] = z_top
            v_here = v[i + 1]
            if not again:
                link[i] = (c[i + 1] * v_here) * q_top
            if kept:
                pivots[i] = q_top
            j = n - 1 - i
            if j > middle:
                o = c[j + 1] * v[j + 1]
                if again:
                    q_tip = pivots[j]
                else:
                    q_tip = 1.0 / ((v[j] + v[j + 1]) - (o * o) * q_tip)
                z_tip = (rhs[j] + o * z_tip) * q_tip
                tension[j] = z_tip
                if not again:
                    link[j] = (c[j] * v[j]) * q_tip
                if kept:
                    pivots[j] = q_tip
        o = c[middle] * v_here
        o_below = c[middle + 1] * v[middle + 1]
        if again:
            pivot = pivots[middle]
        else:
            pivot = ((v_here + v[middle + 1]) - (o * o) * q_top) - (o_below * o_below) * q_tip
        if kept:
            pivots[middle] = pivot
        up = down = ((rhs[middle] + o * z_top) + o_below * z_tip) / pivot
        tension[middle] = up
        for i in range(1, middle + 1):
            up = tension[middle - i] + link[middle - i] * up
            tension[middle - i] = up
            if middle + i < n:
                down = tension[middle + i] + link[middle + i] * down
                tension[middle + i] = down

    return solve


_solve_again = _elimination(kept=False, again=True)


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
def _add_forces(v: FloatArray, s: FloatArray, rhs: FloatArray, couples: FloatArray) -> None:
    """Add what the force `couples` f do, a row after a zero, to the right sides of Eq. (1)."""
    v_below, s_below, f_above, f_below = v[1:], s[1:], couples, couples[2:]
    for i in range(rhs.size):
        from_below = v_below[i] * (f_below[i] * s_below[i])
        rhs[i] = (rhs[i] + from_below) - v[i] * (f_above[i] * s[i])


@inlined_kernel
def _across(
    chain: ChainArrays, work: FloatArray, couples: FloatArray, tensions: FloatArray,
    alpha: FloatArray,
) -> None:  # fmt: skip
    """Write Eq. (2), without gravity, from rows of force couples and tensions, after a zero."""
    v, v_below, inverse_l = chain.inverse_mass, chain.inverse_mass[1:], chain.inverse_length
    s, s_below, c, c_below = work[0], work[0][1:], work[1], work[1][1:]
    f_above, f, f_below = couples, couples[1:], couples[2:]
    t_above, t_below = tensions, tensions[2:]
    for i in range(v.size - 1):  # of an ensemble, `inverse_l` has an entry to spare
        from_below = (t_below[i] * s_below[i] - f_below[i] * c_below[i]) + f[i]
        from_above = (t_above[i] * s[i] + f_above[i] * c[i]) - f[i]
        alpha[i] = (v_below[i] * from_below - v[i] * from_above) * inverse_l[i]


def _point_masses(kept: bool) -> Callable[..., float]:
    """Return the solver of the equations of motion, which may leave the pivots in a row more."""
    eliminate = _elimination(kept, again=False)

    @outlined_kernel
    def solve(
        q: FloatArray, u: FloatArray, torque: FloatArray, chain: ChainArrays, work: FloatArray,
        alpha: FloatArray,
    ) -> float:  # fmt: skip
        """Solve Eqs. (1) and (2); see `npend_gym.physics.kernels.dynamics.accelerations`.

        The long loops are over independent entries, for LLVM to vectorise where there is one chain.
        """
        theta, omega = q, u
        l, inverse_l, damping, g = chain.length, chain.inverse_length, chain.damping, chain.gravity
        n = theta.size
        # Views of one row, so that one index serves for the joint or rod here and below
        s, s_below = work[0], work[0][1:]
        c, c_below = work[1], work[1][1:]
        f, rhs, across = work[COUPLES][1:], work[4][:n], work[6]
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
            rhs[i] = l[i] * (omega[i] * omega[i])
        _add_forces(chain.inverse_mass, s, rhs, work[COUPLES])
        rhs[0] = rhs[0] + g[0] * c[0]
        # _add_drag itself tests for an empty array; a test here would make Numba count references
        # to the views, some ns a call
        power = _add_drag(omega, chain, s, c, rhs, across)
        pivots = work[PIVOTS if kept else 5]
        eliminate(chain.inverse_mass, c, rhs, work[TENSIONS][1:], work[5], pivots)
        _across(chain, work, work[COUPLES], work[TENSIONS], alpha)
        alpha[0] = alpha[0] - (g[0] * s[0]) * inverse_l[0]
        for i in range(chain.drag.size):
            alpha[i] = alpha[i] + across[i] * inverse_l[i]
        return power

    return solve


solve_tensions: Callable[..., float] = _point_masses(kept=False)
solve_tensions_kept: Callable[..., float] = _point_masses(kept=True)


@inlined_kernel
def tensions_respond(
    force: FloatArray, chain: ChainArrays, work: FloatArray, answer: FloatArray, alpha: FloatArray
) -> None:
    """Write how the rods of a chain at rest answer the moments `force` on each alone.

    `work` is as `solve_tensions_kept` left it: the matrix is that of its state. Three rows of
    `answer` are for force couples, tensions, both after a zero, and right sides.
    """
    n, couples, tensions, f = alpha.size, answer[0], answer[1], answer[0][1:]
    rhs = answer[2][: alpha.size]
    for i in range(n):
        f[i] = force[i] * chain.inverse_length[i]
        rhs[i] = 0.0 * f[i]
    _add_forces(chain.inverse_mass, work[0], rhs, couples)
    _solve_again(chain.inverse_mass, work[1], rhs, tensions[1:], work[5], work[PIVOTS])
    _across(chain, work, couples, tensions, alpha)


@inlined_kernel
def damping_power(u: FloatArray, chain: ChainArrays) -> Any:
    """Return the power that the dampers take, sum_i damping_i (omega_i - omega_{i-1})^2 [W]."""
    total = chain.damping[0] * (u[0] * u[0])
    for i in range(1, u.size):
        relative = u[i] - u[i - 1]
        total = total + chain.damping[i] * (relative * relative)
    return total


@inlined_kernel
def any_positive(row: FloatArray) -> bool:
    """Return whether any lane of any entry is greater than zero; none may be less."""
    total = row[0]
    for i in range(1, row.size):
        total = total + row[i]
    return any_of(total > 0.0)


@inlined_kernel
def any_damped(chain: ChainArrays) -> bool:
    """Return whether any joint of any lane takes power."""
    return any_positive(chain.damping)


@inlined_kernel
def one_minus_cos(s: float, c: float) -> Any:
    """Return 1 - cos from sine and cosine, without cancellation near zero."""
    near = (s * s) / (1.0 + where(c > 0.0, c, 0.0))
    return where(c > 0.0, near, 1.0 - c)
