"""The equations of motion of any mechanism in O(n): one unknown taken out after the other.

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

A link on a spring slides along itself: it is x_i further from its joint, so that l and c grow by
x_i, and the force along it in the joint is the tension T_i. Its tip accelerates along it by

    a_e = (-T - m (l - c) omega^2 - b_e - A_en a_n - p_e alpha) / (m + A_ee).                   (4)

This unknown is taken out of (1) first; what is left has A_ee = A_en = p_e = 0. The joint above
feels -T along the link, and the moments have y + 2 x' omega for y. Then x'' = a_e - x + l omega^2.

A base that moves stands after the angles, the stretch x_i of springs after that: q = (theta, X) or
(theta, X, Y), then x, u being their rates. The base accelerates as prescribed or, a cart of mass M,
as (1) lets it under its force. Stretch is a coordinate, not length: rounding of the length would be
noise in the tension of a stiff spring.

R. Featherstone, "Rigid Body Dynamics Algorithms" (2008), chapter 7, has articulated bodies.
"""

# what grows from link to link is a number or a pack, which pyright does not follow
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
# ruff: noqa: ARG001  all kinds of chains share the parameters of a kernel
from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import bare
from npend_gym.compiled.jit import inlined_kernel, outlined_kernel
from npend_gym.compiled.packs import where
from npend_gym.compiled.sincos import sincos
from npend_gym.physics.kernels.laws import spring_tension
from npend_gym.physics.kernels.link_terms import Base, Link, Rotor
from npend_gym.physics.kernels.loads import (
    accelerate_cart,
    rubbing_torques,
    smooth_torques,
    tip_drag,
)
from npend_gym.physics.kernels.tensions import PIVOTS

# Rows of the work space. Before their own, G_E and G_N hold forces of drag, and FREE the torques.
# Behind the n entries for links, the rows for springs: their lengths; of (4) 1 / (m + A_ee), A_en
# and p_e times that, and the part that waits for no acceleration
SIN, COS, _G_E, _G_N, _G_K, _FREE, _REST = range(7)
LENGTHS, _YIELD, _BY_N, _BY_TURN, _LOOSE = SIN, COS, _G_E, _G_N, _FREE

_NO_LENGTH: Any = np.nan  # of springs: no step of an integrator leads beyond


def _ascent_of(machine: bool, geared: bool, springs: bool, kept: bool) -> Callable[..., Any]:
    """Return `ascend`, with rotors if `geared`; `kept` fills PIVOTS for other right sides."""

    @inlined_kernel
    def ascend(u: FloatArray, axial: int, chain: Any, work: FloatArray) -> Any:
        """Take in one link after the other, Eqs. (1) to (4); return A_en, A_nn, b_n at the base.

        What would wait for the division by D comes before it, times D.
        """
        terms, length = bare(chain.terms), bare(chain.length)
        s, c, g_e, g_n, g_k, free, rest = (
            work[SIN], work[COS], work[_G_E], work[_G_N], work[_G_K], work[_FREE], work[_REST]
        )  # fmt: skip
        n, resisted, rotors = length.size, False, terms
        if machine:
            rotors, resisted = bare(chain.rotors), chain.drag.size > 0
        ee: Any = 0.0 * u[0]
        en = nn = b_e = b_n = p_e = p_n = sigma = beta = drift = pull = ee
        for i in range(n - 1, -1, -1):
            l, m, moment = length[i], terms[Link.MASS, i], terms[Link.MOMENT, i]
            square, t, spread, own = u[i] * u[i], free[i], terms[Link.J, i], terms[Link.K, i]
            if machine and resisted:
                b_e, b_n = b_e + g_e[i], b_n + g_n[i]
            if springs:
                stretch, far = work[LENGTHS][n + i] - l, m * l - moment  # far: m (l - c)
                l = l + stretch
                own = own - stretch * far
                spread = spread + (2.0 * moment + m * stretch) * stretch
                moment = moment + m * stretch
                drift = 2.0 * (u[axial + i] * u[i])
                pull = spring_tension(chain.springs, i, stretch, u[axial + i])
                soft = 1.0 / (m + ee)
                loose = -(((pull + far * square) + b_e) * soft)
                by_n, by_turn = en * soft, p_e * soft
                work[_YIELD][n + i], work[_BY_N][n + i], work[_LOOSE][n + i] = soft, by_n, loose
                b_n, nn = b_n + en * loose, nn - en * by_n
                if geared:
                    work[_BY_TURN][n + i] = by_turn
                    beta, sigma = beta + p_e * loose, sigma - p_e * by_turn
                    p_n = p_n - en * by_turn
                    p_e = 0.0 * p_e
            else:
                w = l * square
                if geared:
                    beta = beta - p_e * w
                b_e, b_n = b_e - ee * w, b_n - en * w
            spread = l * l * nn + spread
            lever, reach = l * en, moment + l * nn
            across = terms[Link.Z, i] + terms[Link.E, i] * nn
            if geared:
                spread = (spread + 2.0 * (l * p_n)) + sigma
                rest_moment = 2.0 * (m * l - moment)
                across = across + ((rest_moment * p_n + (m + nn) * sigma) - p_n * p_n)
                lever, reach, own = lever + p_e, reach + p_n, own + (l * p_n + sigma)
                t = t - beta
            inverse: Any = 1.0 / spread
            if springs:
                inverse = where(l > 0.0, inverse, _NO_LENGTH)
                lever = 0.0 * lever
            start, gn = (t - l * b_n) * inverse, reach * inverse
            free[i], rest[i], g_n[i] = start, own * inverse, gn
            if kept:
                work[PIVOTS][i] = inverse
            if springs:
                b_e, b_n = -pull, (own * b_n) * inverse + (gn * t + across * (inverse * drift))
                start = start - gn * drift
            else:
                g_e[i] = lever * inverse
                b_e, b_n = (b_e - moment * square) + lever * start, (own * b_n) * inverse + gn * t
            along = own * en
            if geared:
                along, coupling = along - p_e * reach, rotors[Rotor.COUPLING, i]
                g_k[i] = gk = coupling * inverse
                p_e, p_n = -(lever * gk), -(reach * gk)
                p_e, p_n = c[i] * p_e - s[i] * p_n, s[i] * p_e + c[i] * p_n
                sigma, beta = -(coupling * gk), coupling * start
            # into the axes of the link above
            si, ci = s[i], c[i]
            b_e, b_n = ci * b_e - si * b_n, si * b_e + ci * b_n
            ss, sc, cc = si * si, si * ci, ci * ci
            if springs:
                nn = across * inverse
                ee, en, nn = ss * nn, -(sc * nn), cc * nn
            else:
                carried, taken, cross = m + ee, lever * lever, (2.0 * sc) * along
                ee = cc * carried + ((ss * across - cc * taken) - cross) * inverse
                en = sc * carried + ((cc - ss) * along - sc * (across + taken)) * inverse
                nn = ss * carried + ((cc * across - ss * taken) + cross) * inverse
        return en, nn, b_n

    return ascend


