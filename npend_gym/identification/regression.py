"""A first estimate that needs none: the equations of motion, linear in what is fitted.

Their weak form is used: multiplied by bumps phi(t) and integrated by parts, they contain angles and
angular velocities but no accelerations,

    -int phi' p_i dt + int phi (sum_j W_ij sin(theta_i - theta_j) omega_i omega_j
        + g h_i sin theta_i + D_i - D_{i+1}) dt = int phi (tau_i - tau_{i+1}) dt,

p_i = sum_j W_ij cos(theta_i - theta_j) omega_j being the momentum of link i and D_i the torque of
damping and friction at joint i; see `parameters` for W and h.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.interpolate import LSQUnivariateSpline

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.identification.least_squares import bounded, deviation
from npend_gym.identification.motion import Motion
from npend_gym.identification.parameters import (
    ARMATURE,
    DAMPING,
    DRAG,
    FRICTION,
    GRAVITY,
    INERTIA,
    LENGTH,
    LIFT,
    OFFSET,
    QUADRATIC_DRAG,
    QUANTITIES,
    FitModel,
)

_DEGREE = 5  # of the splines
_KNOTS = 5.0  # in the width of a bump
_OVERLAP = 4  # bumps in the width of one
_REWEIGHTED = 4  # times that a spline is fitted


class Smooth(NamedTuple):
    """Angles [rad] and angular velocities [rad/s] by splines, shape (T, n); NaN outside stretches.

    `width` is that of the bumps they are for: what takes a fifth of it or longer is followed [s].
    """

    width: float
    theta: FloatArray
    omega: FloatArray


def smooth(motion: Motion, width: float) -> Smooth:
    """Return splines of a motion for bumps of `width` [s]."""
    theta, omega = np.full((2, *motion.theta.shape), np.nan)
    for rows in motion.stretches():
        times = motion.times[rows]
        most = max(1, (times.size - 2 * _DEGREE) // 2)
        parts = max(1, min(most, round(_KNOTS * (times[-1] - times[0]) / width)))
        knots = np.quantile(times, np.arange(1, parts) / parts)  # with rows on both sides of each
        for link in range(motion.links):
            measured, weights = motion.theta[rows, link], np.ones(times.size)
            for _ in range(_REWEIGHTED):  # outliers lose their weight
                spline = LSQUnivariateSpline(times, measured, knots, weights, k=_DEGREE)
                theta[rows, link], omega[rows, link] = spline(times), spline(times, 1)
                away = theta[rows, link] - measured
                usual = max(3.0 * float(deviation(away)), 1e-12)
                weights = 1.0 / (1.0 + (away / usual) ** 2)
    return Smooth(width, theta, omega)


def regress(
    model: FitModel, motion: Motion, curves: Smooth, parts: Sequence[slice]
) -> FloatArray | None:
    """Return the values, (10, n), that solve the equations of motion best; None if nothing does.

    `curves` are splines of the motion, of whose rows `parts` are used.
    """
    pairs = [_equations(model, motion, curves, rows) for rows in parts]
    columns, right = zip(*pairs, strict=True)
    matrix, vector = np.concatenate(columns), np.concatenate(right)  # (b, n, 10, n), (b, n)
    known = model.known.copy()
    wanted = model.free.copy()
    wanted[[LENGTH, OFFSET]] = False
    if not wanted.any():  # the equations are linear in nothing that is fitted
        return known
    known[GRAVITY] *= known[LIFT]  # the equations are linear in these products
    if wanted[GRAVITY, 0]:
        wanted[GRAVITY] = True
        wanted[GRAVITY, 0] = motion.forced or not (wanted[INERTIA].any() and wanted[LIFT].any())
    else:
        matrix[..., LIFT, :] += model.chain.gravity * matrix[..., GRAVITY, :]
        matrix[..., GRAVITY, :] = 0.0
    unknown = matrix[..., wanted]
    vector = vector - np.einsum("bijk,jk->bi", matrix, np.where(wanted, 0.0, known))
    if not vector.any() or vector.size < unknown.shape[-1]:
        return None
    weights, fitted = np.ones_like(vector), np.zeros(unknown.shape[-1])
    least = 1e-9 * float(np.abs(vector).max())
    lower = FitModel(model.chain, known, wanted).lower
    lower[np.argwhere(wanted)[:, 0] == GRAVITY] = -np.inf
    for _ in range(10):  # each link's equations by their own scatter, outliers counted less
        rows = (unknown * weights[..., None]).reshape(-1, fitted.size)
        fitted = bounded(rows, (vector * weights).ravel(), lower)
        away = unknown @ fitted - vector
        spread = np.maximum(deviation(away), least)
        weights = (1.0 + (away / (3.0 * spread)) ** 2) ** -0.25 / spread
    known[wanted] = fitted
    return _with_gravity(model, known, wanted)


def _with_gravity(model: FitModel, values: FloatArray, wanted: BoolArray) -> FloatArray | None:
    """Return values, (10, n), with gravity for its products with the lifts; None if it is none."""
    gravity, first = model.chain.gravity, values[GRAVITY, 0]
    if model.free[GRAVITY, 0]:
        told = int(model.chain.n > 1 and model.free[LIFT].any())  # first lift that is known
        lifts = values[LIFT, told:]
        gravity = float(values[GRAVITY, told:] @ lifts) / max(float(lifts @ lifts), 1e-300)
        if not gravity > 0.0:
            return None
        if not wanted[GRAVITY, 0]:  # the scale is that in which gravity is the given one
            values[wanted] *= gravity / model.chain.gravity
        elif model.free[LIFT, 0]:
            values[LIFT, 0] = first / gravity
    values[GRAVITY] = gravity
    return values


def _equations(
    model: FitModel, motion: Motion, curves: Smooth, rows: slice
) -> tuple[FloatArray, FloatArray]:
    """Return the matrix, (b, n, 10, n), and the right side, (b, n), of a part with b bumps."""
    n, times, width = motion.links, motion.times[rows], curves.width
    count = int(_OVERLAP * ((times[-1] - times[0]) / width - 1.0) + 1e-9) + 1
    centres = times[0] + 0.5 * width + np.arange(max(0, count)) * (width / _OVERLAP)
    s = (times - centres[:, None]) / (0.5 * width)
    inside = np.maximum(1.0 - s**2, 0.0)
    share = np.gradient(times)  # of each row in an integral
    bump, slope = inside**3 * share, (-6.0 * s * inside**2) / (0.5 * width) * share
    moved = None if motion.acceleration is None else motion.acceleration[rows]
    momenta, forces = _terms(model, curves.theta[rows], curves.omega[rows], moved)
    matrix = np.einsum("bt,tikj->bikj", bump, forces) - np.einsum("bt,tikj->bikj", slope, momenta)
    torque = np.zeros((times.size, n + 1))
    if motion.torque is not None:
        torque[:, :n] = motion.torque[rows]
    return matrix, bump @ (torque[:, :-1] - torque[:, 1:])


def _terms(
    model: FitModel, theta: FloatArray, omega: FloatArray, moved: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    """Coefficients of the values in the momenta and in the forces, (T, n, 10, n).

    `moved` is the acceleration of the pivot. Entry (t, i, q, k) belongs to the equation of link i
    and to quantity q of link k.
    """
    chain, (count, n) = model.chain, theta.shape
    momenta, forces = np.zeros((2, count, n, len(QUANTITIES), n))
    for i in range(n):
        momenta[:, i, INERTIA, i] = omega[:, i]
        forces[:, i, GRAVITY, i] = np.sin(theta[:, i])
        if moved is not None:
            forces[:, i, LIFT, i] += moved * np.cos(theta[:, i])
        for k in range(i + 1, n):
            difference = theta[:, i] - theta[:, k]
            cosine, sine = (chain.lengths[i] * f(difference) for f in (np.cos, np.sin))
            momenta[:, i, LIFT, k] += cosine * omega[:, k]
            momenta[:, k, LIFT, k] += cosine * omega[:, i]
            forces[:, i, LIFT, k] += sine * omega[:, i] * omega[:, k]
            forces[:, k, LIFT, k] -= sine * omega[:, i] * omega[:, k]
    relative = np.diff(omega, axis=1, prepend=0.0)
    u = relative / chain.friction_speed
    coupling = 1.0 / chain.gear - 1.0
    for j in range(n):
        above = omega[:, j - 1] if j else 0.0
        rotor = coupling[j] * above + omega[:, j]
        for i, sign, share in ((j, 1.0, 1.0), (j - 1, -1.0, coupling[j])):
            if i >= 0:
                forces[:, i, DAMPING, j] += sign * relative[:, j]
                forces[:, i, FRICTION, j] += sign * u[:, j] / np.sqrt(1.0 + u[:, j] ** 2)
                momenta[:, i, ARMATURE, j] += share * rotor
    x, y = (np.cumsum(chain.lengths * f(theta) * omega, axis=1) for f in (np.cos, np.sin))
    speed = np.hypot(x, y)
    for k in range(n):
        for i in range(k + 1):
            lever = chain.lengths[i] * (
                np.cos(theta[:, i]) * x[:, k] + np.sin(theta[:, i]) * y[:, k]
            )
            forces[:, i, DRAG, k] += lever
            forces[:, i, QUADRATIC_DRAG, k] += lever * speed[:, k]
    return momenta, forces
