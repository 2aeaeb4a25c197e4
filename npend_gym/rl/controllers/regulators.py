"""Controllers that know the equations of motion: the references for what is learned."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm, solve_discrete_are
from scipy.optimize import minimize_scalar

from npend_gym import _checks
from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import STANDARD_GRAVITY, Chain
from npend_gym.envs import EnvConfig
from npend_gym.envs.goals import checked_equilibrium
from npend_gym.physics import linearise
from npend_gym.rl.controllers.feedback import StateFeedback, state_names
from npend_gym.rl.controllers.step_model import check_config, checked_place, motors

_SWING = 0.03  # rad, below whose speed dry friction fades for feedback
_OF_CART = 4.0  # weight of the square of the cart's place over the rail
_ROUNDING = 1e-12  # of weights that are given, over the largest
_RIGHT, _WRONG = 1e-6, 1e-3  # residuals of Riccati's equation, over its solution


def discretise(
    config: EnvConfig, angle: float | FloatArray, *, rub: bool | BoolArray = True
) -> tuple[FloatArray, FloatArray]:
    """Return the linear map of one environment step about rest at `angle` [rad], (n,) or for all.

    Dry friction is that of `softened`: at rest the damper that brakes as much in a swing of 0.03
    rad. `rub`, for all joints or for each, (n,), says which have friction at all.

    Returned are the derivatives of the next state (q, u) by the state, (2c, 2c), and by the
    actions, (2c, joints), which are held during the step.
    """
    size, inputs = config.state_size, config.joints.size
    rates = linearise(softened(config, rub), angle, joints=config.joints.tolist())
    block = np.zeros((size + inputs,) * 2)  # exp(dt [[A, B], [0, 0]]) has both matrices
    block[:size] = np.hstack([rates.A, rates.B * config.action_limits])
    step: FloatArray = np.asarray(expm(block * config.dt))
    return step[:size, :size], step[:size, size:]


def softened(config: EnvConfig, rub: bool | BoolArray = True) -> Chain:
    """Return the chain whose derivatives hold for motions as fast as a swing of 0.03 rad.

    Dry friction at rest grows with speed as a strong damper does, but only up to `friction_speed`.
    Noise and a step's motion are faster. With gains for such a damper a motor drives a joint as if
    something held it. In the chain that is returned, friction fades below the speed of that swing.
    `rub` says which joints have friction at all, for all joints or for each, (n,).
    """
    chain = config.chain
    if not np.any(chain.friction):
        return chain
    speed = np.hypot(chain.friction_speed, _SWING / time_scale(config))
    friction = np.where(rub, chain.friction, 0.0)
    changes = {"friction": friction.tolist(), "friction_speed": speed.tolist()}
    return Chain.from_dict(chain.as_dict() | changes)


def lqr(
    config: EnvConfig,
    angle: float | FloatArray = np.pi,
    action_weight: float = 1.0,
    *,
    Q: ArrayLike | None = None,  # noqa: N803 - as in all textbooks
    R: ArrayLike | None = None,  # noqa: N803
    cart_position: float = 0.0,
) -> StateFeedback:
    """Return the linear-quadratic regulator about rest in an equilibrium.

    It minimises the sum over all steps of (theta - angle)^2 + (l / g) omega^2, added up over the
    rods, plus `action_weight` times the squared actions; l is the mean length of the rods. A cart
    adds 4 (position^2 + (l / g) velocity^2) / rail^2, with the position from `cart_position`.

    Dry friction is not a linear force. In joints with a motor it is left out. In the others there
    are two ways. It fades below the speed of a swing of 0.03 rad, and so acts as a damper at rest;
    or it is left out too. `lqr` chooses the way with the smaller gains, so that the motor reaches
    its limit at larger deviations. Strong friction holds a passive joint still and is best taken as
    a damper. Weak friction is best left out. In between, the gains with a damper become infinite.

    Parameters
    ----------
    config : EnvConfig
        Settings of the environment: ``gym.make("npend/SwingUp-v1", ...).unwrapped.config``.
    angle : float or ndarray, shape (n,)
        0 for hanging, pi for upright [rad], for all rods or for each.
    action_weight : float
        Weight of the squared actions.
    Q : array_like, shape (2c, 2c), or (2c,) of a diagonal, optional
        Symmetric, positive semidefinite weights of the deviation of the state, in place of those
        above. The state is the angles [rad], the position of a cart [m], then their rates.
    R : array_like, shape (joints, joints), or (joints,) of a diagonal, optional
        Symmetric, positive definite weights of the actions, in place of `action_weight`. An action
        is a torque or force over its limit: weights W of torques are
        ``R = W * np.outer(config.action_limits, config.action_limits)``.
    cart_position : float
        Position at which the cart should stand [m], within the rail.

    Raises
    ------
    TypeError, ValueError
        If an argument breaks its rule, or the environment has no motor.
    numpy.linalg.LinAlgError
        If the actuated joints cannot stabilise this equilibrium, or double precision does not
        suffice, as for one motor at the base of 14 upright rods.

    Examples
    --------
    >>> from npend_gym import rl
    >>> from npend_gym.envs import EnvConfig
    >>> task = {"n": 2, "mode": "balance"}
    >>> rl.evaluate(rl.lqr(EnvConfig(**task)), task, episodes=2).success.tolist()
    [True, True]
    """
    check_config(config)
    checked_equilibrium("angle", _checks.vector("angle", angle, config.n))
    place = checked_place(config, cart_position)
    weight: float | FloatArray = _checks.positive_number("action_weight", action_weight)
    if R is not None:
        if weight != 1.0:
            raise ValueError("action_weight must be left out with R, which has the same place")
        weight = _weights("R", R, config.joints.size, "an action of config.joints", definite=True)
    states = f"each of {state_names(config)}"
    q = None if Q is None else _weights("Q", Q, config.state_size, states)
    gain = riccati(config, angle, weight, q).gain
    return StateFeedback(config, _checks.array("angle", angle), gain, place)  # a copy


def _weights(
    name: str, given: ArrayLike, size: int, entries: str, *, definite: bool = False
) -> FloatArray:
    """Return a matrix of weights (size, size), given as one or by its diagonal."""
    weights = _checks.array(name, given)
    if weights.shape not in ((size,), (size, size)):
        raise ValueError(
            f"{name} must have the shape {(size, size)}, or {(size,)} of a diagonal, with a row "
            f"for {entries}; got the shape {weights.shape}"
        )
    weights = np.diag(weights) if weights.ndim == 1 else weights
    rounding = _ROUNDING * np.abs(weights).max()
    if (np.abs(weights - weights.T) > rounding).any():
        raise ValueError(
            f"{name} must be symmetric, got {_checks.show(weights.tolist())}: ({name} + {name}.T) "
            "/ 2 costs the same"
        )
    weights = 0.5 * (weights + weights.T)
    least = float(np.linalg.eigvalsh(weights)[0])
    if least < -rounding or (definite and least <= rounding):
        rule = "definite" if definite else "semidefinite"
        raise ValueError(
            f"{name} must be positive {rule}, got an eigenvalue of {least:.6g}: a cost below zero "
            "has no minimum" + (", and an action that costs nothing no bound" if definite else "")
        )
    return weights


class Riccati(NamedTuple):
    """What solves Riccati's equation, for feedback about rest."""

    gain: FloatArray  # (joints, 2c), of `lqr`
    cost: FloatArray  # (2c, 2c): S, the cost from x on is x S x
    rub: BoolArray  # (n,): in which joints dry friction is not left out, see `softened`


