"""How the steps of a motion are taken: its method, and what drives it."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.compiled.callbacks import Callback
from npend_gym.physics.drives import Drives, slots
from npend_gym.physics.kernels.driven import AFTER_TORQUES
from npend_gym.physics.kernels.methods import METHODS, longest_gap
from npend_gym.physics.mechanism import Mechanism
from npend_gym.physics.motion import Integration
from npend_gym.physics.signals import Signal, TimeVarying, varies
from npend_gym.physics.substeps import GAP


class Function:
    """A function that drives a motion; it pickles by its name, where it has one.

    A copy that lost the function says so where it is needed.
    """

    def __init__(self, function: Callable[..., Any] | None, name: str | None = None) -> None:
        self.function = function
        self.name: str | Any = name or getattr(function, "__name__", type(function).__name__)

    def required(self) -> Callable[..., Any]:
        """Return the function; a copy that lost it raises a ValueError."""
        if self.function is None:
            raise ValueError(
                f"this needs the function {self.name}, which could not be pickled with the "
                "trajectory: define it at the top of a module, or simulate again"
            )
        return self.function

    def __call__(self, *arguments: Any) -> Any:
        """Value of the function."""
        return self.required()(*arguments)

    def __deepcopy__(self, _: Any) -> Function:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        try:
            pickle.dumps(self.function)
        except Exception:  # noqa: BLE001 - lambdas and closures raise different ones
            return Function, (None, self.name)
        return Function, (self.function, self.name)


def described(drive: Any, how: str = "") -> Any:
    """Return a drive as records name it: numbers, samples, or a function and `how` it is called."""
    if isinstance(drive, Signal):
        return f"{len(np.asarray(drive.values))} samples, {drive.kind}"
    if callable(drive):
        return f"function {(drive if isinstance(drive, Function) else Function(drive)).name}{how}"
    return None if drive is None else np.asarray(drive, float).tolist()


AT_REST = np.zeros(2)  # acceleration of a pivot that functions or signals accelerate


class Recipe(NamedTuple):
    """How `simulate` takes the steps of a motion: its method, and what drives it."""

    method: str
    settings: dict[str, float]  # "rtol" and "atol", or "dt"
    torque: Any  # on every joint [N m], (n,) or (B, n); or a Signal or Function
    force: Any = 0.0  # on a cart [N], () or (B,); or a Signal or Function
    pivot_acceleration: Any = None  # [m/s^2], (2,); or a Signal or Function
    longest_step: Any = None  # [s], () or (B,), beside "dt" where functions drive a motion

    def of_motion(self, k: int) -> Recipe:
        """Return the recipe of motion `k` of many, with its own drives."""
        # of arrays with a row for each
        axes = {"torque": 2, "force": 1, "pivot_acceleration": 2, "longest_step": 1}
        drives = {name: getattr(self, name) for name in axes}
        own = {
            name: drive[k]
            for name, drive in drives.items()
            if isinstance(drive, np.ndarray) and drive.ndim == axes[name]
        }
        return self._replace(**own)


def drives_of(mechanism: Mechanism, recipe: Recipe) -> Drives:
    """Drives of one motion by a recipe.

    Raises
    ------
    ValueError
        If a copy lost a function.
    """
    n = mechanism.n
    fixed, varying = np.zeros(n + AFTER_TORQUES), dict[str, TimeVarying]()
    for name, place in slots(n).items():
        value = getattr(recipe, name)
        if varies(value):
            varying[name] = value.required() if isinstance(value, Function) else value
        elif value is not None:
            fixed[place] = value
    return Drives(n, fixed, varying, n + (mechanism.places > 0))


def motion_of(
    mechanism: Mechanism,
    state: FloatArray,
    begin: float,
    recipe: Recipe,
    kept: dict[Any, Callback] | None = None,
    members: slice | None = None,
) -> Integration:
    """Return a motion from a state (2m,), ready to be integrated by a recipe.

    `kept` is as for `Drives.begin`, `members` as for `Integration`.
    """
    drives = drives_of(mechanism, recipe)
    m = mechanism.size
    drives.begin(begin, state[:m], state[m:], kept)
    settings = dict(recipe.settings)
    if recipe.longest_step is not None:
        # steps of "rk4" end at each of the times
        gap = GAP if recipe.method == "rk4" else longest_gap(METHODS[recipe.method])
        longest = float(recipe.longest_step) * min(1.0, GAP / gap)
        settings["dt"] = min(settings.get("dt", math.inf), longest)
    return Integration(mechanism, state, drives, settings, members, recipe.method)
