"""RealAIGym's score of 2025: how long a chain is up that is disturbed again and again.

`GlobalPolicyTestingControllerV2` and `leaderboard/pendubot/simulation_v3` of
dfki-ric-underactuated-lab/double_pendulum have the definition and the numbers, which
docs/explanation/scores.md tells.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import BoolArray, FloatArray
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.settings import MAX_DELAY
from npend_gym.rl.evaluation.disturbances import DisturbedEnvs, holding_torques
from npend_gym.rl.evaluation.models import Model, as_controller
from npend_gym.rl.evaluation.performance import UP
from npend_gym.rl.evaluation.rollouts import Controller, Result, forget, rollout
from npend_gym.rl.evaluation.seeds import HELD_OUT
from npend_gym.rl.evaluation.settings import EnvLike, evaluating, setting_of

STEP = 0.002  # s, of the motors that knock the chain down; the controller keeps its own step
# Over the torque limit, 6 N m there: N m/rad, N m/(rad s) and N m s/rad. Their kp = 10, ki = 0.1
# and kd = 1 are for steps of 0.001 s, and they take steps of 0.002 s.
_STIFFNESS, _INTEGRAL, _DAMPING = 10.0 / 6.0, 0.05 / 6.0, 2.0 / 6.0


class Turner:
    """Motors at all joints that turn them to goals: a PID controller with gravity compensation.

    The angles are those of the joints with their whole turns: a joint that has turned twice turns
    back twice. The PID part is clipped to the torque limit, and so is its sum with the
    compensation. The integral runs on from one goal to the next. `step` is the time between two
    calls [s].
    """

    def __init__(self, config: EnvConfig, lanes: int, step: float) -> None:
        self._chain, self._limit, self._step = config.chain, config.max_torque, step
        self._sum, self._last = np.zeros((lanes, config.n)), np.zeros((lanes, config.n))
        self._calls = np.zeros((lanes, 1))

    def __call__(self, goal: FloatArray, theta: FloatArray, acts: BoolArray) -> FloatArray:
        """Return torques [N m], (B, n), towards goals of the joints; zero where no motor `acts`."""
        on, limit = acts[:, None], self._limit
        error = goal - np.diff(theta, axis=1, prepend=0.0)
        self._calls += on
        self._sum += np.where(on, error, 0.0)
        change = np.where(self._calls > 2.0, error - self._last, 0.0)
        self._last = np.where(on, error, self._last)
        drive = _STIFFNESS * error + _INTEGRAL * self._step * self._sum
        drive += _DAMPING / self._step * change
        hold = holding_torques(self._chain, theta)
        torque = np.clip(np.clip(limit * drive, -limit, limit) + hold, -limit, limit)
        return np.where(on, torque, 0.0)


class KnockDowns:
    """For short times, motors at all joints turn them to random angles, in place of the controller.

    The controller that does so, a `Turner`, knows the exact state. Each of `count` knock-downs
    lasts for some `seconds`; `acts`, (steps, lanes), says in which steps of `step` [s].
    """

    def __init__(
        self,
        config: EnvConfig,
        step: float,
        steps: int,
        lanes: int,
        count: int,
        seconds: float,
        seed: int,
    ) -> None:
        rng = np.random.default_rng([seed, 2])
        time = steps * step
        regular = time * np.arange(1, count + 1) / (count + 1)
        begins = regular + rng.uniform(-1.0, 1.0, (lanes, count)) * time / 60.0
        now = step * np.arange(steps)
        self.acts: BoolArray = np.zeros((steps, lanes), np.bool_)
        self._which = np.zeros((steps, lanes), np.int64)
        for k in range(count):
            since = now[:, None] - begins[:, k] + 1e-9
            on = (since >= 0.0) & (since < seconds)
            self.acts |= on
            self._which[on] = k
        self._goals = rng.uniform(-np.pi, np.pi, (lanes, max(1, count), config.n))
        self._turner, self._lanes = Turner(config, lanes, step), np.arange(lanes)

    def __call__(self, step: int, info: dict[str, Any]) -> tuple[FloatArray, BoolArray]:
        """Return the torques of a step, zero in sub-environments where the controller acts."""
        acts, goal = self.acts[step], self._goals[self._lanes, self._which[step]]
        return self._turner(goal, info["theta"], acts), ~acts


class Held:
    """A controller that acts in the first of every `parts` steps, and holds its action for all."""

    def __init__(self, controller: Controller, parts: int) -> None:
        self._controller, self._parts = controller, parts
        self._step, self._action = 0, np.empty(0)

    def reset(self, num_envs: int) -> None:
        """Let the controller forget; the next step is a first one."""
        forget(self._controller, num_envs)
        self._step = 0

    def __call__(self, observation: Any, info: dict[str, Any]) -> NDArray[Any]:
        """Return the actions of the step."""
        if self._step % self._parts == 0:
            self._action = self._controller(observation, info)
        self._step += 1
        return self._action


@dataclass(frozen=True, eq=False, repr=False)
class Recovery(Result):
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


@evaluating
def recovery(
    model: Controller | Model,
    env: EnvLike,
    *,
    seed: int = HELD_OUT,
    episodes: int = 20,
    seconds: float = 60.0,
    resets: int = 15,
    reset_seconds: float = 0.2,
) -> Recovery:
    """Score of the third AI Olympics with RealAIGym: the share of time up between knock-downs.

    In episodes of 60 s the chain is disturbed 15 times: for 0.2 s motors at all joints, with the
    torque limit of the environment, turn them to random angles in place of the controller. The k-th
    time is k 60 s/16, plus up to 1 s in either direction. The score is the fraction of the time for
    which the tip is above 0.9 of the chain's length.

    The motors are a PID controller with gravity compensation and steps of 0.002 s. They turn joints
    by their angles with whole turns, so that a joint that has turned twice turns back twice. The
    controller acts in the steps of its environment, whose delays and noise are kept; pushes keep
    their impulse. `action_delay` and `motor_lag` hold for what knocks the chain down as well, which
    then ends that much later. `randomize` is left out. No force acts on a cart while joints
    are turned, and beyond the end of its rail an episode is over.

    Parameters
    ----------
    model, env
        As for `evaluate`.
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
        If an argument breaks its rule, or the environment has no motor.

    References
    ----------
    J. S. B. Choe, B. Choi and J. Kim, arXiv:2505.07516 (2025); `leaderboard/pendubot/simulation_v3`
    and `GlobalPolicyTestingControllerV2` of dfki-ric-underactuated-lab/double_pendulum.
    `benchmarks/realaigym.py` measures the score in their simulator too; docs/explanation/scores.md
    has both.

    Examples
    --------
    >>> from npend_gym.rl import Policy, recovery
    >>> policy = Policy.pretrained("swingup-1")
    >>> round(recovery(policy, policy.env, episodes=2, seconds=20.0).score, 1)
    0.8
    """
    _checks.count("seed", seed, low=0)
    count, times = _checks.count("episodes", episodes), _checks.count("resets", resets, low=0)
    nominal, config, steps = setting_of(env).nominal(seconds)
    controller = as_controller(model, config, nominal.wrappers)
    length = _checks.positive_number("reset_seconds", reset_seconds)
    parts = max(1, round(config.dt / STEP))
    for name in ("observation_delay", "action_delay"):
        if parts * getattr(config, name) > MAX_DELAY:
            raise ValueError(
                f"{name} must be at most {MAX_DELAY / parts:g} steps of {config.dt:g} s to be "
                f"evaluated by recovery, whose motors act every {STEP:g} s; "
                f"got {getattr(config, name):g}"
            )
    knocks = KnockDowns(config, config.dt / parts, parts * steps, count, times, length, seed)
    shorter = nominal._replace(keywords=_divided(nominal.keywords, config, parts))
    envs, up = DisturbedEnvs(shorter, count, knocks), np.zeros(count)
    for running, _, _, info in rollout(Held(controller, parts), envs, seed):
        up += running & (info["tip_height"] > UP * config.chain.total_length)
    return Recovery(up / (parts * steps))


def _divided(keywords: dict[str, Any], config: EnvConfig, parts: int) -> dict[str, Any]:
    """Return the keywords of the same environment with steps that are `parts` times as short."""
    shorter: dict[str, Any] = {
        "dt": config.dt / parts,
        "max_episode_steps": parts * keywords["max_episode_steps"],
        "observation_delay": parts * config.observation_delay,
        "action_delay": parts * config.action_delay,
        "torque_noise": np.sqrt(parts) * config.torque_noise,  # the same noise over a long step
        "push_force": parts * config.push_force,  # for a step each: the same impulse
    }
    if config.substeps is not None:
        shorter["substeps"] = -(-config.substeps // parts)
    return keywords | shorter
