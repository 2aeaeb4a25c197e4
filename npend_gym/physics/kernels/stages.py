"""One stage of a Runge-Kutta step, kept: a change carried through it, a gradient taken back.

A step of an explicit method begins at y and has the stages and the end

    y_s = y + h sum_j a_sj k_j,   k_s = f(y_s),   y' = y + h sum_s b_s k_s.

Lengths of steps are held fixed. A change dy then goes the same way, with d k_s = (df/dy) d y_s, and
the gradient goes the way back.
"""

from __future__ import annotations

from npend_gym._checks import FloatArray
from npend_gym.compiled.jit import inlined_kernel, spliced_kernel
from npend_gym.physics.kernels.adjoint import ADJOINT_ROWS, adjoint
from npend_gym.physics.kernels.dynamics import ANSWER_ROWS, AnyArrays, respond
from npend_gym.physics.kernels.rk4 import ALPHA, OMEGA, STAGE_ROWS
from npend_gym.physics.kernels.tangent import POSE_ROWS, pose, tangent

# Rows of the work space: what `respond` leaves, which comes first; a force, or what `respond` makes
# of derivatives by accelerations; what tangents or adjoints need
_FORCE, _OUT = ANSWER_ROWS, ANSWER_ROWS + 1
SHARED_ROWS = _OUT + max(4, ADJOINT_ROWS)


@spliced_kernel  # on a GPU no other function may return a view
def stage_of(tape: FloatArray, s: int) -> FloatArray:
    """Return the rows of a stage that is kept."""
    return tape[s * STAGE_ROWS : (s + 1) * STAGE_ROWS]


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
