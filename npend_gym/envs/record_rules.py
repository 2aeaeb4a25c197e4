"""Which numbers the fields of a state may have: `set_state` refuses all others.

A rule is of one number. Whether the numbers of a record fit each other, for example a length and
its inverse, is not checked: such a record gives a wrong motion, but a finite one.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.compiled.sincos import MAX_ANGLE
from npend_gym.envs.config import EnvConfig
from npend_gym.physics.kernels.layout import MAX_SPEED
from npend_gym.physics.kernels.link_terms import Base, Joint, Link

_MOST = sys.float_info.max


class Rule(NamedTuple):
    """What one number of a record may be: from `low` to `high`, or NaN where that means none."""

    low: float = -_MOST
    high: float = _MOST
    step: float = 0.0  # between the numbers allowed; 0: all are
    nan: bool = False

    def __str__(self) -> str:
        if self.high - self.low <= 2.0 and (self.step > 0.0 or self.low == self.high):
            allowed = np.arange(self.low, self.high + 1.0, self.step or 1.0).astype(int)
            return " or ".join(map(str, allowed.tolist()))
        kind = "whole" if self.step else "real" if math.isinf(self.high) else "finite"
        if self.high < _MOST:
            bounds = f" from {self.low:g} to {self.high:g}"
        else:
            bounds = "" if self.low < 0.0 else " greater than zero" if self.low else " from zero on"
        return f"a {kind} number{bounds}" + (" or NaN" if self.nan else "")


_ANY, _SIZE, _POSITIVE = Rule(), Rule(0.0), Rule(math.ulp(0.0))
_COUNT, _TRUTH, _SIGN = Rule(0.0, 2.0**53, 1.0), Rule(0.0, 1.0, 1.0), Rule(-1.0, 1.0, 2.0)
_INSTANT = Rule(0.0, nan=True)
_ANGLE, _SPEED = Rule(-MAX_ANGLE, MAX_ANGLE), Rule(-MAX_SPEED, MAX_SPEED)

_MEMBERS = {
    "time": _SIZE, "threshold": _SIZE, "diverged": _TRUTH, "active": _TRUTH, "gravity": _SIZE,
    "mean_squared_action": Rule(0.0, 1.0), "starting": Rule(0.0, 0.0), "observed": _TRUTH,
    "max_torque": _SIZE, "per_energy": _SIZE, "per_length": _SIZE, "ideal_period": _SIZE,
    "has_bobs": _TRUTH, "episode": _COUNT, "steps": _COUNT, "steps_held": _COUNT,
    "amplitude": _ANGLE, "max_force": _SIZE, "cart_mass": _SIZE, "rail_damping": _SIZE,
    "start": _SIGN, "goal": _SIGN,
}  # fmt: skip
_RODS = {
    "theta": _ANGLE, "omega": _SPEED, "period": _INSTANT, "orientation": _SIGN,
    "sign": Rule(-1.0, 1.0, 1.0), "risen": _TRUTH, "zero": _INSTANT, "length": _POSITIVE,
    "inverse_length": _POSITIVE, "damping": _SIZE, "drag": _SIZE, "quadratic_drag": _SIZE,
    "mass": _POSITIVE, "inverse_mass": _SIZE,
}  # fmt: skip
_LINKS = {"mass": _POSITIVE, "z": _SIZE, "inertia": _SIZE}
_JOINTS = {
    "friction": _SIZE, "per_speed": _SIZE, "armature": _SIZE, "drag": _SIZE,
    "quadratic_drag": _SIZE, "gear": Rule(-math.inf, math.inf), "friction_speed": _SIZE,
}  # fmt: skip
_BASE = {"inverse_mass": _SIZE, "damping": _SIZE}
_UNNAMED = {"links": (Link, _LINKS), "joints": (Joint, _JOINTS), "base": (Base, _BASE)}
_MORE = {"past_actions": Rule(-1.0, 1.0)}


class RecordRules:
    """The rules of all numbers of a record, one after the other.

    Parameters
    ----------
    config : EnvConfig
    parts : mapping
        Name -> dtype and shape of the parts of a record.
    """

    def __init__(self, config: EnvConfig, parts: Mapping[str, np.dtype[np.void]]) -> None:
        of_config = {name: Rule(0.0, most) for name, most in config.largest.items()}
        of_config["completed"] = Rule(0.0, float(config.n), 1.0)
        com = float(config.mode.measures_com)
        of_config["with_com"] = Rule(com, com)
        self._fields = fields = list(_listed(parts, _MEMBERS | of_config))
        counts = np.array([count for *_, count in fields])
        self._ends: NDArray[np.int64] = np.cumsum(counts)
        self._low, self._high, steps, may_be_nan = (
            np.repeat([rule[k] for _, rule, _ in fields], counts) for k in range(4)
        )
        last = self._ends[[name.startswith("rods.") for name, *_ in fields]] - 1
        self._low[last] = np.minimum(self._low[last], 0.0)  # these are free in most fields
        self._whole, self._may_be_nan = np.flatnonzero(steps), np.flatnonzero(may_be_nan)
        self._steps = steps[self._whole]

    def check(self, numbers: FloatArray) -> None:
        """Raise a ValueError that names the first of `numbers`, (k, all), that breaks its rule."""
        good = (numbers >= self._low) & (numbers <= self._high)
        good[:, self._may_be_nan] |= np.isnan(numbers[:, self._may_be_nan])
        if good.all():
            whole = self._whole
            places = np.remainder(numbers[:, whole] - self._low[whole], self._steps)
            good[:, whole] = places == 0.0
        if not good.all():
            place: list[int] = np.argwhere(~good)[0].tolist()
            row, column = place
            name, rule, _ = self._fields[int(np.searchsorted(self._ends, column, "right"))]
            record = f" of record {row}" if len(numbers) > 1 else ""
            raise ValueError(
                f"state must have {rule} as {name}{record}, "
                f"got {float(numbers[row, column])!r}: give it as get_state() returned it"
            )


def _listed(
    parts: Mapping[str, np.dtype[np.void]], members: Mapping[str, Rule]
) -> Iterator[tuple[str, Rule, int]]:
    """Yield name, rule and size of every field, in the order of the record."""
    for part, dtype in parts.items():
        if part in _UNNAMED:
            names, rules = _UNNAMED[part]
            rows, columns = dtype.shape
            for name in names._fields[:rows]:
                yield f"{part}.{name.lower()}", rules.get(name.lower(), _ANY), columns
        elif dtype.names is None:
            yield part, _MORE.get(part, _ANY), math.prod(dtype.shape)
        else:
            rules = members if part == "members" else _RODS
            for name in dtype.names:
                yield f"{part}.{name}", rules.get(name, _ANY), math.prod(dtype[name].shape)
