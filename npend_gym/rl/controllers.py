"""Controllers that know the equations: the yardsticks for what is learned."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import expm, solve_discrete_are
from scipy.optimize import minimize_scalar

from npend_gym._checks import FloatArray
from npend_gym.envs import EnvConfig
from npend_gym.physics import linearise

Info = dict[str, Any]


def sampled(config: EnvConfig, angle: float) -> tuple[FloatArray, FloatArray]:
    """Return the linear map of one step about the chain at rest, all rods at `angle` [rad].

    Returns
    -------
    A : ndarray, shape (2n, 2n)
    B : ndarray, shape (2n, joints)
        By the actions, torques over their limit, which last for the step: the exponential of
        dt [[A, B], [0, 0]] has both.
    """
    n, joints = config.chain.n, config.joints.tolist()
    rates = linearise(config.chain, angle, joints=joints)
    block = np.zeros((2 * n + len(joints),) * 2)
    block[: 2 * n] = np.hstack([rates.A, rates.B * config.max_torque])
    step: FloatArray = np.asarray(expm(block * config.dt))
    return step[: 2 * n, : 2 * n], step[: 2 * n, 2 * n :]


@dataclass(frozen=True)
class StateFeedback:
    """Actions -K (theta - angle, omega), angles by the shortest way round."""

    angle: float  # rad
    gain: FloatArray  # K, (joints, 2n)

    def __call__(self, observation: Any, info: Info) -> FloatArray:
        """Return the actions, shape (B, joints)."""
        del observation
        return -self.state(info) @ self.gain.T

    def state(self, info: Info) -> FloatArray:
        """Return the deviations, shape (B, 2n)."""
        theta: FloatArray = info["theta"]
        away = np.remainder(theta - self.angle + np.pi, 2.0 * np.pi) - np.pi
        return np.concatenate([away, info["omega"]], axis=-1)


def lqr(config: EnvConfig, angle: float = np.pi, effort: float = 1.0) -> StateFeedback:
    """Return the linear-quadratic regulator of a chain at rest with all rods at `angle`.

    It minimises the sum over steps of the squares of theta - angle, of omega (times l/g, l being
    the mean rod) and of the actions (times `effort`).

    Raises
    ------
    numpy.linalg.LinAlgError
        If the equilibrium cannot be stabilised by the actuated joints.
    """
    return StateFeedback(angle, riccati(config, angle, effort)[0])


def riccati(config: EnvConfig, angle: float, effort: float) -> tuple[FloatArray, FloatArray]:
    """Return the gain of `lqr`, (joints, 2n), and S, (2n, 2n): from x on it costs x S x."""
    a, b = sampled(config, angle)
    q = running_cost(config)
    r = effort * np.eye(b.shape[1])
    s = np.asarray(solve_discrete_are(a, b, q, r), np.float64)
    gain = np.linalg.solve(r + b.T @ s @ b, b.T @ s @ a)
    return np.asarray(gain, np.float64), s


def running_cost(config: EnvConfig) -> FloatArray:
    """Return the weights of `lqr` on deviations, (2n, 2n)."""
    return np.diag(np.repeat([1.0, _pace(config) ** 2], config.chain.n))


def _pace(config: EnvConfig) -> float:
    """Return sqrt(l/g) [s], l the mean rod."""
    return float(np.sqrt(config.chain.lengths.mean() / config.chain.gravity))


def damper(config: EnvConfig) -> StateFeedback:
    """Return the viscous brake by a motor at the base that damps the slowest of all modes best.

    Its strength is the one with the smallest spectral radius of a step of the linear system about
    hanging at rest. A brake takes energy out of every mode of the chain; too strong, it holds the
    upper rod still and the others swing on.
    """
    a, b = sampled(config, 0.0)
    rate = np.zeros((b.shape[1], a.shape[0]))
    rate[0, config.chain.n] = 1.0

    def slowest(log_strength: float) -> float:
        closed = a - b @ (math.exp(log_strength) * rate)
        return float(np.abs(np.linalg.eigvals(closed)).max())

    grid = np.linspace(-8.0, 4.0, 121)
    start = min(grid.tolist(), key=slowest)
    best: Any = minimize_scalar(slowest, bounds=(start - 0.1, start + 0.1), method="bounded")
    return StateFeedback(0.0, math.exp(best.x) * rate)


@dataclass(frozen=True)
class SwingUp:
    """Pump energy at the base until it suffices to stand, and catch the chain near upright.

    The torque works with rod 0 while energy is missing and against it where there is too much,
    action = pump (1 - energy / needed) omega_0 sqrt(l/g). Where the regulator's cost of the state
    is below `reach`, it takes over.
    """

    catch: StateFeedback
    cost: FloatArray  # S, (2n, 2n)
    needed: float  # J
    pace: float  # s
    pump: float
    reach: float

    def __call__(self, observation: Any, info: Info) -> FloatArray:
        """Return the actions, shape (B, 1)."""
        x = self.catch.state(info)
        omega: FloatArray = info["omega"]
        energy: FloatArray = info["energy"]
        pumped = self.pump * (1.0 - energy / self.needed) * omega[:, 0] * self.pace
        near = np.sum(x @ self.cost * x, axis=1) < self.reach
        return np.where(near[:, None], self.catch(observation, info), pumped[:, None])


def swing_up(config: EnvConfig, pump: float = 30.0, reach: float = 15.0) -> SwingUp:
    """Return energy-shaping swing-up followed by `lqr`, for a motor at the base.

    The defaults did best for n = 2 among pumps of 3 to 100 and reaches of 5 to 50, in 200 episodes
    of the seeds from 0 on.
    """
    gain, cost = riccati(config, np.pi, effort=1.0)
    catch, needed = StateFeedback(np.pi, gain), config.chain.lifting_energy
    return SwingUp(catch, cost, needed, _pace(config), pump, reach)
