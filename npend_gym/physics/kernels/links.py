"""The equations of motion of real links in O(n), as articulated bodies.

Link i has mass m_i, its centre at c_i along it, inertia I_i about that, and length l_i from joint
to joint. In the axes of a link, e along it and n across, let what hangs on its tip answer an
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
from typing import Any, NamedTuple

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.chain import ChainParameters
from npend_gym.compiled.arrays import aligned_zeros, bare, innermost
from npend_gym.compiled.jit import inlined_kernel
from npend_gym.compiled.sincos import sincos
from npend_gym.physics.kernels.tensions import one_minus_cos


class LinkFields(NamedTuple):
    """Rows of `LinkArrays.terms`, an entry for each link."""

    MASS: int = 0  # m
    MOMENT: int = 1  # m c
    J: int = 2
    K: int = 3
    E: int = 4
    Z: int = 5  # m J - (m c)^2
    CENTRE: int = 6  # c
    INERTIA: int = 7  # I, about the centre


Link = LinkFields()


class JointFields(NamedTuple):
    """Rows of `MachineArrays.joints`, an entry for each joint."""

    COUPLING: int = 0  # k, of the accelerations of the two links, by the rotor [kg m^2]
    FRICTION: int = 1  # N m
    PER_SPEED: int = 2  # s/rad: one over the speed at which friction is 0.7 of that
    ARMATURE: int = 3  # inertia of the rotor, as the joint sees it [kg m^2]
    RATIO: int = 4  # 1/gear - 1: turns of the rotor by the link above, by those of its own
    DRAG: int = 5  # N s/m, on the tip
    QUADRATIC_DRAG: int = 6  # N s^2/m^2


Joint = JointFields()


class BaseFields(NamedTuple):
    """Rows of `MachineArrays.base`, of a base that moves."""

    INVERSE_MASS: int = 0  # 1/M; zero where the motion is prescribed
    ACROSS: int = 1  # x'' as prescribed [m/s^2]
    UP: int = 2  # y''
    DAMPING: int = 3  # of the rail, N s/m


Base = BaseFields()


class LinkArrays(NamedTuple):
    """The parameters of rigid links with viscous joints, or of a pack of such chains."""

    length: FloatArray  # (n,)
    damping: FloatArray  # joints 0..n-1, (n,)
    gravity: FloatArray  # (1,)
    terms: FloatArray  # (len(Link), n)


class MachineArrays(NamedTuple):
    """The same with all that a machine has: rotors, dry friction, drag, a base that moves."""

    length: FloatArray
    damping: FloatArray
    gravity: FloatArray
    terms: FloatArray
    joints: FloatArray  # (len(Joint), n)
    base: FloatArray  # (len(Base), 1); (0, 1) where the base rests


def link_terms(chains: ChainParameters) -> FloatArray:
    """Return the rows of `LinkArrays.terms` of many chains, shape (len(Link), B, n)."""
    m, c, inertia = chains.masses, chains.centres, chains.inertias
    rest = chains.lengths - c
    # the rotor at a joint turns with the link below it, and with the link above by its ratio
    rotors = np.array(chains.armature)
    rotors[:, :-1] += (chains.armature * _ratio(chains) ** 2)[:, 1:]
    return np.stack([
        m, m * c, inertia + m * c * c + rotors, inertia - m * c * rest + rotors,
        inertia + m * rest * rest + rotors, m * (inertia + rotors), c, inertia,
    ])  # fmt: skip


def joint_terms(chains: ChainParameters) -> FloatArray:
    """Return the rows of `MachineArrays.joints` of many chains, shape (len(Joint), B, n)."""
    ratio = _ratio(chains)
    coupling = chains.armature * ratio
    coupling[:, 0] = 0.0  # above joint 0 nothing turns
    return np.stack([
        coupling, chains.friction, 1.0 / chains.friction_speed, chains.armature, ratio,
        chains.drag, chains.quadratic_drag,
    ])  # fmt: skip


def _ratio(chains: ChainParameters) -> FloatArray:
    return 1.0 / chains.gear - 1.0


def count_terms(chains: ChainParameters) -> int:
    """Return how many arrays `model_terms` makes of chains whose base rests: 0, 1 or 3."""
    machinery = (chains.friction, chains.armature, chains.drag, chains.quadratic_drag)
    return 0 if chains.is_ideal else 3 if any(np.any(values) for values in machinery) else 1


def model_terms(
    chains: ChainParameters, base: FloatArray | None = None, count: int | None = None
) -> list[FloatArray]:
    """Return what chains need beside lengths, damping and gravity: none, one or three arrays.

    Shapes are (rows, B, n), and (len(Base), B, 1) for a base that moves, or (0, B, 1) if it rests.
    `count` asks for more arrays than they need; fewer are a ValueError.
    """
    least = count_terms(chains) if base is None else 3
    wanted = least if count is None else count
    if least > wanted:
        raise ValueError(
            "chains of point masses cannot become links, nor links get friction, rotors or drag, "
            "while they are at work: begin with a chain that has these"
        )
    if wanted == 0:
        return []
    if wanted == 1:
        return [link_terms(chains)]
    entries = np.zeros(0) if base is None else base
    moving = np.broadcast_to(entries[:, None, None], (entries.size, len(chains.masses), 1))
    return [link_terms(chains), joint_terms(chains), moving]


def link_arrays(chains: ChainParameters, base: FloatArray | None = None) -> Any:
    """Return the parameters of B chains with links or machinery, the lane innermost.

    `base` holds the entries of `Base` where the base moves.
    """
    plain = innermost(chains.lengths), innermost(chains.damping), np.array(chains.gravity)
    rows = [_rows(terms) for terms in model_terms(chains, base)]
    if len(rows) == 1:
        return LinkArrays(*plain, *rows)
    return MachineArrays(*plain, *rows)


def _rows(terms: FloatArray) -> FloatArray:
    """Return rows (rows, B, n) as (rows, n B), the lane innermost."""
    rows, lanes, columns = terms.shape
    flat = aligned_zeros(rows, columns * lanes)
    flat.reshape(rows, columns, lanes)[:] = terms.swapaxes(1, 2)
    return flat


@inlined_kernel
def _tip_drag(
    u: FloatArray, length: FloatArray, joints: FloatArray, s: FloatArray, c: FloatArray,
    along: FloatArray, across: FloatArray,
) -> Any:  # fmt: skip
    """Write the forces that overcome the drag of each tip, in its link's axes; return the power."""
    n = length.size
    linear, quadratic = joints[Joint.DRAG], joints[Joint.QUADRATIC_DRAG]
    a = b = 0.0 * u[0]  # velocity of the joint above, along e and n
    if u.size > n:
        b = u[n]
    if u.size > n + 1:
        a = -u[n + 1]  # the axes of the base have e downwards
    power = 0.0 * u[0]
    for i in range(n):
        a, b = c[i] * a + s[i] * b, (c[i] * b - s[i] * a) + length[i] * u[i]
        square = a * a + b * b
        drag = linear[i] + quadratic[i] * math.sqrt(square)
        along[i] = drag * a
        across[i] = drag * b
        power = power + drag * square
    return power


