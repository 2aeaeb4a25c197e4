"""What an identification found."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import Chain
from npend_gym.identification.motion import Motion


@dataclass(frozen=True, eq=False)
class Identification:
    """A chain fitted to measured motion, and how far it can be trusted.

    Attributes
    ----------
    chain : Chain
        The fitted chain.
    names, units : tuple of str
        The k fitted values, such as "inertia0" and "kg m^2", or "gravity"; see the notes.
    values, standard_errors : ndarray, shape (k,)
        The values and their standard errors; infinite where the data do not determine a value. The
        errors are from a fit without bounds, also for a value at its bound, zero.
    correlation : ndarray, shape (k, k)
        Correlation of the errors.
    chain_errors : dict of str to ndarray, shape (n,)
        Standard errors of parameters of `chain` by name, the masses taken as exact; one number for
        gravity. NaN where the
        data do not determine a parameter.
    offsets : ndarray, shape (n,)
        Measured minus true absolute angles [rad]; zero where they were not fitted. The encoder
        between two links is off by the difference of their offsets.
    left_out : tuple of str
        Terms of the default that the data do not support, in sentences: they are not fitted.
    small_periods, small_period_errors : ndarray, shape (n,)
        Periods of the normal modes of the fitted chain, of small swings about hanging [s], the
        slowest first, and their standard errors; NaN where nothing swings. See
        `equivalent_lengths`.
    mean_periods : ndarray, shape (n,)
        Measured mean time of each angle from swing to swing [s]. NaN where a link turns over, or
        completes no swing.
    given_rmse : float
        Root mean square error of all angles [rad] of the given chain over the segments that were
        held out, each segment's initial state being fitted. NaN if none was held out, infinite if
        the chain does not move like the data at all. The same holds for the errors of the fitted
        chain below.
    segments : tuple of dict
        For each segment: "piece", "start" and "end" [s], "held_out", "rmse" and "given_rmse".
    outliers : ndarray, bool, shape (T, n)
        Measured angles whose error exceeds six times the scatter of all. They count less in the
        fit, but fully in the errors above.
    residuals : ndarray, shape (T, n)
        Simulated minus measured angles [rad] in the rows of the data; NaN where not simulated.
    held_out : ndarray, bool, shape (T,)
        Which rows were held out.
    undetermined : tuple of str
        What the data cannot determine, in sentences, and what was taken in its place.
    provenance : dict
        How it was made: versions and arguments.

    Notes
    -----
    The motion depends on "inertia" J_i = I_i + m_i c_i^2 + l_i^2 sum_{k>i} m_k and "lift" h_i =
    m_i c_i + l_i sum_{k>i} m_k of each link, and on its "damping", "friction", "drag",
    "quadratic_drag" and "armature" as in `Chain`.
    """

    chain: Chain
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: FloatArray
    standard_errors: FloatArray
    correlation: FloatArray
    chain_errors: dict[str, FloatArray]
    offsets: FloatArray
    left_out: tuple[str, ...]
    small_periods: FloatArray
    small_period_errors: FloatArray
    mean_periods: FloatArray
    given_rmse: float
    segments: tuple[dict[str, Any], ...]
    outliers: BoolArray
    residuals: FloatArray
    held_out: BoolArray
    undetermined: tuple[str, ...]
    provenance: dict[str, Any]

    @property
    def held_out_rmse(self) -> float:
        """Root mean square error of the angles of the held-out segments [rad]; NaN without them."""
        return _rms(self.residuals[self.held_out])

    @property
    def fitted_rmse(self) -> float:
        """Root mean square error of the angles of the fitted segments [rad]."""
        return _rms(self.residuals[~self.held_out])

    @property
    def clean_rmse(self) -> float:
        """The error `held_out_rmse` without outliers [rad]."""
        return _rms(self.residuals[self.held_out[:, None] & ~self.outliers])

    @property
    def equivalent_lengths(self) -> FloatArray:
        """Length L of a bob on a thread with each of `small_periods` [m], shape (n,).

        The square of a mode's angular frequency is g/L.
        """
        return self.chain.gravity * (self.small_periods / (2.0 * math.pi)) ** 2

    def rows(self) -> list[tuple[str, str, float, float]]:
        """Return name, unit, value and standard error of each fitted value."""
        numbers = self.values.tolist(), self.standard_errors.tolist()
        return list(zip(self.names, self.units, *numbers, strict=True))

    def as_dict(self) -> dict[str, Any]:
        """Return the result as plain numbers, lists and dicts, ready for JSON.

        It leaves out `residuals` and the mask `held_out`; `outliers` is their number. NaN and
        infinity become None.
        """
        return {
            "chain": self.chain.as_dict(),
            "parameters": [
                {
                    "name": name,
                    "unit": unit,
                    "value": _plain(value),
                    "standard_error": _plain(error),
                }
                for name, unit, value, error in self.rows()
            ],
            "correlation": _plain(self.correlation),
            "chain_standard_errors": {k: _plain(v) for k, v in self.chain_errors.items()},
            "offsets": _plain(self.offsets),
            "left_out": list(self.left_out),
            "small_periods": _plain(self.small_periods),
            "small_period_errors": _plain(self.small_period_errors),
            "equivalent_lengths": _plain(self.equivalent_lengths),
            "mean_periods": _plain(self.mean_periods),
            "held_out_rmse": _plain(self.held_out_rmse),
            "given_rmse": _plain(self.given_rmse),
            "fitted_rmse": _plain(self.fitted_rmse),
            "clean_rmse": _plain(self.clean_rmse),
            "outliers": int(self.outliers.sum()),
            "segments": [{k: _plain(v) for k, v in one.items()} for one in self.segments],
            "undetermined": list(self.undetermined),
            "provenance": self.provenance,
        }


def describe(
    motion: Motion, segments: list[slice], errors: FloatArray, given: FloatArray, *, held_out: bool
) -> list[dict[str, Any]]:
    """Rows of `Identification.segments` for these, with the errors of two chains."""
    return [
        {
            "piece": int(motion.piece[rows.start]),
            "start": float(motion.times[rows.start]),
            "end": float(motion.times[rows.stop - 1]),
            "held_out": held_out,
            "rmse": error,
            "given_rmse": other,
        }
        for rows, error, other in zip(segments, errors.tolist(), given.tolist(), strict=True)
    ]


def _rms(errors: FloatArray) -> float:
    finite = errors[np.isfinite(errors)]
    if errors.size and not finite.size:  # nothing of it could be simulated
        return math.inf
    return float(np.sqrt(np.mean(finite**2))) if errors.size else math.nan


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list):
        return [_plain(one) for one in value]  # pyright: ignore[reportUnknownVariableType]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value
