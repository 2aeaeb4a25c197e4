"""`identify`: a chain from measured motion; `prediction_rmse`: how well a chain predicts one."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym._provenance import provenance
from npend_gym.chain import Chain, as_chain, check_hung
from npend_gym.identification.motion import MAX_DEVIATION, MIN_ROWS, Motion, check_motion
from npend_gym.identification.parameters import OFFSET, new_model
from npend_gym.identification.plausibility import check_units, warn_of_other_angles, warn_of_values
from npend_gym.identification.result import Identification
from npend_gym.identification.stages import Fit, Stages
from npend_gym.identification.uncertainty import uncertainty, undetermined

_PERIODS = 4.0  # typical periods of the motion in the longest segments, by default
_MANY = 12  # iterations: more are needed only where the given chain is hopeless
_POOR = 0.05  # scatter of the errors, of that of the angles, from which on there is a warning
_SHORT = 0.6  # of the segments' longest duration: where fewer could be followed, angles are doubted
_OUTLIER = 6.0  # times the scatter


def identify(
    times: ArrayLike,
    theta: ArrayLike,
    torque: ArrayLike | None = None,
    *,
    chain: Chain | Mapping[str, Any] | str,
    piece: ArrayLike | None = None,
    fit: Sequence[str] | None = None,
    segment: float | None = None,
    held_out: float = 0.25,
) -> Identification:
    """Fit the parameters of a chain to measured angles, without measured velocities.

    Parameters
    ----------
    times : array_like, shape (T,)
        Instants [s], increasing within a piece; they need no common interval, and may have gaps.
    theta : array_like, shape (T, n), or (T,) for one link
        Absolute angles from hanging [rad], counter-clockwise positive; whole turns do not matter.
    torque : array_like, shape (T, n), or (T,) for joint 0, optional
        Torques at the joints [N m], measured at `times` and linear between them. For commands that
        are held until the next row, give the mean of each and the one before. Without torques the
        motion is taken as free.
    chain : Chain, dict or str
        What is known: lengths, gravity, masses, friction speed, gears; and the values of what is
        not fitted. It is the scale of free swings, whose data has none: lift0 is kept, or inertia0
        where gravity or lift0 is zero.
    piece : array_like of int, shape (T,), optional
        Which recording each row is from; all from one by default.
    fit : sequence of str, optional
        What to fit, of each link: "inertia", "lift", "damping", "friction", "drag",
        "quadratic_drag", "armature", "length" (of all links but the last), "offset" (an angle of
        `theta` less the true one). By default the first four and "quadratic_drag"; with torques
        "armature" too.
    segment : float, optional
        Longest time [s] that is simulated from one first state, which is fitted; that of 20 rows
        at least. By default four typical periods of the motion. Less is taken where the motion is
        too sensitive.
    held_out : float
        Share of the segments, 0 to 0.5, that are not fitted, and judge the fit; they are evenly
        spaced. A single segment is fitted.

    Returns
    -------
    Identification

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, or free swings are 100 times as slow or as fast as those of
        the given chain: times in milliseconds are refused.
    RuntimeError
        If no chain with the given lengths moves like the data.

    Warns
    -----
    UserWarning
        If the angles are likely to be degrees or angles of joints, or lengths millimetres. If a
        piece has no 20 rows without a gap, or there is no segment to hold out. If the
        fitted chain moves otherwise than the data, or few segments with lasting errors determine
        many values. If a fitted value is impossible for a pendulum in air.

    Notes
    -----
    A regression of the equations of motion, in which what is fitted is linear, gives
    first values. Multiple shooting refines them: it simulates segments of the motion, each from its
    own first state. Robust least squares fits their angles, with segments that become longer. Its
    results do not depend on chance. docs/howto/real_pendulum.md has an example.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, identify, simulate
    >>> times = np.linspace(0.0, 10.0, 501)
    >>> motion = simulate(Chain([1.0], [0.8], damping=0.05), 0.7, 0.0, times)
    >>> found = identify(times, motion.theta, chain=Chain([1.0], [0.8]), fit=["damping"])
    >>> round(float(found.chain.damping[0]), 3)
    0.05
    """
    motion = check_motion(times, theta, torque, piece)
    return Problem(motion, chain, fit, segment, held_out).solve()


def prediction_rmse(
    times: ArrayLike,
    theta: ArrayLike,
    torque: ArrayLike | None = None,
    *,
    chain: Chain | Mapping[str, Any] | str,
    piece: ArrayLike | None = None,
    segment: float | None = None,
) -> float:
    """Return the root mean square error with which a chain predicts measured angles [rad].

    Each segment is simulated from a first state that is fitted to it.

    Parameters
    ----------
    times, theta, torque, piece, segment
        As for `identify`.
    chain : Chain, dict or str
        The chain; nothing of it is fitted.

    Returns
    -------
    float
        Infinite if the chain does not move like the data at all.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.

    Examples
    --------
    >>> import numpy as np
    >>> from npend_gym import Chain, simulate
    >>> from npend_gym.identification import prediction_rmse
    >>> times = np.linspace(0.0, 2.0, 201)
    >>> chain = Chain.uniform(1)
    >>> theta = simulate(chain, 0.5, 0.0, times).theta
    >>> prediction_rmse(times, theta, chain=chain) < 1e-3
    True
    """
    problem = Problem(check_motion(times, theta, torque, piece), chain, segment=segment)
    fit = problem.stages.judge(problem.stages.model.known, problem.blocks())
    return math.inf if fit is None else fit.rmse


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
        fit = None if fit is None else _checks.listed("fit", fit, '["damping"]')
        self.held_out: float = _checks.nonnegative_number("held_out", held_out)
        if self.held_out > 0.5:
            raise ValueError(f"held_out must be a share between 0 and 0.5, got {held_out}")
        check_units(known, motion, driven=motion.driven)
        self.stages: Stages = Stages(motion, new_model(known, fit, driven=motion.driven))
        self.longest: float = self.stages.period * _PERIODS
        if segment is not None:
            segment = self.longest = _checks.positive_number("segment", segment)
            slowest = max(float(np.median(np.diff(motion.times[k]))) for k in motion.stretches())
            if segment < (least := MIN_ROWS * slowest) * (1.0 - 1e-9):
                raise ValueError(
                    f"segment must be at least {least:g} s, the time of {MIN_ROWS} rows, got "
                    f"{segment:g}"
                )
        self.provenance: dict[str, Any] = provenance(
            {
                "chain": known.as_dict(),
                "fit": fit,
                "segment": segment,
                "held_out": self.held_out,
                "rows": motion.times.size,
            }
        )

    def blocks(self) -> list[slice]:
        """Return the rows of the segments, of the longest duration."""
        motion = self.stages.motion
        return motion.cut(motion.stretches(), self.longest)

    def solve(self) -> Identification:
        """Fit, and judge the fit by the segments that were held out."""
        stages, motion, model = self.stages, self.stages.motion, self.stages.model
        blocks = self.blocks()
        held = _hold_out(len(blocks), self.held_out)
        if len(blocks) == 1 and self.held_out > 0.0:
            warnings.warn(
                "held_out leaves out nothing: there is one segment; record more, give a shorter "
                "segment, or held_out=0",
                stacklevel=3,
            )
        training = [rows for k, rows in enumerate(blocks) if k not in held]
        fitted, duration = self._fit(training)
        self._warn(fitted, duration, training)
        values = model.unpack(fitted.solution.fitted)
        errors, chain = uncertainty(fitted.solution, model), model.chain_of(values)
        warn_of_values(chain, len(fitted.rows), len(model.names), rough=errors.rough)
        judged = motion.cut([blocks[k] for k in held], duration)
        own = stages.judge(values, judged) if judged else None
        given = stages.judge(model.known, judged, _MANY) if judged else None
        lost, unknown = np.full(len(judged), math.inf), np.full(len(fitted.rows), math.nan)
        segments = _describe(motion, fitted.rows, fitted.errors, unknown, held_out=False)
        errors_of = [lost if fit is None else fit.errors for fit in (own, given)]
        segments += _describe(motion, judged, *errors_of, held_out=True)
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

    def _fit(self, training: Sequence[slice]) -> tuple[Fit, float]:
        """Return the fit over the longest segments that are possible, and their duration [s]."""
        try:
            fitted, duration = self.stages.lengthen(training, self.stages.start(training))
        except np.linalg.LinAlgError as error:
            raise RuntimeError(
                "no chain near the given one moves like the data: check lengths, centres and "
                "times, which must be in metres and seconds, the signs of angles and torques, and "
                "whether angles are absolute"
            ) from error
        if fitted is None:
            raise RuntimeError("the fit left all chains that can move: fit fewer quantities")
        return fitted, duration

    def _warn(self, fitted: Fit, duration: float, training: Sequence[slice]) -> None:
        """Warn if the fitted chain moves otherwise than the data; see `warn_of_other_angles`."""
        motion = self.stages.motion
        spreads = [np.std(motion.theta[rows], axis=0) for rows in motion.stretches()]
        moved = float(np.sqrt(np.mean(np.minimum(spreads, MAX_DEVIATION) ** 2)))
        possible = max(float(np.ptp(motion.times[rows])) for rows in training)
        poor = fitted.scatter > _POOR * moved
        if poor or duration < _SHORT * possible:
            warn_of_other_angles(motion, self.stages.model, fitted)
        if poor:
            warnings.warn(
                f"the fitted chain moves otherwise than the data, by {fitted.scatter:.2g} rad "
                f"where angles vary by {moved:.2g} rad: check lengths, units, signs, and whether "
                "angles are absolute, and 0 where a link hangs",
                stacklevel=4,
            )


def _hold_out(count: int, share: float) -> list[int]:
    """Return which of `count` blocks are held out: evenly spaced, at least one of two."""
    if share == 0.0 or count < 2:
        return []
    middles = (np.arange(math.floor(share * count + 0.5 + 1e-9)) + 0.5) / share
    return (np.ceil(middles - 1e-9).astype(int) - 1).tolist() or [count - 1]


def _describe(
    motion: Motion, segments: list[slice], errors: FloatArray, given: FloatArray, *, held_out: bool
) -> list[dict[str, Any]]:
    """Return what `Identification.segments` says of these, with the errors of two chains."""
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
