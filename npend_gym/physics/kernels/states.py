"""The equations of motion for many states of one chain in one compiled call."""

from __future__ import annotations

from npend_gym._checks import FloatArray
from npend_gym.compiled.jit import kernel
from npend_gym.physics.kernels.dynamics import ChainArrays, accelerations, copy

_TENSIONS = 3  # the row of the scratch in which `accelerations` leaves them, after a zero


@kernel
def solve_states(
    theta: FloatArray, omega: FloatArray, torque: FloatArray, chain: ChainArrays,
    scratch: FloatArray, alpha: FloatArray, tension: FloatArray,
) -> None:  # fmt: skip
    """Write accelerations [rad/s^2] and tensions [N] of each state, a row of (states, n) each."""
    for k in range(theta.shape[0]):
        accelerations(theta[k], omega[k], torque[k], chain, scratch, alpha[k])
        copy(scratch[_TENSIONS][1 : 1 + theta.shape[1]], tension[k])
