"""Motions of one chain from many states side by side, and how they depend on their beginnings."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from npend_gym._checks import FloatArray
from npend_gym.chain import ChainParameters
from npend_gym.compiled.arrays import aligned_zeros
from npend_gym.compiled.packs import WIDTH
from npend_gym.physics.directions import check_directions, kind_of
from npend_gym.physics.kernels.multiple_steps import carry_changes, steps_of_chain
from npend_gym.physics.kernels.rk4_derivatives import tangent_rows
from npend_gym.physics.memory import Memory

_STEPS_PER_CALL = 100_000  # Runge-Kutta steps of one chain: some tenths of a second


class Motions:
    """Motions of one chain from many states, in equal steps, and their exact derivatives.

    The steps have the bits of those of `Ensemble.rollout` with a number of substeps.

    Parameters
    ----------
    chain : ChainParameters
        Those of one chain, shape (1, n).
    dt : float
        Length of a step [s].
    substeps : int
        Runge-Kutta steps in one.
    """

    def __init__(self, chain: ChainParameters, dt: float, substeps: int) -> None:
        self._memory, self._substeps = Memory(chain, WIDTH, packed=True), substeps
        self._ends = chain.centres == chain.lengths
        self._timing = self._memory.plan(dt, substeps, math.inf).timing[0]
        self._scratch = aligned_zeros(tangent_rows(), (self._memory.n + 2) * WIDTH)

    def states(self, first: FloatArray, torques: FloatArray) -> FloatArray:
        """Return the states before and after each step.

        Parameters
        ----------
        first : ndarray, shape (S, 2, n)
            Angles [rad] and angular velocities [rad/s] of S motions.
        torques : ndarray, shape (T, S, n)
            At all joints in each step [N m].

        Returns
        -------
        ndarray, shape (T + 1, S, 2, n)
            Not finite, or beyond all bounds, where a motion diverges.
        """
        steps, size, n = torques.shape
        out = np.empty((steps + 1, size, 2, n))
        out[0] = first
        columns, unchanged = np.empty((steps, size, 0, 2, n)), np.empty((0, 0, n))
        chunk = max(1, _STEPS_PER_CALL // (self._substeps * -(-size // WIDTH) * WIDTH))
        for begin in range(0, steps, chunk):
            span = slice(begin, min(begin + chunk, steps))
            after = out[begin + 1 : span.stop + 1]
            self._take(out[span], torques[span], after, columns[span], unchanged)
        return out

    def sensitivities(
        self,
        states: FloatArray,
        torques: FloatArray,
        parameters: Mapping[str, ArrayLike] | None = None,
    ) -> FloatArray:
        """Return the derivatives of the states by the first ones and by parameters.

        Parameters
        ----------
        states : ndarray, shape (T + 1, S, 2, n)
            What `states` returned for these torques.
        torques : ndarray, shape (T, S, n)
        parameters : mapping of str to array_like, shape (K, n), optional
            K directions in which parameters change, as for `DifferentiableEnsemble`.

        Returns
        -------
        ndarray, shape (T + 1, S, 2n + K, 2, n)
            By the first angles, the first angular velocities, and in each direction.

        Notes
        -----
        The derivatives of a step by its own beginning do not wait for those of others. So that no
        lane is idle, all steps of all motions are taken side by side; the chain rule carries the
        derivatives on.
        """
        steps, size, n = torques.shape
        kind = kind_of(self._memory.arrays[2])
        changed = check_directions(parameters, n, kind, self._ends)
        count = 2 * n + len(changed)
        columns = np.empty((steps, size, count, 2, n))
        before, flat = states[:-1].reshape(1, -1, 2, n), columns.reshape(1, -1, count, 2, n)
        torques, after = torques.reshape(1, -1, n), np.empty_like(before)
        chunk = WIDTH * max(1, _STEPS_PER_CALL // (WIDTH * self._substeps))
        for begin in range(0, steps * size, chunk):
            span = np.s_[:, begin : begin + chunk]
            self._take(before[span], torques[span], after[span], flat[span], changed)
        out = np.empty((steps + 1, size, count, 2 * n))
        carry_changes(columns.reshape(steps, size, count, 2 * n), out)
        return out.reshape(steps + 1, size, count, 2, n)

    def _take(
        self,
        before: FloatArray,
        torques: FloatArray,
        after: FloatArray,
        columns: FloatArray,
        changed: FloatArray,
    ) -> None:
        """Take steps; arguments as those of `steps_of_chain`."""
        memory = self._memory
        changes = aligned_zeros(columns.shape[2] + 1, 2, (memory.n + 1) * WIDTH)
        changed = changed if len(changed) else np.zeros((1, 0, memory.n))
        arrays = before, torques, after, changes, changed, columns
        steps_of_chain(*memory.arrays, *arrays, self._timing, self._scratch)
