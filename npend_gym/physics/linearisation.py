"""The equations of motion, and steps of them, linearised exactly about any states of a chain."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from typing_extensions import Unpack

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import MAX_DENSE, Chain, check_chain
from npend_gym.physics.arguments import check_inputs, check_limits
from npend_gym.physics.derivatives import sound
from npend_gym.physics.equations import StateKeywords, States, states_of
from npend_gym.physics.kernels.link_terms import count_terms
from npend_gym.physics.kernels.states import new_rates_scratch, rates_of_states
from npend_gym.physics.step import Chains, tangents
from npend_gym.physics.step import State as StepState

_ENTRIES = 2**21  # of the Jacobians that are made at once: 16 MB


class Linearisation(NamedTuple):
    """Derivatives by the state (q, u), and by the torques on some joints and the force on a cart.

    For rates: d/dt (delta q, delta u) = A (delta q, delta u) + B delta loads. For a step, the same
    expression is (delta q, delta u) after it.
    """

    A: FloatArray  # (..., 2m, 2m)
    B: FloatArray  # (..., 2m, inputs)


def jacobian(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike = 0.0,
    torque: ArrayLike | None = None,
    **more: Unpack[StateKeywords],
) -> FloatArray:
    """Return the derivatives of d/dt (q, u) by q, u and all torques and forces.

    Parameters
    ----------
    chain : Chain
        Of at most 10 000 rods.
    theta, omega : array_like, shape (..., n)
        Angles [rad] and angular velocities [rad/s], at rest or in motion; one number stands for
        all rods, and leading axes (instants of a trajectory, say) stand for as many states.
    torque : float or array_like, shape (..., n), optional
        Torque on the joints [N m]: a number acts on joint 0, an array on every joint.
    **more
        Force, state of a cart, springs, acceleration of the pivot: see `accelerations`.

    Returns
    -------
    ndarray, shape (..., 2m, 2m + n), on a cart (..., 2m, 2m + n + 1)
        For all coordinates, in the order of `accelerations`. The lower half has the derivatives of
        the accelerations. Its last columns are the inverse mass matrix times the directions of the
        loads.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.

    Notes
    -----
    Each column takes O(n) operations: `npend_gym.physics.kernels.virtual_power` has the equations.
    Dry friction near rest is the damper friction / friction_speed, see `linearise`.

    Examples
    --------
    >>> from npend_gym import Chain, physics
    >>> physics.jacobian(Chain.uniform(1), [0.0]).round(4).tolist()
    [[0.0, 1.0, 0.0], [-9.81, 0.0, 1.0]]
    """
    joints = range(check_chain(chain).n)
    return np.concatenate(linearise(chain, theta, omega, torque, joints, **more), axis=-1)


def linearise(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike = 0.0,
    torque: ArrayLike | None = None,
    joints: Sequence[int] = (0,),
    **more: Unpack[StateKeywords],
) -> Linearisation:
    """Return the derivatives of d/dt (q, u) with respect to the state and to torques.

    Parameters
    ----------
    chain, theta, omega, torque, **more
        As for `jacobian`, whose columns these are.
    joints : sequence of int
        Joints whose torques are the inputs; B has a column for each. On a cart n is the force on
        it, as in `EnvConfig.joints`. Its column is last if n is left out.

    Returns
    -------
    Linearisation
        A, shape (..., 2m, 2m), and B, shape (..., 2m, inputs).

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.

    Notes
    -----
    The derivatives are exact. So at rest, dry friction is a damper of friction / friction_speed:
    0.2 N m s/rad for 0.01 N m. It is that strong only while joints turn more slowly than
    `friction_speed`. A regulator designed with it may have gains of the wrong sign for any faster
    motion. For feedback, raise `friction_speed` to the speeds that noise and a step reach,
    ``Chain.from_dict(chain.as_dict() | {"friction_speed": 0.2})``, or leave out friction. The
    controllers of ``npend_gym.rl`` do so.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Cart, Chain, physics
    >>> A, B = physics.linearise(Chain.uniform(2), np.pi)
    >>> A.shape, B.shape
    ((4, 4), (4, 1))
    >>> float(np.linalg.eigvals(A).real.max().round(4))  # 1/s: how fast it falls from upright
    5.7874
    >>> physics.linearise(Chain.uniform(2, base=Cart(1.0)), np.pi, joints=()).B.shape
    (6, 1)
    """
    _checks.count("n", check_chain(chain).n, high=MAX_DENSE)
    wanted = check_inputs(chain, joints)
    states = states_of(chain, theta, omega, torque, **more)
    m, mechanism = states.mechanism.size, states.mechanism
    q, u, loads = states.rows
    below = np.empty((len(q), m, 2 * m + len(wanted)))
    mass = mechanism.parameters.masses[0].copy()
    rates_of_states(
        q, u, loads, np.array(wanted, np.int64), mechanism.arrays(), mass, new_rates_scratch(m),
        below,
    )  # fmt: skip
    above = np.broadcast_to(np.eye(m, below.shape[-1], k=m), below.shape)  # q' = u
    return _parted(np.concatenate([above, below], axis=-2), states)


def step_jacobian(
    chain: Chain,
    theta: ArrayLike,
    omega: ArrayLike = 0.0,
    torque: ArrayLike | None = None,
    *,
    dt: float,
    substeps: int | None = None,
    joints: Sequence[int] = (0,),
    **more: Unpack[StateKeywords],
) -> Linearisation:
    """Return the derivatives of the states after a step by the states before it and by torques.

    They are exact. See `linearise` for dry friction near rest.

    Parameters
    ----------
    chain, theta, omega, torque, **more
        As for `jacobian`; of rigid rods, on a cart or a pivot at rest.
    dt, substeps
        The step, as `Ensemble.advance` takes it: a Runge-Kutta step for each substep, by default as
        many as resolve the motion.
    joints : sequence of int
        Joints whose torques are the inputs; B has a column for each. On a cart n is the force on
        it, as in `EnvConfig.joints`. Its column is last if n is left out.

    Returns
    -------
    Linearisation
        A, shape (..., 2m, 2m), and B, shape (..., 2m, inputs).

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.
    FloatingPointError
        If a state leaves all bounds in the step.

    Examples
    --------
    >>> from npend_gym import Chain, physics
    >>> A, B = physics.step_jacobian(Chain.uniform(2), 0.1, dt=0.02)
    >>> A.shape, B.shape
    ((4, 4), (4, 1))
    """
    n, m = _checks.count("n", check_chain(chain).n, high=MAX_DENSE), chain.coordinates
    wanted = check_inputs(chain, joints)
    states = states_of(chain, theta, omega, torque, **more)
    q, u, loads = states.rows
    # joints whose torques are not asked for, but act
    others = [int(j) for j in np.flatnonzero(np.any(loads[:, :n], axis=0)) if j not in wanted]
    inputs = np.array([*wanted, *others], np.int64)
    if chain.stiffness is not None:
        raise ValueError(
            "chain must have rigid rods, because the steps of an ensemble do not resolve the "
            'vibrations of springs: take simulate(..., method="rk4").sensitivities()'
        )
    if states.mechanism.places == 2:
        raise ValueError(
            "pivot_acceleration must be None, because an ensemble has pivots at rest, got "
            f"{_checks.show(more.get('pivot_acceleration'))}: take "
            'simulate(..., method="rk4").sensitivities()'
        )
    check_limits(q[:, :n], u[:, :n])
    base = states.mechanism.base
    chains = Chains(chain.repeated(1), count_terms(chain.repeated(1), base), base)
    cut, wide = chains.cut(dt, substeps), 2 * m + inputs.size
    size = max(1, min(len(q), _ENTRIES // (2 * m * wide)))
    whole = np.empty((len(q), 2 * m, 2 * m + len(wanted)))
    for first in range(0, len(q), size):
        span = slice(first, first + size)
        state = StepState(q[span], u[span], loads[span][:, inputs], inputs)
        reached, columns = tangents(chains, state, cut)
        sound(reached)
        whole[span] = columns[..., : whole.shape[-1]]
    return _parted(whole, states)


def _parted(whole: FloatArray, states: States) -> Linearisation:
    """Return the columns by the state and by the inputs, with the leading axes of the states."""
    size = 2 * states.q.shape[-1]
    whole = whole.reshape(*states.q.shape[:-1], *whole.shape[1:])
    return Linearisation(whole[..., :size], whole[..., size:])
