"""Sub-environments of vector environments, in groups: in each group one thing is wrong, or nothing.

What is wrong is what `robustness` tries, drawn between nothing and the largest that is tried there:
the chain, sensors and motors, pulses of torque.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import BoolArray, FloatArray
from npend_gym.envs import EnvConfig
from npend_gym.envs.inputs import env_actions
from npend_gym.rl.controllers.tracking import Tracking
from npend_gym.rl.evaluation.criteria import CRITERIA, Criterion, Pushes
from npend_gym.rl.evaluation.disturbances import DisturbedEnvs, Pulses
from npend_gym.rl.evaluation.rollouts import JoinedEnvs
from npend_gym.rl.evaluation.settings import EnvSetting
from npend_gym.rl.training.chain_plans import Changes

NOTHING, CHAIN, PUSHES, SEVERAL = "nothing", "model", "pushes", "several"
KINDS = (NOTHING, *CRITERIA, SEVERAL)
_HALF = 0.5  # of the errors in a lane with several, and of those lanes that have a wrong chain
_GROWTH, _JUDGED = 1.25, 12  # of a level, after at least so many episodes


class Follower:
    """Motors of B sub-environments that follow the actions u as lag y' = u - y.

    Within a step of dt seconds the mean of y is u + share (y - u).
    """

    def __init__(self, size: int, dt: float, joints: int) -> None:
        self._dt, self._followed = dt, np.zeros((size, joints))

    def begin(self, mask: BoolArray, lags: FloatArray) -> None:
        """Forget the actions in the lanes of `mask`; from now on all lanes have these lags [s]."""
        lag = lags[:, None]
        rate = self._dt / np.where(lag > 0.0, lag, 1.0)
        self._left = np.where(lag > 0.0, np.exp(-rate), 0.0)
        self._share = np.where(lag > 0.0, -np.expm1(-rate) / rate, 0.0)
        self._followed[mask] = 0.0

    def asked(self, actions: FloatArray) -> FloatArray:
        """Return the actions in a step whose mean is to be `actions`, (B, joints)."""
        return (actions - self._share * self._followed) / (1.0 - self._share)

    def act(self, actions: FloatArray) -> None:
        """Follow actions for a step."""
        self._followed = actions + self._left * (self._followed - actions)


def _lags(config: EnvConfig, info: dict[str, Any]) -> FloatArray:
    """Return the lag of the motors of every sub-environment [s], (B,), which may be drawn."""
    if "motor_lag" in config.context_names:
        return info["context"][:, config.context_names.index("motor_lag")]
    return np.full(len(info["time"]), config.motor_lag)


def check_errors(errors: Any) -> None:
    """Refuse anything but a dict of shares whose keys are names of `KINDS`."""
    if not isinstance(errors, dict):
        raise TypeError(f"errors must be a dict, got {_checks.show(errors)}")
    for name, share in cast("dict[Any, Any]", errors).items():
        _checks.choice("errors", name, KINDS)
        _checks.nonnegative_number(f"errors[{name!r}]", share)


class ErrorLanes:
    """Vector environments side by side, as one, each with an error of its own.

    `errors` has the share of the lanes with each of `KINDS`, over the sum of all. Episodes have a
    number of `steps`. Errors other than the chain's are multiplied by `first_level` at first, which
    grows up to ``1.0 + margin``.
    """

    changes: tuple[str, ...] = ("levels", "judged")

    def __init__(
        self,
        setting: EnvSetting,
        size: int,
        errors: Mapping[str, float],
        steps: int,
        first_level: float = 1.0,
        margin: float = 0.0,
    ) -> None:
        check_errors(errors)
        shares = {name: share for name, share in errors.items() if share > 0.0} or {NOTHING: 1.0}
        self._setting = setting._replace(keywords=setting.keywords | {"max_episode_steps": None})
        self.config: EnvConfig = setting.config
        self._steps = steps
        ends = np.rint(size * np.cumsum([*shares.values()]) / sum(shares.values())).astype(np.int64)
        counts = np.diff(ends, prepend=0)
        self.names: list[str] = [  # what is wrong in each group
            name for name, count in zip(shares, counts, strict=True) if count > 0
        ]
        counts = counts[counts > 0]
        self.group: NDArray[np.int64] = np.repeat(np.arange(counts.size), counts)  # of each lane
        self.which: NDArray[np.int64] = np.zeros(size, np.int64)  # of the chains given to `reset`
        self.parts: list[NDArray[np.int64]] = [
            np.flatnonzero(self.group == k) for k in range(counts.size)
        ]
        fixed = [name in (NOTHING, CHAIN) for name in self.names]
        self.levels: FloatArray = np.where(fixed, 1.0, first_level)  # what errors are multiplied by
        self._highest = np.where(fixed, 1.0, 1.0 + margin)
        # episodes that have been judged at this level, and those that were good
        self.judged: NDArray[np.int64] = np.zeros((2, counts.size), np.int64)
        self.lanes: JoinedEnvs = JoinedEnvs([self._make(k) for k in range(counts.size)])
        self._follower = Follower(size, self.config.dt, self.config.joints.size)

    @property
    def rank(self) -> FloatArray:
        """The place of each sub-environment in its group, (B,), from 0 to below 1."""
        return np.concatenate([np.arange(part.size) / part.size for part in self.parts])

    def _make(self, k: int) -> Any:
        """Return the environments of a group with the errors of its level."""
        count, name, level = len(self.parts[k]), self.names[k], self.levels[k]
        if name == PUSHES:
            return DisturbedEnvs(self._setting, count, self._pulses(k, 0))
        errors = CRITERIA if name == SEVERAL else [name]
        level = _HALF * level if name == SEVERAL else level
        own = dict(self._setting.keywords.get("randomize") or {})
        for error in errors:
            criterion = CRITERIA.get(error)
            if isinstance(criterion, Criterion):
                largest = criterion.keywords(self.config, level * criterion.largest_in(self.config))
                own |= {
                    keyword: {"low": 0.0, "high": float(high)}
                    for keyword, high in largest.items()
                    if high > 0.0
                }
        return self._setting.make(count, randomize=own or None)

    def _pulses(self, k: int, seed: int) -> Pulses:
        """Return pulses of torque for the sub-environments of a group."""
        joints = Pushes().pushed(self.config)
        pulses = Pulses(self.config, joints, self._steps, len(self.parts[k]), seed)
        pulses.torques *= self.levels[k]
        return pulses

    def reset(
        self,
        seed: int,
        chains: Sequence[Changes],
        rng: np.random.Generator,
        starts: Mapping[str, FloatArray] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode in every sub-environment, where environment k has the seed ``seed + k``.

        Some groups are given other chains, drawn from `chains`; the first of these changes nothing.
        `starts` has options of all sub-environments, which hold in their later episodes too.
        """
        self.which[:], given = 0, list[dict[str, Any]]()
        for k, (part, name) in enumerate(zip(self.parts, self.names, strict=True)):
            options: dict[str, Any] = {key: value[part] for key, value in (starts or {}).items()}
            if options:  # plans and chains that an expert has are those of all episodes
                options["persist"] = True
            if name == PUSHES:
                self.lanes.envs[k].disturbance = self._pulses(k, seed + int(part[0]))
            if name in (CHAIN, SEVERAL) and len(chains) > 1:
                wrong = rng.random(part.size) < (1.0 if name == CHAIN else _HALF)
                self.which[part] = np.where(wrong, rng.integers(len(chains), size=part.size), 0)
                options["persist"] = True
                for parameter in chains[0]:
                    values = np.array([each[parameter] for each in chains])
                    options[parameter] = values[self.which[part]]
            given.append(options)
        observation, info = self.lanes.reset(seed, given)
        self._begin(info)
        return observation, info

    def _begin(self, info: dict[str, Any]) -> None:
        """Let motors begin in the sub-environments in which an episode does."""
        begins = info["time"] == 0.0
        if begins.any():
            drawn = zip(self.lanes.envs, self.lanes.infos, strict=True)
            lags = [_lags(getattr(env, "unwrapped", env).config, each) for env, each in drawn]
            self._follower.begin(begins, np.concatenate(lags))

    def against_lag(self, tracking: Tracking) -> Tracking:
        """Advice of an expert, with the actions that motors with a lag must be given."""
        return tracking._replace(actions=self._follower.asked(tracking.actions))

    def step(self, action: FloatArray) -> tuple[Any, FloatArray, BoolArray, dict[str, Any]]:
        """Step all sub-environments with actions, (B, joints), or the nearest that there are.

        Returns observations, rewards, which episodes were terminated, and info. Where one was
        terminated, the next step begins another.
        """
        taken, table = env_actions(self.config, action), self.config.action_table
        self._follower.act(table[taken] if len(table) > 0 else action)
        observation, reward, terminated, _, info = self.lanes.step(taken)
        self._begin(info)
        return observation, reward, terminated, info

    def judge(self, lanes: NDArray[np.int64], good: BoolArray) -> None:
        """Count episodes that were judged, of these sub-environments, and those that were good."""
        groups = self.group[lanes]
        kinds = len(self.names)
        self.judged += [np.bincount(rows, minlength=kinds) for rows in (groups, groups[good])]

    def grow(self) -> None:
        """Raise the levels of the groups in which most episodes were good."""
        episodes, good = self.judged
        enough = episodes >= _JUDGED
        higher = enough & (2 * good > episodes) & (self.levels < self._highest)
        self.levels[higher] = np.minimum(self._highest, _GROWTH * self.levels)[higher]
        self.judged[:, enough] = 0
        self._remake(np.flatnonzero(higher))

    def restored(self) -> None:
        """Make the environments of the levels that were restored."""
        self._remake(np.arange(len(self.names)))

    def _remake(self, groups: NDArray[np.int64]) -> None:
        for k in groups.tolist():
            self.lanes.envs[k].close()
            self.lanes.envs[k] = self._make(k)

    def close(self) -> None:
        """Close the environments."""
        self.lanes.close()
