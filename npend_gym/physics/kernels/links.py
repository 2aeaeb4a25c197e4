"""The equations of motion of real links in O(n), as articulated bodies.

Link i has mass m_i, its centre at c_i along it, inertia I_i about that, and length l_i from joint
to joint. Take the axes of a link, e along it and n across. What hangs on its tip answers an
acceleration a of the tip, and alpha of the link, with

    the force A a + b + p alpha,   the torque p . a + sigma alpha + beta,                       (1)

which are zero below the last link; p, sigma and beta come from the rotor of the motor at the joint
below, which turns with both of its links. The joint at the top of link i accelerates by (x, y) in
these axes; the moments about it, with w = l omega^2, give

    alpha = q - g_e x - g_n y - g_k alpha_above,                                                (2)
    D = J + l^2 A_nn + 2 l p_n + sigma,     J = I + m c^2 + rotors,
    g_e = (l A_en + p_e) / D,               g_n = (m c + l A_nn + p_n) / D,
    g_k = k / D,                            q = (t - l (b_n - A_en w) - (beta - p_e w)) / D,

with the torques t on the link, and the coupling k of alpha and alpha_above by the rotor between.
Put into (1) this gives what link i and all below it answer, from the tip to the pivot; there the
acceleration is known, and (2) gives one alpha after the other. No difference of nearly equal terms
is taken, so that c = l, I = 0 is the chain of point masses to rounding:

    A_ee' = m + A_ee - (l A_en + p_e) g_e,  A_en' = (A_en (K + l p_n + sigma) - p_e G) / D,      (3)
    A_nn' = (m J - (m c)^2 + E A_nn + 2 m (l - c) p_n + (m + A_nn) sigma - p_n^2) / D,
    G = m c + l A_nn + p_n,   K = I - m c (l - c) + rotors,   E = I + m (l - c)^2 + rotors.

A base that moves stands after the angles: q = (theta, x) or (theta, x, y), u = (omega, x', y'). It
accelerates as prescribed or, a cart of mass M, as (1) lets it under its force.

R. Featherstone, "Rigid Body Dynamics Algorithms" (2008), chapter 7, has articulated bodies.
"""

# ruff: noqa: ARG001  all kinds of chains share the parameters of a kernel
from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import bare
from npend_gym.compiled.jit import inlined_kernel, outlined_kernel
from npend_gym.compiled.sincos import sincos
from npend_gym.physics.kernels.link_terms import Base, Joint, Link, MachineArrays
from npend_gym.physics.kernels.tensions import PIVOTS, one_minus_cos

# Rows of the work space. Before their own, G_E and G_N hold forces of drag, and FREE the torques
_SIN, _COS, _G_E, _G_N, _G_K, _FREE, _REST = range(7)


@inlined_kernel
def _tip_drag(
    u: FloatArray, coordinates: int, chain: MachineArrays, s: FloatArray, c: FloatArray,
    along: FloatArray, across: FloatArray,
) -> Any:  # fmt: skip
    """Write the forces that overcome the drag of each tip, in its link's axes; return the power."""
    length, joints = bare(chain.length), bare(chain.joints)
    n, linear, quadratic = length.size, joints[Joint.DRAG], joints[Joint.QUADRATIC_DRAG]
    a: Any = 0.0 * u[0]  # velocity of the joint above, along e and n
    power = b = a
    if coordinates > n:
        b = u[n]
    if coordinates > n + 1:
        a = -u[n + 1]  # the axes of the base have e downwards
    for i in range(n):
        a, b = c[i] * a + s[i] * b, (c[i] * b - s[i] * a) + length[i] * u[i]
        square = a * a + b * b
        drag = linear[i] + quadratic[i] * math.sqrt(square)
        along[i] = drag * a
        across[i] = drag * b
        power = power + drag * square
    return power


@inlined_kernel
def _accelerate_base(
    u: FloatArray, torque: FloatArray, chain: MachineArrays, en: Any, nn: Any, b_n: Any,
    alpha: FloatArray,
) -> tuple[Any, Any]:  # fmt: skip
    """Write the acceleration sideways of a base that moves; return both, with gravity."""
    n, base = chain.length.size, bare(chain.base)
    x = -chain.gravity[0] - base[Base.UP, 0]
    force = (torque[n] - base[Base.DAMPING, 0] * u[n]) - (en * x + b_n)
    inverse = base[Base.INVERSE_MASS, 0]
    y = (base[Base.ACROSS, 0] + inverse * force) / (1.0 + inverse * nn)
    alpha[n] = y
    return x, y