def riccati(
    config: EnvConfig,
    angle: float | FloatArray,
    action_weight: float | FloatArray,
    q: FloatArray | None = None,
) -> Riccati:
    """Return the gain of `lqr`, the cost, and how dry friction is taken.

    `action_weight` is a number, or a matrix (joints, joints); q are other weights than those of
    `lqr`, (2c, 2c).
    """
    check_config(config)
    passive = np.ones(config.n, np.bool_)
    passive[motors(config)] = False
    usual, free = state_weights(config), np.zeros_like(passive)
    q, r = usual if q is None else q, np.asarray(action_weight)
    r = r if r.ndim == 2 else r * np.eye(config.joints.size)
    rubbing = (passive, free) if np.any(config.chain.friction[passive]) else (free,)
    systems = [(rub, *discretise(config, angle, rub=rub)) for rub in rubbing]
    solutions: list[tuple[Riccati, FloatArray]] = []
    try:
        for rub, a, b in systems:
            gain, s = _solution(a, b, q, r)
            solutions.append((Riccati(gain, s, rub), a - b @ gain))
        # (l / g) omega^2 weighs like an angle
        found, closed_loop = min(
            solutions, key=lambda one: float(np.linalg.norm(one[0].gain / np.sqrt(np.diag(usual))))
        )
        growth = float(np.abs(np.linalg.eigvals(closed_loop)).max())
        if growth >= 1.0:
            raise np.linalg.LinAlgError(f"deviations that grow by {growth:.6g} in each step")
    except (np.linalg.LinAlgError, ValueError) as error:  # of SciPy
        own = "" if q is usual else ", or with weights in Q of all that does not calm by itself"
        raise np.linalg.LinAlgError(
            "the motors must be able to stabilise the equilibrium at angle "
            f"{_checks.show(angle)}, and double precision must suffice for {config.n} rods with "
            f"motors at joints {config.joints.tolist()}; got: {error}. Make the environment with "
            f"fewer rods, more motors, a smaller dt, or a larger max_torque or max_force{own}"
        ) from error
    return found


