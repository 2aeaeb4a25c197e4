"""Which terms the data support, where the user leaves that open."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.identification.least_squares import bounded
from npend_gym.identification.parameters import OPTIONAL, QUANTITIES, FitModel
from npend_gym.identification.stages import Fit, Stages
from npend_gym.identification.uncertainty import cluster_edges, clusters

_PINNED = 1e-6  # share of its own information that a cluster keeps where it is left out
_SINGULAR = 1e-12  # least eigenvalue of the information, of the largest
_MANY, _CLOSE = 10, 1e-3  # iterations of a trial fit, and decrease of the cost that ends it


class LeftOut(NamedTuple):
    """A term that is not fitted, and how well parts of the data are predicted from the others."""

    term: str
    value: str  # "zero" or "as given"
    rms: float  # error of these predictions without it [rad], and without those left out before
    with_it: float  # the same with it

    def __str__(self) -> str:
        return (
            f"{self.term}: {self.value}; parts of the data are predicted from the others to "
            f"{1e3 * self.rms:.4g} mrad without it, to {1e3 * self.with_it:.4g} mrad with it"
        )


@dataclass(frozen=True, eq=False)
class _Trial:
    """The fit of some terms, and the squares of each cluster predicted from the others, (C,)."""

    fit: Fit
    model: FitModel
    squares: FloatArray
    dropped: tuple[int, str] = (-1, "")  # the row that is no longer fitted, and its value

    @property
    def total(self) -> float:
        return float(self.squares.sum())


def choose(stages: Stages, fit: Fit, model: FitModel) -> tuple[Fit, FitModel, list[LeftOut]]:
    """Return the fit of the terms that the data support, its model, and what it leaves out.

    `fit` is that of all terms of `model`. Each cluster of `uncertainty`, at best a swing, is
    predicted from all others: leave-one-out cross-validation. The optional term without which
    predictions are best is left out, then the next one. The fewest terms are chosen whose squared
    errors exceed the least ones by no more than the standard error of this difference. A term that
    is left out is zero, or has the value of the given chain, whichever predicts better.
    """
    edges = cluster_edges(fit.solution, model.chain.n)
    weights = fit.solution.weights
    path = [_Trial(fit, model, _predicted(fit, model, edges, weights))]
    while found := [
        one
        for fewer, dropped in _fewer(path[-1].model)
        if (one := _trial(stages, path[-1], fewer, dropped, edges, weights)) is not None
    ]:
        path.append(min(found, key=lambda one: one.total))
        if not _as_good(path[-1].squares, min(path, key=lambda one: one.total).squares, 3.0):
            break
    best = min(path, key=lambda one: one.total)
    last = max(k for k, one in enumerate(path) if _as_good(one.squares, best.squares, 1.0))
    rms = [math.sqrt(one.total / float(weights.sum())) for one in path]
    left_out = [
        LeftOut(QUANTITIES[row], value, rms[k + 1], rms[k])
        for k, (row, value) in enumerate(one.dropped for one in path[1 : last + 1])
    ]
    chosen = path[last]
    if not left_out:
        return fit, model, []
    whole = stages.fit(chosen.model, fit.rows, chosen.fit)
    return whole or chosen.fit, chosen.model, left_out


def _fewer(model: FitModel) -> list[tuple[FitModel, tuple[int, str]]]:
    """Return models with one optional term less, and that term with its value."""
    out = list[tuple[FitModel, tuple[int, str]]]()
    for row in OPTIONAL:
        free = model.free.copy()
        free[row] = False
        if not model.free[row].any() or not free.any():  # something must be fitted
            continue
        zero = model.known.copy()
        zero[row] = 0.0
        out.append((replace(model, known=zero, free=free), (row, "zero")))
        if model.known[row].any():
            out.append((replace(model, free=free), (row, "as given")))
    return out


def _trial(
    stages: Stages,
    before: _Trial,
    model: FitModel,
    dropped: tuple[int, str],
    edges: Sequence[int],
    weights: FloatArray,
) -> _Trial | None:
    """Return the fit of a model that begins at another fit; None where nothing moves."""
    fitted = model.pack(before.model.unpack(before.fit.solution.fitted))
    begun = Fit(before.fit.rows, replace(before.fit.solution, fitted=fitted))
    fit = stages.fit(model, begun.rows, begun, _MANY, _CLOSE)
    if fit is None:
        return None
    return _Trial(fit, model, _predicted(fit, model, edges, weights), dropped)


def _as_good(squares: FloatArray, best: FloatArray, errors: float) -> bool:
    """Whether squares of the clusters exceed the best ones by this many standard errors at most."""
    more = squares - best
    return float(more.sum()) <= errors * math.sqrt(more.size) * float(more.std(ddof=1))


def _predicted(fit: Fit, model: FitModel, edges: Sequence[int], weights: FloatArray) -> FloatArray:
    """Return the squares of each cluster as the others predict it, (C,): by one step of Newton's.

    The first states follow. The step is bounded as the fitted values are.
    """
    scale, scores, parts, squares = clusters(fit.solution, model, edges, weights)
    least = (model.lower - fit.solution.fitted) / scale
    gradient, information = scores.sum(axis=0), (1.0 + _PINNED) * parts.sum(axis=0)
    for k, (own, mine) in enumerate(zip(scores, parts, strict=True)):
        right = own - gradient
        values, vectors = np.linalg.eigh(information - mine)
        root = np.sqrt(np.maximum(values, _SINGULAR * max(values[-1], 1e-300)))
        change = vectors @ ((vectors.T @ right) / root**2)
        if np.any(change < least):
            change = bounded((vectors * root).T, (vectors.T @ right) / root, least)
        squares[k] += 2.0 * own @ change + change @ mine @ change
    return squares
