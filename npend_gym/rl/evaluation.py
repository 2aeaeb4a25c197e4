"""What an agent reaches: episodes of seeds that no training has seen, all side by side."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import npend_gym.envs.registration
from npend_gym import _checks
from npend_gym._checks import FloatArray

HELD_OUT = 1_000_000  # the first seed of evaluations; training takes seeds below


class Agent(Protocol):
    """Policies and controllers: observations (B, k) and infos in, actions (B, joints) out."""

    def __call__(self, observation: NDArray[np.float32], info: dict[str, Any]) -> NDArray[Any]:
        """Return the actions, torques over their limit."""
        ...


@dataclass(frozen=True)
class Evaluation:
    """What happened in each episode, arrays of shape (episodes,)."""

    returns: FloatArray
    success: NDArray[np.bool_]  # of the last step
    since: FloatArray  # time from which on the goal stayed met [s]; NaN where there is no success
    spent: FloatArray  # work done by and on the motors, without regard to sign [J]

    @property
    def rate(self) -> float:
        """Share of successful episodes."""
        return float(self.success.mean())

    def as_row(self) -> dict[str, float | None]:
        """Return the means, with the success rate's confidence interval of 95 %.

        "since" is a mean over the successful episodes, None where there are none.
        """
        low, high = wilson_interval(int(self.success.sum()), self.success.size)
        since = self.since[self.success]
        return {
            "episodes": self.success.size,
            "success": self.rate,
            "success_low": round(low, 4),
            "success_high": round(high, 4),
            "return": round(float(self.returns.mean()), 2),
            "since": round(float(since.mean()), 2) if since.size else None,
            "joules": round(float(self.spent.mean()), 2),
        }


def evaluate(
    agent: Agent, keywords: dict[str, Any], *, episodes: int = 100, seed: int = HELD_OUT
) -> Evaluation:
    """Let `agent` act in `episodes` episodes, of seeds `seed`, `seed` + 1 and so on.

    Parameters
    ----------
    agent : callable
        ``agent(observation, info)`` returns the actions of all lanes.
    keywords : dict
        Of ``gym.make_vec("NPendulum-v0", ...)``.

    Raises
    ------
    ValueError, TypeError
        If a keyword breaks its rule.
    """
    npend_gym.envs.registration.register_envs()
    envs: Any = gym.make_vec(
        "NPendulum-v0", num_envs=_checks.count("episodes", episodes), **keywords
    )
    config = envs.unwrapped.config
    observation, info = envs.reset(seed=seed)
    angles = _joint_angles(info["theta"], config.joints)
    returns, spent, since = np.zeros(episodes), np.zeros(episodes), np.zeros(episodes)
    success, running = np.zeros(episodes, np.bool_), np.ones(episodes, np.bool_)
    while running.any():
        action = np.clip(np.asarray(agent(observation, info), np.float64), -1.0, 1.0)
        observation, reward, terminated, truncated, info = envs.step(action)
        before, angles = angles, _joint_angles(info["theta"], config.joints)
        work = np.abs(config.max_torque * action * (angles - before)).sum(axis=1)
        returns += np.where(running, reward, 0.0)
        spent += np.where(running, work, 0.0)
        success = np.where(running, info["success"], success)
        since = np.where(running & ~info["success"], info["time"], since)
        running &= ~(terminated | truncated)
    envs.close()
    return Evaluation(returns, success, np.where(success, since, np.nan), spent)


def _joint_angles(theta: FloatArray, joints: NDArray[np.int64]) -> FloatArray:
    """Return by how much each actuated joint is bent [rad], (B, joints)."""
    bent = np.diff(theta, axis=1, prepend=0.0)
    return bent[:, joints]


def wilson_interval(successes: int, trials: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return Wilson's confidence interval of a success rate.

    The rates p with (k/n - p)^2 <= z^2 p (1 - p) / n, for k successes in n trials.
    """
    trials = _checks.count("trials", trials)
    successes = _checks.count("successes", successes, low=0, high=trials)
    z = NormalDist().inv_cdf(0.5 + 0.5 * confidence)
    centre = successes + 0.5 * z * z
    width = z * math.sqrt(successes * (trials - successes) / trials + 0.25 * z * z)
    low, high = ((centre + side * width) / (trials + z * z) for side in (-1.0, 1.0))
    return max(low, 0.0), min(high, 1.0)