def _ascent_of_bobs(kept: bool) -> Callable[..., Any]:
    """Return `ascend` for point masses on springs, for which A, p and sigma are zero in Eq. (1).

    What a link needs of those below is its neighbour's pull, so that none waits for another.
    """

    @inlined_kernel
    def ascend(u: FloatArray, axial: int, chain: Any, work: FloatArray) -> Any:
        mass, length, n = bare(chain.terms)[Link.MASS], bare(chain.length), chain.length.size
        s, c, g_e, g_n, free = work[SIN], work[COS], work[_G_E], work[_G_N], work[_FREE]
        lengths, soft, loose, resisted = (
            work[LENGTHS][n:], work[_YIELD][n:], work[_LOOSE][n:], chain.drag.size > 0
        )  # fmt: skip
        b_e: Any = 0.0 * u[0]
        b_n = b_e
        for i in range(n - 1, -1, -1):
            if resisted:
                b_e, b_n = b_e + g_e[i], b_n + g_n[i]
            l, m = lengths[i], mass[i]
            inverse: Any = where(l > 0.0, 1.0 / (m * l), _NO_LENGTH)
            pull = spring_tension(chain.springs, i, l - length[i], u[axial + i])
            push = free[i] * (inverse * m)
            soft[i], g_n[i], loose[i] = inverse * l, inverse * m, -((pull + b_e) * (inverse * l))
            free[i] = (push - b_n) * inverse
            if kept:
                work[PIVOTS][i] = inverse * (inverse * m)
            b_e, b_n = -(c[i] * pull + s[i] * push), c[i] * push - s[i] * pull
        return 0.0 * b_n, 0.0 * b_n, b_n

    return ascend


def _descent_of(machine: bool, springs: bool, solid: bool, moving: bool) -> Callable[..., None]:
    """Return `descend` for links in motion, or at rest."""

    @inlined_kernel
    def descend(
        u: FloatArray, axial: int, chain: Any, work: FloatArray, x: Any, y: Any, out: Any
    ) -> None:
        """Write the accelerations of the links, Eq. (2), the base accelerating by (x, y).

        Links at rest answer moments alone.
        """
        length, s, c = bare(chain.length), work[SIN], work[COS]
        g_e, g_n, g_k, free, rest = work[_G_E], work[_G_N], work[_G_K], work[_FREE], work[_REST]
        geared, n = False, length.size
        if machine:
            geared = chain.rotors.shape[0] > 0
        above = 0.0 * x
        for i in range(n):
            l = length[i]
            x, y = c[i] * x + s[i] * y, c[i] * y - s[i] * x
            start = free[i]
            if springs:
                l = work[LENGTHS][n + i]
                if moving:
                    y = y + 2.0 * (u[axial + i] * u[i])
            else:
                start = start - g_e[i] * x
            if machine and geared:
                start = start - g_k[i] * above
            above = start - g_n[i] * y
            out[i] = above
            # y + l alpha, where 1 - l g_n is K / D: the next link need not wait for alpha
            y = l * start + rest[i] * y if solid else l * start
            if springs:
                tip = work[_LOOSE][n + i]
                if solid:
                    tip = tip - work[_BY_N][n + i] * y
                    if geared:
                        tip = tip - work[_BY_TURN][n + i] * above
                if moving:
                    x = x - l * (u[i] * u[i])
                out[axial + i], x = tip - x, tip
            elif moving:
                x = x - l * (u[i] * u[i])

    return descend


