"""A pivot, or a cart, that was moved sideways and measured: what its acceleration does.

In the frame of a pivot with the acceleration a, the force -h_i a cos(theta_i) acts on link i, h_i
being its lift. Torques u_j at the joints, u_j - u_{j+1} being that force, do the same.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import LSQUnivariateSpline

from npend_gym._checks import FloatArray
from npend_gym.identification.motion import Motion, checked_finite

_KNOTS = 12.0  # of the spline of positions in a typical period of the swing
_DEGREE = 5
_SEVERAL = 3.0  # times the noise: what a spline leaves that does not follow the positions
_ORDER = 6  # of the differences that show the noise


def with_position(motion: Motion, position: ArrayLike | None) -> Motion:
    """Return the motion with the acceleration of its pivot, whose positions [m] are given (T,).

    Raises
    ------
    ValueError, TypeError
        If there is no finite position for each instant.
    """
    if position is None:
        return motion
    places = checked_finite("position", position)
    if places.shape != motion.times.shape:
        raise ValueError(
            f"position must have a number for each of the {motion.times.size} instants [m], got "
            f"shape {places.shape}"
        )
    acceleration, period = np.zeros_like(places), motion.period()
    for rows in motion.stretches():
        times = motion.times[rows]
        parts = max(1, round(_KNOTS * float(times[-1] - times[0]) / period))
        acceleration[rows] = _spline(times, places[rows], parts)(times, 2)
    return replace(motion, position=places, acceleration=acceleration)


def _spline(times: FloatArray, places: FloatArray, parts: int) -> Any:
    """Return a spline of `parts` parts, or of twice as many until it follows the positions.

    It follows them where what is left is noise: no larger than what differs from row to row.
    """
    most, noise = max(1, (times.size - 2 * _DEGREE) // 2), _noise(places)
    while True:
        parts = min(parts, most)
        knots = np.quantile(times, np.arange(1, parts) / parts)
        spline = LSQUnivariateSpline(times, places, knots, k=_DEGREE)
        if parts == most or np.std(places - spline(times)) <= _SEVERAL * noise:
            return spline
        parts *= 2


def _noise(places: FloatArray) -> float:
    """Return the standard deviation of what changes positions from row to row [m]."""
    order = min(_ORDER, places.size - 1)
    changes = np.abs(np.diff(places))
    rounding = float(np.min(changes, where=changes > 0.0, initial=np.inf)) / math.sqrt(12.0)
    rounded = rounding if np.any(changes == 0.0) else 0.0
    scatter = float(np.std(np.diff(places, order)))
    return max(scatter / math.sqrt(math.comb(2 * order, order)), rounded)


def levers(motion: Motion) -> FloatArray:
    """Return the torques at the joints for a lift of one of each link, (T, joints, links)."""
    out = np.zeros((motion.times.size, motion.links, motion.links))
    if motion.acceleration is not None:
        force = -motion.acceleration[:, None] * np.cos(motion.theta)
        out += force[:, None, :] * np.tri(motion.links).T
    return out
