"""How well a controller does: episodes of seeds that no training has seen, all side by side."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.rl.evaluation.models import Model, as_controller
from npend_gym.rl.evaluation.rollouts import Controller, joint_motion, rollout
from npend_gym.rl.evaluation.seeds import HELD_OUT
from npend_gym.rl.evaluation.settings import EnvLike, evaluating, setting_of

_EPISODES = 100


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation:
    """What happened in each episode, arrays of shape (episodes,).

    Attributes
    ----------
    returns : ndarray, float
        Sum of the rewards.
    success : ndarray, bool
        ``info["success"]`` of the last step. In a mode that defines neither `achieved` nor `failed`
        there is none: NaN, and so are the rate and its interval; `as_row` has None.
    settling_time : ndarray, float
        Last time [s] at which ``info["success"]`` was not yet true: where the goal must hold for
        5 s, these are included. NaN without success.
    motor_work : ndarray, float
        Work [J] that the motors did and took up, both counted as positive: the sum over steps and
        motors of abs(torque times turn of the joint), with the torque that acted,
        ``info["torque"]``.
    """

    returns: FloatArray
    success: NDArray[Any]
    settling_time: FloatArray
    motor_work: FloatArray

    def __repr__(self) -> str:
        row = self.as_row()
        if not self._evaluated:
            return (
                f"Evaluation({row['episodes']} episodes: the mode defines no success; mean return "
                f"{row['return']:.2f})"
            )
        low, high = row["success_low"], row["success_high"]
        settled = row["settling_time"]
        since = "" if settled is None else f" from {settled:.2f} s on"
        return (
            f"Evaluation({row['episodes']} episodes: success {row['success']:.1%}{since}, 95 % "
            f"confidence {low:.1%} to {high:.1%}; mean return {row['return']:.2f}, motor work "
            f"{row['motor_work']:.2f} J)"
        )

    @property
    def success_rate(self) -> float:
        """Fraction of successful episodes."""
        return float(self.success.mean())

    @property
    def success_interval(self) -> tuple[float, float]:
        """Wilson's confidence interval of 95 % for the success rate."""
        from scipy.stats import binomtest  # takes long to import

        if not self._evaluated:
            return math.nan, math.nan
        test = binomtest(int(self.success.sum()), self.success.size)
        low, high = test.proportion_ci(method="wilson")
        return float(low), float(high)

    @property
    def _evaluated(self) -> bool:
        """Whether the mode defines a success."""
        return self.success.dtype == np.bool_

    def as_row(self) -> dict[str, float | None]:
        """Return the means, with the confidence interval of the success rate.

        "settling_time" is a mean over the successful episodes, None where there are none.
        """
        rate, (low, high) = self.success_rate, self.success_interval
        settled = self.settling_time[np.isfinite(self.settling_time)]
        evaluated = self._evaluated
        return {
            "episodes": self.success.size,
            "success": rate if evaluated else None,
            "success_low": round(low, 4) if evaluated else None,
            "success_high": round(high, 4) if evaluated else None,
            "return": round(float(self.returns.mean()), 2),
            "settling_time": round(float(settled.mean()), 2) if settled.size else None,
            "motor_work": round(float(self.motor_work.mean()), 2),
        }


@evaluating
def evaluate(
    model: Controller | Model,
    env: EnvLike,
    *,
    episodes: int = _EPISODES,
    seed: int = HELD_OUT,
    deterministic: bool = True,
    n_eval_episodes: int | None = None,
    options: Mapping[str, Any] | None = None,
) -> Evaluation:
    """Let a model act in whole episodes, all side by side.

    Parameters
    ----------
    model : callable, or anything with the method `predict` of Stable-Baselines3
        ``model(observation, info)`` returns the actions, see `Controller`. With noise, delay or
        rounding of sensors the state in `info` is that observed. A module of PyTorch may take the
        observations alone, (B, k), and return a tensor.
        ``model.predict(observation, state, episode_start, deterministic=True)`` returns the actions
        and the state of a recurrent model, which is kept.
    env : mapping, str, EnvSpec, or environment
        An id such as "npend/SwingUp-v1", the specification ``gym.spec(id)``, or a dict of keywords
        of ``gym.make_vec``, whose "id" is "NPendulum-v0" if left out. Those of a policy,
        ``policy.env``, make the environment show what the policy observes. Or a vector environment
        of Gymnasium or Stable-Baselines3, with its wrappers: another one like it is played, with a
        environment for each episode, and the model acts behind these wrappers, whose statistics
        stay as they are. Where no wrapper changes observations or actions, a model of
        Stable-Baselines3 acts behind those of its own training, `VecNormalize` say.
    episodes : int
        Number of episodes; they have the seeds `seed`, `seed` + 1 and so on.
    seed : int
        Seed of the first episode.
    deterministic : bool
        Is given to `predict`. With False a model of Stable-Baselines3 draws its actions, from
        PyTorch's generator: ``torch.manual_seed(0)`` before makes them the same again.
    n_eval_episodes : int, optional
        Another name of `episodes`, that of Stable-Baselines3's `evaluate_policy`.
    options : mapping, optional
        Options of `reset`, such as ``{"start": start, "goal": goal}`` in mode "transition".

    Returns
    -------
    Evaluation
        With the rewards of the environment itself, which no wrapper has changed.

    Raises
    ------
    ValueError, TypeError
        If an argument or a keyword breaks its rule; if the environment shows another `observation`
        than a model was trained on, or has other motors; if a wrapper changes observations or
        actions in a way that is not known; or if a model was trained with a `VecNormalize` with
        which it was not loaded, as far as the model shows that it had one.

    Examples
    --------
    >>> from npend_gym import rl
    >>> policy = rl.Policy.pretrained("balance-2")
    >>> rl.evaluate(policy, policy.env, episodes=2).success.tolist()
    [True, True]
    """
    _checks.count("seed", seed, low=0)
    if n_eval_episodes is not None:
        if episodes not in (_EPISODES, n_eval_episodes):
            raise ValueError(
                "n_eval_episodes must be left out where episodes is given, because both are the "
                f"number of episodes; got {n_eval_episodes} and {episodes}"
            )
        episodes = _checks.count("n_eval_episodes", n_eval_episodes)
    _checks.truth("deterministic", deterministic)
    setting = setting_of(env)
    envs = setting.make(_checks.count("episodes", episodes))
    if envs.unwrapped.max_episode_steps is None:
        raise ValueError(
            "max_episode_steps must be a number, so that every episode ends; got None: give a "
            "dict env with it, or an environment in gymnasium.wrappers.TimeLimit"
        )
    config = envs.unwrapped.config
    controller = as_controller(model, config, setting.wrappers, deterministic=deterministic)
    returns, work, last_failure = np.zeros((3, episodes))
    success, idle = np.zeros(episodes, np.bool_), np.zeros((episodes, 0))
    for running, before, reward, info in rollout(controller, envs, seed, options):
        turned = (joint_motion(info)[0] - joint_motion(before)[0])[:, config.joints]
        step_work = np.abs(info.get("torque", idle) * turned).sum(axis=1)
        returns += np.where(running, reward, 0.0)
        work += np.where(running, step_work, 0.0)
        if "success" in info:
            success = np.where(running, info["success"], success)
            last_failure = np.where(running & ~info["success"], info["time"], last_failure)
    if not config.mode.defines_success:
        success = np.full(episodes, np.nan)
    settled = np.where(success == 1.0, last_failure, np.nan)
    return Evaluation(returns, success, settled, work)
