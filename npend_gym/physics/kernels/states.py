"""The equations of motion for many states of one chain in one compiled call."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import aligned_zeros, bare
from npend_gym.compiled.jit import kernel
from npend_gym.physics.kernels.canonical import SWEEP_ROWS, Change, change_canonical
from npend_gym.physics.kernels.dynamics import AnyArrays, accelerations, accelerations_kept, copy
from npend_gym.physics.kernels.stages import (
    ALPHA,
    OMEGA,
    SHARED_ROWS,
    STAGE_ROWS,
    change_stage,
    take_poses,
)
from npend_gym.physics.kernels.tangent import POSE_ROWS
from npend_gym.physics.kernels.tensions import TENSIONS

# Rows of the work space of `rates_of_states`: those of `stages`; the changes of a column; each
# state as a stage
_TURNED, _SPED, _PUSHED, _GAINED, _STAGE = range(SHARED_ROWS, SHARED_ROWS + 5)
_POSE = _STAGE + STAGE_ROWS


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
    gained, stage, poses = scratch[_GAINED][:m], scratch[_STAGE:], scratch[_POSE:]
    for k in range(len(q)):
        copy(u[k], stage[OMEGA])
        accelerations_kept(q[k], u[k], loads[k], chain, stage, stage[ALPHA][:m])
        take_poses(1, m, chain, mass, stage, poses)
        for column in range(2 * m + wanted.size):
            for i in range(m):
                turned[i] = 1.0 if column == i else 0.0
                sped[i] = 1.0 if column == m + i else 0.0
            if column >= 2 * m:
                pushed[wanted[column - 2 * m]] = 1.0
            change_stage(
                0, chain, mass, stage, poses, turned, sped, pushed, unchanged, gained, scratch
            )
            if column >= 2 * m:
                pushed[wanted[column - 2 * m]] = 0.0
            for i in range(m):
                jacobians[k, i, column] = gained[i]


def new_momenta_scratch(m: int) -> FloatArray:
    """Return the work space of `momenta_of_states`, for `m` coordinates."""
    return aligned_zeros(SWEEP_ROWS + 5, m + 1)


@kernel
def momenta_of_states(
    q: FloatArray, u: FloatArray, chain: AnyArrays, scratch: FloatArray, jacobians: FloatArray
) -> None:
    """Write the derivatives of the momenta N u by the last columns of q and u, (S, m, columns).

    `q` and `u` are as for `rates_of_states`.
    """
    q, u, chain, scratch, jacobians = bare(q), bare(u), bare(chain), bare(scratch), bare(jacobians)
    m, count = q.shape[1], jacobians.shape[2]
    turned, sped = scratch[SWEEP_ROWS][:m], scratch[SWEEP_ROWS + 1][:m]
    p, force, loads = scratch[SWEEP_ROWS + 2], scratch[SWEEP_ROWS + 3], scratch[SWEEP_ROWS + 4]
    change = Change(turned, sped, loads, scratch[:0])
    for k in range(len(q)):
        for column in range(count):
            for i in range(m):
                turned[i] = 1.0 if column - count == i - 2 * m else 0.0
                sped[i] = 1.0 if column - count == i - m else 0.0
            change_canonical(q[k], u[k], loads, chain, change, scratch, p, force)
            for i in range(m):
                jacobians[k, i, column] = p[i]
