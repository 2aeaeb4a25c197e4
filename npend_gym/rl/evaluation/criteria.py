"""The criteria of robustness: which errors of model, sensors and motors are tried, and how large.

They are those of the second and third AI Olympics with RealAIGym, for any number of rods: the file
`leaderboard/pendubot/robustness_v2/benchmark_controller.py` of the repository
dfki-ric-underactuated-lab/double_pendulum has the numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.envs.config import EnvConfig
from npend_gym.rl.evaluation.disturbances import Pulses

CRITERIA = ("model", "velocity_noise", "torque_noise", "motor_lag", "delay", "pushes")
PUSHED = 50  # rollouts
_FACTORS = (0.75, 1.25)  # of a parameter of the chain
_WHERE_ZERO = {"damping": 0.1, "friction": 0.2}  # N m s/rad, N m: the ends, from zero
_OF_LINKS = ("centres", "inertias")  # which point masses on massless rods have not
_PARAMETERS = (
    "masses", "lengths", *_OF_LINKS, "damping", "friction", "armature", "drag", "quadratic_drag"
)  # fmt: skip
_LARGEST_SPEED_NOISE = 0.5  # rad/s
_LARGEST_TORQUE_NOISE = 1.1 / 6.0  # over the torque limit
_LARGEST_LAG = 0.02  # s; a responsiveness of 0.1 at 500 Hz is a lag of 0.019 s
_LARGEST_DELAY = 0.04  # s
_MAJORITY = 0.5  # of the repetitions, more than which must succeed


@dataclass(frozen=True, eq=False)
class Group:
    """Rollouts in one vector environment: of each value, `repetitions` lanes in a row.

    Attributes
    ----------
    parameters : list of str
        What has each value: "masses[0]", say, or the name of the criterion.
    values : ndarray, shape (k,)
    repetitions : int
    keywords : dict
        Of the environment, beside its own.
    options : dict
        Of its reset.
    pulses : Pulses, optional
    """

    parameters: list[str]
    values: FloatArray
    repetitions: int = 1
    keywords: dict[str, Any] = field(default_factory=dict[str, Any])
    options: dict[str, Any] = field(default_factory=dict[str, Any])
    pulses: Pulses | None = None

    @property
    def lanes(self) -> int:
        """Number of rollouts."""
        return self.values.size * self.repetitions

    def survived(self, success: Any) -> Any:
        """Return which values succeeded in most of their repetitions, (k,), by lanes."""
        return success.reshape(self.values.size, -1).mean(axis=1) > _MAJORITY


def pushed_joints(config: EnvConfig, given: Sequence[int] | None) -> NDArray[np.int64]:
    """Return the joints that are pushed: by default those with a motor, or all where none has."""
    if given is not None:
        chosen = [_checks.count("pushed", joint, low=0, high=config.n - 1) for joint in given]
        if not chosen or len(set(chosen)) < len(chosen):
            raise ValueError(f"pushed must name at least one joint, and each once, got {chosen}")
        return np.array(chosen, np.int64)
    motors = config.joints[config.joints < config.n]
    return motors if motors.size > 0 else np.arange(config.n)


def groups_of(criterion: str, config: EnvConfig, values: int, repetitions: int) -> list[Group]:
    """Return the rollouts of a criterion other than "pushes"; none where it does not apply."""
    if criterion == "model":
        return list(_model(config, values))
    if criterion == "torque_noise" and not np.any(config.joints < config.n):
        return []  # the force on a cart has none
    largest, repeated = {
        "velocity_noise": (_LARGEST_SPEED_NOISE, repetitions),
        "torque_noise": (_LARGEST_TORQUE_NOISE * config.max_torque, repetitions),
        "motor_lag": (_LARGEST_LAG, 1),
        "delay": (_LARGEST_DELAY, 1),
    }[criterion]
    tried = np.linspace(0.0, largest, values).tolist()
    if criterion == "delay":  # the keyword counts steps
        changes = [{"observation_delay": value / config.dt} for value in tried]
    else:
        changes = [{criterion: value} for value in tried]
    return [
        Group([criterion], np.array([value]), repeated, change)
        for value, change in zip(tried, changes, strict=True)
    ]


def pushes(pulses: Pulses) -> list[Group]:
    """Return the rollouts of the criterion "pushes"."""
    lanes = pulses.torques.shape[1]
    return [Group(["pushes"] * lanes, np.arange(lanes, dtype=float), pulses=pulses)]


def _model(config: EnvConfig, values: int) -> Iterator[Group]:
    """Yield an environment for each parameter of the chain, with lanes for each rod and value."""
    chain = config.chain
    names = [n for n in _PARAMETERS if not (n in _OF_LINKS and chain.has_bobs)]
    for name in names:
        nominal: FloatArray = getattr(chain, name)
        rods = [i for i in range(chain.n) if nominal[i] != 0.0 or name in _WHERE_ZERO]
        if not rods:
            continue
        tried = np.tile(nominal, (len(rods), values, 1))
        for row, i in zip(tried, rods, strict=True):
            row[:, i] = (
                np.linspace(*_FACTORS, values) * nominal[i]
                if nominal[i] != 0.0
                else np.linspace(0.0, _WHERE_ZERO[name], values)
            )
        keywords: dict[str, Any] = {}
        if name == "friction":  # options give it to environments alone that were made with some
            keywords["randomize"] = {name: {"low": 0.0, "high": float(tried.max())}}
        yield Group(
            [f"{name}[{i}]" for i in rods for _ in range(values)],
            np.concatenate([row[:, i] for row, i in zip(tried, rods, strict=True)]),
            keywords=keywords,
            options={name: tried.reshape(-1, chain.n)},
        )
