"""The protocol by which robustness is measured: six criteria, and the share that survives each."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import BoolArray, FloatArray
from npend_gym._provenance import provenance
from npend_gym.chain import plain_keywords
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.registration import ENV_ID
from npend_gym.rl.evaluation.criteria import (
    CRITERIA,
    PUSHED,
    Group,
    groups_of,
    pushed_joints,
    pushes,
)
from npend_gym.rl.evaluation.disturbances import DisturbedEnvs, Pulses
from npend_gym.rl.evaluation.models import Model, as_controller
from npend_gym.rl.evaluation.rollouts import (
    Controller,
    Lanes,
    Observer,
    make_envs,
    nominal_env,
    rollout,
)
from npend_gym.rl.evaluation.seeds import HELD_OUT


class Outcome(NamedTuple):
    """What became of the values of one criterion.

    Attributes
    ----------
    parameters : list of str
        What had each value: "masses[0]", or the name of the criterion.
    values : ndarray, shape (k,)
        In the parameter's unit: of `Chain`, rad/s, N m, s, and the numbers of pushed rollouts.
    survived : ndarray, bool, shape (k,)
    """

    parameters: list[str]
    values: FloatArray
    survived: BoolArray

    @property
    def share(self) -> float:
        """Fraction of the values that were survived."""
        return float(self.survived.mean())

    def of(self, parameter: str) -> tuple[FloatArray, BoolArray]:
        """Return the values of one parameter, and which of them were survived."""
        own = np.array(self.parameters) == parameter
        return self.values[own], self.survived[own]


@dataclass(frozen=True, eq=False)
class Robustness:
    """How much a controller survives, see `robustness`.

    Attributes
    ----------
    outcomes : mapping
        An `Outcome` for each criterion, in the order of "model", "velocity_noise",
        "torque_noise", "motor_lag", "delay" and "pushes".
    provenance : dict
        What made this result.
    """

    outcomes: Mapping[str, Outcome]
    provenance: Mapping[str, Any]

    @property
    def survived(self) -> dict[str, float]:
        """The share of the values survived, of each criterion."""
        return {name: outcome.share for name, outcome in self.outcomes.items()}

    @property
    def score(self) -> float:
        """Mean over the criteria of the share survived, 0 to 1."""
        return float(np.mean(list(self.survived.values())))

    def as_row(self) -> dict[str, float]:
        """Return the score and the shares."""
        shares = {"score": self.score} | self.survived
        return {name: round(share, 4) for name, share in shares.items()}

    def as_dict(self) -> dict[str, Any]:
        """Return all of it as plain numbers, texts, lists and dicts, for JSON."""
        outcomes = {
            name: {
                "parameters": each.parameters,
                "values": each.values.tolist(),
                "survived": each.survived.tolist(),
            }
            for name, each in self.outcomes.items()
        }
        return self.as_row() | {"outcomes": outcomes, "provenance": dict(self.provenance)}


def robustness(
    controller: Controller | Model,
    keywords: dict[str, Any],
    *,
    env_id: str = ENV_ID,
    seed: int = HELD_OUT,
    values: int = 21,
    repetitions: int = 10,
    seconds: float = 10.0,
    pushed: Sequence[int] | None = None,
    progress: Callable[[Iterable[str]], Iterable[str]] = iter,
) -> Robustness:
    """Try a controller with a wrong model, noise, delay, a slow motor and pushes.

    Each criterion is tried with evenly spaced values. A value is survived where the goal of the
    environment's mode is met at the end of a rollout (for "swingup": upright and slow). The score
    is the mean of the six shares of values survived.

    ==================  ====================================================================
    "model"             each parameter of the chain, of one rod at a time, changed by +-25 %;
                        damping or friction that is zero becomes 0 to 0.1 N m s/rad, 0 to 0.2 N m
    "velocity_noise"    standard deviation of angular velocities observed, 0 to 0.5 rad/s
    "torque_noise"      standard deviation of torques, 0 to 11/60 of their limit
    "motor_lag"         time constant with which the motor follows, 0 to 0.02 s
    "delay"             of what is observed, 0 to 0.04 s
    "pushes"            50 rollouts with three random pulses of torque at each motor's joint
    ==================  ====================================================================

    The controller must know nothing of these errors: ``info["theta"]`` and ``info["omega"]`` are
    the state as observed, with noise and delay.

    Parameters
    ----------
    controller : callable, or a model of Stable-Baselines3
        As for `evaluate`. All rollouts of a criterion are side by side: it is called with B lanes,
        after ``reset(B)`` where it has such a method.
    keywords : dict
        Keywords of ``gym.make_vec(env_id, ...)``, such as ``policy.env``. `randomize` is left out.
    env_id : str
    seed : int
        Seed of the first rollout of each criterion; the others have the following ones.
    values : int
        Number of values for each parameter.
    repetitions : int
        Rollouts with each value of noise, of which more than half must succeed.
    seconds : float
        Duration of a rollout.
    pushed : sequence of int, optional
        The joints that are pushed: by default those with a motor, as on RealAIGym's leaderboard.
        Six pulses at most are dealt to them.
    progress : callable
        May wrap the iteration over the criteria, as tqdm does.

    Returns
    -------
    Robustness

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, or the environment has no motor, observes the context, or is
        a `goal_env`.

    References
    ----------
    F. Wiebe and others, *Reinforcement Learning for Robust Athletic Intelligence: Lessons from the
    2nd "AI Olympics with RealAIGym" Competition*, arXiv:2503.15290 (2025); the numbers are those of
    `leaderboard/pendubot/robustness_v2` in dfki-ric-underactuated-lab/double_pendulum.

    Examples
    --------
    >>> from npend_gym.rl import Policy, robustness
    >>> policy = Policy.pretrained("swingup-1")
    >>> found = robustness(policy, policy.env, values=3, repetitions=3)
    >>> round(found.outcomes["model"].share, 3)
    0.833
    """
    _checks.count("values", values, low=2)
    _checks.count("repetitions", repetitions)
    nominal, config, steps = nominal_env(env_id, keywords, seconds)
    at_the_end = copy.copy(config.mode)
    vars(at_the_end)["hold"] = 0.0  # the goal is to be met at the end
    nominal["mode"] = at_the_end
    observer = Observer(as_controller(controller, config), config)
    pulses = Pulses(config, pushed_joints(config, pushed), steps, PUSHED, seed)
    outcomes: dict[str, Outcome] = {}
    for criterion in progress(CRITERIA):
        groups = (
            pushes(pulses)
            if criterion == "pushes"
            else groups_of(criterion, config, values, repetitions)
        )
        if groups:
            outcomes[criterion] = _try(observer, env_id, nominal, config, groups, seed)
    arguments = {
        "env_id": env_id,
        "env": plain_keywords(keywords | {"mode": config.mode.name}),
        "values": values,
        "repetitions": repetitions,
        "seconds": seconds,
        "pushed": None if pushed is None else list(pushed),
    }
    return Robustness(outcomes, provenance(arguments, seed))


def _try(
    controller: Controller,
    env_id: str,
    nominal: dict[str, Any],
    config: EnvConfig,
    groups: list[Group],
    seed: int,
) -> Outcome:
    """Play the rollouts of a criterion."""
    envs = [
        make_envs(env_id, group.lanes, nominal | group.keywords)
        if group.pulses is None
        else DisturbedEnvs(env_id, group.lanes, nominal, config, group.pulses)
        for group in groups
    ]
    lanes = Lanes(envs)
    success: NDArray[np.bool_] = np.zeros(lanes.num_envs, np.bool_)
    start = lanes.reset(seed, [group.options for group in groups])
    for running, _, _, info in rollout(controller, lanes, *start):
        success = np.where(running, info["success"], success)
    lanes.close()
    parts = np.split(success, np.cumsum([group.lanes for group in groups])[:-1])
    return Outcome(
        [name for group in groups for name in group.parameters],
        np.concatenate([group.values for group in groups]),
        np.concatenate([g.survived(part) for g, part in zip(groups, parts, strict=True)]),
    )
