"""RealAIGym's score of 2025: how long a chain is up that is knocked down again and again.

`GlobalPolicyTestingControllerV2` and `leaderboard/pendubot/simulation_v3` of
dfki-ric-underactuated-lab/double_pendulum have the definition and the numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from npend_gym import _checks
from npend_gym._checks import BoolArray, FloatArray
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.registration import ENV_ID
from npend_gym.rl.evaluation.disturbances import DisturbedEnvs
from npend_gym.rl.evaluation.models import Model, as_controller
from npend_gym.rl.evaluation.performance import UP
from npend_gym.rl.evaluation.rollouts import Controller, nominal_env, rollout
from npend_gym.rl.evaluation.seeds import HELD_OUT

_STIFFNESS, _DAMPING = 10.0 / 6.0, 1.0 / 6.0  # N m/rad and N m s/rad over the torque limit, 6 N m


def turning_torque(
    config: EnvConfig, goal: FloatArray, theta: FloatArray, omega: FloatArray
) -> FloatArray:
    """Return the torques at all joints [N m], (B, n), that turn them to their goals [rad], (B, n).

    A proportional-differential controller with compensation of gravity, within the torque limit.
    """
    angle = np.diff(theta, axis=1, prepend=0.0)
    speed = np.diff(omega, axis=1, prepend=0.0)
    error = np.remainder(goal - angle + np.pi, 2.0 * np.pi) - np.pi
    drive = config.max_torque * (_STIFFNESS * error - _DAMPING * speed)
    weight = config.chain.gravity * config.chain.lift * np.sin(theta)
    drive += np.cumsum(weight[:, ::-1], axis=1)[:, ::-1]
    return np.clip(drive, -config.max_torque, config.max_torque)


class KnockDowns:
    """For short times, motors at all joints turn them to random angles, in place of the controller.

    The controller that does so, `turning_torque`, knows the exact state.

    Attributes
    ----------
    acts : ndarray, bool, shape (steps, lanes)
        In which steps.
    """

    def __init__(
        self, config: EnvConfig, steps: int, lanes: int, count: int, seconds: float, seed: int
    ) -> None:
        rng = np.random.default_rng([seed, 2])
        time = steps * config.dt
        regular = np.linspace(time / (count + 1), time, count)
        begins = regular + rng.uniform(-1.0, 1.0, (lanes, count)) * time / 60.0
        now = config.dt * np.arange(steps)[:, None, None] + 1e-9
        on: BoolArray = (begins <= now) & (now < begins + seconds)
        self.acts: BoolArray = np.any(on, axis=2)
        self._which = np.where(on, np.arange(count), 0).max(axis=2, initial=0)
        self._goals = rng.uniform(-np.pi, np.pi, (lanes, max(1, count), config.n))
        self._config, self._lanes = config, np.arange(lanes)

    def __call__(self, step: int, info: dict[str, Any]) -> tuple[FloatArray, BoolArray]:
        """Return the torques of a step, zero in lanes where the controller acts."""
        acts, goal = self.acts[step], self._goals[self._lanes, self._which[step]]
        torque = turning_torque(self._config, goal, info["theta"], info["omega"])
        return np.where(acts[:, None], torque, 0.0), ~acts


@dataclass(frozen=True, eq=False)
class Recovery:
    """How long the chain was up in each episode, see `recovery`.

    Attributes
    ----------
    uptime : ndarray, shape (episodes,)
        Fraction of the time for which the tip was above 0.9 of the chain's length.
    """

    uptime: FloatArray

    @property
    def score(self) -> float:
        """Mean fraction of the time."""
        return float(self.uptime.mean())

    def as_row(self) -> dict[str, float]:
        """Return the score, and its least and largest values over the episodes."""
        found = {"score": self.score, "least": self.uptime.min(), "largest": self.uptime.max()}
        return {name: round(float(value), 4) for name, value in found.items()}


def recovery(
    controller: Controller | Model,
    keywords: dict[str, Any],
    *,
    env_id: str = ENV_ID,
    seed: int = HELD_OUT,
    episodes: int = 20,
    seconds: float = 60.0,
    resets: int = 15,
    reset_seconds: float = 0.2,
) -> Recovery:
    """Judge by the score of the third AI Olympics with RealAIGym: the time up between knock-downs.

    In episodes of 60 s the chain is knocked down 15 times: for 0.2 s motors at all joints, with the
    torque limit of the environment, turn them to random angles in place of the controller. The
    k-th time is 60 s/16 + (k - 1) (60 s - 60 s/16)/14, plus up to 1 s in either direction. The
    score is the fraction of the time for which the tip is above 0.9 of the chain's length.

    Parameters
    ----------
    controller : callable, or a model of Stable-Baselines3
        As for `evaluate`.
    keywords : dict
        Keywords of ``gym.make_vec(env_id, ...)``.
    env_id : str
    seed : int
        Seed of the first episode, and of all knock-downs.
    episodes : int
    seconds : float
        Duration of an episode.
    resets : int
        Number of knock-downs.
    reset_seconds : float
        Duration of each.

    Returns
    -------
    Recovery

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, or the environment has no motor or a cart.

    References
    ----------
    J. S. B. Choe, B. Choi and J. Kim, arXiv:2505.07516 (2025); `leaderboard/pendubot/simulation_v3`
    and `GlobalPolicyTestingControllerV2` of dfki-ric-underactuated-lab/double_pendulum. Their
    controller has an integral part too, which in 0.2 s adds 1 % of the torque limit at most.

    Examples
    --------
    >>> from npend_gym.rl import Policy, recovery
    >>> policy = Policy.pretrained("swingup-1")
    >>> round(float(recovery(policy, policy.env, episodes=2).uptime.mean()), 2)
    0.96
    """
    count, times = _checks.count("episodes", episodes), _checks.count("resets", resets, low=0)
    nominal, config, steps = nominal_env(env_id, keywords, seconds, cart=False)
    controller = as_controller(controller, config)
    length = _checks.positive_number("reset_seconds", reset_seconds)
    knocks = KnockDowns(config, steps, count, times, length, seed)
    envs = DisturbedEnvs(env_id, count, nominal, config, knocks)
    up = np.zeros(count)  # steps
    for running, _, _, info in rollout(controller, envs, *envs.reset(seed=seed)):
        up += running & (info["tip_height"] > UP * config.chain.total_length)
    envs.close()
    return Recovery(up / steps)