def _solution(
    a: FloatArray, b: FloatArray, q: FloatArray, r: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the gain and S of Riccati's equation.

    Where S has large and small eigenvalues, SciPy loses digits. It is then solved again in
    coordinates in which the S that was found is the identity.
    """

    def checked(s: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        gain = np.asarray(np.linalg.solve(r + b.T @ s @ b, b.T @ s @ a), np.float64)
        residual = np.linalg.norm(q + a.T @ s @ (a - b @ gain) - s) / (np.linalg.norm(s) or 1.0)
        return float(residual), gain, s

    best = checked(np.asarray(solve_discrete_are(a, b, q, r), np.float64))
    with suppress(np.linalg.LinAlgError, ValueError):
        for _ in range(3 if best[0] > _RIGHT else 0):
            sizes, axes = np.linalg.eigh(best[2])
            sizes = np.sqrt(np.maximum(sizes, np.finfo(float).eps * sizes[-1]))
            to, back = (axes * sizes).T, axes / sizes
            again: Any = solve_discrete_are(to @ a @ back, to @ b, back.T @ q @ back, r)
            best = min(best, checked(to.T @ again @ to), key=lambda one: one[0])
    if not best[0] < _WRONG:
        raise np.linalg.LinAlgError(f"Riccati's equation is missed by {best[0]:.2g}")
    return best[1:]


def state_weights(config: EnvConfig) -> FloatArray:
    """Return the weights of `lqr` on the deviations, a diagonal matrix (2c, 2c)."""
    of_q = np.ones(config.state_size // 2)
    of_q[config.n :] = 0.0 if config.rail is None else _OF_CART / config.rail**2
    return np.diag(np.concatenate([of_q, time_scale(config) ** 2 * of_q]))


def time_scale(config: EnvConfig) -> float:
    """Return sqrt(l / g) [s], where l is the mean length of the rods; without gravity g is 9.81."""
    return float(np.sqrt(config.chain.lengths.mean() / (config.chain.gravity or STANDARD_GRAVITY)))


def modal_damping(config: EnvConfig) -> StateFeedback:
    """Return a viscous brake by the first motor that damps the slowest mode as fast as possible.

    Its strength minimises the spectral radius of a step of the linear system about hanging at rest.
    A brake takes energy out of every mode of the chain; a brake that is too strong holds the upper
    rod, or the cart, still while the others continue to swing. A cart comes back to the place of a
    release at rest, but no force pulls it there. So its position is left out of the system. Without
    gravity no mode swings, which raises a ValueError.

    Examples
    --------
    >>> from npend_gym import rl
    >>> from npend_gym.envs import EnvConfig
    >>> task = {"n": 2, "mode": "calm"}
    >>> rl.evaluate(rl.modal_damping(EnvConfig(**task)), task, episodes=2).success.tolist()
    [True, True]
    """
    check_config(config)
    _checks.positive_number("gravity", config.chain.gravity)
    a, b = discretise(config, 0.0)
    gain = np.zeros((b.shape[1], a.shape[0]))
    gain[0, a.shape[0] // 2 :] = turned_by(config)[0]
    moving = [k for k in range(len(a)) if not (config.has_cart and k == config.n)]

    def spectral_radius(log_strength: float) -> float:
        closed_loop = a - b @ (math.exp(log_strength) * gain)
        return float(np.abs(np.linalg.eigvals(closed_loop[np.ix_(moving, moving)])).max())

    grid = np.linspace(-8.0, 4.0, 121)
    before, start = math.nan, min(grid.tolist(), key=spectral_radius)
    # a motor that is far weaker or stronger than the chain's weight
    while start != before and start in (grid[0], grid[-1]):
        grid += 12.0 if start == grid[-1] else -12.0
        before, start = start, min([start, *grid.tolist()], key=spectral_radius)
    best: Any = minimize_scalar(
        spectral_radius, bounds=(start - 0.1, start + 0.1), method="bounded"
    )
    return StateFeedback(config, 0.0, math.exp(best.x) * gain)


def turned_by(config: EnvConfig) -> FloatArray:
    """Return, for each motor, how the rate at which it moves follows from u, (joints, c)."""
    rates = np.eye(config.n + 1)
    rates[range(1, config.n), range(config.n - 1)] = -1.0  # a joint turns by omega_i - omega_{i-1}
    return rates[config.joints, : config.state_size // 2]
