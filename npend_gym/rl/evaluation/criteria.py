"""The criteria of robustness: which errors of model, sensors and motors are tried, and how large.

Six are those of the second and third AI Olympics with RealAIGym, for any number of rods: the file
`leaderboard/pendubot/robustness_v2/benchmark_controller.py` of the repository
dfki-ric-underactuated-lab/double_pendulum has the numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import BoolArray, FloatArray
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.inputs import substeps_beyond
from npend_gym.rl.evaluation.disturbances import DisturbedEnvs, Pulses
from npend_gym.rl.evaluation.settings import EnvSetting

_PUSHED = 50  # rollouts
_FACTORS = (0.75, 1.25)  # of a parameter of the chain
_WHERE_ZERO = {"damping": 0.1, "friction": 0.2}  # N m s/rad, N m: the ends, from zero
_OF_LINKS = ("centres", "inertias")  # which point masses on massless rods have not
_PARAMETERS = (
    "masses", "lengths", *_OF_LINKS, "damping", "friction", "armature", "drag", "quadratic_drag"
)  # fmt: skip
_MAJORITY = 0.5  # of the repetitions, more than which must succeed


class Trial(NamedTuple):
    """The nominal environment, and the arguments of `robustness`."""

    config: EnvConfig
    steps: int  # of a rollout
    values: int
    repetitions: int
    seed: int


@dataclass(frozen=True, eq=False)
class RolloutGroup:
    """Rollouts in one vector environment: of each value, `repetitions` environments in a row."""

    parameters: list[str]  # what has each value: "masses[0]", say, or the name of the criterion
    values: FloatArray  # (k,)
    repetitions: int = 1
    keywords: Mapping[str, Any] = field(default_factory=dict[str, Any])  # beside its own
    options: dict[str, Any] = field(default_factory=dict[str, Any])  # of its reset
    pulses: Pulses | None = None

    @property
    def lanes(self) -> int:
        """Number of rollouts."""
        return self.values.size * self.repetitions

    def make(self, nominal: EnvSetting) -> Any:
        """Return the vector environment."""
        if self.pulses is not None:
            return DisturbedEnvs(nominal, self.lanes, self.pulses)
        return nominal.make(self.lanes, **self.keywords)

    def survived(self, success: BoolArray) -> BoolArray:
        """Return which values succeeded in most of their repetitions, (k,), by sub-environments."""
        return success.reshape(self.values.size, -1).mean(axis=1) > _MAJORITY


@dataclass(frozen=True)
class Criterion:
    """An error that grows from nothing, as keywords of the environment, see `robustness`.

    Attributes
    ----------
    largest : float, or callable
        The largest error that is tried; ``largest(config)`` returns it where it depends on the
        environment, and 0 where the criterion does not apply.
    keywords : callable
        ``keywords(config, value)`` returns the keywords of an environment with the error `value`.
    unit : str
        Of the errors, for figures.
    noise : bool
        Whether each value is tried `repetitions` times, because its rollouts differ.
    scored : bool
        Whether the score has it, as it has the six published criteria.

    Examples
    --------
    >>> from npend_gym import rl
    >>> late = rl.Criterion(2.0, lambda config, value: {"action_delay": value}, unit="steps")
    >>> policy = rl.Policy.pretrained("swingup-1")
    >>> found = rl.robustness(policy, policy.env, criteria={"late": late}, values=3)
    >>> found.outcomes["late"].values.tolist()
    [0.0, 1.0, 2.0]
    """

    largest: float | Callable[[EnvConfig], float]
    keywords: Callable[[EnvConfig, float], Mapping[str, Any]]
    unit: str = ""
    noise: bool = False
    scored: bool = False

    def largest_in(self, config: EnvConfig) -> float:
        """Return the largest error that is tried in an environment."""
        largest = self.largest(config) if callable(self.largest) else self.largest
        return _checks.nonnegative_number("largest", largest)

    def groups(self, name: str, trial: Trial) -> list[RolloutGroup]:
        """Return the rollouts of the criterion `name`, a vector environment for each value."""
        config, end = trial.config, self.largest_in(trial.config)
        repeated = trial.repetitions if self.noise else 1
        tried = np.linspace(0.0, end, trial.values) if end > 0.0 else np.zeros(0)
        return [
            RolloutGroup([name], np.array([value]), repeated, self.keywords(config, float(value)))
            for value in tried
        ]


@dataclass(frozen=True)
class WrongModel:
    """Each parameter of the chain, of one rod at a time, is changed by up to a quarter."""

    unit: str = ""  # each parameter has its own
    scored: bool = True

    def groups(self, name: str, trial: Trial) -> list[RolloutGroup]:
        """Return an environment for each parameter, with environments for each rod and value."""
        del name
        chain, values = trial.config.chain, trial.values
        groups: list[RolloutGroup] = []
        for parameter in _PARAMETERS:
            nominal: FloatArray = getattr(chain, parameter)
            rods = [i for i in range(chain.n) if nominal[i] != 0.0 or parameter in _WHERE_ZERO]
            if not rods or (parameter in _OF_LINKS and chain.has_bobs):
                continue
            tried = np.tile(nominal, (len(rods), values, 1))
            for row, i in zip(tried, rods, strict=True):
                row[:, i] = (
                    np.linspace(*_FACTORS, values) * nominal[i]
                    if nominal[i] != 0.0
                    else np.linspace(0.0, _WHERE_ZERO[parameter], values)
                )
            keywords: dict[str, Any] = {}
            # options give friction to environments alone that were made with some
            if parameter == "friction":
                keywords["randomize"] = {parameter: {"low": 0.0, "high": float(tried.max())}}
            elif needed := substeps_beyond(trial.config, {parameter: tried.reshape(-1, chain.n)}):
                keywords["substeps"] = needed  # light short rods turn fast where damping is added
            group = RolloutGroup(
                [f"{parameter}[{i}]" for i in rods for _ in range(values)],
                np.concatenate([row[:, i] for row, i in zip(tried, rods, strict=True)]),
                keywords=keywords,
                options={parameter: tried.reshape(-1, chain.n)},
            )
            groups.append(group)
        return groups


@dataclass(frozen=True)
class Pushes:
    """Random pulses of torque, 50 rollouts, see ``disturbances.Pulses``.

    Attributes
    ----------
    joints : sequence of int, optional
        The joints that are pushed: by default those with a motor, or all where none has.
    """

    joints: Sequence[int] | None = None
    unit: str = ""
    scored: bool = True

    def groups(self, name: str, trial: Trial) -> list[RolloutGroup]:
        """Return the rollouts of the criterion `name`."""
        config, joints = trial.config, self.pushed(trial.config)
        pulses = Pulses(config, joints, trial.steps, _PUSHED, trial.seed)
        return [RolloutGroup([name] * _PUSHED, np.arange(_PUSHED, dtype=float), pulses=pulses)]

    def pushed(self, config: EnvConfig) -> NDArray[np.int64]:
        """Return the joints that are pushed."""
        if self.joints is None:
            motors = config.joints[config.joints < config.n]
            return motors if motors.size > 0 else np.arange(config.n)
        chosen = [_checks.count("joints", j, low=0, high=config.n - 1) for j in self.joints]
        if not chosen or len(set(chosen)) < len(chosen):
            raise ValueError(f"joints must name at least one joint, and each once, got {chosen}")
        return np.array(chosen, np.int64)


def _torque_noise(config: EnvConfig) -> float:
    """Return the largest standard deviation [N m]; 0 where only a force on a cart acts."""
    return 1.1 / 6.0 * config.max_torque if np.any(config.joints < config.n) else 0.0


CRITERIA: Mapping[str, Any] = MappingProxyType(
    {
        "model": WrongModel(),
        "velocity_noise": Criterion(
            0.5, lambda _, value: {"velocity_noise": value}, "rad/s", noise=True, scored=True
        ),
        "torque_noise": Criterion(
            _torque_noise, lambda _, value: {"torque_noise": value}, "N m", noise=True, scored=True
        ),
        # a responsiveness of 0.1 at 500 Hz is a lag of 0.019 s
        "motor_lag": Criterion(0.02, lambda _, value: {"motor_lag": value}, "s", scored=True),
        "delay": Criterion(
            0.04, lambda config, value: {"observation_delay": value / config.dt}, "s", scored=True
        ),
        "pushes": Pushes(),
        "angle_noise": Criterion(0.02, lambda _, value: {"angle_noise": value}, "rad", noise=True),
        "angle_resolution": Criterion(0.01, lambda _, value: {"angle_resolution": value}, "rad"),
    }
)
"""The criteria of `robustness` by name: six that are published and make the score, and two more."""