@inlined_kernel
def _friction_torque(joints: FloatArray, i: int, relative: Any) -> Any:
    """Return the torque of dry friction at joint `i`, of the sign of its speed [N m]."""
    u = relative * joints[Joint.PER_SPEED, i]
    return (joints[Joint.FRICTION, i] * u) / math.sqrt(1.0 + u * u)


def _torques_of(machine: bool) -> Callable[..., None]:
    """Return `torques` for MachineArrays, or for LinkArrays: one text, compiled for each.

    Numba drops what stands under `if machine` where that is False, here and below. Views of what is
    bare cost nothing; of other arrays it would count references, some tens of ns.
    """

    @inlined_kernel
    def torques(u: FloatArray, torque: FloatArray, chain: Any, net: FloatArray) -> None:
        """Write the torque on each link: that of its joint less that of the joint below."""
        damping, joints = bare(chain.damping), bare(chain.joints if machine else chain.terms)
        for i in range(net.size):
            relative = u[i] - u[i - 1] if i > 0 else u[i]
            tau = torque[i] - damping[i] * relative
            if machine:
                tau = tau - _friction_torque(joints, i, relative)
            net[i] = tau
            if i > 0:
                net[i - 1] = net[i - 1] - tau

    return torques


def _ascent_of(machine: bool, kept: bool) -> Callable[..., Any]:
    """Return `ascend`; `kept` leaves in the row PIVOTS what another right side needs."""

    @inlined_kernel
    def ascend(u: FloatArray, chain: Any, work: FloatArray) -> Any:
        """Take in one link after the other, Eqs. (1) to (3); return A_en, A_nn, b_n at the base.

        What would wait for the division by D comes before it, times D.
        """
        terms, length = bare(chain.terms), bare(chain.length)
        joints = bare(chain.joints if machine else chain.terms)
        s, c, g_e, g_n, g_k, free, rest = (
            work[_SIN], work[_COS], work[_G_E], work[_G_N], work[_G_K], work[_FREE], work[_REST]
        )  # fmt: skip
        ee: Any = 0.0 * u[0]
        en = nn = b_e = b_n = p_e = p_n = sigma = beta = ee
        for i in range(length.size - 1, -1, -1):
            l, m, moment = length[i], terms[Link.MASS, i], terms[Link.MOMENT, i]
            square, t = u[i] * u[i], free[i]
            w = l * square
            if machine:
                b_e, b_n, beta = b_e + g_e[i], b_n + g_n[i], beta - p_e * w
            b_e, b_n = b_e - ee * w, b_n - en * w
            spread = l * l * nn + terms[Link.J, i]
            lever, reach, own = l * en, moment + l * nn, terms[Link.K, i]
            if machine:
                spread = (spread + 2.0 * (l * p_n)) + sigma
                lever, reach, own = lever + p_e, reach + p_n, own + (l * p_n + sigma)
                t = t - beta
            inverse = 1.0 / spread
            across, along = terms[Link.Z, i] + terms[Link.E, i] * nn, own * en
            start, gn = (t - l * b_n) * inverse, reach * inverse
            g_e[i], g_n[i], free[i], rest[i] = lever * inverse, gn, start, own * inverse
            b_e, b_n = (b_e - moment * square) + lever * start, (own * b_n) * inverse + gn * t
            if kept:
                work[PIVOTS][i] = inverse
            if machine:
                across = across + ((2.0 * (m * l - moment)) * p_n + (m + nn) * sigma - p_n * p_n)
                along, coupling = along - p_e * reach, joints[Joint.COUPLING, i]
                g_k[i] = gk = coupling * inverse
                p_e, p_n = -(lever * gk), -(reach * gk)
                p_e, p_n = c[i] * p_e - s[i] * p_n, s[i] * p_e + c[i] * p_n
                sigma, beta = -(coupling * gk), coupling * start
            # into the axes of the link above
            si, ci = s[i], c[i]
            b_e, b_n = ci * b_e - si * b_n, si * b_e + ci * b_n
            ss, sc, cc = si * si, si * ci, ci * ci
            carried, taken, cross = m + ee, lever * lever, (2.0 * sc) * along
            ee = cc * carried + ((ss * across - cc * taken) - cross) * inverse
            en = sc * carried + ((cc - ss) * along - sc * (across + taken)) * inverse
            nn = ss * carried + ((cc * across - ss * taken) + cross) * inverse
        return en, nn, b_n

    return ascend


