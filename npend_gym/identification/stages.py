"""The fit in stages: a regression gives first values, shooting over longer and longer segments."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.identification.least_squares import CONVERGED, Solution, solve
from npend_gym.identification.motion import MIN_ROWS, Motion
from npend_gym.identification.parameters import OFFSET, FitModel
from npend_gym.identification.regression import Smooth, regress, smooth
from npend_gym.identification.shooting import Shooting
from npend_gym.physics.substeps import MAX_ROTATION, default_substeps

_FIRST = 0.25  # typical periods in the shortest segments
_WIDTHS = 6  # of bumps, tried by the regression
_ROUGH = 1  # iterations that tell which first values are best
_PASSING = 1e-2  # decrease of the cost in a step that ends a stage before the last one
_NODES = 4  # substeps between two nodes of the grid
_SENSITIVE = 0.2  # growth of the scatter to so many rad: a chaotic motion has many solutions
_AS_GOOD = 1.2  # times the error of segments half as long: noise, and no lost motion, is so large
_TOO_MUCH = 8.0  # a fit whose error grows by this factor when segments are twice as long ...
_SMALL = 0.02  # ... and exceeds this [rad] has lost the motion


@dataclass(frozen=True, eq=False)
class Fit:
    """A solution for parts of the motion, `rows`, of S segments."""

    rows: list[slice]
    solution: Solution

    @property
    def links(self) -> int:
        """Number of links."""
        return self.solution.states.shape[1] // 2

    @property
    def scatter(self) -> float:
        """Standard deviation of the errors by their median [rad]."""
        return self.solution.scatter

    @property
    def residuals(self) -> FloatArray:
        """Simulated less measured angles [rad] in all rows of the segments, one after another."""
        return self.solution.residuals[self.solution.counted > 0.0].reshape(-1, self.links)

    @property
    def errors(self) -> FloatArray:
        """Root mean square error of the angles of each segment [rad], shape (S,)."""
        counts = self.solution.counted.sum(axis=1)
        return np.sqrt((self.solution.residuals**2).sum(axis=1) / counts)

    @property
    def rmse(self) -> float:
        """Root mean square error of all angles [rad]."""
        return float(np.sqrt(np.mean(self.residuals**2)))

    @property
    def may_be_lost(self) -> bool:
        """Whether segments amplify errors so much that another solution may be the right one."""
        by_angles = self.solution.slopes[1][..., : self.links]
        return float(np.abs(by_angles).max()) * self.scatter > _SENSITIVE

    def has_lost(self, shorter: Fit) -> bool:
        """Whether longer segments lost the motion, or amplify its errors so much that they may."""
        return self.rmse > max(_SMALL, _TOO_MUCH * shorter.rmse) or self.may_be_lost


class Stages:
    """Fits of a model to one motion, whose first states come from splines of it."""

    def __init__(self, motion: Motion, model: FitModel) -> None:
        self.motion: Motion = motion
        self.model: FitModel = model
        self.period: float = motion.period()
        self._interval = float(np.median(np.diff(motion.times)))
        self._curves = smooth(motion, 0.25 * self.period)
        speed = float(np.nanquantile(np.abs(self._curves.omega), 0.999))
        self._rate = speed / MAX_ROTATION  # substeps in a second, at least
        self._step = _NODES / max(default_substeps(model.chain, 1.0), self._rate)

    def fit(
        self,
        model: FitModel,
        rows: Sequence[slice],
        start: Fit | FloatArray,
        iterations: int = 50,
        converged: float = CONVERGED,
    ) -> Fit | None:
        """Return the fit of `model` to segments of these rows; None where nothing moves.

        It begins with what was fitted before, or with given values (k,); first states that were
        not fitted before are those of the splines.
        """
        firsts, found = [part.start for part in rows], dict[int, FloatArray]()
        if isinstance(start, Fit):
            before, start = start, start.solution.fitted
            firsts_before = (part.start for part in before.rows)
            found = dict(zip(firsts_before, before.solution.states, strict=True))
        smoothed = np.hstack([self._curves.theta[firsts], self._curves.omega[firsts]])
        states = np.array([found.get(k, one) for k, one in zip(firsts, smoothed, strict=True)])
        shooting = Shooting(model, self.motion, rows, self._step, self._rate)
        counted = np.repeat(shooting.measured, self.motion.links, axis=1).astype(np.float64)
        solution = solve(
            shooting.simulate, (start, states), counted, model.lower, iterations, converged
        )
        return None if solution is None else Fit(list(rows), solution)

    def start(self, parts: Sequence[slice]) -> FloatArray:
        """Return the values, (10, n), that fit best: those given, or those of several regressions.

        The splines of the best regression give the first states from now on. If none makes a chain
        that moves, a RuntimeError is raised.
        """
        widest = 0.5 * self.period
        narrowest = min(max(10.0 * self._interval, 0.05 * self.period), 0.5 * widest)
        first = [(self._curves, self.model.known)]
        for width in np.geomspace(narrowest, widest, _WIDTHS).tolist():
            curves = smooth(self.motion, width)
            values = regress(self.model, self.motion, curves, parts)
            if values is not None:
                first.append((curves, values))
        duration = self._durations(parts)[0]
        while True:
            short = self.motion.cut(parts, duration)
            tried = [(self._rough(curves, values, short), curves, values)
                     for curves, values in first]  # fmt: skip
            best, curves, values = min(tried, key=lambda one: _rms(one[0]))
            if not self._can_halve(best, duration):
                break
            duration *= 0.5
        self._curves = min(tried[1:] or tried, key=lambda one: _rms(one[0]))[1]
        if best is None:
            raise RuntimeError(
                "no links of these lengths move like the data: check the lengths of the chain, the "
                "units and the order of the angles, and that they are absolute, not of the joints"
            )
        return values

    def _rough(self, curves: Smooth, values: FloatArray, rows: Sequence[slice]) -> Fit | None:
        self._curves = curves
        return self.fit(self.model.fixed(values), rows, np.empty(0), _ROUGH)

    def _can_halve(self, fit: Fit | None, duration: float) -> bool:
        """Return whether a fit may be lost that has no shorter one, and segments can be halved."""
        may_be_lost = fit is None or fit.may_be_lost
        return may_be_lost and duration >= 2.0 * MIN_ROWS * self._interval

    def lengthen(
        self,
        parts: Sequence[slice],
        values: FloatArray,
        model: FitModel | None = None,
        most: int = 50,
    ) -> tuple[Fit | None, float]:
        """Return the fit over the longest segments that are possible, and their duration [s].

        It begins with `values` (10, n); each stage takes at most `most` iterations. The first stage
        has no shorter one to be compared with: it is halved until it amplifies no error too much,
        or segments have 20 rows.
        """
        model, best, reached = model or self.model, None, 0.0
        durations = self._durations(parts)
        begun = [self._first(parts, durations[0], model, values, most)]
        while self._can_halve(begun[0], durations[0]):
            durations.insert(0, 0.5 * durations[0])
            begun.insert(0, self._first(parts, durations[0], model, values, most))
        if begun[0] is not None and begun[0].may_be_lost:  # by large errors, or it is lost
            while len(begun) > 1 and _rms(begun[1]) < _AS_GOOD * _rms(begun[0]):
                del begun[0], durations[0]
        new = begun[0]
        for duration in durations:
            if best is not None:
                new = self.fit(model, self.motion.cut(parts, duration), best, most, _PASSING)
            if new is None or (best is not None and model.names and new.has_lost(best)):
                break
            best, reached = new, duration
        final = None if best is None else self.fit(model, best.rows, best, most)
        return final or best, reached

    def _first(
        self,
        parts: Sequence[slice],
        duration: float,
        model: FitModel,
        values: FloatArray,
        most: int,
    ) -> Fit | None:
        rows = self.motion.cut(parts, duration)
        return self.fit(model, rows, model.pack(values), most, _PASSING)

    def fit_once(self, rows: Sequence[slice], most: int) -> Fit | None:
        """Return the fit over these rows as they are, from the values of `start`."""
        return self.fit(self.model, rows, self.model.pack(self.start(rows)), most, _PASSING)

    def judge(self, values: FloatArray, parts: Sequence[slice], most: int = 50) -> Fit | None:
        """Return the fit of the first states alone, with the values (10, n), in stages."""
        fit, reached = self.lengthen(parts, values, self.model.fixed(values), most)
        return fit if reached == self._durations(parts)[-1] else None

    def with_offset(self) -> Stages:
        """Return the same for angles that are off by a constant, which is fitted."""
        free = self.model.free.copy()
        free[OFFSET] = self.model.chain.gravity > 0.0  # without it no angle tells an offset
        return Stages(self.motion, replace(self.model, free=free))

    def _durations(self, parts: Sequence[slice]) -> list[float]:
        """Return how long segments are in each stage [s]: twice as long each time."""
        times = self.motion.times
        longest = max(float(times[rows.stop - 1] - times[rows.start]) for rows in parts)
        shortest = max(_FIRST * self.period, 2 * MIN_ROWS * self._interval)
        stages = max(0, math.floor(math.log2(longest / shortest))) if longest > shortest else 0
        return [longest / 2**k for k in range(stages, -1, -1)]


def _rms(fit: Fit | None) -> float:
    return math.inf if fit is None else fit.solution.rms


def split(blocks: Sequence[slice], share: float) -> tuple[list[slice], list[slice]]:
    """Return which blocks are fitted and which are held out."""
    held = hold_out(len(blocks), share)
    return [rows for k, rows in enumerate(blocks) if k not in held], [blocks[k] for k in held]


def hold_out(count: int, share: float) -> list[int]:
    """Return which of `count` blocks are held out: evenly spaced, at least one of two."""
    if share == 0.0 or count < 2:
        return []
    middles = (np.arange(math.floor(share * count + 0.5 + 1e-9)) + 0.5) / share
    return (np.ceil(middles - 1e-9).astype(int) - 1).tolist() or [count - 1]
