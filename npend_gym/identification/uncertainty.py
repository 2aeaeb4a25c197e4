"""How well the data determine what was fitted, and what they do not determine at all."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.identification.least_squares import Solution
from npend_gym.identification.parameters import (
    ARMATURE,
    DAMPING,
    DRAG,
    GRAVITY,
    INERTIA,
    LENGTH,
    LIFT,
    MARGIN,
    OFFSET,
    FitModel,
    weighs,
)

_FEW, _ENOUGH = 6, 2  # clusters: at least, and for each fitted value where errors are short enough
_ROUGH = 3.0  # times what independent errors explain: errors of few segments are then rough
_LARGE = 0.05  # relative standard error of an inertia or a lift from which on that matters
_PINNED = 1e-6  # share of what is known of a value that the other clusters have at least
_SINGULAR = 1e-12  # eigenvalue of the scaled information, relative to the largest
_VAGUE = 0.5  # relative standard error from which on a value counts as not determined


class Uncertainty(NamedTuple):
    """Standard errors of the k fitted values, and their covariance and correlation."""

    errors: FloatArray  # (k,), infinite where the data do not determine a value
    covariance: FloatArray  # of what the data determine, (k, k)
    correlation: FloatArray  # (k, k); zero beside a value without error
    # Whether few segments determine much, errors last long, and inertias or lifts are not known
    # to 5 %, or gravity
    rough: bool


def uncertainty(solution: Solution, model: FitModel) -> Uncertainty:
    """Return the standard errors of a solution, from how much it depends on each segment.

    Errors of a model, and of smoothed measurements, last for many rows, so that rows do not tell
    how much they change the fit. The errors are therefore those of a jackknife over C clusters: the
    covariance is (C - 1)/C sum_c d_c d_c^T (the "CR3" estimate). Here d_c is the change of the
    fitted values, less its mean, when cluster c is left out. One step of Newton's method computes
    it. A cluster is a segment. Where there are less than two for each fitted value, segments are
    cut into parts, which are as long as the errors last, or longer; but less than 6 segments make 6
    clusters. No standard error is less than that of independent errors.

    A value that ended at its bound, zero, might be there by the chance of these data. Errors are
    therefore those of a fit without bounds: such a value has an error too, and all others have that
    of not knowing it.
    """
    edges = cluster_edges(solution, model.chain.n)
    scale, scores, parts, _ = clusters(solution, model, edges, solution.weights)
    values, vectors = np.linalg.eigh(parts.sum(axis=0))
    determined = values > _SINGULAR * values.max(initial=0.0)
    whiten = vectors[:, determined] / np.sqrt(values[determined])  # to values of unit information
    left = (1.0 + _PINNED) * np.eye(determined.sum()) - whiten.T @ parts @ whiten
    changes = np.linalg.solve(left, (scores @ whiten)[..., None])[..., 0] @ whiten.T
    changes -= changes.mean(axis=0)
    inner = (1.0 - 1.0 / len(scores)) * changes.T @ changes
    total, fitted = float(solution.weights.sum()), scale.size
    unknowns = fitted + solution.states.size
    variance = np.sum((solution.weights * solution.residuals) ** 2) / max(1.0, total - unknowns)
    least = variance * whiten @ whiten.T
    excess = np.diag(inner) / np.maximum(np.diag(least), 1e-300)
    # few segments leave the correlation of many values open, the information does not
    share = fitted / (fitted + len(scores) - 1.0)
    mixed = (1.0 - share) * _correlation(inner) + share * _correlation(least)
    spread = np.sqrt(np.maximum(np.diag(inner), np.diag(least)))
    covariance = mixed * np.outer(spread * scale, spread * scale)
    errors = np.sqrt(np.diag(covariance))
    errors[np.abs(vectors[:, ~determined]).max(axis=1, initial=0.0) > 0.1] = np.inf
    ruling = np.isin(np.argwhere(model.free)[:, 0], (INERTIA, LIFT, GRAVITY))
    rough = len(solution.weights) < _ENOUGH * fitted and float(np.median(excess)) > _ROUGH**2
    rough &= bool(np.any(spread[ruling] > _LARGE))
    return Uncertainty(errors, covariance, _correlation(covariance), rough)


def clusters(
    solution: Solution, model: FitModel, edges: Sequence[int], weights: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the sizes of the k fitted values, and what C clusters say of them in these units.

    Half the gradient of each cluster's weighted squares, (C, k), and half their second derivatives,
    (C, k, k), the first states following at their best; and the squares, (C,). `edges` cut each
    segment into clusters, see `uncertainty`; `weights` are those of the residuals.
    """
    scale = model.scale(model.unpack(solution.fitted))
    columns = solution.projected * scale
    weighted = columns * weights[..., None]
    scores = _clusters(weighted * solution.residuals[..., None], edges)
    parts = _clusters(np.einsum("smi,smj->smij", weighted, columns), edges)
    return scale, scores, parts, _clusters(weights * solution.residuals**2, edges)


