"""The equations of motion for many states of one chain in one compiled call."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import aligned_zeros, bare
from npend_gym.compiled.jit import kernel
from npend_gym.physics.kernels.dynamics import (
    ANSWER_ROWS,
    WORK_ROWS,
    AnyArrays,
    accelerations,
    accelerations_kept,
    copy,
    respond,
)
from npend_gym.physics.kernels.tangent import POSE_ROWS, pose, tangent
from npend_gym.physics.kernels.tensions import TENSIONS

# Rows of the work space of `rates_of_states`: what `respond` leaves; the changes of a column, of
# the accelerations at first of f - N alpha; four for `tangent`; then the stage
_TURNED, _SPED, _PUSHED, _FORCE, _GAINED, _OUT = range(ANSWER_ROWS, ANSWER_ROWS + 6)
_STAGE = _OUT + 4
_ALPHA = _STAGE + WORK_ROWS + 1
_POSE = _ALPHA + 1


@kernel
def solve_states(
    theta: FloatArray, omega: FloatArray, torque: FloatArray, chain: AnyArrays,
    scratch: FloatArray, alpha: FloatArray, tension: FloatArray,
) -> None:  # fmt: skip
    """Write accelerations [rad/s^2] and tensions [N] of each state, a row of (states, n) each.

    What is written for tensions has no meaning for links with inertia.
    """
    for k in range(theta.shape[0]):
        accelerations(theta[k], omega[k], torque[k], chain, scratch, alpha[k])
        copy(scratch[TENSIONS][1 : 1 + tension.shape[1]], tension[k])


def new_rates_scratch(m: int) -> FloatArray:
    """Return the work space of `rates_of_states`, for `m` coordinates."""
    return aligned_zeros(_POSE + POSE_ROWS, m + 3)  # loads: m and a force, at most


@kernel
def rates_of_states(
    q: FloatArray, u: FloatArray, loads: FloatArray, wanted: NDArray[np.int64], chain: AnyArrays,
    mass: FloatArray, scratch: FloatArray, jacobians: FloatArray,
) -> None:  # fmt: skip
    """Write the derivatives of u' by q, u and the `wanted` loads, (S, m, 2m + wanted.size).

    `q` and `u` are S states of one chain, a row of m coordinates each; `loads` (S, n or more) are
    the torques at the joints, then the force on a base that moves.
    """
    q, u, loads, jacobians = bare(q), bare(u), bare(loads), bare(jacobians)
    chain, mass, scratch = bare(chain), bare(mass), bare(scratch)
    m, unchanged = q.shape[1], scratch[:0]
    turned, sped, pushed = scratch[_TURNED][:m], scratch[_SPED][:m], scratch[_PUSHED]
    force, gained, alpha = scratch[_FORCE][:m], scratch[_GAINED][:m], scratch[_ALPHA][:m]
    stage, poses = scratch[_STAGE:], scratch[_POSE:]
    for k in range(len(q)):
        accelerations_kept(q[k], u[k], loads[k], chain, stage, alpha)
        pose(u[k], alpha, chain, mass, stage, poses)
        for column in range(2 * m + wanted.size):
            for i in range(m):
                turned[i] = 1.0 if column == i else 0.0
                sped[i] = 1.0 if column == m + i else 0.0
            if column >= 2 * m:
                pushed[wanted[column - 2 * m]] = 1.0
            tangent(
                u[k], alpha, turned, sped, pushed, unchanged, chain, mass, poses, scratch[_OUT:],
                force,
            )  # fmt: skip
            respond(force, chain, stage, scratch, gained)
            if column >= 2 * m:
                pushed[wanted[column - 2 * m]] = 0.0
            for i in range(m):
                jacobians[k, i, column] = gained[i]
