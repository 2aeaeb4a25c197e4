"""Parts of measured motion side by side, each to be simulated from a first state of its own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.integrate import cumulative_trapezoid

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.identification.motion import MIN_ROWS, Motion


@dataclass(frozen=True, eq=False)
class Segments:
    """Parts of a measured motion, filled up to M rows each, and the grid that simulates them.

    Attributes
    ----------
    rows : list of slice
        The rows of the S segments in the motion.
    times : ndarray, shape (S, M)
        Time since the start of the segment [s].
    theta : ndarray, shape (S, M, n)
        Measured angles [rad]; zero where there is none.
    measured : ndarray, bool, shape (S, M)
        Which of these are rows of the motion.
    step : float
        Interval of the grid [s]; it begins at the start of each segment.
    torque : ndarray, shape (steps, S, n)
        Mean torque in each interval of the grid [N m].
    """

    rows: list[slice]
    times: FloatArray
    theta: FloatArray
    measured: BoolArray
    step: float
    torque: FloatArray


def cut(motion: Motion, stretches: Sequence[slice], duration: float) -> list[slice]:
    """Return the rows of stretches, each cut into equal parts of at most `duration` [s]."""
    out: list[slice] = []
    for rows in stretches:
        times = motion.times[rows] - motion.times[rows.start]
        parts = max(1, math.ceil(times[-1] / duration - 0.05))  # rather one that is 5 % longer
        inner = [float(times[-1]) * k / parts for k in range(1, parts)]
        edges = [rows.start + int(np.searchsorted(times, one)) for one in inner]
        out += [slice(a, b) for a, b in pairwise([rows.start, *edges, rows.stop])]
    return [rows for rows in out if rows.stop - rows.start >= MIN_ROWS]


def side_by_side(motion: Motion, parts: Sequence[slice], longest_step: float) -> Segments:
    """Return parts of a motion as segments on a grid of intervals not above `longest_step` [s].

    The interval of the grid is a multiple of the median one of the rows, or an equal part of it.
    """
    size, most = len(parts), max(rows.stop - rows.start for rows in parts)
    times, theta = np.zeros((size, most)), np.zeros((size, most, motion.links))
    measured = np.zeros((size, most), np.bool_)
    for k, rows in enumerate(parts):
        count = rows.stop - rows.start
        times[k, :count] = motion.times[rows] - motion.times[rows.start]
        theta[k, :count] = motion.theta[rows]
        measured[k, :count] = True
    interval = float(np.median(np.diff(times, axis=1)[measured[:, 1:]]))
    several = math.floor(longest_step / interval + 1e-9)
    step = several * interval if several else interval / math.ceil(interval / longest_step - 1e-9)
    steps = math.ceil(float(times.max()) / step - 1e-6)
    torque = np.zeros((steps, size, motion.links))
    if motion.torque is not None:
        edges = np.arange(steps + 1) * step
        for k, rows in enumerate(parts):
            at = times[k, : rows.stop - rows.start]
            impulse = cumulative_trapezoid(motion.torque[rows], at, axis=0, initial=0)
            for joint in range(motion.links):
                torque[:, k, joint] = np.diff(np.interp(edges, at, impulse[:, joint])) / step
    return Segments(list(parts), times, theta, measured, step, torque)
