"""What `identify` solves: segments, stages, what is held out, and what is doubted."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._provenance import provenance
from npend_gym.chain import Chain, as_chain, check_hung
from npend_gym.identification.motion import MIN_ROWS, Motion
from npend_gym.identification.parameters import INERTIA, LIFT, OFFSET, new_model
from npend_gym.identification.plausibility import (
    DOUBTED,
    LEVEL,
    check_explained,
    check_readings,
    check_units,
    check_values,
    is_off,
    say_offsets,
    spread_of,
)
from npend_gym.identification.result import Identification, describe
from npend_gym.identification.selection import LeftOut, choose
from npend_gym.identification.small_swings import small_period_errors, small_periods
from npend_gym.identification.stages import Fit, Stages, split
from npend_gym.identification.uncertainty import uncertainty, undetermined
from npend_gym.physics.arguments import warn_caller

_PERIODS = 4.0  # typical periods of the motion in the longest segments, by default
_MANY = 12  # iterations: more are needed only where the given chain is hopeless
_OUTLIER = 6.0  # times the scatter


class FitProblem:
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
        fit = None if fit is None else _checks.listed("fit", fit, '["damping"]')
        self.held_out: float = _checks.nonnegative_number("held_out", held_out)
        if self.held_out > 0.5:
            raise ValueError(f"held_out must be a share between 0 and 0.5, got {held_out}")
        check_units(known, motion)
        self.open: bool = fit is None  # which terms are fitted
        model = new_model(known, fit, driven=motion.driven, moved=motion.acceleration is not None)
        self.stages: Stages = Stages(motion, model)
        self.longest: float = self.stages.period * _PERIODS
        if segment is not None:
            segment = self.longest = _checks.positive_number("segment", segment)
            slowest = max(float(np.median(np.diff(motion.times[k]))) for k in motion.stretches())
            if segment < (least := MIN_ROWS * slowest) * (1.0 - 1e-9):
                raise ValueError(
                    f"segment must be at least {least:g} s, the time of {MIN_ROWS} rows, got "
                    f"{segment:g}"
                )
        arguments = {"chain": known.as_dict(), "fit": fit, "segment": segment}
        arguments |= {"held_out": self.held_out, "rows": motion.times.size}
        self.provenance: dict[str, Any] = provenance(arguments)

    def blocks(self) -> list[slice]:
        """Return the rows of the segments, of the longest duration."""
        motion = self.stages.motion
        return motion.cut(motion.stretches(), self.longest)

    def solve(self) -> Identification:
        """Fit, and judge the fit by the segments that were held out."""
        fitted, held, duration = self._fit()
        stages, motion, given_model = self.stages, self.stages.motion, self.stages.model
        model, left_out = given_model, list[LeftOut]()
        errors = uncertainty(fitted.solution, model)
        if self.open and not errors.rough:  # few segments tell no terms apart
            fitted, model, left_out = choose(stages, fitted, model)
            errors = uncertainty(fitted.solution, model)
        values = model.unpack(fitted.solution.fitted)
        chain = model.chain_of(values)
        if self.open:
            say_offsets(values[OFFSET])
        if errors.rough:
            warn_caller(
                f"standard errors are large, and rough: {len(fitted.rows)} segments, whose errors "
                f"last long, must tell {len(model.names)} values; record more or livelier motions, "
                "or fit fewer quantities"
            )
        weighed = bool(model.free[[INERTIA, LIFT]].any())
        check_values(chain, given_model.chain, motion, weighed=weighed)
        judged = motion.cut(held, duration)
        own = stages.judge(values, judged) if judged else None
        given = stages.judge(given_model.known, judged, _MANY) if judged else None
        lost, unknown = np.full(len(judged), math.inf), np.full(len(fitted.rows), math.nan)
        segments = describe(motion, fitted.rows, fitted.errors, unknown, held_out=False)
        errors_of = [lost if fit is None else fit.errors for fit in (own, given)]
        segments += describe(motion, judged, *errors_of, held_out=True)
        held_out = np.zeros(motion.times.size, np.bool_)
        for rows in judged:
            held_out[rows] = True
        residuals = np.full_like(motion.theta, np.nan)
        for fit in (fitted, own):
            if fit is not None:
                residuals[np.r_[tuple(fit.rows)]] = fit.residuals
        scatter = max(fitted.scatter, own.scatter if own else 0.0)
        found = fitted.solution.fitted
        return Identification(
            chain=chain,
            names=tuple(model.names),
            units=tuple(model.units),
            values=found,
            standard_errors=errors.errors,
            correlation=errors.correlation,
            chain_errors=model.chain_errors(chain, errors.errors, errors.covariance),
            offsets=values[OFFSET],
            left_out=tuple(str(one) for one in left_out),
            small_periods=small_periods(chain),
            small_period_errors=small_period_errors(model, found, errors),
            mean_periods=motion.mean_periods(),
            given_rmse=given.rmse if given else math.inf if judged else math.nan,
            segments=tuple(segments),
            outliers=np.abs(residuals) > _OUTLIER * scatter,
            residuals=residuals,
            held_out=held_out,
            undetermined=tuple(
                undetermined(model, chain, found, errors.errors, driven=motion.driven)
            ),
            provenance=self.provenance,
        )

    def _fit(self) -> tuple[Fit, list[slice], float]:
        """Return the fit over the longest segments, those held out, how long.

        Where they become shorter than they were first, what is held out is chosen again.
        """
        motion, model, blocks = self.stages.motion, self.stages.model, self.blocks()
        training, held = split(blocks, self.held_out)
        longest = max(float(np.ptp(motion.times[rows])) for rows in training)
        fitted, duration = self._lengthen(training)
        doubted = DOUBTED * spread_of(motion) < fitted.scatter < 2.0 * LEVEL
        if self.open and doubted and not motion.driven:  # errors of torques look like offsets
            fitted, duration = self._with_offset(training, fitted, duration)
        check_explained(motion, model, fitted, duration, longest)
        if duration < longest and self.held_out > 0.0:
            blocks = motion.cut(motion.stretches(), duration)
            training, held = split(blocks, self.held_out)
            found = self.stages.model.unpack(fitted.solution.fitted)
            fitted, duration = self._lengthen(training, found)
        if len(blocks) == 1 and self.held_out > 0.0:
            warn_caller(
                "held_out leaves out nothing: there is one segment; record more, give a shorter "
                "segment, or held_out=0"
            )
        return fitted, held, duration

    def _with_offset(
        self, training: Sequence[slice], fit: Fit, duration: float
    ) -> tuple[Fit, float]:
        """Return the fit with angles that are off by a little, if that is much better."""
        before, values = self.stages, self.stages.model.unpack(fit.solution.fitted)
        self.stages = before.with_offset()
        with suppress(RuntimeError, ValueError):
            found, longest = self._lengthen(training, values)
            if is_off(found, fit, self.stages.model, longer=longest > duration):
                return found, longest
        self.stages = before
        return fit, duration

    def _lengthen(
        self, training: Sequence[slice], values: FloatArray | None = None
    ) -> tuple[Fit, float]:
        """Return the fit over the longest segments that are possible, and their duration [s]."""
        stages = self.stages
        try:
            values = stages.start(training) if values is None else values
            fitted, duration = stages.lengthen(training, values)
            if fitted is None:
                raise RuntimeError("the fit left all chains that can move: fit fewer quantities")
        except (np.linalg.LinAlgError, RuntimeError) as error:
            check_readings(stages.motion, stages.model, training, math.inf)
            if isinstance(error, RuntimeError):
                raise
            raise RuntimeError(
                "no chain near the given one moves like the data: check lengths, centres and "
                "times, which must be in metres and seconds, the signs of angles and torques, and "
                "whether angles are absolute"
            ) from error
        return fitted, duration