def solver(machine: bool, springs: bool, solid: bool, kept: bool) -> Callable[..., Any]:
    """Return the solver for mechanisms with these features; `solid` links need not be bobs."""
    if solid:
        ascend, ascend_geared = (
            _ascent_of(machine, geared, springs, kept) for geared in (False, True)
        )
    else:
        ascend = ascend_geared = _ascent_of_bobs(kept)
    descend = _descent_of(machine, springs, solid, moving=True)

    @outlined_kernel
    def solve(
        q: FloatArray, u: FloatArray, torque: FloatArray, chain: Any, work: FloatArray,
        alpha: FloatArray,
    ) -> Any:  # fmt: skip
        # u and alpha may be longer than q
        q, u, torque, work, alpha = bare(q), bare(u), bare(torque), bare(work), bare(alpha)
        n, s, c, lengths = chain.length.size, work[SIN], work[COS], bare(chain.length)
        axial = q.size
        s[0], c[0] = sincos(q[0])
        for i in range(1, n):
            s[i], c[i] = sincos(q[i] - q[i - 1])
        if springs:
            axial = axial - n
            lengths = work[LENGTHS][n:]
            for i in range(n):
                lengths[i] = chain.length[i] + q[axial + i]
        if chain.friction.shape[0] > 0:
            rubbing_torques(u, torque, chain, work[_FREE][:n])
        else:
            smooth_torques(u, torque, chain, work[_FREE][:n])
        power: Any = 0.0 * u[0]
        if machine and chain.drag.size > 0:
            speeds = u[: q.size]
            power = tip_drag(speeds, axial, lengths, chain, s, c, work[_G_E], work[_G_N])
        # asked once: in each link, the question would cost a tenth of the step
        if machine and solid and chain.rotors.shape[0] > 0:
            en, nn, b_n = ascend_geared(u, axial, chain, work)
        else:
            en, nn, b_n = ascend(u, axial, chain, work)
        x, y = 0.0 * power - chain.gravity[0], 0.0 * power
        if axial > n:
            x, y = accelerate_cart(
                u[n], torque[n], bare(chain.gravity), bare(chain.base), en, nn, b_n
            )
            alpha[n] = y
            if kept:
                inverse = chain.base[Base.INVERSE_MASS, 0]
                work[PIVOTS][n] = inverse / (1.0 + inverse * nn)
            if axial > n + 1:
                alpha[n + 1] = chain.base[Base.UP, 0] + 0.0 * y
        descend(u, axial, chain, work, x, y, alpha)
        return power

    return solve


def response(machine: bool, springs: bool, solid: bool) -> Callable[..., None]:
    """Return `respond` for mechanisms with these features: see `dynamics.respond`."""
    descend = _descent_of(machine, springs, solid, moving=False)

    @inlined_kernel
    def respond(
        force: FloatArray, chain: Any, work: FloatArray, answer: FloatArray, alpha: FloatArray
    ) -> None:
        """Write how a mechanism at rest answers the moments `force` on each link alone.

        `work` is as the solver left it: Eqs. (1) to (4) hold with the same coefficients.
        """
        lengths, n, axial = bare(chain.length), chain.length.size, force.size
        s, c, g_e, g_n, g_k, start, rest, inverse = (
            work[SIN], work[COS], work[_G_E], work[_G_N], work[_G_K], work[_FREE], work[_REST],
            work[PIVOTS],
        )  # fmt: skip
        geared = False
        if machine:
            geared = chain.rotors.shape[0] > 0
        if springs:
            lengths, axial = work[LENGTHS][n:], axial - n
        b_e: Any = 0.0 * force[0]
        b_n = beta = x = y = b_e
        for i in range(n - 1, -1, -1):
            if springs:
                pulled = force[axial + i] - b_e
                work[_LOOSE][n + i] = pulled * work[_YIELD][n + i]
                if solid:
                    b_n = b_n + work[_BY_N][n + i] * pulled
                    if geared:
                        beta = beta + work[_BY_TURN][n + i] * pulled
            t = force[i] - beta
            free = t - lengths[i] * b_n
            start[i] = free * inverse[i]
            if springs:
                b_e = force[axial + i]
            else:
                b_e = b_e + g_e[i] * free
            b_n = rest[i] * b_n + g_n[i] * t if solid else g_n[i] * t
            if machine and geared:
                beta = g_k[i] * free
            b_e, b_n = c[i] * b_e - s[i] * b_n, s[i] * b_e + c[i] * b_n
        if axial > n:
            y = (force[n] - b_n) * inverse[n]
            alpha[n] = y
        if axial > n + 1:
            alpha[n + 1] = 0.0 * y  # a prescribed motion answers nothing
        descend(force, axial, chain, work, x, y, alpha)

    return respond
