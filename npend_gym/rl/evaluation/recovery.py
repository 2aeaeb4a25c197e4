"""RealAIGym's score of 2025: how long a chain is up that is disturbed again and again.

`GlobalPolicyTestingControllerV2` of dfki-ric-underactuated-lab/double_pendulum has the definition.
`leaderboard/pendubot/simulation_v3` and `experiments/icra_2025` have the numbers, which
docs/explanation/scores.md tells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

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
_ROBOT_LENGTH = 0.5  # m


class Rule(NamedTuple):
    """When the motors that knock the chain down act, and how.

    Torques are divided by the torque limit, 6 N m there. Their ki and kd are for steps of 0.001 s,
    and they take steps of 0.002 s.
    """

    resets: int
    seconds: float  # of each
    stiffness: float  # 1/rad
    integral: float  # 1/(rad s)
    damping: float  # s/rad
    most: float = math.inf  # of the part of the torque that the stiffness causes
    max_angle: float = math.inf  # of a joint [rad]; beyond, a knock-down begins early
    max_speed: float = math.inf  # rad/s, likewise, for a chain of their length


RULES = {
    "simulation": Rule(15, 0.2, 10.0 / 6.0, 0.05 / 6.0, 2.0 / 6.0),
    "hardware": Rule(10, 1.0, 2.0 / 6.0, 0.0, 0.6 / 6.0, 3.0 / 6.0, 3.5 * math.pi, 20.0),
}
_CALM = 10  # steps within the limits, before which no knock-down ends


class Turner:
    """Motors at all joints that turn them to goals: a PID controller with gravity compensation.

    The angles are those of the joints with their whole turns: a joint that has turned twice turns
    back twice. The PID part is clipped to the torque limit, and so is its sum with the
    compensation. The integral runs on from one goal to the next. `step` is the time between two
    calls [s].
    """

    def __init__(
        self, config: EnvConfig, lanes: int, step: float, rule: Rule = RULES["simulation"]
    ) -> None:
        self._chain, self._limit, self._step = config.chain, config.max_torque, step
        self._rule = rule
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
        rule = self._rule
        drive = np.clip(rule.stiffness * error, -rule.most, rule.most)
        drive += rule.integral * self._step * self._sum + rule.damping / self._step * change
        hold = holding_torques(self._chain, theta)
        torque = np.clip(np.clip(limit * drive, -limit, limit) + hold, -limit, limit)
        return np.where(on, torque, 0.0)


class KnockDowns:
    """For short times, motors at all joints turn them to random angles, in place of the controller.

    The controller that does so, a `Turner`, knows the exact state. Each knock-down lasts for
    `rule.seconds`. One begins early where a joint is beyond the limits of the rule. All later ones
    then wait for the time since the one before. `steps` of `step` seconds are called in their
    order.
    """

    def __init__(
        self, config: EnvConfig, step: float, steps: int, lanes: int, rule: Rule, seed: int
    ) -> None:
        rng, count = np.random.default_rng([seed, 2]), rule.resets
        time, self._step, self._lanes = steps * step, step, np.arange(lanes)
        regular = time * np.arange(1, count + 1) / (count + 1)
        begins = regular + rng.uniform(-1.0, 1.0, (lanes, count)) * time / 60.0
        self._begins = np.pad(begins, [(0, 0), (0, 1)], constant_values=np.inf)
        self._goals = rng.uniform(-np.pi, np.pi, (lanes, max(1, count), config.n))
        if math.isfinite(rule.max_angle):  # more of them may begin
            more = rng.uniform(-np.pi, np.pi, (lanes, 9 * count + 1, config.n))
            self._goals: FloatArray = np.concatenate([self._goals, more], axis=1)
        self._rule = rule
        speed = rule.max_speed / math.sqrt(config.chain.total_length / _ROBOT_LENGTH)
        self._limits = (("theta", rule.max_angle), ("omega", speed))
        self._turner = Turner(config, lanes, step, rule)
        self.acts = np.zeros(lanes, np.bool_)  # where one goes on
        self._regular, self._begun = np.zeros((2, lanes), np.int64)  # of them, and of all
        # when it began, when it was planned, and by how much all others are put off
        self._since, self._last, self._wait = np.zeros((3, lanes))
        self._calm = np.full(lanes, _CALM)

    def __call__(self, step: int, info: dict[str, Any]) -> tuple[FloatArray, BoolArray]:
        """Return the torques of a step, zero in sub-environments where the controller acts."""
        now, beyond = step * self._step, np.zeros(len(self._lanes), np.bool_)
        for name, limit in self._limits:
            if math.isfinite(limit):
                beyond |= (np.abs(np.diff(info[name], axis=1, prepend=0.0)) > limit).any(axis=1)
        self._calm = np.where(beyond, 0, self._calm + 1)
        planned = self._begins[self._lanes, self._regular] + self._wait
        begin = (beyond | (now + 1e-9 >= planned)) & ~self.acts
        over = (now - self._since + 1e-9 >= self._rule.seconds) & (self._calm >= _CALM)
        early = begin & beyond
        self._wait += np.where(early, now - self._last, 0.0)
        self._regular += begin & ~early
        self._begun += begin
        self._since = np.where(begin, now, self._since)
        self._last = np.where(early, now, np.where(begin, planned, self._last))
        self.acts: BoolArray = self.acts & ~over | begin
        goals = self._goals[self._lanes, np.maximum(self._begun - 1, 0) % self._goals.shape[1]]
        return self._turner(goals, info["theta"], self.acts), ~self.acts


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
    resets: int | None = None,
    reset_seconds: float | None = None,
    rule: str = "simulation",
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
    are turned. Where an episode terminates, at the end of a rail or as the mode says, the chain
    counts as down from then on.

    ``rule="hardware"`` is that of the competition on the robot: the chain is disturbed 10 times for
    1 s by weaker motors. Where a joint turns further than 3.5 pi, or faster than 20 rad/s
    sqrt(0.5 m / length), a disturbance begins early and all later ones are put off.

    Parameters
    ----------
    model, env
        As for `evaluate`.
    seed : int
        Seed of the first episode, and of all knock-downs.
    episodes : int
    seconds : float
        Duration of an episode.
    resets : int, optional
        Number of knock-downs; by default that of the rule, 15 or 10.
    reset_seconds : float, optional
        Duration of each; by default that of the rule, 0.2 s or 1 s.
    rule : str
        "simulation" or "hardware".

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
    and `GlobalPolicyTestingControllerV2` of dfki-ric-underactuated-lab/double_pendulum;
    `experiments/icra_2025` there for the rule "hardware".
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
    count = _checks.count("episodes", episodes)
    chosen = RULES[_checks.choice("rule", rule, tuple(RULES))]
    times = chosen.resets if resets is None else _checks.count("resets", resets, low=0)
    nominal, config, steps = setting_of(env).nominal(seconds)
    controller = as_controller(model, config, nominal.wrappers)
    length = chosen.seconds if reset_seconds is None else reset_seconds
    length = _checks.positive_number("reset_seconds", length)
    chosen = chosen._replace(resets=times, seconds=length)
    parts = max(1, round(config.dt / STEP))
    for name in ("observation_delay", "action_delay"):
        if parts * getattr(config, name) > MAX_DELAY:
            raise ValueError(
                f"{name} must be at most {MAX_DELAY / parts:g} steps of {config.dt:g} s to be "
                f"evaluated by recovery, whose motors act every {STEP:g} s; "
                f"got {getattr(config, name):g}"
            )
    knocks = KnockDowns(config, config.dt / parts, parts * steps, count, chosen, seed)
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
