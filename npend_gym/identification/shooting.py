"""Shooting: the motion of every segment from a first state of its own, and its derivatives."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from scipy.interpolate import CubicHermiteSpline, make_interp_spline

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import Chain
from npend_gym.compiled.sincos import MAX_ANGLE
from npend_gym.identification.least_squares import Point
from npend_gym.identification.motion import Motion
from npend_gym.identification.moving_pivot import levers
from npend_gym.identification.parameters import LIFT, OFFSET, FitModel
from npend_gym.physics.derivatives import DifferentiableEnsemble
from npend_gym.physics.kernels.layout import MAX_SPEED
from npend_gym.physics.substeps import default_substeps

_STIFFER = 1000  # times the substeps of the given chain: a trial chain that needs more is refused
_NUMBERS = 4_000_000  # of the derivatives at all nodes, that are kept at a time


class Shooting:
    """Segments of a measured motion side by side, and their simulation.

    Each segment is simulated in equal steps from its first row on. Between two nodes of this grid
    angles are those of the cubic that has the angles and angular velocities of both.

    `rows` has those of the S segments in the motion; `measured`, (S, M), says which of M rows a
    segment has. The step of the grid is at most `longest` [s]: a multiple of the median interval of
    the rows, or an equal part of it; where torques act, at most one interval. `rate` is the least
    number of substeps in a second.

    Notes
    -----
    Torques are linear between rows, and those of the ensemble are constant in a step h. The means
    m_k in the steps move a chain less, by (w h)^2 / 12 at a frequency w. The torques u_k = m_k -
    (m_{k+1} - 2 m_k + m_{k-1}) / 12 correct this; an error of order (w h)^4 is left.
    """

    def __init__(
        self, model: FitModel, motion: Motion, rows: Sequence[slice], longest: float, rate: float
    ) -> None:
        self.model: FitModel = model
        self.rows: list[slice] = list(rows)
        counts = np.array([each.stop - each.start for each in rows])
        self.measured: BoolArray = np.arange(int(counts.max())) < counts[:, None]
        times = self._side_by_side(motion.times)
        self._times: FloatArray = np.where(self.measured, times - times[:, :1], 0.0)
        self._theta = self._side_by_side(motion.theta)
        interval = float(np.median(np.diff(self._times, axis=1)[self.measured[:, 1:]]))
        if motion.forced:
            interval = min(float(np.median(np.diff(motion.times[each]))) for each in rows)
            longest = min(longest, interval)
        several = math.floor(longest / interval + 1e-9)
        parts = 1 if several else math.ceil(interval / longest - 1e-9)
        self._step = max(1, several) * interval / parts
        self._least = self._step * rate
        self._most = _STIFFER * default_substeps(model.chain, self._step)
        self._ensembles = dict[int, DifferentiableEnsemble]()  # by their size
        steps = math.ceil(float(self._times.max()) / self._step - 1e-6)
        acts = motion.torque is not None or motion.acceleration is not None
        self._joints = range(motion.links if acts else 1)
        n = len(self._joints)
        drives = np.zeros((motion.times.size, n * (1 + motion.links)))  # torques, and levers
        if motion.torque is not None:
            drives[:, :n] = motion.torque
        if motion.acceleration is not None:
            drives[:, n:] = levers(motion).reshape(len(drives), -1)
        self._drives = np.zeros((steps, len(self.rows), drives.shape[1]))
        if acts:
            edges = np.arange(steps + 1) * self._step
            for k, each in enumerate(self.rows):
                at = np.append(self._times[k, : counts[k]], edges[-1] + 1.0)
                torque = drives[[*range(each.start, each.stop), each.stop - 1]]
                impulse = make_interp_spline(at, torque, k=1).antiderivative()(edges)
                impulse[1:-1] -= np.diff(impulse, 2, axis=0) / 12.0
                self._drives[:, k] = np.diff(impulse, axis=0) / self._step
        self._torque, self._levers = np.split(self._drives, [n], axis=2)
        self._levers = self._levers.reshape(steps, len(self.rows), n, motion.links)

    def _side_by_side(self, values: FloatArray) -> FloatArray:
        """Return the rows of the segments, (S, M, ...), of values of the whole motion."""
        out = np.zeros((*self.measured.shape, *values.shape[1:]))
        out[self.measured] = values[np.r_[tuple(self.rows)]]
        return out

    def simulate(self, fitted: FloatArray, states: FloatArray) -> Point | None:
        """Return simulated less measured angles [rad], (S, M n), zero where none is measured.

        Their derivatives are the exact ones of the Runge-Kutta steps that were taken. None where no
        chain has these values, (k,), or one leaves all bounds, or needs far more substeps than the
        given one. `states`, (S, 2n), are the first of each segment.
        """
        values = self.model.unpack(fitted)
        chain, (theta, omega) = self.model.possible_chain(values), np.split(states, 2, axis=1)
        bounded = np.abs(theta).max() <= MAX_ANGLE and np.abs(omega).max() <= MAX_SPEED
        if chain is None or not bounded:
            return None
        substeps = default_substeps(chain, self._step)
        if substeps > self._most:
            return None
        ensemble = self._ensemble(chain, theta, omega)
        substeps = max(math.ceil(self._least), substeps)
        torques = self._torque + self._levers @ values[LIFT]
        nodes = ensemble.rollout(torques, self._step, substeps)
        if ensemble.diverged.any():
            return None
        away = self._at_rows(*nodes) + values[OFFSET] - self._theta
        residuals = np.where(self.measured[..., None], away, 0.0).reshape(len(away), -1)
        return Point(residuals, partial(self._linearise, chain, substeps, torques, *nodes))

    def _ensemble(
        self, chain: Chain, theta: FloatArray, omega: FloatArray
    ) -> DifferentiableEnsemble:
        """Return copies of a chain in these states, (B, n), ready to be advanced."""
        size = len(theta)
        if size not in self._ensembles:
            general = {"friction": 1.0, "armature": 1.0}  # the kind that has all parameters
            general = Chain.from_dict(chain.as_dict() | general)
            self._ensembles[size] = DifferentiableEnsemble(general, size, joints=self._joints)
        ensemble = self._ensembles[size]
        ensemble.set_chain(slice(None), chain.repeated(size))
        ensemble.set_state(slice(None), theta, omega)
        return ensemble

    def _at_rows(self, theta: FloatArray, omega: FloatArray, first: int = 0) -> FloatArray:
        """Return angles, or changes of them, at the rows of s segments from the `first` on.

        `theta` and `omega`, (nodes, s, ...), are those at the nodes; the result is (s, M, ...).
        """
        nodes, count = len(theta), int(theta.shape[1])
        angles, rates = (m.swapaxes(0, 1).reshape(nodes * count, -1) for m in (theta, omega))
        instants = np.arange(float(nodes * count)) * self._step  # one segment after the other
        curve = CubicHermiteSpline(instants, angles, rates)
        at = self._times[first : first + count] + instants[::nodes, None]
        return curve(at).reshape(*at.shape, *theta.shape[2:])

    def _linearise(
        self, chain: Chain, substeps: int, torques: FloatArray, theta: FloatArray, omega: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives by what is fitted, and by the first states.

        The derivatives of a step by its own beginning do not wait for those of others. So all steps
        of all segments are differentiated side by side, and the chain rule carries them on.
        """
        (steps, size, joints), (_, rows, n) = self._torque.shape, self._theta.shape
        fitted, directions = len(self.model.names), self.model.directions(chain)
        given = len(directions["inertias"])  # what follows are offsets
        places = np.argwhere(self.model.free[:OFFSET])
        lifts, moved = np.flatnonzero(places[:, 0] == LIFT), bool(np.any(self._levers))
        links = places[lifts, 1]
        count = 2 * n + given
        by_fitted, by_state = np.zeros((size, rows, n, fitted)), np.zeros((size, rows, n, 2 * n))
        by_fitted[..., given:] = np.eye(n)[:, self.model.free[OFFSET]]
        chunk = max(1, _NUMBERS // ((steps + 1) * count * 2 * n))
        for first in range(0, size, chunk):
            span = slice(first, min(first + chunk, size))
            before = theta[:-1, span].reshape(-1, n), omega[:-1, span].reshape(-1, n)
            torque = torques[:, span].reshape(-1, joints)
            step = self._ensemble(chain, *before).step_jacobian(
                torque, self._step, substeps, parameters=directions if given else None
            )
            changes = np.empty((steps + 1, span.stop - first, 2 * n, count))
            changes[0] = np.eye(2 * n, count)
            by_start = step.A.reshape(*changes[1:].shape[:3], 2 * n)
            own = step.C.reshape(*changes[1:].shape[:3], given)
            if moved:  # a lift carries the force of the pivot's acceleration
                by_torque = step.B.reshape(*changes[1:].shape[:3], joints)
                own[..., lifts] += by_torque @ self._levers[:, span][..., links]
            for k in range(steps):
                np.matmul(by_start[k], changes[k], out=changes[k + 1])
                changes[k + 1, ..., 2 * n :] += own[k]
            angles = self._at_rows(changes[:, :, :n], changes[:, :, n:], first)
            by_state[span], by_fitted[span, ..., :given] = np.split(angles, [2 * n], axis=-1)
        by_fitted[~self.measured] = by_state[~self.measured] = 0.0
        return by_fitted.reshape(size, rows * n, fitted), by_state.reshape(size, rows * n, 2 * n)
