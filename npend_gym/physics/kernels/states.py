"""The equations of motion for many states of one chain in one compiled call."""

from __future__ import annotations

from npend_gym._checks import FloatArray
from npend_gym.compiled.jit import kernel
from npend_gym.physics.kernels.dynamics import AnyArrays, accelerations, copy
from npend_gym.physics.kernels.tensions import TENSIONS


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
        copy(scratch[TENSIONS][1 : 1 + theta.shape[1]], tension[k])
