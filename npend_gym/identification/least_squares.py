"""Robust least squares with few common unknowns and many that concern one segment each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from npend_gym._checks import FloatArray


class Point(Protocol):
    """Residuals (S, M), for some values of the unknowns, and their derivatives."""

    @property
    def residuals(self) -> FloatArray:
        """The residuals, shape (S, M)."""
        ...

    def linearise(self) -> tuple[FloatArray, FloatArray]:
        """Return their derivatives by the unknowns, (S, M, k) and (S, M, r)."""
        ...


_OUTLYING = 3.0  # times the scatter of the residuals: from there on they count less
CONVERGED = 1e-6  # relative decrease of the cost, in two steps
_MAX_DAMPING = 1e10


@dataclass(frozen=True, eq=False)
class Solution:
    """What `solve` found.

    Attributes
    ----------
    fitted : ndarray, shape (k,)
        The common unknowns.
    states : ndarray, shape (S, r)
        The unknowns of each segment.
    residuals : ndarray, shape (S, M)
    weights : ndarray, shape (S, M)
        How much each residual counts, 1 for a small one, and 0 where there is none.
    by_state : ndarray, shape (S, M, r)
        Derivatives of the residuals by the unknowns of each segment.
    projected : ndarray, shape (S, M, k)
        Derivatives of the residuals by the common unknowns, the others following at their best.
    """

    fitted: FloatArray
    states: FloatArray
    residuals: FloatArray
    weights: FloatArray
    by_state: FloatArray
    projected: FloatArray

    @property
    def rms(self) -> float:
        """Root mean square of the residuals, each as much as it counts."""
        return float(np.sqrt(np.sum(self.weights * self.residuals**2) / np.sum(self.weights)))


def scatter(residuals: FloatArray, counted: FloatArray) -> float:
    """Return the `deviation` of the residuals that count, never quite zero."""
    return max(float(deviation(residuals[counted > 0.0])), 1e-12)


def deviation(errors: FloatArray) -> FloatArray:
    """Return the standard deviation along axis 0 by the median: outliers do not matter to it."""
    return 1.4826 * np.median(np.abs(errors), axis=0)


def solve(
    evaluate: Callable[[FloatArray, FloatArray], Point | None],
    start: tuple[FloatArray, FloatArray],
    counted: FloatArray,
    lower: FloatArray,
    iterations: int = 50,
    converged: float = CONVERGED,
) -> Solution | None:
    """Minimise sum rho(residual^2), rho(z) = 2 c^2 (sqrt(1 + z / c^2) - 1), by damped Gauss-Newton.

    It is the loss "soft_l1" of `scipy.optimize.least_squares`, with c three times the scatter of
    the residuals, found anew in each step. The unknowns of the segments are eliminated one
    segment after the other (Schur complement), which that function cannot do: with many segments
    this takes a hundredth of the time.

    Parameters
    ----------
    evaluate : callable
        Takes the unknowns, shapes (k,) and (S, r). Returns None where there is no motion.
    start : tuple of ndarray
        First values of the unknowns.
    counted : ndarray, shape (S, M)
        1 where there is a residual, 0 where not.
    lower : ndarray, shape (k,)
        Least values of the common unknowns.
    iterations : int
        Steps at most.
    converged : float
        Relative decrease of the cost in a step after which there is no other.

    Returns
    -------
    Solution or None
        None if there is no motion at the start.
    """
    fitted, states = start
    point = evaluate(fitted, states)
    damping, small = 1e-3, 0
    for _ in range(iterations):
        if point is None:
            return None
        f = point.residuals
        c = _OUTLYING * scatter(f, counted)
        cost = _cost(f, c)
        system = _Normal(f, *point.linearise(), counted * _weights(f, c))
        while damping < _MAX_DAMPING:
            change, changes = system.step(damping, lower - fitted)
            new = np.maximum(fitted + change, lower), states + changes
            there = evaluate(*new)
            if there is not None and _cost(there.residuals, c) < cost:
                break
            damping *= 8.0
        else:
            break
        gain = 1.0 - _cost(there.residuals, c) / cost
        (fitted, states), point = new, there
        damping = max(damping / 8.0, 1e-9)
        small = small + 1 if gain < converged else 0
        if small == (2 if converged <= CONVERGED else 1):
            break
    if point is None:
        return None
    f, (by_fitted, by_state) = point.residuals, point.linearise()
    weights = counted * _weights(f, _OUTLYING * scatter(f, counted))
    projected = _Normal(f, by_fitted, by_state, weights).project()
    return Solution(fitted, states, f, weights, by_state, projected)


def _weights(f: FloatArray, c: float) -> FloatArray:
    return 1.0 / np.sqrt(1.0 + (f / c) ** 2)


def _cost(f: FloatArray, c: float) -> float:
    if not np.all(np.isfinite(f)):
        return np.inf
    return float(np.sum(np.sqrt(1.0 + (f / c) ** 2) - 1.0))


class _Normal:
    """The normal equations: common unknowns p, those of each segment s."""

    def __init__(
        self, f: FloatArray, by_fitted: FloatArray, by_state: FloatArray, weights: FloatArray
    ) -> None:
        self._by_fitted, self._by_state = by_fitted, by_state
        self._weighted = by_state * weights[..., None]
        weighted = by_fitted * weights[..., None]
        rows = weights.size, by_fitted.shape[2]
        self.pp = weighted.reshape(rows).T @ by_fitted.reshape(rows)
        self.ss = self._weighted.swapaxes(1, 2) @ by_state
        self.sp = self._weighted.swapaxes(1, 2) @ by_fitted
        self.gradient = np.einsum("smi,sm->i", weighted, f)
        self.gradients = np.einsum("smi,sm->si", self._weighted, f)

    def step(self, damping: float, least: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the changes of the unknowns, those of the common ones not below `least`."""
        ss = _damped(self.ss, damping)
        both = np.linalg.solve(ss, np.concatenate([self.sp, self.gradients[..., None]], axis=-1))
        pp = _damped(self.pp, damping) - np.einsum("sij,sik->jk", self.sp, both[..., :-1])
        right = -self.gradient + np.einsum("sij,si->j", self.sp, both[..., -1])
        change = np.zeros_like(right)
        bound = (least >= 0.0) & (right < 0.0)
        for _ in range(right.size + 1):  # once more for each that comes to its bound
            change[bound], free = least[bound], ~bound
            rest = right[free] - pp[np.ix_(free, bound)] @ change[bound]
            change[free] = np.linalg.solve(pp[np.ix_(free, free)], rest)
            if np.all(change >= least):
                break
            bound |= change < least
        return change, -both[..., -1] - both[..., :-1] @ change

    def project(self) -> FloatArray:
        """Return the derivatives by the common unknowns, the others following at their best."""
        return self._by_fitted - self._by_state @ np.linalg.solve(self.ss, self.sp)


def _damped(matrix: FloatArray, damping: float) -> FloatArray:
    """Return a matrix, or a stack of them, whose diagonal is larger by the factor 1 + damping."""
    out = matrix.copy()
    diagonal = np.einsum("...ii->...i", out)
    diagonal *= 1.0 + damping
    diagonal += 1e-300
    return out
