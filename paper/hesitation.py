"""How the bobs near the pivot hesitate after a release, and complete their pseudo-period early.

A release sends a front down the chain, which the free end reflects. At small angles the bobs have
swung back for long when it returns. From some 0.6 rad on it meets those near the pivot just after
their first reversal: their velocity falls again before it arrives, below zero in many, which
completes their pseudo-period (definition "bob") a whole swing early. The velocities are a few
percent of what they were before: the bobs hesitate.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from npend_gym import Chain, pseudo_periods, simulate, theory
from npend_gym.physics import tensions
from npend_gym.tools import FloatArray

EARLY = 0.8  # T1: a bob that completes before this has not swung to and fro
_RTOL = 1e-8


def heights(n: int) -> FloatArray:
    """Return the height of every bob over the free end by the length, (N - i + 1/2)/(N + 1/2)."""
    rods: FloatArray = np.arange(n, dtype=np.float64)
    return (n - rods - 0.5) / (n + 0.5)


def hesitation_rows(n_values: Sequence[int], amplitudes: Sequence[float]) -> list[dict[str, Any]]:
    """Return the tidy table of early bobs: a row for every number of rods and angle.

    Parameters
    ----------
    n_values : sequence of int
        Numbers of equal rods.
    amplitudes : sequence of float
        Starting angles of all rods [rad].

    Returns
    -------
    list of dict
        Share of the bobs that complete before 0.8 T1, and earliest, mean and median pseudo-period,
        definition "bob", over T1. "lowest" is the height over the free end of the lowest bob in the
        longest group of neighbours that are early, NaN where none is.
    """
    rows: list[dict[str, Any]] = []
    for n in n_values:
        chain, height = Chain.uniform(n), heights(n)
        t1 = theory.fundamental_period(chain)
        for amplitude in amplitudes:
            ratio = pseudo_periods(chain, amplitude, duration=2.0 * t1, rtol=_RTOL) / t1
            early = ratio < EARLY
            rows.append({
                "n": n, "angle_rad": amplitude, "share": float(early.mean()),
                "lowest": _lowest(early, height), "earliest": float(np.nanmin(ratio)),
                "mean": float(np.nanmean(ratio)), "median": float(np.nanmedian(ratio)),
            })  # fmt: skip
    return rows


def _lowest(early: NDArray[np.bool_], height: FloatArray) -> float:
    """Return the height of the last bob of the longest group of neighbours that are `early`."""
    best, run, lowest = 0, 0, math.nan
    for k, one in enumerate(early.tolist()):
        run = run + 1 if one else 0
        if run > best:
            best, lowest = run, float(height[k])
    return lowest


def front_times(n: int, amplitude: float) -> tuple[float, float]:
    """Return when the front of a release reaches the free end, and the pivot again, over T1."""
    tip, back = front_passes(n, amplitude, [0.0, 1.0])
    return float(tip), float(back)


def front_passes(n: int, amplitude: float, at: ArrayLike, frames: int = 2000) -> FloatArray:
    """Return when the front of a release, on its way back, is at the heights `at`, over T1.

    The front moves along the chain, of two or more rods, at the speed of its waves: sqrt(T/(m l))
    rods a second with the tension T [N] of the simulation. It is zero at the free end of the rope,
    half a rod below the last bob. With y the rods from there to the front, u = sqrt(y) moves at
    sqrt(T/y)/2, and is reflected at u = 0. NaN where the front is not back within T1.
    """
    chain = Chain.uniform(n)
    t1 = theory.fundamental_period(chain)
    times = np.linspace(0.0, t1, frames)
    motion = simulate(chain, amplitude, 0.0, times, rtol=_RTOL, atol=1e-2 * _RTOL)
    below: FloatArray = np.arange(1.0, n + 1.0)  # rods from the middle of each rod to the free end
    # the last rod's stands for all nearer to the free end, for T goes to zero as y does
    ratio: FloatArray = tensions(chain, motion.theta, motion.omega)[:, ::-1] / below

    def speed(k: int, u: float) -> float:
        row: FloatArray = ratio[k]
        return 0.5 * math.sqrt(max(float(np.interp(u * u, below, row)), 0.0))

    step = t1 / (frames - 1)
    passed: FloatArray = np.empty(frames)  # -u, from -sqrt(n + 1/2) upwards
    passed[0] = -math.sqrt(n + 0.5)
    for k in range(frames - 1):
        first = speed(k, float(passed[k]))
        passed[k + 1] = passed[k] + 0.5 * step * (
            first + speed(k + 1, float(passed[k]) + step * first)
        )
    marks: FloatArray = np.sqrt((n + 0.5) * np.asarray(at, float))
    return np.interp(marks, passed, times / t1, right=math.nan)


class Velocities(NamedTuple):
    """Horizontal velocities of some bobs of a release.

    times : (T,), over T1. heights : (H,), over the length. values : (H, T), by the greatest speed
    that the bob has had. passes : (H,), when the front comes back to each bob, over T1. front :
    when it is back at the pivot, over T1.
    """

    times: FloatArray
    heights: FloatArray
    values: FloatArray
    passes: FloatArray
    front: float


def velocities(n: int, amplitude: float, at: ArrayLike, frames: int = 1200) -> Velocities:
    """Return the velocities of the bobs nearest to the heights `at` (0 tip, 1 pivot)."""
    chain = Chain.uniform(n)
    t1 = theory.fundamental_period(chain)
    times = np.linspace(0.0, 1.2, frames)
    motion = simulate(chain, amplitude, 0.0, times * t1, rtol=_RTOL, atol=1e-2 * _RTOL)
    bobs = np.abs(heights(n)[:, None] - np.asarray(at)).argmin(axis=0)
    speeds = motion.velocities()[:, bobs, 0].T
    greatest = np.maximum.accumulate(np.abs(speeds), axis=1)
    speeds /= np.where(greatest > 0.0, greatest, 1.0)  # all are at rest at first
    passes = front_passes(n, amplitude, np.append(heights(n)[bobs], 1.0))
    return Velocities(times, heights(n)[bobs], speeds, passes[:-1], float(passes[-1]))


def onset(n: int, height: float = 0.9, low: float = 0.5, high: float = 0.75) -> float:
    """Return the least amplitude [rad] from which the bob at `height` completes early.

    The bob's velocity after its first reversal has a minimum when the front returns; it is zero
    there at the amplitude that is returned. ValueError is raised if it is not between the two.
    """
    try:
        return float(brentq(lambda a: _dip(n, a, height), low, high, xtol=1e-4))
    except (IndexError, ValueError) as error:  # no bob so high; the same sign at both angles
        rule = f"whose bob at {height:g} is early from an angle of {low:g} to {high:g} rad on"
        raise ValueError(f"n must be a number of rods {rule}, got {n}") from error


def _dip(n: int, amplitude: float, height: float) -> float:
    """Return the minimum of the velocity of the bob at `height` near the front's return [m/s]."""
    chain = Chain.uniform(n)
    t1 = theory.fundamental_period(chain)
    times = np.append(0.0, np.linspace(0.58, 0.72, 701) * t1)
    motion = simulate(chain, amplitude, 0.0, times, rtol=_RTOL, atol=1e-2 * _RTOL)
    speeds = motion.velocities()[1:, :, 0]
    above = int(np.flatnonzero(heights(n) >= height)[-1])  # of the two bobs around it
    share = (float(heights(n)[above]) - height) * (n + 0.5)
    at: FloatArray = (1.0 - share) * speeds[:, above] + share * speeds[:, above + 1]
    change: FloatArray = np.diff(at)
    inner = np.flatnonzero((change[:-1] < 0.0) & (change[1:] >= 0.0)) + 1
    return float(at[inner].min() if inner.size else at.min())
