"""Direct transcription: trajectories to upright as solutions of a least-squares problem.

The states at all steps and the actions between them are unknowns, and each step of the environment
has to lead from one state to the next. The first guess need not be a motion at all, which is why
chains of three rods and more, whose motion no guess can foresee, are no harder than one rod.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from npend_gym._checks import FloatArray
from npend_gym.envs import EnvConfig
from npend_gym.physics import Ensemble

MAX_ACTION = 0.9  # of a planned trajectory: the rest of the torque is for tracking
_ACTION_WEIGHT = 0.05
_TOLERANCE = 1e-7  # of a step: rad, and 0.3 rad/s
_MAX_ITERATIONS = 300
_HALF_WAVES = 6  # half sines in the first guess
_DIFFERENCE = 1e-5  # for derivatives by central differences
_MAX_UNKNOWN = 60.0  # rad or rad/s; no useful trajectory exceeds it


class NominalTrajectory(NamedTuple):
    """A motion from hanging to standing at rest, in steps of the environment."""

    states: FloatArray  # (steps + 1, 2n): theta [rad], omega [rad/s]
    actions: FloatArray  # (steps, joints), torques divided by their limit


class Transcription:
    """The least-squares problem: small defects, with a growing weight, and small actions.

    A defect is by how much a step of the environment misses the next state. Unknowns z are the
    states between the first and the last, (steps - 1, 2n), and v, (steps, joints), where the
    actions are MAX_ACTION tanh v.
    """

    def __init__(self, config: EnvConfig, steps: int) -> None:
        self.n, self.joints, self.steps, self.dt = (
            config.chain.n, config.joints.size, steps, config.dt
        )  # fmt: skip
        self.inputs = 2 * self.n + self.joints
        self.step = Stepper(config, steps)
        self.step_many = Stepper(config, steps * 2 * self.inputs)
        self.end = np.zeros(2 * self.n)  # the state in which the trajectory ends
        self.scale = np.tile(np.repeat([1.0, 0.3], self.n), steps)

    def solve(self, rng: np.random.Generator) -> NominalTrajectory | None:
        """Return a trajectory, or None where the guess leads to none.

        The method of Levenberg and Marquardt is written out because SciPy's `least_squares`, whose
        solver for sparse Jacobians is iterative, takes four times as long: on the same guesses, 33
        instead of 7 s of CPU time for 8 guesses of N = 2 and 6 s (7 trajectories each), 72 instead
        of 16 s for 8 guesses of N = 3 and 5 s (5 each), 63 instead of 15 s for 4 guesses of N = 4
        and 8 s (1 each).
        """
        self.end, z = self.guess(rng)
        weight, damping = 1.0, 1e-2
        for _ in range(_MAX_ITERATIONS):
            residual = self.residual(z, weight)
            z, decrease, damping = self.improve(z, residual, weight, damping)
            if decrease < 3e-3:  # converged for this weight
                if np.abs(self.defects(z)).max() < _TOLERANCE:
                    return self.trajectory(z)
                weight *= 3.0
            if weight > 1e7:
                break
        return None

    def improve(
        self, z: FloatArray, residual: FloatArray, weight: float, damping: float
    ) -> tuple[FloatArray, float, float]:
        """Take a Levenberg-Marquardt step; return z, the relative decrease, the new damping."""
        jacobian = self.jacobian(z, weight)
        matrix, gradient = (jacobian.T @ jacobian).tocsc(), jacobian.T @ residual
        cost = float(residual @ residual)
        for _ in range(12):
            trial = z - spsolve(matrix + damping * sparse.eye_array(z.size, format="csc"), gradient)
            if np.abs(trial).max() < _MAX_UNKNOWN:
                new = self.residual(trial, weight)
                decrease = 1.0 - float(new @ new) / cost
                if decrease > 0.0:
                    return trial, decrease, max(damping / 3.0, 1e-10)
            damping *= 4.0
        return z, 0.0, 1e-4

    def guess(self, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Draw an end, each rod turned up in one sense or the other, and a wavy path to it.

        The actions of the path are small; nothing makes it a motion of the chain.
        """
        s = np.linspace(0.0, 1.0, self.steps + 1)[:, None]
        end = np.zeros(2 * self.n)
        end[: self.n] = np.pi * rng.choice([1.0, 1.0, 1.0, -1.0], self.n)
        k = np.arange(1, _HALF_WAVES + 1)[:, None]
        waves = np.sin(np.pi * k * s[:, None]) * rng.normal(0.0, 0.6, (_HALF_WAVES, self.n))
        theta = (3.0 - 2.0 * s) * s**2 * end[: self.n] + np.sin(np.pi * s) * waves.sum(axis=1)
        states = np.hstack([theta, np.gradient(theta, self.dt, axis=0)])
        v = rng.normal(0.0, 0.1, self.steps * self.joints)
        return end, np.concatenate([states[1:-1].ravel(), v])

    def trajectory(self, z: FloatArray) -> NominalTrajectory:
        """Return the unknowns as states and actions."""
        inner, v = np.split(z, [(self.steps - 1) * 2 * self.n])
        states = np.vstack([np.zeros(2 * self.n), inner.reshape(-1, 2 * self.n), self.end])
        return NominalTrajectory(states, MAX_ACTION * np.tanh(v.reshape(self.steps, self.joints)))

    def defects(self, z: FloatArray) -> FloatArray:
        """Return by how much each step misses the next state, (steps * 2n,)."""
        states, actions = self.trajectory(z)
        return self.scale * (self.step(states[:-1], actions) - states[1:]).ravel()

    def residual(self, z: FloatArray, weight: float) -> FloatArray:
        """Return the residuals: weighted defects, then weighted v."""
        v = z[(self.steps - 1) * 2 * self.n :]
        return np.concatenate([weight * self.defects(z), _ACTION_WEIGHT * v])

    def jacobian(self, z: FloatArray, weight: float) -> Any:
        """Return the derivative of the residuals by z, sparse."""
        states, actions = self.trajectory(z)
        a, b = self.derivatives(states, actions)
        b = b * (MAX_ACTION - actions**2 / MAX_ACTION)[:, None, :]  # by v
        size = 2 * self.n
        by_state = sparse.vstack(
            [sparse.csr_array((size, size * (self.steps - 1))), sparse.block_diag(a[1:])]
        ) - sparse.eye_array(size * self.steps, size * (self.steps - 1))
        weights = sparse.diags_array(weight * self.scale)
        by_v = _ACTION_WEIGHT * sparse.eye_array(self.steps * self.joints)
        return sparse.block_array(
            [[weights @ by_state, weights @ sparse.block_diag(b)], [None, by_v]], format="csr"
        )

    def derivatives(self, states: FloatArray, actions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the steps' derivatives by state, (steps, 2n, 2n), and action, (..., joints)."""
        at = np.hstack([states[:-1], actions])
        difference = _DIFFERENCE * np.eye(self.inputs)
        places = at[:, None, None] + np.stack([difference, -difference], axis=1)
        flat = places.reshape(-1, self.inputs)
        reached = self.step_many(flat[:, : 2 * self.n], flat[:, 2 * self.n :])
        reached = reached.reshape(self.steps, self.inputs, 2, 2 * self.n)
        slopes = np.swapaxes(reached[:, :, 0] - reached[:, :, 1], 1, 2) / (2.0 * _DIFFERENCE)
        return slopes[..., : 2 * self.n], slopes[..., 2 * self.n :]


class Stepper:
    """Steps of the environment from any states, all side by side."""

    def __init__(self, config: EnvConfig, count: int) -> None:
        self.config = config
        self.ensemble = Ensemble(config.chain, count, joints=config.joints.tolist())

    def __call__(self, states: FloatArray, actions: FloatArray) -> FloatArray:
        """Return the states, (B, 2n), after a step under the actions, (B, joints)."""
        theta, omega = np.split(states, 2, axis=1)
        self.ensemble.set_state(slice(None), theta, omega)
        torque = self.config.max_torque * actions
        self.ensemble.advance(torque, self.config.dt, self.config.substeps)
        return np.hstack([self.ensemble.theta, self.ensemble.omega])