def _descent_of(machine: bool, moving: bool) -> Callable[..., None]:
    """Return `descend` for links in motion, or at rest."""

    @inlined_kernel
    def descend(u: FloatArray, chain: Any, work: FloatArray, x: Any, y: Any, out: Any) -> None:
        """Write the accelerations of the links, Eq. (2), the base accelerating by (x, y).

        Links at rest answer moments alone.
        """
        length, s, c = bare(chain.length), work[_SIN], work[_COS]
        g_e, g_n, g_k, free, rest = work[_G_E], work[_G_N], work[_G_K], work[_FREE], work[_REST]
        above = 0.0 * x
        for i in range(length.size):
            x, y = c[i] * x + s[i] * y, c[i] * y - s[i] * x
            start = free[i] - g_e[i] * x
            if machine:
                start = start - g_k[i] * above
            above = start - g_n[i] * y
            out[i] = above
            # y + l alpha, where 1 - l g_n is K / D: the next link need not wait for alpha
            y = length[i] * start + rest[i] * y
            if moving:
                x = x - length[i] * (u[i] * u[i])

    return descend


def _articulated(machine: bool, kept: bool = False) -> Callable[..., Any]:
    """Return the solver for MachineArrays, or for LinkArrays."""
    torques, ascend, descend = (
        _torques_of(machine), _ascent_of(machine, kept), _descent_of(machine, moving=True)
    )  # fmt: skip

    @outlined_kernel
    def solve(
        q: FloatArray, u: FloatArray, torque: FloatArray, chain: Any, work: FloatArray,
        alpha: FloatArray,
    ) -> Any:  # fmt: skip
        # u and alpha may be longer than q
        q, u, torque, work, alpha = bare(q), bare(u), bare(torque), bare(work), bare(alpha)
        n, s, c = chain.length.size, work[_SIN], work[_COS]
        s[0], c[0] = sincos(q[0])
        for i in range(1, n):
            s[i], c[i] = sincos(q[i] - q[i - 1])
        torques(u, torque, chain, work[_FREE][:n])
        power: Any = 0.0 * u[0]
        if machine:
            power = _tip_drag(u, q.size, chain, s, c, work[_G_E], work[_G_N])
        en, nn, b_n = ascend(u, chain, work)
        x, y = 0.0 * power - chain.gravity[0], 0.0 * power
        if machine and q.size > n:
            x, y = _accelerate_base(u, torque, chain, en, nn, b_n, alpha)
            if kept:
                inverse = chain.base[Base.INVERSE_MASS, 0]
                work[PIVOTS][n] = inverse / (1.0 + inverse * nn)
            if q.size > n + 1:
                alpha[n + 1] = chain.base[Base.UP, 0] + 0.0 * y
        descend(u, chain, work, x, y, alpha)
        return power

    return solve


solve_links: Callable[..., Any] = _articulated(machine=False)
solve_machine: Callable[..., Any] = _articulated(machine=True)
solve_links_kept: Callable[..., Any] = _articulated(machine=False, kept=True)
solve_machine_kept: Callable[..., Any] = _articulated(machine=True, kept=True)


