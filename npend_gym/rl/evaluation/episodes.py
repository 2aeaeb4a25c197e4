"""How well a controller does: episodes of seeds that no training has seen, all side by side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.envs.registration import ENV_ID
from npend_gym.rl.evaluation.models import Model, as_controller
from npend_gym.rl.evaluation.rollouts import Controller, make_envs, rollout
from npend_gym.rl.evaluation.seeds import HELD_OUT


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What happened in each episode, arrays of shape (episodes,).

    Attributes
    ----------
    returns : ndarray, float
        Sum of the rewards.
    success : ndarray, bool
        ``info["success"]`` of the last step.
    settling_time : ndarray, float
        Time [s] from which on ``info["success"]`` was true: where the goal must hold for 5 s, these
        are included. NaN without success.
    motor_work : ndarray, float
        Work [J] that the motors did and took up, both counted as positive: the sum over steps and
        motors of abs(torque times turn of the joint), with the torque that acted,
        ``info["torque"]``.
    """

    returns: FloatArray
    success: NDArray[np.bool_]
    settling_time: FloatArray
    motor_work: FloatArray

    @property
    def success_rate(self) -> float:
        """Fraction of successful episodes."""
        return float(self.success.mean())

    @property
    def success_interval(self) -> tuple[float, float]:
        """Wilson's confidence interval of 95 % for the success rate."""
        from scipy.stats import binomtest  # takes long to import

        test = binomtest(int(self.success.sum()), self.success.size)
        low, high = test.proportion_ci(method="wilson")
        return float(low), float(high)

    def as_row(self) -> dict[str, float | None]:
        """Return the means, with the confidence interval of the success rate.

        "settling_time" is a mean over the successful episodes, None where there are none.
        """
        low, high = self.success_interval
        settled = self.settling_time[self.success]
        return {
            "episodes": self.success.size,
            "success": self.success_rate,
            "success_low": round(low, 4),
            "success_high": round(high, 4),
            "return": round(float(self.returns.mean()), 2),
            "settling_time": round(float(settled.mean()), 2) if settled.size else None,
            "motor_work": round(float(self.motor_work.mean()), 2),
        }


def evaluate(
    controller: Controller | Model,
    keywords: Mapping[str, Any],
    *,
    episodes: int = 100,
    seed: int = HELD_OUT,
    env_id: str = ENV_ID,
) -> Evaluation:
    """Let `controller` act in whole episodes, all side by side.

    Parameters
    ----------
    controller : callable, or a model of Stable-Baselines3
        ``controller(observation, info)`` returns the actions, see `Controller`. A model takes its
        deterministic actions. It keeps the state of a recurrent network, and it observes through
        the statistics of its `VecNormalize` environment.
    keywords : dict
        Keywords of ``gym.make_vec(env_id, ...)``. Those of a policy, ``policy.env``, make the
        environment show what the policy observes, whatever the environment shows by default.
    episodes : int
        Number of episodes; they have the seeds `seed`, `seed` + 1 and so on.
    seed : int
        Seed of the first episode.
    env_id : str
        Environment to play, "npend/SwingUp-v1" say. Its `reward_threshold` is a mean of `returns`.

    Returns
    -------
    Evaluation

    Raises
    ------
    ValueError, TypeError
        If an argument or a keyword breaks its rule; or if a model was trained on observations that
        were changed, and the change is not known: by a wrapper of Gymnasium, or by a `VecNormalize`
        with which the model was not loaded, as far as the model shows that it had one.

    Examples
    --------
    >>> from npend_gym import rl
    >>> policy = rl.Policy.pretrained("balance-2")
    >>> rl.evaluate(policy, policy.env, episodes=2).success.tolist()
    [True, True]
    """
    envs = make_envs(env_id, _checks.count("episodes", episodes), keywords)
    config = envs.unwrapped.config
    controller = as_controller(controller, config)
    observation, first = envs.reset(seed=seed)
    angles, idle = _motor_places(first, config.joints), np.zeros((episodes, 0))
    returns, work, last_failure = np.zeros(episodes), np.zeros(episodes), np.zeros(episodes)
    success = np.zeros(episodes, np.bool_)
    for running, _, reward, info in rollout(controller, envs, observation, first):
        before, angles = angles, _motor_places(info, config.joints)
        step_work = np.abs(info.get("torque", idle) * (angles - before)).sum(axis=1)
        returns += np.where(running, reward, 0.0)
        work += np.where(running, step_work, 0.0)
        success = np.where(running, info["success"], success)
        last_failure = np.where(running & ~info["success"], info["time"], last_failure)
    envs.close()
    return Evaluation(returns, success, np.where(success, last_failure, np.nan), work)


def _motor_places(info: dict[str, Any], joints: NDArray[np.int64]) -> FloatArray:
    """Return the angle [rad] of each actuated joint, or the place [m] of the cart, (B, joints)."""
    relative = np.diff(info["theta"], axis=1, prepend=0.0)
    if "cart_position" in info:
        relative = np.column_stack([relative, info["cart_position"]])
    return relative[:, joints]
