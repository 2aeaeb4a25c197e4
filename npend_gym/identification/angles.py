"""How angles follow from what sensors record: positions of markers, and rates of a gyroscope."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from npend_gym._checks import FloatArray
from npend_gym.identification.motion import Motion, passes

_UNIT = 0.01  # by so much a quaternion's sum of squares differs from 1, where it is rounded
_FIXED = 0.05  # of the scatter of the next marker: one that moves less is the pivot
_ROUND = 0.03  # scatter of the distance from the middle of a circle, of its mean


def from_positions(
    places: FloatArray, film: bool, said: list[str]
) -> tuple[FloatArray, FloatArray]:
    """Return the angles, and the lengths, of links between markers at `places` (T, markers, 2)."""
    scatter = np.sqrt(places.var(axis=0).sum(axis=1))
    if len(scatter) > 1 and scatter[0] < _FIXED * scatter[1]:
        pivot, places, how = np.median(places[:, 0], axis=0), places[:, 1:], "the first marker"
    elif is_circle(places[:, 0]):
        pivot, how = np.zeros(2), "the origin"
    else:
        pivot, how = centre_of_circle(places[:, 0]), "the centre of the first marker's circle"
    joints = np.concatenate([np.broadcast_to(pivot, (len(places), 1, 2)), places], axis=1)
    x, y = (np.diff(joints[:, :, k], axis=1) for k in (0, 1))
    down = film or float(np.mean(y[:, 0] / np.hypot(x[:, 0], y[:, 0]))) > 0.5
    theta, lengths = np.arctan2(x, y if down else -y), np.median(np.hypot(x, y), axis=0)
    shown = ", ".join(f"{length:.4g}" for length in lengths.tolist())
    said.append(
        f"positions are read with y {'down' if down else 'up'} and the pivot at {how}; links are "
        f"{shown} long in their unit"
    )
    return theta, lengths


def is_quaternion(values: FloatArray) -> bool:
    """Return whether rows of four numbers are turns in space: no four angles keep such a sum."""
    return bool(np.all(np.abs((values**2).sum(axis=1) - 1.0) < _UNIT))


def is_circle(places: FloatArray) -> bool:
    """Return whether places (T, 2) lie on a circle about the origin."""
    away: FloatArray = np.hypot(*places.T)
    return bool(np.std(away) < _ROUND * np.mean(away))


def centre_of_circle(places: FloatArray) -> FloatArray:
    """Return the centre of the circle on which places (T, 2) lie, by linear least squares."""
    middle: FloatArray = np.asarray(places.mean(axis=0))
    x, y = ((places - middle)[:, k] for k in (0, 1))
    matrix: FloatArray = np.column_stack([2.0 * x, 2.0 * y, np.ones_like(x)])
    squares: FloatArray = x**2 + y**2
    return middle + np.linalg.lstsq(matrix, squares, rcond=None)[0][:2]


def from_rates(
    times: FloatArray, rates: FloatArray, pieces: NDArray[Any], axes: bool, said: list[str]
) -> FloatArray:
    """Return angles of which the rates, or those about three axes, are given [rad/s].

    The axis of the hinge is the direction in which rates vary most: a phone may lie obliquely. No
    rate says how an angle changed in a gap, or from one recording to the next: each stretch is
    integrated alone, and rows that belong to none are NaN.
    """
    if axes:
        axis = np.linalg.svd(rates - rates.mean(axis=0), full_matrices=False)[2][0]
        axis *= np.sign(axis[np.argmax(np.abs(axis))])
        rates = (rates @ axis)[:, None]
        shown = ", ".join(f"{part:.2f}" for part in axis.tolist())
        said.append(f"the axis of the hinge is ({shown}) in the sensor")
    stretches = Motion(times, rates, None, pieces).stretches() or [slice(0, times.size)]
    theta = np.full_like(rates, np.nan)
    for rows, link in product(stretches, range(rates.shape[1])):
        theta[rows, link] = _without_drift(times[rows], rates[rows, link], len(stretches) == 1)
    said.append("rates are integrated; a steady rate, and the mean angle, are taken as zero")
    if (lost := int(np.isnan(theta).any(axis=1).sum())) == times.size:
        raise ValueError("rates must show a whole swing of every link between two gaps at least")
    if lost:
        said.append(f"{lost} rows show no whole swing between two gaps and are left out")
    return theta


def _without_drift(times: FloatArray, rates: FloatArray, alone: bool) -> FloatArray:
    """Return the integral of rates that swing about zero; NaN where it is unknown.

    Without a whole swing the mean angle of a stretch is not zero; that of one `alone` is a guess.
    """
    theta: FloatArray = np.asarray(cumulative_trapezoid(rates, times, initial=0))
    steady, middle = float(rates.mean()), 0.0
    for _ in range(3):  # the mean of parts of a swing is not the steady rate
        turned = passes(times, rates - steady)
        if turned.size > 1:  # of whole swings from a turning point on, a line has no slope
            whole = (times >= turned[0]) & (times <= turned[-1])
        else:
            whole = np.full(times.size, alone)
        if not whole.any():
            return np.full_like(theta, np.nan)
        steady, middle = np.polyfit(times[whole], theta[whole], 1).tolist()
    return theta - middle - steady * times
