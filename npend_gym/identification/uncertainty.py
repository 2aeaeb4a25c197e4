"""How well the data determine what was fitted, and what they do not determine at all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.identification.least_squares import Solution
from npend_gym.identification.parameters import (
    ARMATURE,
    DAMPING,
    DRAG,
    INERTIA,
    LENGTH,
    LIFT,
    OFFSET,
    Model,
)

_CLUSTERS = 3  # independent parts of the data for each fitted value, at least
_SINGULAR = 1e-12  # eigenvalue of the scaled information, relative to the largest
_VAGUE = 0.5  # relative standard error from which on a value counts as not determined


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Standard errors of the k fitted values and their covariance.

    Attributes
    ----------
    errors : ndarray, shape (k,)
        Infinite where the data do not determine a value.
    covariance : ndarray, shape (k, k)
        Of what the data determine.
    """

    errors: FloatArray
    covariance: FloatArray

    @property
    def correlation(self) -> FloatArray:
        """The correlation of the fitted values, shape (k, k); zero beside a value without error."""
        spread = np.sqrt(np.diag(self.covariance))
        spread = np.where(spread > 0.0, spread, np.inf)
        out = self.covariance / np.outer(spread, spread)
        np.fill_diagonal(out, 1.0)
        return out


def uncertainty(solution: Solution, model: Model) -> Uncertainty:
    """Return the standard errors of a solution, from how much its segments differ.

    Errors of a model, and of smoothed measurements, last for many rows. The covariance is
    therefore that of clusters (the "sandwich"): H^-1 (sum_c s_c s_c^T) H^-1, where H is the
    information of what is fitted and s_c the gradient of segment c, c from 1 to C, times C / (C -
    k). Too few segments are cut into several clusters each. No standard error is less than that of
    independent errors. Values held at a bound have none.
    """
    scale = model.scale(model.unpack(solution.fitted))
    free = solution.fitted > model.lower
    columns = solution.projected[..., free] * scale[free]
    weighted = columns * solution.weights[..., None]
    values, vectors = np.linalg.eigh(np.einsum("smi,smj->ij", weighted, columns))
    told = values > _SINGULAR * values.max(initial=0.0)
    inverse = vectors[:, told] / values[told] @ vectors[:, told].T
    fitted = int(free.sum())
    scores = _clusters(weighted * solution.residuals[..., None], fitted)
    many = len(scores) / max(1, len(scores) - fitted)
    inner = many * inverse @ (scores.T @ scores) @ inverse
    total, unknowns = float(solution.weights.sum()), fitted + solution.states.size
    variance = np.sum((solution.weights * solution.residuals) ** 2) / max(1.0, total - unknowns)
    alone = np.diag(variance * inverse) / np.maximum(np.diag(inner), 1e-300)
    inner *= np.sqrt(np.outer(np.maximum(alone, 1.0), np.maximum(alone, 1.0)))
    covariance = np.zeros((scale.size, scale.size))
    covariance[np.ix_(free, free)] = inner * np.outer(scale[free], scale[free])
    errors = np.sqrt(np.diag(covariance))
    untold = np.abs(vectors[:, ~told]).max(axis=1, initial=0.0) > 0.1
    errors[np.flatnonzero(free)[untold]] = np.inf
    return Uncertainty(errors, covariance)


def _clusters(scores: FloatArray, fitted: int) -> FloatArray:
    """Return the sums over clusters of scores (S, M, k), shape (c, k)."""
    size, rows, _ = scores.shape
    parts = min(rows, max(1, -(-_CLUSTERS * fitted // size)))
    edges = [part * rows // parts for part in range(parts)]
    return np.add.reduceat(scores, edges, axis=1).reshape(size * parts, fitted)


def undetermined(
    model: Model, found: Chain, fitted: FloatArray, errors: FloatArray, *, driven: bool
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
    out.append(
        f"lengths: {taken} were taken from the given chain; the length of the last link changes "
        "nothing but the drag of its end"
    )
    if driven and free[INERTIA, 0] and not free[ARMATURE, 0]:
        out.append("armature0: it adds to inertia0 alone, and was taken from the given chain")
    if chain.n == 1 and free[DRAG, 0] and free[DAMPING, 0]:
        out.append("damping0 and drag0: one link cannot tell them apart")
    for name, value, error, (row, _) in zip(
        model.names, fitted, errors, np.argwhere(free), strict=True
    ):
        if np.isinf(error):
            out.append(f"{name}: the data do not determine it beside the others")
        elif error > _VAGUE * abs(value) and row not in (OFFSET, LIFT):
            out.append(f"{name}: {value:.3g} +- {error:.2g} is not told from zero")
    return out


def _scale(chain: Chain) -> str:
    """Return what sets the scale of free swings."""
    kept = f"lift0 = {chain.lift[0]:.6g} kg m" if chain.gravity else "inertia0"
    text = (
        "the scale: free swings do not change when all masses, inertias, damping, friction and "
        f"drag are multiplied by one factor; {kept} of the given chain was kept"
    )
    if np.array_equal(chain.centres, chain.lengths):
        text += ", whose centres of mass are at the ends of its links: give centres if they are not"
    return text


def _other_masses(chain: Chain, found: Chain) -> list[str]:
    """Return which masses of the chain `found` are not those given."""
    moved = np.flatnonzero(np.abs(found.masses - chain.masses) > 1e-6 * chain.masses)
    return [
        f"masses[{i}]: {found.masses[i]:.3g} kg was taken for the given {chain.masses[i]:.3g} kg, "
        "with which no link has the fitted inertia and lift: check the given masses and centres"
        for i in moved.tolist()
    ]
