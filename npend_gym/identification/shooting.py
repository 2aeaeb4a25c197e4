"""Shooting: the motion of every segment from a first state of its own, and its derivatives."""

from __future__ import annotations

import math

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.compiled.sincos import MAX_ANGLE
from npend_gym.identification.parameters import OFFSET, Model
from npend_gym.identification.segments import Segments
from npend_gym.physics.kernels.layout import MAX_SPEED
from npend_gym.physics.kernels.multiple_steps import angles_between
from npend_gym.physics.motions import Motions
from npend_gym.physics.substeps import default_substeps

_NUMBERS = 4_000_000  # of the derivatives at all nodes, that are kept at a time


class Shooting:
    """Simulated motions of segments, as functions of what is fitted.

    Between the nodes of the grid angles are those of the cubic that has the angles and angular
    velocities of both.

    Parameters
    ----------
    model : Model
    segments : Segments
    rate : float
        Substeps in a second, at least.
    """

    def __init__(self, model: Model, segments: Segments, rate: float) -> None:
        self.model, self.segments, self._least = model, segments, segments.step * rate
        self._values, self._chain, self._motions = np.empty(0), None, None  # of the last motions
        at = segments.times / segments.step
        self._node = np.minimum(at.astype(np.int64), len(segments.torque) - 1)
        x = at - self._node
        fallen, h = x * x * (3.0 - 2.0 * x), segments.step
        slopes = h * x * (1.0 - x) ** 2, h * x * x * (x - 1.0)
        self._weights = np.stack([1.0 - fallen, slopes[0], fallen, slopes[1]], axis=-1)

    def simulate(self, fitted: FloatArray, states: FloatArray) -> Simulated | None:
        """Return the motions of all segments.

        Parameters
        ----------
        fitted : ndarray, shape (k,)
            As `Model.pack` returns them.
        states : ndarray, shape (S, 2n)
            First angles and angular velocities of each segment.

        Returns
        -------
        Simulated or None
            None where no chain has these values, or one leaves all bounds.
        """
        values = self.model.unpack(fitted)
        if not np.array_equal(values, self._values):
            self._values, self._chain = values, self.model.possible_chain(values)
            self._motions = None if self._chain is None else self._motions_of(self._chain)
        chain, motions = self._chain, self._motions
        if chain is None or motions is None:
            return None
        nodes = motions.states(states.reshape(len(states), 2, -1), self.segments.torque)
        largest = np.abs(nodes).max(axis=(0, 1, 3))
        if not (largest[0] <= MAX_ANGLE and largest[1] <= MAX_SPEED):  # or NaN
            return None
        return Simulated(self, chain, motions, nodes, values[OFFSET])

    def _motions_of(self, chain: Chain) -> Motions:
        substeps = max(math.ceil(self._least), default_substeps(chain, self.segments.step))
        # with some friction, however small, one kind of kernel is compiled for all models
        some = chain.friction + _checks.SMALLEST
        return Motions(chain.repeated(1, friction=some[None]), self.segments.step, substeps)

    def angles(self, nodes: FloatArray, span: slice = slice(None)) -> FloatArray:
        """Return angles at the measured times, or D changes of them, (S, M, n, D).

        `nodes` (T + 1, S, D, 2, n) are states at the nodes of the grid, of some segments.
        """
        node, weights = self._node[span], self._weights[span]
        out = np.empty((*node.shape, nodes.shape[4], nodes.shape[2]))
        angles_between(nodes, node, weights, out)
        return out


class Simulated:
    """Simulated motions of the segments of a `Shooting`.

    Attributes
    ----------
    residuals : ndarray, shape (S, M n)
        Simulated less measured angles [rad]; zero where none is measured.
    """

    def __init__(
        self,
        shooting: Shooting,
        chain: Chain,
        motions: Motions,
        nodes: FloatArray,
        offsets: FloatArray,
    ) -> None:
        self._shooting, self._chain, self._motions, self._nodes = shooting, chain, motions, nodes
        segments = shooting.segments
        away = shooting.angles(nodes[:, :, None])[..., 0] + offsets - segments.theta
        self.residuals = np.where(segments.measured[..., None], away, 0.0).reshape(len(away), -1)

    def linearise(self) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of the residuals by what is fitted and by the first states.

        Returns
        -------
        tuple of ndarray, shapes (S, M n, k) and (S, M n, 2n)
            Exact ones of the Runge-Kutta steps that were taken.
        """
        shooting, segments, model = self._shooting, self._shooting.segments, self._shooting.model
        directions = model.directions(self._chain)
        (steps, size, n), rows = segments.torque.shape, segments.times.shape[1]
        count = len(model.names) + 2 * n
        out = np.empty((size, rows, n, count))
        moving = 2 * n + len(directions["inertias"])  # what follows are offsets
        out[..., moving:] = np.eye(n)[:, model.free[OFFSET]]
        chunk = max(1, _NUMBERS // ((steps + 1) * count * 2 * n))
        for begin in range(0, size, chunk):
            span = slice(begin, begin + chunk)
            nodes = np.ascontiguousarray(self._nodes[:, span])
            torque = np.ascontiguousarray(segments.torque[:, span])
            changes = self._motions.sensitivities(nodes, torque, directions)
            out[span, :, :, :moving] = shooting.angles(changes, span)
        out[~segments.measured] = 0.0
        flat = out.reshape(size, rows * n, count)
        return flat[..., 2 * n :].copy(), flat[..., : 2 * n].copy()
