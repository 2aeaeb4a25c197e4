"""A Runge-Kutta step, kept: a change carried through it, a gradient taken back.

A step of an explicit method begins at y and has the stages and the end

    y_s = y + h sum_j a_sj k_j,   k_s = f(y_s),   y' = y + h sum_s b_s k_s.

Lengths of steps are held fixed. A change dy then goes the same way, with d k_s = (df/dy) d y_s, and
the gradient goes the way back. What lies within a step by dense output is linear in the same k_s,
with weights of its own.

A method is the rows a_s and its weights b, arrays or tuples, and how many stages count. Of each
stage two rows of `slopes` are what belongs to its k: changes of q' and u', or derivatives by them.
"""

from __future__ import annotations

from typing import Any

from npend_gym._checks import FloatArray
from npend_gym.compiled.jit import inlined_kernel, spliced_kernel
from npend_gym.physics.kernels.adjoint import ADJOINT_ROWS, adjoint
from npend_gym.physics.kernels.driven import Torque, loads_at
from npend_gym.physics.kernels.dynamics import (
    ANSWER_ROWS,
    WORK_ROWS,
    AnyArrays,
    accelerations_kept,
    copy,
    respond,
)
from npend_gym.physics.kernels.tangent import POSE_ROWS, pose, tangent

# Rows of a stage that is kept: those of `accelerations_kept`, its accelerations and velocities
ALPHA, OMEGA, STAGE_ROWS = WORK_ROWS + 1, WORK_ROWS + 2, WORK_ROWS + 3
# Rows of the work space: what `respond` leaves, which comes first; a force, or what `respond` makes
# of derivatives by accelerations; what tangents or adjoints need
_FORCE, _OUT = ANSWER_ROWS, ANSWER_ROWS + 1
SHARED_ROWS = _OUT + max(4, ADJOINT_ROWS)


@spliced_kernel  # on a GPU no other function may return a view
def stage_of(tape: FloatArray, s: int) -> FloatArray:
    """Return the rows of a stage that is kept."""
    return tape[s * STAGE_ROWS : (s + 1) * STAGE_ROWS]


@inlined_kernel
def take_stages(
    h: Any, a: Any, count: int, q: FloatArray, u: FloatArray, torque: Torque, chain: AnyArrays,
    x: FloatArray, tape: FloatArray,
) -> None:  # fmt: skip
    """Evaluate the stages of a step from `q` and `u`, and keep them in `tape`; `x` is for work."""
    m = q.size
    for s in range(count):
        stage, row = stage_of(tape, s), a[s]
        w = stage[OMEGA][:m]
        copy(q, x)
        copy(u, w)
        for j in range(s):
            if row[j] != 0.0:
                before, weight = stage_of(tape, j), h * row[j]
                for i in range(m):
                    x[i] += weight * before[OMEGA][i]
                    w[i] += weight * before[ALPHA][i]
        loads = loads_at(0.0, x, w, torque, chain, s)
        accelerations_kept(x, w, loads, chain, stage, stage[ALPHA][:m])


@inlined_kernel
def take_poses(
    count: int, m: int, chain: AnyArrays, mass: FloatArray, tape: FloatArray, poses: FloatArray
) -> None:
    """Write what the tangents of each of `count` stages have in common."""
    for s in range(count):
        stage = stage_of(tape, s)
        u, alpha = stage[OMEGA][:m], stage[ALPHA][:m]
        pose(u, alpha, chain, mass, stage, poses[s * POSE_ROWS :])


@inlined_kernel
def change_stage(
    s: int, chain: AnyArrays, mass: FloatArray, tape: FloatArray, poses: FloatArray,
    turned: FloatArray, sped: FloatArray, pushed: FloatArray, changed: FloatArray,
    gained: FloatArray, rows: FloatArray,
) -> None:  # fmt: skip
    """Write the change of the accelerations of a stage; see `tangent.tangent`."""
    m, stage, force = turned.size, stage_of(tape, s), rows[_FORCE][: turned.size]
    tangent(
        stage[OMEGA][:m], stage[ALPHA][:m], turned, sped, pushed, changed, chain, mass,
        poses[s * POSE_ROWS :], rows[_OUT:], force,
    )  # fmt: skip
    respond(force, chain, stage, rows, gained)


