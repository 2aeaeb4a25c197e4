"""The protocol by which robustness is measured: criteria, and the share that survives each."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from npend_gym import _checks
from npend_gym._checks import BoolArray, FloatArray
from npend_gym._provenance import provenance
from npend_gym.chain import plain_keywords
from npend_gym.rl.evaluation.criteria import CRITERIA, RolloutGroup, Trial
from npend_gym.rl.evaluation.models import Model, as_controller
from npend_gym.rl.evaluation.rollouts import Controller, JoinedEnvs, Result, rollout
from npend_gym.rl.evaluation.seeds import HELD_OUT
from npend_gym.rl.evaluation.settings import EnvLike, EnvSetting, evaluating, setting_of


class Outcome(NamedTuple):
    """What became of the values of one criterion.

    Attributes
    ----------
    parameters : list of str
        What had each value: "masses[0]", or the name of the criterion.
    values : ndarray, shape (k,)
        In the parameter's unit: of `Chain`, that of the criterion, and the numbers of pushed
        rollouts.
    survived : ndarray, bool, shape (k,)
    unit : str
        Of the criterion.
    scored : bool
        Whether the score has it.
    """

    parameters: list[str]
    values: FloatArray
    survived: BoolArray
    unit: str = ""
    scored: bool = True

    @property
    def share(self) -> float:
        """Fraction of the values that were survived."""
        return float(self.survived.mean())

    def of(self, parameter: str) -> tuple[FloatArray, BoolArray]:
        """Return the values of one parameter, and which of them were survived."""
        own = np.array(self.parameters) == parameter
        return self.values[own], self.survived[own]


@dataclass(frozen=True, eq=False, repr=False)
class Robustness(Result):
    """How much a model survives, see `robustness`.

    Attributes
    ----------
    outcomes : mapping
        An `Outcome` for each criterion that applies, in their order.
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
        """Mean share of the criteria that the score has, of all where it has none; 0 to 1."""
        tried = self.outcomes.values()
        return float(np.mean([o.share for o in tried if o.scored] or [o.share for o in tried]))

    def as_row(self) -> dict[str, float]:
        """Return the score and the shares."""
        shares = {"score": self.score} | self.survived
        return {name: round(share, 4) for name, share in shares.items()}

    def as_dict(self) -> dict[str, Any]:
        """Return all of it as plain numbers, texts, lists and dicts, for JSON."""
        outcomes = {
            name: each._asdict()
            | {"values": each.values.tolist(), "survived": each.survived.tolist()}
            for name, each in self.outcomes.items()
        }
        return self.as_row() | {"outcomes": outcomes, "provenance": dict(self.provenance)}