def _response(machine: bool) -> Callable[..., None]:
    """Return what `links_respond` and `machine_respond` are: one text, two compiled versions."""
    descend = _descent_of(machine, moving=False)

    @inlined_kernel
    def respond(
        force: FloatArray, chain: Any, work: FloatArray, answer: FloatArray, alpha: FloatArray
    ) -> None:
        """Write how the links of a chain at rest answer the moments `force` on each alone.

        `work` is as the solver left it: Eqs. (1) and (2) hold with the same coefficients.
        """
        length, n = bare(chain.length), chain.length.size
        s, c, g_e, g_n, g_k, start, rest, inverse = (
            work[_SIN], work[_COS], work[_G_E], work[_G_N], work[_G_K], work[_FREE], work[_REST],
            work[PIVOTS],
        )  # fmt: skip
        b_e: Any = 0.0 * force[0]
        b_n = beta = x = y = b_e
        for i in range(n - 1, -1, -1):
            t = force[i] - beta
            free = t - length[i] * b_n
            start[i] = free * inverse[i]
            b_e, b_n = b_e + g_e[i] * free, rest[i] * b_n + g_n[i] * t
            if machine:
                beta = g_k[i] * free
            b_e, b_n = c[i] * b_e - s[i] * b_n, s[i] * b_e + c[i] * b_n
        if machine and force.size > n:
            y = (force[n] - b_n) * inverse[n]
            alpha[n] = y
        if machine and force.size > n + 1:
            alpha[n + 1] = 0.0 * y  # a prescribed motion answers nothing
        descend(force, chain, work, x, y, alpha)

    return respond


links_respond: Callable[..., None] = _response(machine=False)
machine_respond: Callable[..., None] = _response(machine=True)


@inlined_kernel
def machine_power(u: FloatArray, chain: MachineArrays) -> Any:
    """Return the power that damping and friction of joints and rail take [W]."""
    n = chain.length.size
    total = 0.0 * u[0]
    for i in range(n):
        relative = u[i] - u[i - 1] if i > 0 else u[i]
        torque = chain.damping[i] * relative + _friction_torque(chain.joints, i, relative)
        total = total + torque * relative
    if u.size > n:
        total = total + chain.base[Base.DAMPING, 0] * (u[n] * u[n])
    return total


@inlined_kernel
def machine_damped(chain: MachineArrays) -> bool:
    """Return True: its power is always asked for."""
    return True


@inlined_kernel
def link_energies(
    omega: FloatArray, carried: FloatArray, mass: FloatArray, velocity: FloatArray, chain: Any,
    s: FloatArray, c: FloatArray,
) -> Any:  # fmt: skip
    """As `tensions.bob_energies`, of links: their centres move and they turn."""
    terms = chain.terms
    kinetic = lift = tip = vertical = horizontal = 0.0
    for i in range(velocity.size):
        centre, turning = terms[Link.CENTRE, i], omega[i]
        across = horizontal + centre * (turning * c[i])
        up = vertical + centre * (turning * s[i])
        moving = terms[Link.MASS, i] * (across * across + up * up)
        kinetic = kinetic + 0.5 * (moving + terms[Link.INERTIA, i] * (turning * turning))
        vertical = vertical + chain.length[i] * (turning * s[i])
        horizontal = velocity[i]
        lift = lift + carried[i] * one_minus_cos(s[i], c[i])
        tip = tip - chain.length[i] * c[i]
    return kinetic, lift, tip


@inlined_kernel
def machine_energies(
    omega: FloatArray, carried: FloatArray, mass: FloatArray, velocity: FloatArray,
    chain: MachineArrays, s: FloatArray, c: FloatArray,
) -> Any:  # fmt: skip
    """As `link_energies`, with the rotors and a cart."""
    n = velocity.size
    kinetic, lift, tip = link_energies(omega, carried, mass, velocity, chain, s, c)
    above = 0.0 * omega[0]
    for i in range(n):
        rotor = chain.joints[Joint.RATIO, i] * above + omega[i]
        kinetic = kinetic + 0.5 * (chain.joints[Joint.ARMATURE, i] * (rotor * rotor))
        above = omega[i]
    if chain.base.size > 0:
        # all links move with the cart: m v_cart^2 / 2 + v_cart . momentum; the cart's own
        speed, terms, momentum, total = omega[n], chain.terms, 0.0 * above, 0.0 * above
        horizontal = 0.0 * above
        for i in range(n):
            across = horizontal + terms[Link.CENTRE, i] * (omega[i] * c[i])
            momentum = momentum + terms[Link.MASS, i] * across
            total = total + terms[Link.MASS, i]
            horizontal = velocity[i]
        cart = 1.0 / chain.base[Base.INVERSE_MASS, 0]
        kinetic = kinetic + (momentum + 0.5 * ((total + cart) * speed)) * speed
    return kinetic, lift, tip
