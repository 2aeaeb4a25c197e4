"""Eigenvalues of a hanging chain of links, counted in O(n) and found by halving.

The mass matrix M is factored from the tip of the chain up, as `npend_gym.physics.kernels.recursion`
does it in any state: the pivot D_i of link i is its inertia about its joint with all that hangs
below. The same sweep factors mu M - B, with B the matrix of springs, dampers and drag on joints and
links. By Sylvester's law of inertia, as many D_i are negative as M^(-1) B has eigenvalues above mu.
Each link hands two coordinates on to the one above: the velocity across of the joint between them,
and the angular velocity of the link above, which rotors and dampers see.
"""

from __future__ import annotations

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.compiled.jit import inner_kernel, kernel


@inner_kernel
def _count_above(mu: float, bodies: FloatArray, forces: FloatArray) -> int:
    """Return how many eigenvalues of M^(-1) B are larger than mu."""
    l, c, m, inertia = bodies[0], bodies[1], bodies[2], bodies[3]
    armature, ratio = bodies[4], bodies[5]
    stiffness, damping, drag = forces[0], forces[1], forces[2]
    xx = xw = ww = 0.0  # of mu M - B, in the joint's velocity x and the link's angular velocity w
    count = 0
    for i in range(l.size - 1, -1, -1):
        xx = xx - drag[i]
        own = mu * (inertia[i] + m[i] * c[i] * c[i] + armature[i])
        pivot = (own - stiffness[i] - damping[i]) + ((xx * l[i] + 2.0 * xw) * l[i] + ww)
        if pivot < 0.0:
            count += 1
        elif pivot == 0.0:
            pivot = 1e-30 * own
        to_x = mu * m[i] * c[i] + xx * l[i] + xw
        to_w = mu * armature[i] * ratio[i] + damping[i]
        # that is mu m + xx - to_x^2 / pivot, which would lose the digits of light links
        mass, rest = mu * m[i], l[i] - c[i]
        resists = (mu * (inertia[i] + armature[i]) - stiffness[i] - damping[i]) + ww
        beside = mass * (xx * rest + 2.0 * xw) * rest - xw * xw
        xx = ((mass + xx) * resists + beside) / pivot
        xw = -to_x * to_w / pivot
        ww = mu * armature[i] * ratio[i] * ratio[i] - damping[i] - to_w * to_w / pivot
    return count


@kernel
def eigenvalue(bodies: FloatArray, forces: FloatArray, k: int) -> float:
    """Return eigenvalue k of M^(-1) B, in increasing order, to the last digits.

    Parameters
    ----------
    bodies : ndarray, shape (6, n)
        Length, centre, mass, inertia, armature and 1/gear - 1 of each link; lengths and centres
        are negative for links that rest upright.
    forces : ndarray, shape (3, n)
        Stiffness and damping of each joint, and drag of each tip: B is diagonal in the angles, in
        the relative angles, and in the positions of the tips.
    k : int
    """
    n = bodies.shape[1]
    above = n - 1 - k  # eigenvalues above the wanted one
    high = 0.0
    for i in range(n):
        own = bodies[3, i] + bodies[2, i] * bodies[1, i] * bodies[1, i] + bodies[4, i]
        length = bodies[0, i]
        force = forces[0, i] + forces[1, i] + forces[2, i] * length * length
        high = max(high, force / own)
    if high == 0.0:
        return 0.0
    while _count_above(high, bodies, forces) > above:
        high = 2.0 * high
    low = 0.5 * high
    while _count_above(low, bodies, forces) <= above:
        high, low = low, 0.5 * low
        if low < 1e-250:
            return 0.0
    middle = 0.5 * (low + high)
    while low < middle < high:
        if _count_above(middle, bodies, forces) > above:
            low = middle
        else:
            high = middle
        middle = 0.5 * (low + high)
    return middle


@kernel
def any_above(mu: FloatArray, bodies: FloatArray, forces: FloatArray, found: BoolArray) -> None:
    """Write whether M^(-1) B has an eigenvalue above `mu`, for each of many chains.

    Parameters
    ----------
    mu : ndarray, shape (B,)
    bodies, forces : ndarray, shapes (B, 6, n) and (B, 3, n)
        As for `eigenvalue`.
    found : ndarray of bool, shape (B,)
    """
    for j in range(mu.size):
        found[j] = _count_above(mu[j], bodies[j], forces[j]) > 0
