"""Measured motion: angles, perhaps torques, of one or several recordings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.identification.instants import MIN_ROWS, evenly_spaced
from npend_gym.physics.arguments import warn_caller

MAX_ROWS = 2_000_000
_GAP = 10.0  # times the median interval: the rows after a longer one begin a new stretch
_AT_REST = 0.25  # times the mean deviation in the other half of the rows: less is no motion
_STEADY = 0.25  # of the speed: a larger change of it is noise, or the rows are too far apart
_BACK = 0.7  # of the farthest move in any time: a link that moved less in a longer one came back
MAX_DEVIATION = math.pi  # rad; those of a link that turns over grow with the recording
_LIKELY = 8.0 * math.pi  # rad; larger angles are likely to be degrees
_PASSED = 0.25  # of the scatter of an angle: what it moves beyond hanging when it has passed there
RADIANS = "np.radians converts, or give --degrees of npend identify"


@dataclass(frozen=True, eq=False)
class Motion:
    """Measured motion of a chain of n links.

    Attributes
    ----------
    times : ndarray, shape (T,)
        Instants [s], increasing within each piece.
    theta : ndarray, shape (T, n)
        Absolute angles from hanging [rad], counter-clockwise positive.
    torque : ndarray, shape (T, n), or None
        Torque at each joint [N m]; None for free swings.
    piece : ndarray, int64, shape (T,)
        Which recording each row is from; the rows of one recording stand together.
    position, acceleration : ndarray, shape (T,), or None
        Sideways position [m] and acceleration [m/s^2] of the pivot; None where it rests.
    """

    times: FloatArray
    theta: FloatArray
    torque: FloatArray | None
    piece: NDArray[np.int64]
    position: FloatArray | None = None
    acceleration: FloatArray | None = None

    @property
    def links(self) -> int:
        """Number of links."""
        return self.theta.shape[1]

    @property
    def driven(self) -> bool:
        """Whether torques act."""
        return self.torque is not None and bool(np.any(self.torque))

    @property
    def forced(self) -> bool:
        """Whether torques act, or the pivot moves."""
        return self.driven or self.acceleration is not None

    def stretches(self) -> list[slice]:
        """Return the rows of each stretch: a piece, or a part of it between two gaps.

        A gap is an interval more than ten times as long as the median one of its piece; stretches
        of fewer than 20 rows are left out.
        """
        out: list[slice] = []
        for rows in self.pieces():
            intervals = np.diff(self.times[rows])
            typical = float(np.median(intervals)) if intervals.size else 0.0
            gaps = rows.start + 1 + np.flatnonzero(intervals > _GAP * typical)
            out += _between([rows.start, *gaps.tolist(), rows.stop])
        return out

    def pieces(self) -> list[slice]:
        """Return the rows of each piece."""
        edges = np.flatnonzero(np.diff(self.piece)) + 1
        return [slice(a, b) for a, b in pairwise([0, *edges.tolist(), self.times.size])]

    def cut(self, stretches: Sequence[slice], duration: float) -> list[slice]:
        """Return the rows of stretches, each cut into equal parts of at most `duration` [s].

        Parts are longer if they would have fewer than 20 rows.
        """
        out: list[slice] = []
        for rows in stretches:
            times = self.times[rows] - self.times[rows.start]
            parts = math.ceil(times[-1] / duration - 0.05)  # rather one that is 5 % longer
            parts = max(1, min(parts, times.size // MIN_ROWS))
            shares = [float(times[-1]) * k / parts for k in range(1, parts)]
            inner = [rows.start + int(row) for row in np.searchsorted(times, shares)]
            edges = [rows.start]
            for edge in inner:
                if edge - edges[-1] >= MIN_ROWS and rows.stop - edge >= MIN_ROWS:
                    edges.append(edge)
            out += _between([*edges, rows.stop])
        return out

    def period(self) -> float:
        """Return 2 pi times the median deviation of the angles over the median speed [s].

        This is the period of a sinusoidal swing, in the part of each stretch in which the angle
        moves. Deviations above pi count as pi: they come from links that turn over.
        """
        periods: list[float] = []
        for rows, link in product(self.stretches(), range(self.links)):
            times, theta = _moving(self.times[rows], self.theta[rows, link])
            speed, away = _speed(times, theta), float(np.median(_deviations(theta)))
            if speed > 0.0 and away > 0.0:
                periods.append(2.0 * np.pi * min(away, MAX_DEVIATION) / speed)
        if not periods:
            raise ValueError("theta must move, but each measured angle is at rest most of the time")
        return float(np.median(periods))

    def mean_periods(self) -> FloatArray:
        """Return the mean time of each angle from swing to swing [s], shape (n,).

        A swing begins where the link passes hanging counter-clockwise. NaN where a link turns over,
        or does not complete a swing.
        """
        spans, counts = np.zeros((2, self.links))
        turns = np.zeros(self.links, np.bool_)
        for rows, link in product(self.stretches(), range(self.links)):
            times, theta = _moving(self.times[rows], self.theta[rows, link])
            turns[link] |= np.ptp(theta) > math.tau
            passed = passes(times, theta - math.tau * np.rint(np.median(theta) / math.tau))
            if passed.size > 1:
                spans[link] += passed[-1] - passed[0]
                counts[link] += passed.size - 1
        return np.where((counts > 0) & ~turns, spans / np.maximum(counts, 1.0), np.nan)


def pieces_in_turn(pieces: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Pieces of recordings in turn, numbered on; those of a single recording as they are."""
    if len(pieces) == 1:
        return pieces[0]
    numbered, count = list[NDArray[np.int64]](), 0
    for piece in pieces:
        numbered.append(np.unique(piece, return_inverse=True)[1] + count)
        count = int(numbered[-1].max(initial=count - 1)) + 1
    return np.concatenate(numbered)


