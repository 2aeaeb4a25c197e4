"""What `identify` does with arguments that are checked: fit, judge, and say what was found."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._provenance import provenance
from npend_gym.chain import Chain, as_chain, check_hung
from npend_gym.identification.motion import Motion
from npend_gym.identification.parameters import OFFSET, Model, new_model
from npend_gym.identification.plausibility import check_units, warn_of_other_angles, warn_of_values
from npend_gym.identification.result import Identification
from npend_gym.identification.segments import cut
from npend_gym.identification.stages import Fit, Stages
from npend_gym.identification.uncertainty import uncertainty, undetermined

_PERIODS = 4.0  # typical periods of the motion in the longest segments, by default
_MANY = 12  # iterations: more are needed only where the given chain is hopeless
_POOR = 0.05  # scatter of the errors, of that of the angles, from which on there is a warning
_SHORT = 0.6  # of the segments' longest duration: where fewer could be followed, angles are doubted
_OUTLIER = 6.0  # times the scatter


class Problem:
    """What `identify` solves, checked; arguments as there.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.
    """

    def __init__(
        self,
        motion: Motion,
        chain: Chain | Mapping[str, Any] | str,
        fit: Sequence[str] | None = None,
        segment: float | None = None,
        held_out: float = 0.25,
    ) -> None:
        known = check_hung(as_chain(chain), "identify")
        if known.n != motion.links:
            raise ValueError(
                f"chain must have a link for each of {motion.links} angles, got {known.n}"
            )
        self.held_out = _checks.nonnegative_number("held_out", held_out)
        if self.held_out > 0.5:
            raise ValueError(f"held_out must be a share between 0 and 0.5, got {held_out}")
        self.driven = motion.torque is not None and bool(np.any(motion.torque))
        check_units(known, motion, driven=self.driven)
        self.stages = Stages(motion, new_model(known, fit, driven=self.driven))
        self.longest = self.stages.period * _PERIODS
        if segment is not None:
            self.longest = _checks.positive_number("segment", segment)
        self.provenance = provenance(
            {
                "chain": known.as_dict(),
                "fit": None if fit is None else list(fit),
                "segment": segment,
                "held_out": self.held_out,
                "rows": motion.times.size,
            }
        )

    def blocks(self) -> list[slice]:
        """Return the rows of the segments, of the longest duration."""
        motion = self.stages.motion
        return cut(motion, motion.stretches(), self.longest)

    def solve(self) -> Identification:
        """Fit, and judge the fit by the segments that were held out."""
        motion, blocks = self.stages.motion, self.blocks()
        held = _hold_out(len(blocks), self.held_out)
        training = [rows for k, rows in enumerate(blocks) if k not in held]
        fitted, duration = self._fit(training)
        judged = cut(motion, [blocks[k] for k in held], duration)
        moved = float(np.std(np.concatenate([motion.theta[rows] for rows in training])))
        possible = max(float(np.ptp(motion.times[rows])) for rows in training)
        if motion.links > 1 and (fitted.scatter > _POOR * moved or duration < _SHORT * possible):
            warn_of_other_angles(motion, self.stages.model, fitted)
        if fitted.scatter > _POOR * moved:
            warnings.warn(
                f"the fitted chain moves otherwise than the data, by {fitted.scatter:.2g} rad "
                f"where angles vary by {moved:.2g} rad: check lengths, units, signs, and whether "
                "angles are absolute",
                stacklevel=3,
            )
        return _result(self, fitted, judged)

    def _fit(self, training: list[slice]) -> tuple[Fit, float]:
        """Return the fit over the longest segments that are possible, and their duration [s]."""
        try:
            return self.stages.lengthen(training, self.stages.start(training))
        except np.linalg.LinAlgError as error:
            raise RuntimeError(
                "no chain near the given one moves like the data: check lengths, centres and "
                "times, which must be in metres and seconds, the signs of angles and torques, and "
                "whether angles are absolute"
            ) from error


def _hold_out(count: int, share: float) -> list[int]:
    """Return which of `count` blocks are held out: every so many, at least one of two."""
    if share == 0.0 or count < 2:
        return []
    every = round(1.0 / share)
    return list(range((every - 1) // 2, count, every)) or [count - 1]


def _result(problem: Problem, fitted: Fit, judged: Sequence[slice]) -> Identification:
    """Return what the fit and the segments that were held out say."""
    stages, solution = problem.stages, fitted.solution
    motion, model = stages.motion, stages.model
    values = model.unpack(solution.fitted)
    own = stages.judge(values, judged) if judged else None
    given = stages.judge(model.known, judged, _MANY) if judged else None
    errors, chain = uncertainty(solution, model), model.chain_of(values)
    count, rough = len(fitted.segments.rows), errors.rough
    warn_of_values(chain, count, len(model.names), rough=rough)
    held_out = np.zeros(motion.times.size, np.bool_)
    for rows in judged:
        held_out[rows] = True
    scatter = max(fitted.scatter, own.scatter if own else 0.0)
    fits = [(fitted, False, None)] + ([] if own is None else [(own, True, given)])
    residuals = _residuals(motion, [fit for fit, _, _ in fits])
    return Identification(
        chain=chain,
        names=tuple(model.names),
        units=tuple(model.units),
        values=solution.fitted,
        standard_errors=errors.errors,
        correlation=errors.correlation,
        chain_errors=_chain_errors(model, chain, errors.covariance),
        offsets=values[OFFSET],
        held_out_rmse=np.nan if own is None else own.rmse,
        given_rmse=np.nan if given is None else given.rmse,
        fitted_rmse=fitted.rmse,
        segments=tuple(row for fit in fits for row in _rows(motion, *fit)),
        outliers=np.abs(residuals) > _OUTLIER * scatter,
        residuals=residuals,
        held_out=held_out,
        undetermined=tuple(
            undetermined(model, chain, solution.fitted, errors.errors, driven=problem.driven)
        ),
        provenance=problem.provenance,
    )


def _rows(motion: Motion, fit: Fit, held_out: bool, given: Fit | None) -> list[dict[str, Any]]:
    """Return what `Identification.segments` says of the segments of a fit."""
    errors = np.sqrt(fit.squares / fit.counts)
    others = np.full_like(errors, np.nan)
    if given is not None:
        others = np.sqrt(given.squares / given.counts)
    return [
        {
            "piece": int(motion.piece[rows.start]),
            "start": float(motion.times[rows.start]),
            "end": float(motion.times[rows.stop - 1]),
            "held_out": held_out,
            "rmse": float(error),
            "given_rmse": float(other),
        }
        for rows, error, other in zip(fit.segments.rows, errors, others, strict=True)
    ]


def _residuals(motion: Motion, fits: Sequence[Fit]) -> FloatArray:
    """Return simulated less measured angles of all rows, NaN where not simulated, (T, n)."""
    out = np.full_like(motion.theta, np.nan)
    for fit in fits:
        for rows, one in zip(fit.segments.rows, fit.solution.residuals, strict=True):
            out[rows] = one.reshape(-1, motion.links)[: rows.stop - rows.start]
    return out


def _chain_errors(model: Model, chain: Chain, covariance: FloatArray) -> dict[str, FloatArray]:
    """Return standard errors of parameters of the chain, of those without an infinite one."""
    return {
        name: np.sqrt(
            np.einsum("ki,kl,li->i", slope, covariance[: len(slope), : len(slope)], slope)
        )
        for name, slope in model.directions(chain).items()
    }
