"""The fit in stages: a regression gives first values, shooting over longer and longer segments."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.identification.least_squares import CONVERGED, Solution, scatter, solve
from npend_gym.identification.motion import MIN_ROWS, Motion
from npend_gym.identification.parameters import Model
from npend_gym.identification.regression import regress, smooth
from npend_gym.identification.segments import Segments, cut, side_by_side
from npend_gym.identification.shooting import Shooting
from npend_gym.physics.substeps import MAX_ROTATION, default_substeps

_FIRST = 0.25  # typical periods in the shortest segments
_WIDTHS = 6  # of bumps, tried by the regression
_ROUGH = 3  # iterations that tell which first values are best
_PASSING = 1e-2  # decrease of the cost in a step that ends a stage before the last one
_NODES = 2  # substeps between two nodes of the grid
_SENSITIVE = 0.2  # growth of the scatter to so many rad: a chaotic motion has many solutions
_TOO_MUCH = 8.0  # a fit whose error grows by this factor when segments are twice as long ...
_SMALL = 0.02  # ... and exceeds this [rad] has lost the motion


@dataclass(frozen=True, eq=False)
class Fit:
    """A solution for parts of the motion."""

    segments: Segments
    solution: Solution

    @property
    def squares(self) -> FloatArray:
        """Sum of the squared errors of each segment [rad^2], shape (S,)."""
        return (self.solution.residuals**2).sum(axis=1)

    @property
    def counts(self) -> FloatArray:
        """Number of measured angles in each segment, shape (S,)."""
        return self.segments.measured.sum(axis=1) * float(self.segments.theta.shape[2])

    @property
    def growth(self) -> float:
        """How many times as large an error of the first angles becomes in a segment, at most."""
        angles = self.segments.theta.shape[2]
        return float(np.abs(self.solution.by_state[..., :angles]).max())

    def states(self) -> dict[int, FloatArray]:
        """Return the first state of each segment by its first row in the motion."""
        firsts = (rows.start for rows in self.segments.rows)
        return dict(zip(firsts, self.solution.states, strict=True))

    @property
    def scatter(self) -> float:
        """Standard deviation of the errors by their median [rad]."""
        return scatter(self.solution.residuals, self.solution.weights)

    @property
    def rmse(self) -> float:
        """Root mean square error of all angles [rad]."""
        return float(np.sqrt(self.squares.sum() / self.counts.sum()))


class Stages:
    """Fits of a model to one motion, whose first states come from splines of it.

    Parameters
    ----------
    motion : Motion
    model : Model
        What is fitted.
    """

    def __init__(self, motion: Motion, model: Model) -> None:
        self.motion, self.model = motion, model
        self.period = typical_period(motion)
        self._interval = float(np.median(np.diff(motion.times)))
        self._curves = smooth(motion, 0.25 * self.period)
        speed = float(np.nanquantile(np.abs(self._curves.omega), 0.999))
        self._rate = speed / MAX_ROTATION  # substeps in a second, at least
        self._step = _NODES / max(default_substeps(model.chain, 1.0), self._rate)

    def _fit(
        self,
        model: Model,
        parts: Sequence[slice],
        before: Fit | FloatArray,
        iterations: int = 50,
        converged: float = CONVERGED,
    ) -> Fit | None:
        """Return the fit of `model` to parts of the motion; None where nothing moves.

        It begins with what was fitted before, or with given values (k,); first states that were
        not fitted before are those of the splines.
        """
        segments, states = side_by_side(self.motion, parts, self._step), self._curves.states(parts)
        if isinstance(before, Fit):
            found = before.states()
            states = np.array([found.get(p.start, s) for p, s in zip(parts, states, strict=True)])
        start = before.solution.fitted if isinstance(before, Fit) else before, states
        shooting = Shooting(model, segments, self._rate)
        counted = np.repeat(segments.measured, self.motion.links, axis=1).astype(np.float64)
        solution = solve(shooting.simulate, start, counted, model.lower, iterations, converged)
        return None if solution is None else Fit(segments, solution)

    def judge(self, values: FloatArray, parts: Sequence[slice], iterations: int = 50) -> Fit | None:
        """Return the fit of the first states alone, with the values (9, n), in stages."""
        model, fit, durations = self.model.fixed(values), None, self._durations(parts)
        for duration in durations:
            cuts, before = cut(self.motion, parts, duration), np.zeros(0) if fit is None else fit
            converged = CONVERGED if duration == durations[-1] else _PASSING
            fit = self._fit(model, cuts, before, iterations, converged)
        return fit

    def start(self, parts: Sequence[slice]) -> FloatArray:
        """Return the values, (9, n), that fit best: those given, or those of several regressions.

        The splines of the best regression give the first states from now on.

        Raises
        ------
        RuntimeError
            If none of them makes a chain that moves.
        """
        short = cut(self.motion, parts, self._durations(parts)[0])
        widest = 0.5 * self.period
        narrowest = min(max(10.0 * self._interval, 0.05 * self.period), 0.5 * widest)
        judged = self.judge(self.model.known, short, _ROUGH)
        candidates = [] if judged is None else [(judged.solution.rms, self.model.known)]
        best = math.inf, self._curves
        for width in np.geomspace(narrowest, widest, _WIDTHS).tolist():
            self._curves = smooth(self.motion, width)
            values = regress(self.model, self.motion, self._curves, parts)
            judged = None if values is None else self.judge(values, short, _ROUGH)
            if values is not None and judged is not None:
                candidates.append((judged.solution.rms, values))
                best = min(best, (judged.solution.rms, self._curves), key=lambda one: one[0])
        self._curves = best[1]
        if not candidates:
            raise RuntimeError(
                "no links of these lengths move like the data: check the lengths of the chain, the "
                "units and the order of the angles, and that they are absolute, not of the joints"
            )
        return min(candidates, key=lambda one: one[0])[1]

    def lengthen(self, parts: Sequence[slice], values: FloatArray) -> tuple[Fit, float]:
        """Return the fit over the longest segments that are possible, and their duration [s]."""
        durations = self._durations(parts)
        cuts, reached = cut(self.motion, parts, durations[0]), durations[0]
        best = self._fit(self.model, cuts, self.model.pack(values), converged=_PASSING)
        if best is None:
            raise RuntimeError("the fit left all chains that can move: fit fewer quantities")
        for duration in durations[1:]:
            longer = cut(self.motion, parts, duration)
            new = self._fit(self.model, longer, best, converged=_PASSING)
            if new is None or new.rmse > max(_SMALL, _TOO_MUCH * best.rmse):
                break
            if new.growth * new.scatter > _SENSITIVE:
                break
            best, reached = new, duration
        final = self._fit(self.model, best.segments.rows, best)
        return final or best, reached

    def fit_once(self, parts: Sequence[slice]) -> Fit | None:
        """Return the fit over these parts as they are, from the values of `start`."""
        return self._fit(self.model, parts, self.model.pack(self.start(parts)), converged=_PASSING)

    def _durations(self, parts: Sequence[slice]) -> list[float]:
        """Return how long segments are in each stage [s]: twice as long each time."""
        times = self.motion.times
        longest = max(float(times[rows.stop - 1] - times[rows.start]) for rows in parts)
        shortest = max(_FIRST * self.period, 2 * MIN_ROWS * self._interval)
        stages = max(0, math.floor(math.log2(longest / shortest))) if longest > shortest else 0
        return [longest / 2**k for k in range(stages, -1, -1)]


def typical_period(motion: Motion, most: float = math.inf) -> float:
    """Return 2 pi times the median deviation of the angles over the median speed [s].

    It is the period of a swing that is a sine. Deviations above `most` [rad] count as that.
    """
    periods: list[float] = []
    for rows in motion.stretches():
        theta = motion.theta[rows]
        rates = np.diff(theta, axis=0) / np.diff(motion.times[rows])[:, None]
        speed = np.median(np.abs(rates), axis=0)
        away = np.median(np.abs(theta - np.median(theta, axis=0)), axis=0)
        moving = (speed > 0.0) & (away > 0.0)
        periods += (2.0 * np.pi * np.minimum(away, most)[moving] / speed[moving]).tolist()
    if not periods:
        raise ValueError("theta must move, but each measured angle is at rest most of the time")
    return float(np.median(periods))