def passes(times: FloatArray, theta: FloatArray) -> FloatArray:
    """Return when an angle passes zero upwards [s]: on the way from well below to well above."""
    least = _PASSED * float(np.std(theta))
    side = np.where(theta > least, 1, np.where(theta < -least, -1, 0))
    away = np.flatnonzero(side)
    ups = np.flatnonzero(np.diff(side[away]) > 0)
    out = np.empty(ups.size)
    for k, (low, high) in enumerate(zip(away[ups], away[ups + 1], strict=True)):
        slope, at_zero = np.polyfit(theta[low : high + 1], times[low : high + 1], 1)
        out[k] = at_zero if math.isfinite(slope) else times[low]
    return out


def _deviations(theta: FloatArray) -> FloatArray:
    return np.abs(theta - np.median(theta))


def _moving(times: FloatArray, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the part in which an angle moves: a half that is nearly at rest is left out."""
    while theta.size >= 2 * MIN_ROWS:
        halves = np.array_split(np.arange(theta.size), 2)
        means = [float(_deviations(theta[half]).mean()) for half in halves]
        if min(means) >= _AT_REST * max(means):
            break
        times, theta = (each[halves[int(np.argmax(means))]] for each in (times, theta))
    return times, theta


def _speed(times: FloatArray, theta: FloatArray) -> float:
    """Return the median speed [rad/s] between rows so far apart that it hardly changes.

    Between neighbours noise, and the resolution of an encoder, may be more than the motion.
    """
    least, found, farthest = math.inf, 0.0, 0.0
    for lag in 2 ** np.arange(max(1, int(np.log2(theta.size / 4)))):
        moved = theta[lag:] - theta[:-lag]
        far = float(np.median(np.abs(moved)))
        if far < _BACK * farthest:  # rows that are whole periods apart
            break
        farthest = max(far, farthest)
        rates = moved / (times[lag:] - times[:-lag])
        speed = float(np.median(np.abs(rates)))
        if speed == 0.0:
            continue
        change = float(np.abs(rates[lag:] - rates[:-lag]).mean()) / speed
        if change < least:
            least, found = change, speed
        if change <= _STEADY:
            break
    return found


def _between(edges: Sequence[int]) -> list[slice]:
    """Return the rows between these edges, where there are enough."""
    return [slice(a, b) for a, b in pairwise(edges) if b - a >= MIN_ROWS]


def check_motion(
    times: ArrayLike,
    theta: ArrayLike,
    torque: ArrayLike | None = None,
    piece: ArrayLike | None = None,
) -> Motion:
    """Return measured motion, every part of it checked; angles are unwrapped.

    Parameters
    ----------
    times : array_like, shape (T,)
        Instants [s].
    theta : array_like, shape (T, n), or (T,) for one link
        Absolute angles from hanging [rad].
    torque : array_like, shape (T, n), or (T,) for joint 0, optional
        Torques at the joints [N m].
    piece : array_like of int, shape (T,), optional
        Which recording each row is from; all from one by default.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.

    Warns
    -----
    UserWarning
        If the angles are so large that they are likely to be degrees, or a piece is left out: it
        has no 20 rows without a gap.
    """
    instants = checked_finite("times", times)
    if instants.ndim != 1 or not MIN_ROWS <= instants.size <= MAX_ROWS:
        raise ValueError(
            f"times must hold {MIN_ROWS} to {MAX_ROWS} instants, got shape {instants.shape}"
        )
    rows = instants.size
    angles = _columns("theta", theta, rows)
    torques = None if torque is None else _columns("torque", torque, rows)
    n = angles.shape[1]
    if torques is not None and torques.shape[1] != n:
        if torques.shape[1] != 1:
            raise ValueError(
                f"torque must have the shape ({rows}, {n}), or ({rows},) for joint 0, "
                f"got shape {torques.shape}"
            )
        torques = np.hstack([torques, np.zeros((rows, n - 1))])
    motion = Motion(instants, angles, torques, _check_pieces(piece, rows))
    motion = replace(motion, times=evenly_spaced(motion.times, motion.pieces()))
    _check_order(motion)
    used = {rows.start for rows in motion.stretches()}
    if not used:
        raise ValueError(
            f"times must have {MIN_ROWS} rows without a gap at least once; the median interval is "
            f"{np.median(np.diff(instants)):g} s"
        )
    unused = [rows for rows in motion.pieces() if used.isdisjoint(range(rows.start, rows.stop))]
    if unused:
        left_out = ", ".join(str(motion.piece[rows.start]) for rows in unused)
        warn_caller(f"piece {left_out} is left out: it must have {MIN_ROWS} rows without a gap")
    return _unwrapped(motion)


def checked_finite(name: str, value: ArrayLike) -> FloatArray:
    """Return an array of finite numbers."""
    raw = np.atleast_1d(np.asarray(value))
    if raw.dtype.kind == "f" and not np.all(np.isfinite(raw)):
        row = int(np.argwhere(~np.isfinite(raw))[0][0])
        raise ValueError(
            f"{name} must be finite, got {raw[row]} in row {row}: leave out rows without a value, "
            "gaps are allowed"
        )
    return _checks.array(name, value)


def _columns(name: str, value: ArrayLike, rows: int) -> FloatArray:
    out = checked_finite(name, value)
    out = out[:, None] if out.ndim == 1 else out
    if out.ndim != 2 or out.shape[0] != rows or out.shape[1] == 0:
        raise ValueError(
            f"{name} must have a row for each of the {rows} instants, got shape {out.shape}"
        )
    return out


def _check_pieces(piece: ArrayLike | None, rows: int) -> NDArray[np.int64]:
    if piece is None:
        return np.zeros(rows, np.int64)
    labels = checked_finite("piece", piece)
    if labels.shape != (rows,) or np.any((labels != np.round(labels)) | (abs(labels) >= 2**53)):
        raise ValueError(
            f"piece must be {rows} integers below 2^53, one for each row, got {_checks.show(piece)}"
        )
    starts = np.flatnonzero(np.diff(labels, prepend=np.nan) != 0.0)
    if np.unique(labels[starts]).size < starts.size:
        raise ValueError("piece must number recordings whose rows stand together, got them mixed")
    return labels.astype(np.int64)


def _check_order(motion: Motion) -> None:
    same = np.diff(motion.piece) == 0
    wrong = np.flatnonzero(same & (np.diff(motion.times) <= 0.0))
    if wrong.size:
        row = int(wrong[0]) + 1
        repeated = motion.times[row] == motion.times[row - 1]
        way = "leave out rows that stand twice, and give times that are rounded more decimals"
        raise ValueError(
            f"times must increase within a piece, got {motion.times[row]:g} s in row {row} after "
            f"{motion.times[row - 1]:g} s: "
            + (way if repeated else "sort the rows, and number recordings in piece")
        )


def _unwrapped(motion: Motion) -> Motion:
    largest = float(np.abs(motion.theta).max())
    if largest > _LIKELY:
        warn_caller(
            f"theta reaches {largest:.4g} rad, {largest / math.tau:.1f} turns: are these degrees? "
            f"They must be radians ({RADIANS}); a chain may have turned so often"
        )
    theta = motion.theta.copy()
    if largest > _LIKELY and largest > math.tau * motion.links:
        return motion  # of no sum of angles within a turn: they are whole as they are
    for rows in motion.stretches():
        theta[rows] = np.unwrap(theta[rows], axis=0)
    return replace(motion, theta=theta)
