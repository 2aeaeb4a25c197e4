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

Rods that stretch by x have the length r = l + x and two terms more, with rates mu for x,

    R_i = (r_i alpha_i + 2 x_i' omega_i) n_i + (x_i'' - r_i omega_i^2) e_i      for l_i T_i,
    S_i = r_i lambda_i n_i + mu_i e_i                                          for l_i lambda_i n_i,

and P has the terms (k_i x_i + d_i x_i') mu_i. Their N is that of (theta, base, x), and what it says
of lambda needs no solution: see `springs`. docs/explanation/derivatives.md has all of it. Here is
what the files of `tangent` and `adjoint` share: how friction and drag grow with speed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import bare
from npend_gym.compiled.jit import inlined_kernel
from npend_gym.compiled.packs import where
from npend_gym.physics.kernels.link_terms import Joint, Parameter


@inlined_kernel
def friction_slopes(joints: FloatArray, i: int, relative: Any) -> tuple[Any, Any]:
    """Return the torque of friction at joint `i` per N m of its own, and the slope by speed."""
    u = relative * joints[Joint.PER_SPEED, i]
    root = math.sqrt(1.0 + u * u)
    slope = (joints[Joint.FRICTION, i] * joints[Joint.PER_SPEED, i]) / (root * root * root)
    return u / root, slope


def count_rods_of(own: bool) -> Callable[..., int]:
    """Return `count_rods` for one kind of chains."""

    @inlined_kernel
    def count_rods(u: FloatArray, chain: Any) -> int:
        """Return the number of rods; lengths of point masses may have an entry to spare."""
        n = u.size
        if own:
            n = chain.length.size
        return n

    return count_rods


def slopes_of_drag(links: bool, machine: bool) -> Callable[..., tuple[Any, Any, Any]]:
    """Return `drag_slopes` for one kind of chains."""

    @inlined_kernel
    def drag_slopes(chain: Any, i: int, x: Any, y: Any) -> tuple[Any, Any, Any]:
        """Return the speed, drag over velocity, and the growth of that along the velocity."""
        linear: Any = 0.0 * x
        quadratic = linear
        if machine:
            linear = chain.joints[Joint.DRAG, i]
            quadratic = chain.joints[Joint.QUADRATIC_DRAG, i]
        if not links:
            linear, quadratic = chain.drag[i], chain.quadratic_drag[i]
        speed = math.sqrt(x * x + y * y)
        moving = speed > 0.0
        growth = where(moving, quadratic / where(moving, speed, 1.0), 0.0)
        return speed, linear + quadratic * speed, growth

    return drag_slopes


def joint_adjoint_of(machine: bool) -> Callable[..., Any]:
    """Return `add_joint` for chains with friction or without."""

    @inlined_kernel
    def add_joint(
        i: int, relative: Any, turn: Any, chain: Any, torque_bar: FloatArray, chain_bar: FloatArray
    ) -> Any:
        """Add the part of the torque at joint `i`; return the derivative by its speed."""
        torque_bar[i] = torque_bar[i] + turn
        slope = chain.damping[i]
        if machine:
            joints = bare(chain.joints)
            share, rubbing = friction_slopes(joints, i, relative)
            slope = slope + rubbing
            if chain_bar.size > 0:
                scaled = relative * joints[Joint.PER_SPEED, i]
                chain_bar[Parameter.friction, i] -= share * turn
                chain_bar[Parameter.friction_speed, i] += (rubbing * scaled) * turn
        if chain_bar.size > 0:
            chain_bar[Parameter.damping, i] -= relative * turn
        return slope * turn

    return add_joint
