"""Controllers that know the equations of motion: the references for what is learned."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import expm, solve_discrete_are
from scipy.optimize import minimize_scalar

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import STANDARD_GRAVITY, Chain
from npend_gym.envs import EnvConfig
from npend_gym.physics import linearise
from npend_gym.rl.controllers.single import takes_one_too
from npend_gym.rl.controllers.step_model import check_base

_SWING = 0.03  # rad, at whose speed dry friction is taken as a damper


def discretise(
    config: EnvConfig, angle: float | FloatArray, *, rub: bool | BoolArray = True
) -> tuple[FloatArray, FloatArray]:
    """Return the linear map of one environment step about rest at `angle` [rad], (n,) or for all.

    Dry friction is taken as the damper that brakes as much in a swing of 0.03 rad; its slope at
    rest holds for far slower motions alone. `rub`, for all joints or for each, (n,), says which
    have friction at all.

    Returns
    -------
    A : ndarray, shape (2n, 2n)
        Derivative of the next state (theta, omega) by the state.
    B : ndarray, shape (2n, joints)
        Derivative of the next state by the actions, which are held during the step (zero-order
        hold): the exponential of dt [[A, B], [0, 0]] contains both matrices.
    """
    n, joints = check_base(config).chain.n, config.joints.tolist()
    rates = linearise(_with_dampers(config, rub), angle, joints=joints)
    block = np.zeros((2 * n + len(joints),) * 2)
    block[: 2 * n] = np.hstack([rates.A, rates.B * config.max_torque])
    step: FloatArray = np.asarray(expm(block * config.dt))
    return step[: 2 * n, : 2 * n], step[: 2 * n, 2 * n :]


def _with_dampers(config: EnvConfig, rub: bool | BoolArray) -> Chain:
    """Return the chain with dampers in place of dry friction, see `discretise`."""
    chain = config.chain
    if not np.any(chain.friction):
        return chain
    dampers = chain.friction / np.hypot(chain.friction_speed, _SWING / time_scale(config))
    damping = (chain.damping + np.where(rub, dampers, 0.0)).tolist()
    return Chain.from_dict(chain.as_dict() | {"friction": 0.0, "damping": damping})


@dataclass(frozen=True, eq=False)
class StateFeedback:
    """Linear feedback: the actions are -gain (theta - angle, omega), angles wrapped."""

    angle: float | FloatArray  # rad, of all rods or of each, (n,)
    gain: FloatArray  # (joints, 2n)

    def __call__(self, observation: Any, info: dict[str, Any]) -> FloatArray:
        """Return the actions, shape (B, joints); of a single environment (joints,)."""
        del observation
        return -self.deviation(info) @ self.gain.T

    def deviation(self, info: dict[str, Any]) -> FloatArray:
        """Return the deviations (theta - angle, omega), angles in [-pi, pi), shape (B, 2n)."""
        theta: FloatArray = info["theta"]
        wrapped = np.remainder(theta - self.angle + np.pi, 2.0 * np.pi) - np.pi
        return np.concatenate([wrapped, info["omega"]], axis=-1)


def lqr(
    config: EnvConfig, angle: float | FloatArray = np.pi, action_weight: float = 1.0
) -> StateFeedback:
    """Return the linear-quadratic regulator about rest in an equilibrium.

    It minimises the sum over all steps of (theta - angle)^2 + (l / g) omega^2, added up over the
    rods, plus `action_weight` times the squared actions; l is the mean length of the rods.

    Dry friction is no linear force. In joints with a motor it is taken as none, and in the others
    as none or as the damper of a swing of 0.03 rad, see `discretise`: whichever has the smaller
    gains, so that the motor reaches its limit at larger deviations. Strong friction holds a passive
    joint still and is best taken as a damper, weak friction is best left out, and between them
    the gains with a damper become infinite.

    Parameters
    ----------
    config : EnvConfig
        Of the environment: ``gym.make("NPendulum-v0", ...).unwrapped.config``.
    angle : float or ndarray, shape (n,)
        0 for hanging, pi for upright [rad], for all rods or for each.
    action_weight : float
        Weight of the squared actions.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the actuated joints cannot stabilise this equilibrium.

    Examples
    --------
    >>> from npend_gym import rl
    >>> from npend_gym.envs import EnvConfig
    >>> task = {"n": 2, "mode": "balance"}
    >>> rl.evaluate(rl.lqr(EnvConfig(**task)), task, episodes=2).success.tolist()
    [True, True]
    """
    return StateFeedback(angle, riccati(config, angle, action_weight)[0])


def riccati(
    config: EnvConfig, angle: float | FloatArray, action_weight: float
) -> tuple[FloatArray, FloatArray]:
    """Return the gain of `lqr`, (joints, 2n), and S, (2n, 2n): the cost from x on is x S x."""
    passive = np.ones(check_base(config).chain.n, np.bool_)
    passive[config.joints] = False
    q, free = state_weights(config), np.zeros_like(passive)
    solutions: list[tuple[FloatArray, FloatArray]] = []
    for rub in (passive, free) if np.any(config.chain.friction[passive]) else (free,):
        a, b = discretise(config, angle, rub=rub)
        r = action_weight * np.eye(b.shape[1])
        s: FloatArray = np.asarray(solve_discrete_are(a, b, q, r), np.float64)
        gain = np.linalg.solve(r + b.T @ s @ b, b.T @ s @ a)
        solutions.append((np.asarray(gain, np.float64), s))
    # (l / g) omega^2 weighs like an angle
    return min(solutions, key=lambda one: float(np.linalg.norm(one[0] / np.sqrt(np.diag(q)))))


def state_weights(config: EnvConfig) -> FloatArray:
    """Return the weights of `lqr` on the deviations, a diagonal matrix (2n, 2n)."""
    return np.diag(np.repeat([1.0, time_scale(config) ** 2], config.chain.n))


def time_scale(config: EnvConfig) -> float:
    """Return sqrt(l / g) [s], where l is the mean length of the rods; without gravity g is 9.81."""
    return float(np.sqrt(config.chain.lengths.mean() / (config.chain.gravity or STANDARD_GRAVITY)))


def modal_damping(config: EnvConfig) -> StateFeedback:
    """Return a viscous brake by the first motor that damps the slowest mode as fast as possible.

    Its strength minimises the spectral radius of a step of the linear system about hanging at
    rest. A brake takes energy out of every mode of the chain; a brake that is too strong holds the
    upper rod still while the others continue to swing.

    Examples
    --------
    >>> from npend_gym import rl
    >>> from npend_gym.envs import EnvConfig
    >>> task = {"n": 2, "mode": "calm"}
    >>> rl.evaluate(rl.modal_damping(EnvConfig(**task)), task, episodes=2).success.tolist()
    [True, True]
    """
    a, b = discretise(config, 0.0)
    gain = np.zeros((b.shape[1], a.shape[0]))
    gain[0, config.chain.n] = 1.0

    def spectral_radius(log_strength: float) -> float:
        closed_loop = a - b @ (math.exp(log_strength) * gain)
        return float(np.abs(np.linalg.eigvals(closed_loop)).max())

    grid = np.linspace(-8.0, 4.0, 121)
    start = min(grid.tolist(), key=spectral_radius)
    best: Any = minimize_scalar(
        spectral_radius, bounds=(start - 0.1, start + 0.1), method="bounded"
    )
    return StateFeedback(0.0, math.exp(best.x) * gain)


@dataclass(frozen=True, eq=False)
class EnergySwingUp:
    """Swing-up by energy shaping: pump energy at the base, then balance by LQR near upright.

    While energy is missing the torque acts in the direction in which rod 0 turns, and against it
    where there is too much: action = pump_gain (1 - energy / upright_energy) omega_0 time_scale.
    The regulator takes over where its cost of the state is below `catch_cost`.
    """

    balance: StateFeedback
    cost: FloatArray  # S of `riccati`, (2n, 2n)
    upright_energy: float  # above hanging at rest [J]
    time_scale: float  # s
    pump_gain: float
    catch_cost: float

    @takes_one_too
    def __call__(self, observation: Any, info: dict[str, Any]) -> FloatArray:
        """Return the actions, shape (B, 1); of a single environment (1,)."""
        x = self.balance.deviation(info)
        omega: FloatArray = info["omega"]
        energy: FloatArray = info["energy"]
        missing = 1.0 - energy / self.upright_energy
        pump = self.pump_gain * missing * omega[:, 0] * self.time_scale
        near = np.sum(x @ self.cost * x, axis=1) < self.catch_cost
        return np.where(near[:, None], self.balance(observation, info), pump[:, None])


def energy_swing_up(
    config: EnvConfig, pump_gain: float = 30.0, catch_cost: float = 15.0
) -> EnergySwingUp:
    """Return a swing-up by energy shaping followed by `lqr`, for a motor at the base.

    The defaults did best for n = 2 among gains of 3 to 100 and costs of 5 to 50, in the 200
    episodes of the seeds 0 to 199.

    Examples
    --------
    >>> from npend_gym import rl
    >>> from npend_gym.envs import EnvConfig
    >>> task = {"n": 1, "mode": "swingup"}
    >>> rl.evaluate(rl.energy_swing_up(EnvConfig(**task)), task, episodes=2).success.tolist()
    [True, True]
    """
    gain, cost = riccati(config, np.pi, action_weight=1.0)
    balance, upright_energy = StateFeedback(np.pi, gain), config.chain.lifting_energy
    return EnergySwingUp(balance, cost, upright_energy, time_scale(config), pump_gain, catch_cost)
