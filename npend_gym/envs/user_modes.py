"""Modes of the user's own, whose methods Python calls: starts, rewards, ends and success."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._streams import Purpose
from npend_gym.compiled.philox import generator
from npend_gym.compiled.sincos import MAX_ANGLE
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.kernels import ruled
from npend_gym.envs.laws import of_kind
from npend_gym.envs.modes import Mode, Quantities
from npend_gym.envs.outputs import Outputs
from npend_gym.envs.rows import Episode, Flag, Output, Setting, Task
from npend_gym.envs.seeds import LaneNumbers
from npend_gym.physics.kernels.layout import MAX_SPEED, Member

_ruled = of_kind(ruled)
# What NumPy, Python and PyTorch say where an array is taken for one number
_OF_ARRAYS = "is ambiguous", "Python scalar", "to a scalar"


def returned_by(mode: Mode, method: str, quantities: Quantities[Any]) -> Any:
    """Result of a method of a mode; an error says that it takes arrays for numbers."""
    try:
        return getattr(mode, method)(quantities)
    except (ValueError, TypeError, RuntimeError) as error:
        if not any(text in str(error) for text in _OF_ARRAYS):
            raise
        raise type(error)(
            f"{method} of mode {mode.name!r} must work on arrays: quantities have an entry for "
            "each lane of a vector environment, theta and omega one for each rod. Use + - * /, abs "
            "and comparisons: np.where, or a comparison times a number, in place of `if`; & | in "
            "place of `and`, `or`; functions of NumPy in place of min, max and those of math; got "
            f"the error: {error}"
        ) from error


def start_states(
    config: EnvConfig, members: FloatArray, seeds: Sequence[int], chosen: LaneNumbers
) -> tuple[FloatArray, FloatArray]:
    """Return the angles and velocities, (k, n), at which the mode starts `chosen` lanes."""
    theta, omega = np.empty((2, chosen.size, config.n))
    for row, k in enumerate(chosen):
        rows = [Episode.EPISODE, Setting.amplitude, Setting.spread]
        episode, amplitude, spread = members[rows, k].tolist()
        rng = generator(seeds[int(k)], 0, Purpose.START, int(episode))
        pair: Any = config.mode.start(rng, config.n, amplitude, spread)
        is_pair = type(pair) in (tuple, list) or np.ndim(pair) == 2
        if not is_pair or len(pair) != 2:
            raise ValueError(
                f"start of mode {config.mode.name!r} must return two arrays of shape "
                f"({config.n},), angles and angular velocities; got {_checks.show(pair)}"
            )
        angles, speeds = pair
        for name, values, limit, out in (
            ("angles", angles, MAX_ANGLE, theta), ("velocities", speeds, MAX_SPEED, omega)
        ):  # fmt: skip
            label = f"the {name} of mode.start"
            out[row] = _checks.within(label, _checks.vector(label, values, config.n), limit)
    return theta, omega


def judge(results: Outputs, members: FloatArray, task: FloatArray, *, observes: bool) -> None:
    """Write reward, end and success as the mode judges."""
    config, count = results.config, results.count
    outputs, flags = results.rows[:, :count], results.flags[:, :count]
    quantities = results.quantities()
    held, starts = members[Episode.STEPS_HELD], members[Episode.STARTING] > 0.0
    judged = starts if observes else np.ones(count, np.bool_)
    own = [_checked(config.mode, method, quantities, count) for method in ("failed", "achieved")]
    needs_reward = not observes and config.reward_type != "sparse"
    reward = _checked(config.mode, "reward", quantities, count) if needs_reward else np.zeros(())
    place, upright = quantities.rail_position, quantities.uprightness
    reward, failed, achieved = _ruled(task, place, upright, reward, *own)
    held[judged] *= np.broadcast_to(achieved, (count,))[judged]
    flags[Flag.SUCCESS] = held > task[Task.HOLD_STEPS]
    if not observes:
        rewards = outputs[Output.REWARD]
        rewards[:] = np.where(starts, 0.0, reward)
        wrong = np.flatnonzero(~(np.isfinite(rewards) | flags[Flag.DIVERGED]))
        if wrong.size > 0:
            raise ValueError(
                f"reward of mode {config.mode.name!r} must be finite, "
                f"got {rewards[wrong[0]]:g} in sub-environment {wrong[0]}"
            )
        flags[Flag.TERMINATED] = failed & ~starts
    members[Episode.STARTING], members[Member.ACTIVE] = 0.0, 1.0


def _checked(mode: Mode, method: str, quantities: Quantities[Any], count: int) -> NDArray[Any]:
    """Result of a method of the mode, of shape () or (B,); an error says what is wrong."""
    is_reward = method == "reward"
    value = returned_by(mode, method, quantities)
    try:
        out = np.asarray(value)
    except ValueError:  # lists of several lengths
        out = np.array(None)
    is_kind = out.dtype.kind in ("biuf" if is_reward else "biu")  # True * True is an integer
    if is_kind and out.shape in ((), (count,)):
        return out if is_reward else out.astype(np.bool_, copy=False)
    rule = "a finite number" if is_reward else "True or False"
    raise (ValueError if is_kind else TypeError)(
        f"{method} of mode {mode.name!r} must be {rule}, or an array of them of shape "
        f"({count},), got {_checks.show(out.tolist() if out.shape else value)}"
    )
