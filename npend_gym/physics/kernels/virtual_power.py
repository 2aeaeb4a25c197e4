"""The derivatives of the equations of motion in O(n): their tangent and their adjoint.

With N the mass matrix and f all other moments on the rods, N alpha = f. For any numbers lambda,

    P = lambda . (N alpha - f)                                                              (1)

is the virtual power of what is left of the equations when the rods turn at the rates lambda; it is
zero in every motion. A small change of the state, of a torque or of a parameter changes alpha by

    d alpha = -N^-1 d(N alpha - f), alpha held,                                             (2)

and if a function of alpha has the derivatives a, it changes by a . d alpha = -dP for the lambda
that solves N lambda = a: the same system once more, with the factors that are there, because N is
symmetric. Tangent and adjoint therefore need no more than P, which is a sum over points: with e_i
along rod i and n_i across it, the centre of link i accelerates by A_i, less gravity, and moves at
the virtual velocity V_i,

    T_i = alpha_i n_i - omega_i^2 e_i,
    A_i = J_i + c_i T_i,           J_{i+1} = J_i + l_i T_i,           J_0 = (0, g),
    V_i = W_i + c_i lambda_i n_i,  W_{i+1} = W_i + l_i lambda_i n_i,  W_0 = 0,

    P = sum_i [m_i A_i . V_i + I_i alpha_i lambda_i + K_i . W_{i+1}
               - tau_i (lambda_i - lambda_{i-1})
               + r_i (alpha_i + k_i alpha_{i-1}) (lambda_i + k_i lambda_{i-1})],            (3)

with the torques tau_i of the joints less damping and friction, and the forces K_i that overcome
drag on the tips. Rotors have the inertia r_i and turn with the link above by k_i. A pass down the
chain gives A and V, a pass up the forces F and G on each joint. F is the sum of m A + K below, and
G the sum of m V; one link has (with F and G of the joint at its tip, and e . = scalar product)

    dP/dtheta_i = -lambda_i e_i . (l_i F + c_i m_i A_i)
                  - (alpha_i e_i + omega_i^2 n_i) . (l_i G + c_i m_i V_i)                   (4)

and so on. Point masses are c = l, I = 0: with their tensions t and force couples f, those of alpha
and those of lambda, F = f n - t e, and so G, so that no pass is needed.

Links on springs are x further from their joints: r = l + x and c + x stand for l and c. With rates
mu for x there are two terms more, the same for tips and centres:

    x_i'' e_i + 2 x_i' omega_i n_i    beside r_i T_i,        mu_i e_i    beside r_i lambda_i n_i,

and P has the terms T(x_i, x_i') mu_i with their tensions T. Then, at fixed F and A,

    dP/dx_i = (lambda_i n_i) . (F + m_i A_i) + T_i . (G + m_i V_i) + mu_i dT/dx_i.          (5)

docs/explanation/derivatives.md has all of it. `laws` has how friction, drag and tension change.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import bare
from npend_gym.compiled.jit import inlined_kernel
from npend_gym.physics.kernels.dynamics import FEATURES
from npend_gym.physics.kernels.laws import Parameter, friction_return, friction_slope
from npend_gym.physics.kernels.link_terms import ChainArrays

# Point masses on rigid rods, machine, springs
KINDS: dict[Any, tuple[bool, bool, bool]] = {
    ChainArrays: (True, False, False),
    **{kind: (False, *flags[:2]) for kind, flags in FEATURES.items()},
}


def joint_slope_of(ideal: bool) -> Callable[..., Any]:
    """Return `joint_slope` for one kind of chains."""

    @inlined_kernel
    def joint_slope(i: int, relative: Any, chain: Any) -> Any:
        """Return how the torque that resists at joint `i` grows with its speed."""
        slope = chain.damping[i] + 0.0 * relative
        if not ideal and chain.friction.shape[0] > 0:
            slope = slope + friction_slope(bare(chain.friction), i, relative)
        return slope

    return joint_slope


def joint_adjoint_of(ideal: bool) -> Callable[..., Any]:
    """Return `add_joint` for one kind of chains."""
    joint_slope = joint_slope_of(ideal)

    @inlined_kernel
    def add_joint(
        i: int, relative: Any, turn: Any, chain: Any, torque_bar: FloatArray, chain_bar: FloatArray
    ) -> Any:
        """Add the part of the torque at joint `i`; return the derivative by its speed."""
        torque_bar[i] = torque_bar[i] + turn
        if chain_bar.size > 0:
            chain_bar[Parameter.damping, i] -= relative * turn
            if not ideal and chain.friction.shape[0] > 0:
                friction_return(bare(chain.friction), i, relative, -turn, chain_bar)
        return joint_slope(i, relative, chain) * turn

    return add_joint
