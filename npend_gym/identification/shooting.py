"""Shooting: the motion of every segment from a first state of its own, and its derivatives."""

from __future__ import annotations

import math

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.identification.parameters import OFFSET, Model
from npend_gym.identification.segments import Segments
from npend_gym.physics import Ensemble
from npend_gym.physics.substeps import default_substeps

_LANES = 4096  # chains that are simulated side by side
_STEP = 1e-6  # of the size of a value, for differences


class Shooting:
    """The residuals of segments: simulated less measured angles, as functions of what is fitted.

    Parameters
    ----------
    model : Model
    segments : Segments
    rate : float
        Substeps in a second, at least.
    """

    def __init__(self, model: Model, segments: Segments, rate: float) -> None:
        self.model, self.segments, self._least = model, segments, segments.step * rate
        at = segments.times / segments.step
        self._node = np.minimum(at.astype(np.int64), len(segments.torque) - 1)
        self._fraction = (at - self._node)[..., None, None]

    def residuals(self, fitted: FloatArray, states: FloatArray) -> FloatArray | None:
        """Return simulated less measured angles [rad], shape (S, M n); zero where none is measured.

        Parameters
        ----------
        fitted : ndarray, shape (k,)
            As `Model.pack` returns them.
        states : ndarray, shape (S, 2n)
            First angles and angular velocities of each segment.

        Returns
        -------
        ndarray or None
            None where no chain has these values.
        """
        angles = self._angles(self.model.unpack(fitted)[None], states[None])
        return None if angles is None else self._compare(angles)[0]

    def linearise(
        self, fitted: FloatArray, states: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """Return residuals and their derivatives by what is fitted and by the first states.

        Returns
        -------
        tuple of ndarray, shapes (S, M n), (S, M n, k) and (S, M n, 2n)
            None where no chain has these values.

        Notes
        -----
        This is the one place that knows how derivatives are made: by forward differences, all
        side by side. Exact sensitivities of the motion would replace its body.
        """
        k, numbers = fitted.size, states.shape[1]
        values = self.model.unpack(fitted)
        steps = np.concatenate([_STEP * self.model.scale(values), np.full(numbers, _STEP)])
        changed = np.tile(fitted, (1 + k + numbers, 1))
        changed[1 : k + 1] += np.diag(steps[:k])
        first = np.tile(states, (1 + k + numbers, 1, 1))
        first[k + 1 :] += np.diag(steps[k:])[:, None]
        angles = self._angles(self.model.unpack(changed), first)
        if angles is None:
            return None
        out = self._compare(angles)
        slopes = np.moveaxis((out[1:] - out[0]) / steps[:, None, None], 0, -1)
        return out[0], slopes[..., :k].copy(), slopes[..., k:].copy()

    def _compare(self, angles: FloatArray) -> FloatArray:
        """Return simulated less measured angles, shape (V, S, M n)."""
        segments = self.segments
        out = np.where(segments.measured[..., None], angles - segments.theta, 0.0)
        return out.reshape(*out.shape[:2], -1)

    def _angles(self, values: FloatArray, states: FloatArray) -> FloatArray | None:
        """Return the simulated angles of V variants at the measured times, (V, S, M, n).

        `values`, (V, 8, n), are close to the first of them; `states` has the shape (V, S, 2n).
        """
        if states.shape[:2] == (1, 1):  # two lanes, for the kernel that is compiled anyway
            angles = self._angles(np.tile(values, (2, 1, 1)), np.tile(states, (2, 1, 1)))
            return None if angles is None else angles[:1]
        rows = self.model.parameters(values, values[0])
        if rows is None:
            return None
        chain = self.model.chain_of(values[0])
        substeps = max(math.ceil(self._least), default_substeps(chain, self.segments.step))
        # An Ensemble takes chains that need no more than its first one. With some friction, however
        # small, that has room for all values, and one kind of kernel is compiled for all models.
        roomy = chain.as_dict() | {"friction": (chain.friction + _checks.SMALLEST).tolist()}
        variants, size = states.shape[:2]
        chunk = max(1, _LANES // variants)
        parts: list[FloatArray] = []
        for begin in range(0, size, chunk):
            span = slice(begin, begin + chunk)
            count = min(size, begin + chunk) - begin
            ensemble = Ensemble(Chain.from_dict(roomy), variants * count, joints=range(chain.n))
            lanes = (np.repeat(row, count, axis=0) for row in rows)
            ensemble.set_chain(slice(None), type(rows)(*lanes))
            parts.append(self._run(ensemble, states[:, span], span, substeps))
        return np.concatenate(parts, axis=1) + values[:, None, None, OFFSET]

    def _run(
        self, ensemble: Ensemble, states: FloatArray, span: slice, substeps: int
    ) -> FloatArray:
        """Return the angles of some segments at their measured times, (V, S, M, n).

        Between the nodes of the grid angles are those of the cubic that has the angles and
        angular velocities of both.
        """
        variants, size, n = *states.shape[:2], ensemble.n
        step, torque = self.segments.step, self.segments.torque[:, span]
        ensemble.set_state(
            slice(None), states[..., :n].reshape(-1, n), states[..., n:].reshape(-1, n)
        )
        both = ensemble.rollout(np.tile(torque, (1, variants, 1)), step, substeps)
        theta, omega = (one.reshape(-1, variants, size, n) for one in both)
        node, x = self._node[span], self._fraction[span]
        segment = np.arange(size, dtype=np.int64)[:, None]
        a, b = (theta[node + end, :, segment] for end in (0, 1))  # (S, M, V, n)
        u, v = (step * omega[node + end, :, segment] for end in (0, 1))
        rise = b - a
        angles = a + x * (u + x * ((3.0 * rise - 2.0 * u - v) + x * (u + v - 2.0 * rise)))
        return np.moveaxis(angles, 2, 0)
