"""Quantities that were sampled in time, with which a motion is driven."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray

KINDS = ("previous", "linear")
_MAX_SAMPLES = 10_000_000
_ROUNDING = 4.0 * np.finfo(float).eps  # of instants that were summed, not multiplied


@dataclass(frozen=True, eq=False)
class Signal:
    """A quantity that was sampled in time: a torque, a force, an acceleration of the pivot.

    Parameters
    ----------
    times : array_like, shape (K,)
        Instants [s], increasing.
    values : array_like, shape (K,) or (K, m)
        The quantity at these instants. "previous" also accepts one value fewer: ``values[k]`` holds
        from ``times[k]`` to ``times[k + 1]``.
    kind : {"previous", "linear"}
        Constant from each instant to the next, or on straight lines between them (the names of
        `scipy.interpolate.interp1d`).

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, Signal, simulate
    >>> times = np.linspace(0.0, 1.0, 11)
    >>> push = Signal(times, 5.0 * np.sin(times)[:, None], kind="linear")
    >>> motion = simulate(Chain.uniform(1), 0.0, 0.0, [0.0, 1.0], torque=push)
    >>> motion.theta[-1].round(4).tolist()
    [0.478]
    """

    times: ArrayLike
    values: ArrayLike
    kind: str = "previous"

    def __post_init__(self) -> None:
        """Check and keep the arguments as arrays."""
        times, values = _checks.array("times", self.times), _checks.array("values", self.values)
        kind = _checks.choice("kind", self.kind, KINDS)
        if times.ndim != 1 or not 2 <= times.size <= _MAX_SAMPLES or np.any(np.diff(times) <= 0.0):
            raise ValueError(
                f"times must be two or more increasing instants, got {_checks.show(times)}"
            )
        fits = {times.size, times.size - 1} if kind == "previous" else {times.size}
        if values.ndim not in (1, 2) or len(values) not in fits:
            raise ValueError(
                f"values must have a row for each of the {times.size} times"
                + (", or for each interval between them" if kind == "previous" else "")
                + f", got shape {values.shape}"
            )
        for name, samples in (("times", times), ("values", values)):
            samples.setflags(write=False)
            object.__setattr__(self, name, samples)

    def __call__(self, t: float) -> FloatArray:
        """Return the quantity at the instant `t` [s], shape () or (m,).

        Raises
        ------
        ValueError
            If it lies outside the samples.
        """
        times, values = np.asarray(self.times), np.asarray(self.values)
        if not self.covers(t):
            raise ValueError(
                f"t must lie within the samples, {times[0]:.10g} to {times[-1]:.10g} s, got "
                f"{t:.10g}"
            )
        t = min(max(t, times[0]), times[-1])
        k = min(int(np.searchsorted(times, t, side="right")), len(values)) - 1
        if self.kind == "previous" or t == times[k]:
            return values[k].copy()
        x = (t - times[k]) / (times[k + 1] - times[k])
        return values[k] + x * (values[k + 1] - values[k])

    def covers(self, *instants: float) -> bool:
        """Return whether instants [s] lie within the samples, or beside them by rounding."""
        times = np.asarray(self.times)
        beside = _ROUNDING * max(abs(times[0]), abs(times[-1]))
        return all(times[0] - beside <= t <= times[-1] + beside for t in instants)

    def line(self, t: float) -> tuple[FloatArray, FloatArray]:
        """Return the value at `t` and the slope from there to the next sample, (m,) each."""
        times, values = np.asarray(self.times), np.asarray(self.values)
        k = max(0, min(int(np.searchsorted(times, t, side="right")), times.size - 1) - 1)
        value = np.atleast_1d(values[k])
        if self.kind == "previous":
            return value, np.zeros_like(value)
        slope = (np.atleast_1d(values[k + 1]) - value) / (times[k + 1] - times[k])
        return value + (t - times[k]) * slope, slope


TimeVarying = Signal | Callable[..., Any]


def varies(value: Any) -> bool:
    """Return whether a drive changes in time: a `Signal` or a function."""
    return isinstance(value, Signal) or callable(value)