@inlined_kernel
def _friction_torque(joints: FloatArray, i: int, relative: Any) -> Any:
    """Return the torque of dry friction at joint `i`, of the sign of its speed [N m]."""
    u = relative * joints[Joint.PER_SPEED, i]
    return (joints[Joint.FRICTION, i] * u) / math.sqrt(1.0 + u * u)


def _articulated(machine: bool) -> Callable[..., Any]:
    """Return the solver for MachineArrays, or for LinkArrays: one text, two compiled versions."""

    @inlined_kernel
    def solve(
        q: FloatArray, u: FloatArray, torque: FloatArray, chain: Any, work: FloatArray,
        alpha: FloatArray,
    ) -> Any:  # fmt: skip
        # Views of what is bare cost nothing; of others Numba would count references, tens of ns
        terms, length, damping = bare(chain.terms), bare(chain.length), bare(chain.damping)
        n, work = length.size, bare(work)
        q, u, torque, alpha = bare(q), bare(u), bare(torque), bare(alpha)
        s, c, g_e, g_n, g_k = work[0], work[1], work[2], work[3], work[4]
        free, rest = work[5], work[6]
        s[0], c[0] = sincos(q[0])
        for i in range(1, n):
            s[i], c[i] = sincos(q[i] - q[i - 1])
        zero = 0.0 * u[0]
        power = zero
        if machine:
            joints, base = bare(chain.joints), bare(chain.base)
            power = _tip_drag(u, length, joints, s, c, g_e, g_n)
        ee = en = nn = b_e = b_n = p_e = p_n = sigma = beta = tau_below = zero
        for i in range(n - 1, -1, -1):
            l, m, moment = length[i], terms[Link.MASS, i], terms[Link.MOMENT, i]
            square = u[i] * u[i]
            w = l * square
            relative = u[i] - u[i - 1] if i > 0 else u[i]
            tau = torque[i] - damping[i] * relative
            if machine:
                tau = tau - _friction_torque(joints, i, relative)
                b_e, b_n, beta = b_e + g_e[i], b_n + g_n[i], beta - p_e * w
            t = tau - tau_below
            tau_below = tau
            b_e = b_e - ee * w
            b_n = b_n - en * w
            spread = l * l * nn + terms[Link.J, i]
            lever, reach, kept = l * en, moment + l * nn, terms[Link.K, i]
            if machine:
                spread = (spread + 2.0 * (l * p_n)) + sigma
                lever, reach, kept = lever + p_e, reach + p_n, kept + (l * p_n + sigma)
                t = t - beta
            inverse = 1.0 / spread
            ge, gn, start = lever * inverse, reach * inverse, (t - l * b_n) * inverse
            g_e[i], g_n[i], free[i], rest[i] = ge, gn, start, kept * inverse
            # Eq. (3), times D where it would wait for the division
            b_e = (b_e - moment * square) + lever * start
            b_n = (kept * b_n) * inverse + gn * t
            across = terms[Link.Z, i] + terms[Link.E, i] * nn
            along = kept * en
            if machine:
                across = across + ((2.0 * (m * l - moment)) * p_n + (m + nn) * sigma - p_n * p_n)
                along = along - p_e * reach
                coupling = joints[Joint.COUPLING, i]
                gk = coupling * inverse
                g_k[i] = gk
                p_e, p_n = -(lever * gk), -(reach * gk)
                sigma, beta = -(coupling * gk), coupling * start
            # into the axes of the link above
            si, ci = s[i], c[i]
            b_e, b_n = ci * b_e - si * b_n, si * b_e + ci * b_n
            ss, sc, cc = si * si, si * ci, ci * ci
            carried, taken, cross = m + ee, lever * lever, (2.0 * sc) * along
            ee = cc * carried + ((ss * across - cc * taken) - cross) * inverse
            en = sc * carried + ((cc - ss) * along - sc * (across + taken)) * inverse
            nn = ss * carried + ((cc * across - ss * taken) + cross) * inverse
            if machine:
                p_e, p_n = ci * p_e - si * p_n, si * p_e + ci * p_n

        x, y = zero - chain.gravity[0], zero
        if machine and base.size > 0:
            x = x - base[Base.UP, 0]
            force = (torque[n] - base[Base.DAMPING, 0] * u[n]) - (en * x + b_n)
            inverse = base[Base.INVERSE_MASS, 0]
            y = (base[Base.ACROSS, 0] + inverse * force) / (1.0 + inverse * nn)
            alpha[n] = y
            if u.size > n + 1:
                alpha[n + 1] = zero + base[Base.UP, 0]
        above = zero
        for i in range(n):
            x, y = c[i] * x + s[i] * y, c[i] * y - s[i] * x
            start = free[i] - g_e[i] * x
            if machine:
                start = start - g_k[i] * above
            above = start - g_n[i] * y
            alpha[i] = above
            # y + l alpha, where 1 - l g_n is K / D: the next link need not wait for alpha
            x, y = x - length[i] * (u[i] * u[i]), length[i] * start + rest[i] * y
        return power

    return solve


solve_links, solve_machine = _articulated(machine=False), _articulated(machine=True)


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