@inlined_kernel
def return_stage(
    s: int, chain: AnyArrays, mass: FloatArray, tape: FloatArray, bar: FloatArray,
    q_bar: FloatArray, u_bar: FloatArray, load_bar: FloatArray, chain_bar: FloatArray,
    rows: FloatArray,
) -> None:  # fmt: skip
    """Take derivatives by the accelerations of a stage, `bar`, back; see `adjoint.adjoint`."""
    m, stage, lam = bar.size, stage_of(tape, s), rows[_FORCE][: bar.size]
    respond(bar, chain, stage, rows, lam)
    adjoint(
        stage[OMEGA][:m], stage[ALPHA][:m], lam, chain, mass, stage, rows, rows[_OUT:], q_bar,
        u_bar, load_bar, chain_bar,
    )  # fmt: skip


@inlined_kernel
def gather(
    weights: Any, h: Any, slopes: FloatArray, count: int, q: FloatArray, u: FloatArray
) -> None:
    """Add h sum_s weights_s k_s to `q` and `u`."""
    for s in range(count):
        if weights[s] != 0.0:
            weight, faster, gained = h * weights[s], slopes[2 * s], slopes[2 * s + 1]
            for i in range(q.size):
                q[i] += weight * faster[i]
                u[i] += weight * gained[i]


@inlined_kernel
def change_stages(
    h: Any, a: Any, end: Any, count: int, pairs: int, chain: AnyArrays, mass: FloatArray,
    tape: FloatArray, poses: FloatArray, q: FloatArray, u: FloatArray, pushed: FloatArray,
    changed: FloatArray, begin: FloatArray, slopes: FloatArray, rows: FloatArray,
) -> None:  # fmt: skip
    """Carry changes `q` and `u` at the start of a step to its end, in place.

    How each k changes is left in `slopes`, `pairs` of rows, one more than stages; or in one pair,
    where a stage depends on the one before alone. The start is left in the first two of the three
    rows `begin`. What a stage adds to the end and to the next stage is added at once: to read it
    again would take a tenth longer in packs.
    """
    q_begin, u_begin, x, first = begin[0], begin[1], begin[2][: q.size], slopes[0]
    for i in range(q.size):
        q_begin[i], u_begin[i] = q[i], u[i]
        x[i], first[i] = q[i], u[i]
    for s in range(count):
        own, following = 2 * (s % pairs), slopes[2 * ((s + 1) % pairs)]
        sped, gained = slopes[own][: q.size], slopes[own + 1][: q.size]
        if pairs > 1:
            gather(a[s], h, slopes, s - 1, x, sped)  # from the stage before it is there
        change_stage(s, chain, mass, tape, poses, x, sped, pushed, changed, gained, rows)
        part, weight = h * a[min(s + 1, count - 1)][s], h * end[s]
        for i in range(q.size):
            faster, more = sped[i], gained[i]
            q[i], u[i] = q[i] + weight * faster, u[i] + weight * more
            x[i], following[i] = q_begin[i] + part * faster, u_begin[i] + part * more


@inlined_kernel
def spread(
    weights: Any, h: Any, q_bar: FloatArray, u_bar: FloatArray, slopes: FloatArray, count: int,
    first: bool,
) -> None:  # fmt: skip
    """Add the derivatives by each k, from those by what `gather` leads to; the `first` are all."""
    for s in range(count):
        weight, faster, gained = h * weights[s], slopes[2 * s], slopes[2 * s + 1]
        for i in range(q_bar.size):
            if first:
                faster[i], gained[i] = weight * q_bar[i], weight * u_bar[i]
            else:
                faster[i] += weight * q_bar[i]
                gained[i] += weight * u_bar[i]


@inlined_kernel
def return_stages(
    h: Any, a: Any, count: int, chain: AnyArrays, mass: FloatArray, tape: FloatArray,
    q_bar: FloatArray, u_bar: FloatArray, load_bars: FloatArray, chain_bar: FloatArray,
    x: FloatArray, slopes: FloatArray, rows: FloatArray,
) -> None:  # fmt: skip
    """Take derivatives by each k of a step back, and add them to those by its start.

    `load_bars` has a row for the loads of each stage, or one for their sum.
    """
    m = q_bar.size
    for back in range(count):
        s = count - 1 - back
        w, bar, row = slopes[2 * s][:m], slopes[2 * s + 1][:m], a[s]
        load_bar = load_bars[min(s, load_bars.shape[0] - 1)]
        return_stage(s, chain, mass, tape, bar, x, w, load_bar, chain_bar, rows)
        for i in range(m):
            q_bar[i] += x[i]
            u_bar[i] += w[i]
        for j in range(s):
            if row[j] != 0.0:
                weight, faster, gained = h * row[j], slopes[2 * j], slopes[2 * j + 1]
                for i in range(m):
                    faster[i] += weight * x[i]
                    gained[i] += weight * w[i]
