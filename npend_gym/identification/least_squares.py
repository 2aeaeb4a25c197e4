"""Robust least squares with few common unknowns and many that concern one segment each."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear

from npend_gym._checks import FloatArray

_OUTLYING = 3.0  # times the scatter of the residuals: from there on they count less
CONVERGED = 1e-6  # relative decrease of the cost in the last step
_MAX_DAMPING = 1e10


class Point(NamedTuple):
    """The residuals for some values of the unknowns, and what returns their derivatives."""

    residuals: FloatArray  # (S, M)
    linearise: Callable[[], tuple[FloatArray, FloatArray]]  # by the unknowns: (S, M, k), (S, M, r)


class _Normal(NamedTuple):
    """The normal equations: common unknowns p, those of each segment s."""

    pp: FloatArray  # (k, k)
    sp: FloatArray  # (S, r, k)
    ss: FloatArray  # (S, r, r)
    p: FloatArray  # (k,): half the gradient of the squares, as below
    s: FloatArray  # (S, r)


@dataclass(frozen=True, eq=False)
class Solution:
    """Values of the unknowns, best ones where `solve` returns it."""

    fitted: FloatArray  # the common unknowns, (k,)
    states: FloatArray  # the unknowns of each segment, (S, r)
    point: Point  # the residuals there
    counted: FloatArray  # 1 where there is a residual, 0 where not, (S, M)

    @property
    def residuals(self) -> FloatArray:
        """The residuals, shape (S, M)."""
        return self.point.residuals

    @cached_property
    def scatter(self) -> float:
        """The `deviation` of the residuals, never quite zero."""
        return max(float(deviation(self.residuals[self.counted > 0.0])), 1e-12)

    @cached_property
    def weights(self) -> FloatArray:
        """How much each residual counts, 1 for a small one, and 0 where there is none, (S, M)."""
        return self.counted / np.sqrt(1.0 + (self.residuals / (_OUTLYING * self.scatter)) ** 2)

    @property
    def rms(self) -> float:
        """Root mean square of the residuals, each as much as it counts."""
        return float(np.sqrt(np.sum(self.weights * self.residuals**2) / np.sum(self.weights)))

    @cached_property
    def slopes(self) -> tuple[FloatArray, FloatArray]:
        """Derivatives of the residuals by both kinds of unknowns, (S, M, k) and (S, M, r)."""
        return self.point.linearise()

    @property
    def projected(self) -> FloatArray:
        """Derivatives by the common unknowns, the others following at their best, (S, M, k)."""
        by_fitted, by_state = self.slopes
        return by_fitted - by_state @ np.linalg.solve(self._normal.ss, self._normal.sp)

    @cached_property
    def _normal(self) -> _Normal:
        by_fitted, by_state = self.slopes
        p, s = (slopes * self.weights[..., None] for slopes in (by_fitted, by_state))
        f, rows = self.residuals[..., None], (self.weights.size, p.shape[2])
        p_rows, s_columns = p.reshape(rows), s.swapaxes(1, 2)
        return _Normal(
            p_rows.T @ by_fitted.reshape(rows), s_columns @ by_fitted, s_columns @ by_state,
            p_rows.T @ f.ravel(), (s_columns @ f)[..., 0],
        )  # fmt: skip

    def step(self, damping: float, least: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return changes of the unknowns that lead down, of the common ones not below `least`."""
        pp, sp, ss, p, s = self._normal
        both = np.linalg.solve(_damped(ss, damping), np.concatenate([sp, s[..., None]], axis=-1))
        inner: FloatArray = _damped(pp, damping) - np.einsum("sij,sik->jk", sp, both[..., :-1])
        right: FloatArray = np.einsum("sij,si->j", sp, both[..., -1]) - p
        factor: FloatArray = np.asarray(np.linalg.cholesky(inner), np.float64)
        change = bounded(factor.T, solve_triangular(factor, right, lower=True), least)
        return change, -both[..., -1] - both[..., :-1] @ change

    def cost(self, limit: float) -> float:
        """Return half the sum of rho(residual^2), of `solve`, in units of `limit`."""
        if not np.all(np.isfinite(self.residuals)):
            return np.inf
        return float(np.sum(np.sqrt(1.0 + (self.residuals / limit) ** 2) - 1.0))


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
    the residuals, which each step determines. The unknowns of the segments are eliminated one
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
    point, damping = evaluate(*start), 1e-3
    if point is None:
        return None
    best = Solution(*start, point, counted)
    for _ in range(iterations):
        limit, before = _OUTLYING * best.scatter, damping
        cost = best.cost(limit)
        while damping < _MAX_DAMPING:
            change, changes = best.step(damping, lower - best.fitted)
            there = np.maximum(best.fitted + change, lower), best.states + changes
            point = evaluate(*there)
            new = None if point is None else Solution(*there, point, counted)
            gain = -math.inf if new is None else cost - new.cost(limit)
            if new is not None and gain > 0.0:
                break
            damping *= 8.0
        else:
            break
        best = new
        if gain < converged * cost:
            break
        if damping == before:  # the first try was good
            damping = max(damping / 8.0, 1e-9)
    return best


def deviation(errors: FloatArray) -> FloatArray:
    """Return the standard deviation along axis 0 by the median: outliers do not matter to it."""
    return 1.4826 * np.median(np.abs(errors), axis=0)


def bounded(matrix: FloatArray, right: FloatArray, lower: FloatArray) -> FloatArray:
    """Return the x not below `lower` for which `matrix` x is closest to `right`."""
    if not lower.size:
        return lower
    size = np.linalg.norm(matrix, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    return lsq_linear(matrix / size, right, (lower * size, np.inf), method="bvls").x / size


def _damped(matrix: FloatArray, damping: float) -> FloatArray:
    """Return a matrix, or a stack of them, whose diagonal is larger by the factor 1 + damping."""
    out = matrix.copy()
    diagonal = np.einsum("...ii->...i", out)
    diagonal *= 1.0 + damping
    diagonal += 1e-300
    return out
