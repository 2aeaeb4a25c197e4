"""A pivot, or a cart, that was moved sideways and measured: what its acceleration does.

In the frame of a pivot with the acceleration a, the force -h_i a cos(theta_i) acts on link i, h_i
being its lift. Torques u_j at the joints, u_j - u_{j+1} being that force, do the same.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import LSQUnivariateSpline

from npend_gym._checks import FloatArray
from npend_gym.identification.motion import Motion, checked_finite

_KNOTS = 12.0  # of the spline of positions in a typical period of the swing
_DEGREE = 5


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
        most = max(1, (times.size - 2 * _DEGREE) // 2)
        parts = max(1, min(most, round(_KNOTS * float(times[-1] - times[0]) / period)))
        knots = np.quantile(times, np.arange(1, parts) / parts)
        acceleration[rows] = LSQUnivariateSpline(times, places[rows], knots, k=_DEGREE)(times, 2)
    return replace(motion, position=places, acceleration=acceleration)


def levers(motion: Motion) -> FloatArray:
    """Return the torques at the joints for a lift of one of each link, (T, joints, links)."""
    out = np.zeros((motion.times.size, motion.links, motion.links))
    if motion.acceleration is not None:
        force = -motion.acceleration[:, None] * np.cos(motion.theta)
        out += force[:, None, :] * np.tri(motion.links).T
    return out