@evaluating
def robustness(
    model: Controller | Model,
    env: EnvLike,
    *,
    criteria: Mapping[str, Any] = CRITERIA,
    seed: int = HELD_OUT,
    values: int = 21,
    repetitions: int = 10,
    seconds: float = 10.0,
    progress: Callable[[Iterable[str]], Iterable[str]] = iter,
) -> Robustness:
    """Try a model with a wrong chain, noise, delay, a slow motor and pushes.

    Each criterion is tried with evenly spaced values. A value is survived where the goal of the
    environment's mode is met at the end of a rollout (for "swingup": upright and slow). The score
    is the mean of the shares of values survived, of the first six criteria, which are published.

    ==================  ====================================================================
    "model"             each parameter of the chain, of one rod at a time, changed by +-25 %;
                        damping or friction that is zero becomes 0 to 0.1 N m s/rad, 0 to 0.2 N m
    "velocity_noise"    standard deviation of angular velocities observed, 0 to 0.5 rad/s
    "torque_noise"      standard deviation of torques, 0 to 11/60 of their limit
    "motor_lag"         time constant with which the motor follows, 0 to 0.02 s
    "delay"             of what is observed, 0 to 0.04 s
    "pushes"            50 rollouts with three random pulses of torque at each motor's joint
    "angle_noise"       standard deviation of angles observed, 0 to 0.02 rad; not in the score
    "angle_resolution"  of the encoders, 0 to 0.01 rad; not in the score
    ==================  ====================================================================

    The model must know nothing of these errors: ``info["theta"]`` and ``info["omega"]`` are the
    state as observed, with noise and delay.

    Parameters
    ----------
    model, env
        As for `evaluate`. All rollouts of a criterion are side by side: the model acts in B
        environments, after ``reset(B)`` where it has such a method. `randomize` is left out.
    criteria : mapping
        By name what is tried, each a `Criterion` or another object with its attributes `unit` and
        `scored` and its method `groups`. ``CRITERIA | {"mine": ...}`` adds one.
    seed : int
        Seed of the first rollout of each criterion; the others have the following ones.
    values : int
        Number of values for each parameter.
    repetitions : int
        Rollouts with each value of noise, of which more than half must succeed.
    seconds : float
        Duration of a rollout.
    progress : callable
        May wrap the iteration over the criteria, as tqdm does.

    Returns
    -------
    Robustness

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, or the environment has no motor, observes the context, or is
        a `goal_env`; if its mode defines no success; if no criterion applies to it.

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
    1.0
    """
    _check_criteria(criteria)
    seed = _checks.count("seed", seed, low=0)
    values = _checks.count("values", values, low=2)
    repetitions = _checks.count("repetitions", repetitions)
    seconds = _checks.positive_number("seconds", seconds)
    setting = setting_of(env)
    nominal, config, steps = setting.nominal(seconds)
    if not config.mode.defines_success:
        raise ValueError(
            f"achieved of mode {config.mode.name!r} must be defined for robustness, which counts "
            "the episodes at whose end it is True; performance and recovery need none"
        )
    at_the_end = copy.copy(config.mode)
    vars(at_the_end)["hold"] = 0.0  # the goal is to be met at the end
    nominal.keywords["mode"] = at_the_end
    observer = as_controller(model, config, nominal.wrappers, observes=True)
    trial = Trial(config, steps, values, repetitions, seed)
    # all of them before the first rollout, so that none fails after those of others
    made = {name: _rollouts(name, criteria[name], trial, nominal) for name in criteria}
    outcomes: dict[str, Outcome] = {}
    for name in progress(criteria):
        criterion, (groups, lanes) = criteria[name], made[name]
        if not groups:
            continue
        success: BoolArray = np.zeros(lanes.num_envs, np.bool_)
        options = [group.options for group in groups]
        for running, _, _, info in rollout(observer, lanes, seed, options):
            success = np.where(running, info["success"], success)
        parts = zip(groups, lanes.split(success), strict=True)
        outcomes[name] = Outcome(
            [parameter for group in groups for parameter in group.parameters],
            np.concatenate([group.values for group in groups]),
            np.concatenate([group.survived(part) for group, part in parts]),
            criterion.unit,
            criterion.scored,
        )
    if not outcomes:
        raise ValueError(f"criteria must have one that fits this environment, got {list(criteria)}")
    arguments = {
        "env_id": setting.env_id,
        "env": plain_keywords(setting.keywords | {"mode": config.mode.name}),
        "criteria": list(outcomes),
        "values": values,
        "repetitions": repetitions,
        "seconds": seconds,
    }
    return Robustness(outcomes, provenance(arguments, seed))


def _check_criteria(criteria: Any) -> None:
    """Raise a TypeError unless each criterion is one, under its name."""
    parts = "groups", "unit", "scored"
    named = criteria.values() if hasattr(criteria, "values") else [None]
    if not all(hasattr(each, part) for each in named for part in parts):
        raise TypeError(
            "criteria must have a Criterion, or an object like one, under each name, as CRITERIA "
            f"has; got {_checks.show(criteria)}"
        )


def _rollouts(
    name: str, criterion: Any, trial: Trial, nominal: EnvSetting
) -> tuple[list[RolloutGroup], JoinedEnvs]:
    """Return the rollouts of a criterion and their environments, or say that it does not fit."""
    try:
        groups: list[RolloutGroup] = criterion.groups(name, trial)
        return groups, JoinedEnvs([group.make(nominal) for group in groups])
    except ValueError as error:
        raise ValueError(
            f"criteria[{name!r}] does not fit this environment: {error}; leave it out"
        ) from error
