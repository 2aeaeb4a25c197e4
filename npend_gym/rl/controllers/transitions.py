"""Plans for many pairs of equilibria, played by one controller, and kept in a file."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._files import parse_json, read_arrays, replacing
from npend_gym._provenance import provenance
from npend_gym.chain import plain_keywords
from npend_gym.envs import EnvConfig
from npend_gym.envs.inputs import env_actions
from npend_gym.rl.controllers.planning import planned_transition
from npend_gym.rl.controllers.step_model import (
    StepModel,
    at_rest,
    check_config,
    state_of,
    wrapped,
)
from npend_gym.rl.controllers.tracking import PlannedTransition, Tracking, track
from npend_gym.rl.controllers.transcription import NominalTrajectory
from npend_gym.rl.evaluation.settings import env_of

MAX_BYTES = 100_000_000  # of a file of plans once unpacked
_HEADER = 256  # bytes, at most, before the numbers of an array in a file
_MAX_RODS = 8  # 65 280 pairs
_LARGEST = 1e5  # rad, rad/s or s
_DEFECT = 1e-6  # rad and rad/s by which a plan may miss its ends, and a step the next state

Pair = tuple[tuple[bool, ...], tuple[bool, ...]]  # which rods stand at the start, and at the goal


class PlannedTransitions:
    """A controller that follows the plan for the start and the goal of each episode.

    An episode begins when an environment is observed for the first time or at time 0, its time has
    gone back, or its goal has changed. The start is the equilibrium nearest to that state, and the
    goal is ``info["goal"]``.

    Parameters
    ----------
    plans : mapping
        A `PlannedTransition` for each pair: which rods stand at the start, and which at the goal,
        ``plans[(False, False), (True, True)]`` for the swing-up of two rods.
    arguments : mapping, optional
        Arguments with which the plans were made; `save` records them.

    Raises
    ------
    TypeError
        If `plans` is empty, or holds something else.
    """

    def __init__(
        self, plans: Mapping[Pair, PlannedTransition], arguments: Mapping[str, Any] | None = None
    ) -> None:
        self.plans: dict[Pair, PlannedTransition] = dict(plans)
        given: list[Any] = [*self.plans.values()]
        if not given or not all(isinstance(plan, PlannedTransition) for plan in given):
            raise TypeError(f"plans must be PlannedTransitions, got {_checks.show(given)}")
        self.arguments: dict[str, Any] = dict(arguments or {})
        self._numbers = {pair: number for number, pair in enumerate(self.plans)}
        self.reset()

    def reset(self, num_envs: int = 0) -> None:
        """Let episodes begin with the next call; `num_envs` has no effect."""
        del num_envs
        self._time, self._goal = np.empty(0), np.empty((0, 0))
        self._number = np.empty(0, np.int64)  # of the plan of each environment
        self._origin = np.empty((0, 0))  # whole turns of the rods at the beginning [rad]

    def __call__(self, observation: Any, info: dict[str, Any]) -> FloatArray:
        """Return the actions (B, joints), of discrete ones the numbers (B,); without B of one."""
        del observation
        return env_actions(self.config, self.tracking(info).actions)

    @property
    def config(self) -> EnvConfig:
        """The settings of the environment that the plans are for."""
        return next(iter(self.plans.values())).config

    def tracking(self, info: dict[str, Any]) -> Tracking:
        """Return the actions, and how far the states are from the trajectories of the plans.

        Of a single environment its arrays have no leading axis of B.
        """
        plans = list(self.plans.values())
        given = state_of(self.config, info)
        states, time = np.atleast_2d(given), np.atleast_1d(info["time"])
        self._begin(states, time, np.atleast_2d(info["goal"]))
        states = states - self._origin
        parts: list[Tracking] = []
        order = np.argsort(self._number, kind="stable")
        numbers, first = np.unique(self._number[order], return_index=True)
        for number, lanes in zip(numbers, np.split(order, first[1:]), strict=True):
            parts.append(plans[int(number)].at(states[lanes], time[lanes]))
        whole = (np.concatenate(values)[np.argsort(order)] for values in zip(*parts, strict=True))
        return Tracking(*(each if given.ndim == 2 else each[0] for each in whole))

    def _begin(self, states: FloatArray, time: FloatArray, goal: FloatArray) -> None:
        """Find the plans of the environments whose episode begins."""
        n, new = goal.shape[1], np.ones(len(time), np.bool_)
        number, origin = np.empty(len(time), np.int64), np.zeros(states.shape)
        if time.shape == self._time.shape:
            new[:] = (time < self._time) | (time == 0.0) | np.any(goal != self._goal, axis=1)
            number, origin = self._number.copy(), self._origin.copy()
        for lane in np.flatnonzero(new):
            half_turns = np.rint(states[lane, :n] / np.pi)
            origin[lane, :n] = 2.0 * np.pi * np.floor(0.5 * half_turns)
            start = np.remainder(half_turns, 2.0) == 1.0
            pair = _pair(start, np.cos(goal[lane]) < 0.0)
            if pair not in self._numbers:
                raise ValueError(f"there is no plan from {pair[0]} to {pair[1]} (True: stands)")
            number[lane] = self._numbers[pair]
        self._number, self._origin = number, origin
        self._time, self._goal = time.copy(), goal.copy()

    def save(self, path: str | PathLike[str]) -> None:
        """Write the trajectories and their provenance to one file, `path` (.npz).

        Raises
        ------
        ValueError
            If they take more than 100 MB before they are compressed, which `load` refuses, or the
            plans do not all have the same number of steps.
        """
        plans, made = list(self.plans.values()), provenance(plain_keywords(self.arguments))
        if len(steps := {len(plan.gains) for plan in plans}) > 1:
            raise ValueError(
                "seconds must be the same for all plans in a file, got plans of "
                f"{', '.join(map(str, sorted(steps)))} steps: save them in several files"
            )
        arrays: dict[str, Any] = {
            "pairs": np.array(list(self.plans), np.bool_),
            "states": np.stack([plan.nominal.states for plan in plans]),
            "actions": np.stack([plan.nominal.actions for plan in plans]),
            "settle": np.array([plan.settle for plan in plans]),
            "about": np.array(json.dumps(made, allow_nan=False)),
        }
        size = sum(array.nbytes + _HEADER for array in arrays.values())
        if size > MAX_BYTES:
            raise ValueError(
                f"plans in a file must take at most {MAX_BYTES} bytes, got {size}: save them in "
                "several files, PlannedTransitions(some of plans).save(path)"
            )
        with replacing(Path(path), binary=True) as file:
            np.savez_compressed(file, **arrays)

    @classmethod
    def load(cls, path: str | PathLike[str], config: EnvConfig) -> PlannedTransitions:
        """Read what `save` wrote; the feedback is computed again.

        Parameters
        ----------
        path : path
        config : EnvConfig
            Settings of the environment that the plans were made for: see `planned_transition`.

        Raises
        ------
        ValueError
            If the file holds no plans, or plans that are not motions of this environment.
        """
        check_config(config)
        try:
            arrays = read_arrays(Path(path), MAX_BYTES)
            pairs, states, actions, settle = _check_arrays(arrays, config)
            about = parse_json(str(arrays["about"])) if "about" in arrays else {}
            arguments: Any = about.get("arguments", {})
            if not isinstance(arguments, dict):
                raise ValueError("its arguments must be names and values")
        except (KeyError, ValueError) as error:
            raise ValueError(f"{path} holds no plans: {error}") from error
        plans: dict[Pair, PlannedTransition] = {}
        for k in range(len(pairs)):
            nominal, pair = NominalTrajectory(states[k], actions[k]), _pair(*pairs[k])
            _check_motion(path, nominal, pair, config)
            plans[pair] = track(config, nominal, float(settle[k]))
        return cls(plans, cast("dict[str, Any]", arguments))


def planned_transitions(
    config: EnvConfig,
    seconds: float = 6.0,
    *,
    settle: float = 2.0,
    tries: int = 4,
    guess: str = "mpc",
    seed: int = 0,
    progress: Callable[[Iterable[Pair]], Iterable[Pair]] = iter,
    cart_position: float = 0.0,
) -> PlannedTransitions:
    """Plan the transitions between all pairs of different equilibria, 2^n (2^n - 1) of them.

    Parameters
    ----------
    config, seconds, settle, tries, guess, seed, cart_position
        As for `planned_transition`, which makes each of the plans. Chains that stand start up to
        0.05 rad from rest, and amplify that along a trajectory unless LQR calms them before.
    progress : callable
        May wrap the iteration over the pairs, as tqdm does.

    Returns
    -------
    PlannedTransitions
        A controller for mode "transition".

    Raises
    ------
    RuntimeError
        If none of the guesses for a pair leads to a trajectory.

    Examples
    --------
    >>> from npend_gym.envs import EnvConfig
    >>> from npend_gym.rl import evaluate, planned_transitions
    >>> plans = planned_transitions(EnvConfig(mode="transition", n=1), 3.0, tries=1)
    >>> evaluate(plans, {"mode": "transition", "n": 1}, episodes=4).success_rate
    1.0
    """
    check_config(config)
    n = _checks.count("the number of rods", config.n, high=_MAX_RODS)
    plans: dict[Pair, PlannedTransition] = {}
    settings: dict[str, Any] = {"settle": settle, "tries": tries, "guess": guess, "seed": seed}
    settings |= {"cart_position": cart_position} if config.has_cart or cart_position else {}
    arguments = {"env": env_of(config, strict=False), "seconds": seconds} | settings
    for start, goal in progress(pairs_of(n)):
        ends = np.pi * np.array(start), np.pi * np.array(goal)
        plans[start, goal] = planned_transition(config, *ends, seconds, **settings)
    return PlannedTransitions(plans, arguments)


def pairs_of(n: int) -> list[Pair]:
    """Return all pairs of different equilibria of n rods."""
    equilibria = itertools.product([False, True], repeat=n)
    return list(itertools.permutations(equilibria, 2))


def _pair(start: Iterable[Any], goal: Iterable[Any]) -> Pair:
    return tuple(bool(stands) for stands in start), tuple(bool(stands) for stands in goal)


def _check_arrays(arrays: Mapping[str, NDArray[Any]], config: EnvConfig) -> list[NDArray[Any]]:
    """Return pairs, states, actions and times to settle, if they fit each other and `config`."""
    found = [arrays[name] for name in ("pairs", "states", "actions", "settle")]
    types, axes = [str(array.dtype) for array in found], [array.ndim for array in found]
    if types != ["bool", "float64", "float64", "float64"] or axes != [3, 3, 3, 1]:
        raise ValueError(f"its arrays are of {', '.join(types)} with {axes} axes")
    n, joints, (count, steps) = config.n, config.joints.size, found[2].shape[:2]
    states = count, steps + 1, config.state_size
    shapes = [(count, 2, n), states, (count, steps, joints), (count,)]
    if [array.shape for array in found] != shapes or count * steps == 0:
        raise ValueError(f"no plans for {n} rods and {joints} motors")
    limits = {"states": _LARGEST, "actions": 1.0, "settle": _LARGEST}
    for (name, limit), values in zip(limits.items(), found[1:], strict=True):
        if not (np.abs(values) <= limit).all():
            raise ValueError(f"{name} must lie within +-{limit:g}")
    _checks.at_least_zero("settle", found[3])
    return found


def _check_motion(path: object, nominal: NominalTrajectory, pair: Pair, config: EnvConfig) -> None:
    """Raise a ValueError where steps of the environment do not lead along the trajectory."""
    states, actions = nominal
    places = states[[0, -1], config.n] if config.has_cart else (0.0, 0.0)
    ends = np.stack([
        at_rest(config, np.pi * np.array(stands), place)
        for stands, place in zip(pair, places, strict=True)
    ])  # fmt: skip
    if not (np.abs(wrapped(config, states[[0, -1]] - ends)) < _DEFECT).all():
        raise ValueError(f"{path} holds plans that do not lead where they say")
    missed = np.abs(StepModel(config)(states[:-1], actions) - states[1:]).max()
    if not missed < _DEFECT:
        raise ValueError(
            f"{path} holds plans of another environment: a step misses the next state by "
            f"{missed:.2g}, at most {_DEFECT:g}"
        )
