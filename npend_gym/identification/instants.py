"""Instants of a recording that were rounded."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.physics.arguments import warn_caller

MIN_ROWS = 20  # in a stretch that is used: fewer rows say nothing beside their own first state
_COARSE = 0.02  # of the interval: times that are rounded to less are as good as exact


def evenly_spaced(given: FloatArray, pieces: Sequence[slice]) -> FloatArray:
    """Return times with the even intervals from which they were rounded, where they were.

    A film has 60 frames a second and times with two decimals: they are wrong by up to 5 ms.
    """
    times, intervals = given.copy(), list[float]()
    for rows in pieces:
        own = times[rows]
        unit = next((u for u in (1.0, 0.1, 0.01, 1e-3, 1e-4) if _is_multiple(own, u)), 0.0)
        steps = np.diff(own)
        if own.size < MIN_ROWS or unit == 0.0 or np.any(steps < 0.0) or np.ptp(steps) < 0.5 * unit:
            continue
        mean = float(own[-1] - own[0]) / (own.size - 1)
        typical = float(np.mean(steps[steps <= np.median(steps) + 1.5 * unit]))
        numbers = list[FloatArray]()
        if np.ptp(steps) < 1.5 * unit:  # else rows are missing, or stand twice
            numbers.append(np.arange(own.size, dtype=np.float64))
        if typical > 0.0:
            numbers.append(np.cumsum(np.rint(np.r_[0.0, steps] / typical)))
        for frames in numbers:
            interval, first = np.polyfit(frames, own, 1) if mean > 0.0 else (0.0, 0.0)
            even = first + interval * frames
            away = np.max(np.abs(even - own)) / unit
            if 0.1 < away < 0.55 and np.all(np.diff(frames) > 0.0) and unit > _COARSE * interval:
                times[rows] = even
                intervals.append(float(interval))
                break
    if not intervals:
        return given
    warn_caller(
        "times are rounded: rows are taken as evenly spaced, "
        f"{1e3 * float(np.median(intervals)):.4g} ms apart; give times with more decimals"
    )
    return times


def _is_multiple(times: FloatArray, unit: float) -> bool:
    return bool(np.all(np.abs(times / unit - np.rint(times / unit)) < 1e-6))