def cluster_edges(solution: Solution, links: int) -> list[int]:
    """Return the first residuals of the parts into which each segment is cut."""
    segments, size = solution.weights.shape
    rows, fitted = size // links, solution.fitted.size
    possible = math.floor(rows / lasting(solution.weights * solution.residuals, links))
    parts = max(min(-(-_ENOUGH * fitted // segments), possible), -(-_FEW // segments))
    parts = min(rows, parts)
    return [part * rows // parts * links for part in range(parts)]


def lasting(residuals: FloatArray, links: int) -> float:
    """Return for how many rows residuals (S, M) of this many links last: 1 for white noise.

    It is 1 + 2 sum_k r_k, with their autocorrelation r_k at lag k up to the first that is negative.
    """
    errors = residuals.reshape(len(residuals), -1, links)
    rows = errors.shape[1]
    spectrum = np.abs(np.fft.rfft(errors, 2 * rows, axis=1)) ** 2
    products = np.fft.irfft(spectrum.sum(axis=(0, 2)), 2 * rows)[:rows]
    if not products[0] > 0.0:
        return 1.0
    ends = np.flatnonzero(products < 0.0)
    last = int(ends[0]) if ends.size else rows
    return float(1.0 + 2.0 * products[1:last].sum() / products[0])


def _clusters(rows: FloatArray, edges: Sequence[int]) -> FloatArray:
    """Return sums over the parts of each segment, (S, M, ...), as (parts, ...)."""
    return np.add.reduceat(rows, edges, axis=1).reshape(-1, *rows.shape[2:])


def _correlation(covariance: FloatArray) -> FloatArray:
    """Return the correlation; zero beside a value without error."""
    spread = np.sqrt(np.diag(covariance))
    spread = np.where(spread > 0.0, spread, np.inf)
    out = covariance / np.outer(spread, spread)
    np.fill_diagonal(out, 1.0)
    return out


def undetermined(
    model: FitModel, found: Chain, fitted: FloatArray, errors: FloatArray, *, driven: bool
) -> list[str]:
    """Return in sentences what the data leave open, and what the chain `found` has in its place."""
    chain, free = model.chain, model.free
    out = [] if driven else [_scale(chain)]
    if free[INERTIA].any() or free[LIFT].any():
        out.append(
            "masses: the motion depends on two numbers of each link, inertia and lift, and not on "
            "its mass, centre and inertia about the centre separately; the given masses were kept "
            "where they leave no negative inertia"
        )
        out += _other_masses(chain, found)
    taken = f"gravity {chain.gravity:g} m/s^2"
    if free[LENGTH].any():
        taken += ", which sets their scale, and the last one"
    elif chain.n > 1:
        taken += ", and all lengths but the last,"
    if free[GRAVITY, 0]:
        taken = "those that were not fitted"
        out.append(
            "gravity: its standard error contains no errors of lengths, centres and other values "
            "of the given chain"
        )
    out.append(
        f"lengths: {taken} were taken from the given chain; the length of the last link changes "
        "nothing but the drag of its end"
    )
    if driven and free[INERTIA, 0] and not free[ARMATURE, 0]:
        out.append("armature0: it adds to inertia0 alone, and was taken from the given chain")
    if chain.n == 1 and free[DRAG, 0] and free[DAMPING, 0]:
        out.append("damping0 and drag0: one link does not determine both")
    for name, value, error, (row, _) in zip(
        model.names, fitted, errors, np.argwhere(free), strict=True
    ):
        if np.isinf(error):
            out.append(f"{name}: the data do not determine it beside the others")
        elif error > _VAGUE * abs(value) and row not in (OFFSET, LIFT):
            out.append(f"{name}: {value:.3g} +- {error:.2g} cannot be distinguished from zero")
    return out


def _scale(chain: Chain) -> str:
    """The quantity that sets the scale of free swings."""
    kept = f"lift0 = {chain.lift[0]:.6g} kg m" if weighs(chain)[0] else "inertia0"
    text = (
        "the scale: free swings do not change when all masses, inertias, damping, friction and "
        f"drag are multiplied by one factor; {kept} of the given chain was kept"
    )
    if np.array_equal(chain.centres, chain.lengths):
        text += ", whose centres of mass are at the ends of its links: give centres if they are not"
    return text


def _other_masses(chain: Chain, found: Chain) -> list[str]:
    """Return which masses of the chain `found` are not those given."""
    moved = np.flatnonzero(np.abs(found.masses - chain.masses) > 2.0 * MARGIN * chain.masses)
    return [
        f"masses[{i}]: {found.masses[i]:.4g} kg was taken for the given {chain.masses[i]:.4g} kg, "
        "with which no link has the fitted inertia and lift: check the given masses and centres"
        for i in moved.tolist()
    ]
