"""Direct transcription: motions between equilibria as solutions of a least-squares problem.

The states at all steps and the actions between them are unknowns. Each step of the environment must
lead from one state to the next. The first guess need not be a motion at all. So chains of three
rods and more, whose motion no guess can foresee, are no harder than one rod.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, solveh_banded

from npend_gym._checks import FloatArray
from npend_gym.envs import EnvConfig
from npend_gym.rl.controllers.step_model import StepModel, at_rest, beyond

MAX_ACTION = 0.9  # of a planned trajectory: the rest of the torque is for tracking
_MAX_DISCRETE = 0.97  # of a plan for discrete actions, which are rounded to the nearest
MAX_PLACE = 0.85  # of the rail, likewise
_ACTION_WEIGHT = 0.05
_TOLERANCE = 1e-7  # of a step: rad, and 0.3 rad/s
_MAX_ITERATIONS = 300
_HALF_WAVES = 6  # half sines in the first guess
_MAX_GUESS = 0.97  # of the largest action: actions that are guessed can still change both ways
_MAX_UNKNOWN = 60.0  # rad or rad/s; no useful trajectory exceeds it


class NominalTrajectory(NamedTuple):
    """A motion from one equilibrium to another, in steps of the environment."""

    states: FloatArray  # (steps + 1, 2c): theta [rad], omega [rad/s]
    actions: FloatArray  # (steps, joints), torques divided by their limit


class Weights(NamedTuple):
    """What counts beside the squares of actions, see `planned_transition`."""

    speed: float = 0.0  # [s/rad]
    change: float = 0.0  # [s]
    slow_from: float = 0.0  # [s]: when the speeds begin to count


_NO_WEIGHTS = Weights()


class Transcription:
    """The least-squares problem: small defects, with a growing weight, and wanted actions.

    A defect is by how much a step of the environment misses the next state. The unknowns z are, in
    the order of time, the state before each step and v, where actions are tanh v times the largest.
    The first state is known: z has (steps - 1) (2c + joints) + joints entries. How far a cart is
    beyond MAX_PLACE of its rail is weighted as a defect is.

    `start` and `goal` are equilibria, (n,): the angles at the start, and those at the end but for
    whole turns [rad]. A cart goes from the middle of its rail to `place` [m].

    `weights` are those of other things than actions, see `planned_transition`.
    """

    def __init__(
        self,
        config: EnvConfig,
        steps: int,
        start: FloatArray,
        goal: FloatArray,
        place: float = 0.0,
        weights: Weights = _NO_WEIGHTS,
    ) -> None:
        self.n: int = config.chain.n
        self.joints: int = config.joints.size
        self.steps: int = steps
        self.dt: float = config.dt
        self.size: int = config.state_size
        self.model: StepModel = StepModel(config)
        self.begin: FloatArray = at_rest(config, start)  # the state in which the trajectory begins
        self.goal, self.place = goal, place
        self.end = np.zeros(self.size)  # the state in which the trajectory ends
        self.wanted = np.zeros((steps, self.joints))  # v
        self.scale: NDArray[Any] = np.repeat([1.0, 0.3], self.size // 2)
        self.largest: float = MAX_ACTION if config.torque_levels is None else _MAX_DISCRETE
        self.change: float = _ACTION_WEIGHT * weights.change / config.dt  # of v, from step to step
        rates = np.eye(self.size)[self.size // 2 :]  # of the joints, and of a cart, by the state
        rates[1 : self.n] -= rates[: self.n - 1]
        self.speeds: FloatArray = _ACTION_WEIGHT * weights.speed * rates
        self.slow: slice = slice(round(weights.slow_from / config.dt), None)  # steps

    def solve(
        self, end: FloatArray, z: FloatArray, like: NominalTrajectory | None = None
    ) -> NominalTrajectory | None:
        """Return a trajectory to `end`, (2c,), or None where the guess z leads to none.

        Its actions are near those of the trajectory `like`, or small. The method is that of
        Levenberg and Marquardt. A defect depends on two states that follow each other, so that the
        normal equations in the order of time are a band.
        """
        self.end: FloatArray = end
        self.wanted = np.zeros((self.steps, self.joints))
        if like is not None:
            self.wanted: FloatArray = self.rows(self.unknowns(*like)[1])[1]
        defects, weight, damping = self.defects(z), 1.0, 1e-2
        for _ in range(_MAX_ITERATIONS):
            try:
                z, defects, decrease, damping = self.improve(z, defects, weight, damping)
            except FloatingPointError:  # steps too coarse for so fast a state
                break
            if decrease < 3e-3:  # converged for this weight
                if np.abs(defects).max() < _TOLERANCE:
                    return self.trajectory(z)
                weight *= 3.0
            if weight > 1e7:
                break
        return None

    def improve(
        self, z: FloatArray, defects: FloatArray, weight: float, damping: float
    ) -> tuple[FloatArray, FloatArray, float, float]:
        """Take a step: return z, its defects, the relative decrease of the cost, the damping."""
        band, gradient = self.normal_equations(z, defects, weight)
        cost = self.cost(z, defects, weight)
        for _ in range(12):
            damped = band.copy()
            damped[0] += damping
            trial = z - _solve(damped, gradient)
            if np.abs(trial).max() < _MAX_UNKNOWN:
                new = self.defects(trial)
                decrease = 1.0 - self.cost(trial, new, weight) / cost
                if decrease > 0.0:
                    return trial, new, decrease, max(damping / 3.0, 1e-10)
            damping *= 4.0
        return z, defects, 0.0, 1e-4

    def wavy_guess(self, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Draw an end, to which rods turn in one sense or the other, and a wavy path to it.

        The actions of the path are small; nothing makes it a motion of the chain.
        """
        s = np.linspace(0.0, 1.0, self.steps + 1)[:, None]
        turn = rng.choice([1.0, 1.0, 1.0, -1.0], self.n) * (self.goal - self.begin[: self.n])
        k = np.arange(1, _HALF_WAVES + 1)[:, None]
        waves = np.sin(np.pi * k * s[:, None]) * rng.normal(0.0, 0.6, (_HALF_WAVES, self.n))
        smooth = (3.0 - 2.0 * s) * s**2
        q = smooth * np.full(self.size // 2, self.place)  # of a cart
        q[:, : self.n] = smooth * turn + np.sin(np.pi * s) * waves.sum(axis=1)
        q[:, : self.n] += self.begin[: self.n]
        states = np.hstack([q, np.gradient(q, self.dt, axis=0)])
        v = rng.normal(0.0, 0.1, (self.steps, self.joints))
        end = self._end_at(self.begin[: self.n] + turn)
        return end, np.hstack([states[:-1], v]).ravel()[self.size :]

    def unknowns(self, states: FloatArray, actions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the nearest end and z of a motion that ends near the goal, as a guess."""
        turns = np.rint((states[-1, : self.n] - self.goal) / (2.0 * np.pi))
        end = self._end_at(self.goal + 2.0 * np.pi * turns)
        v = np.arctanh(np.clip(actions / self.largest, -_MAX_GUESS, _MAX_GUESS))
        return end, np.hstack([states[:-1], v]).ravel()[self.size :]

    def _end_at(self, angles: FloatArray) -> FloatArray:
        return at_rest(self.model.config, angles, self.place)

    def rows(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the state before each step, (steps, 2c), and v, (steps, joints)."""
        rows = np.concatenate([self.begin, z]).reshape(self.steps, -1)
        return rows[:, : self.size], rows[:, self.size :]

    def trajectory(self, z: FloatArray) -> NominalTrajectory:
        """Return the unknowns as states and actions."""
        states, v = self.rows(z)
        return NominalTrajectory(np.vstack([states, self.end]), self.largest * np.tanh(v))

    def defects(self, z: FloatArray) -> FloatArray:
        """Return by how much each step misses the next state, (steps, 2c)."""
        states, actions = self.trajectory(z)
        return self.scale * (self.model(states[:-1], actions) - states[1:])

    def cost(self, z: FloatArray, defects: FloatArray, weight: float) -> float:
        """Return the sum of squares: weighted defects, and how far v is from that wanted."""
        states, v = self.rows(z)
        v, far = v - self.wanted, beyond(self.model.config, states, MAX_PLACE)
        missed = float(np.vdot(defects, defects)) + float(np.vdot(far, far))
        wanted = (
            _ACTION_WEIGHT * v,
            states[self.slow] @ self.speeds.T,
            self.change * self.changes(z),
        )
        return weight**2 * missed + sum(float(np.vdot(each, each)) for each in wanted)

    def changes(self, z: FloatArray) -> FloatArray:
        """Return by how much v changes from step to step, (steps - 1, joints)."""
        return np.diff(self.rows(z)[1], axis=0)

    def normal_equations(
        self, z: FloatArray, defects: FloatArray, weight: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return J^T J, its lower band as `solveh_banded` takes it, and J^T r.

        J is the derivative of the residuals r by z. The defects of step k depend on its state and
        action and on the next state, with the derivatives (A, B, -1) times `scale`.
        """
        size, (states, actions) = self.size, self.trajectory(z)
        a, b = self.model.derivatives(states[:-1], actions)
        b = b * (self.largest - actions**2 / self.largest)[:, None, :]  # by v
        scale = weight * self.scale[:, None]
        here = scale * np.concatenate([a, b], axis=2)
        # below the diagonal: rows of the state and action of step k, then of the next state
        columns = np.zeros((self.steps, 2 * (size + self.joints) + size, size + self.joints))
        both = size + self.joints
        columns[:, :both] = np.swapaxes(here, 1, 2) @ here
        columns[1:, range(size), range(size)] += scale[:, 0] ** 2
        columns[:, range(size, both), range(size, both)] += _ACTION_WEIGHT**2
        columns[self.slow, :size, :size] += self.speeds.T @ self.speeds
        of_change = self.change**2
        columns[1:, range(size, both), range(size, both)] += of_change
        columns[:-1, range(size, both), range(size, both)] += of_change
        columns[:-1, range(both + size, 2 * both), range(size, both)] -= of_change
        far = beyond(self.model.config, states[:-1], MAX_PLACE)
        columns[:, self.n, self.n] += weight**2 * (far != 0.0)
        columns[:, both : both + size] = -scale * here
        below = np.arange(both + size)[:, None] + np.arange(both)
        band = np.moveaxis(columns[:, below, np.arange(both)], 0, 1).reshape(both + size, -1)
        residual = weight * defects
        gradient = np.einsum("kij,ki->kj", here, residual)
        gradient[1:, :size] -= scale[:, 0] * residual[:-1]
        gradient[:, self.n] += weight**2 * far
        gradient[:, size:] += _ACTION_WEIGHT**2 * (self.rows(z)[1] - self.wanted)
        gradient[self.slow, :size] += states[:-1][self.slow] @ self.speeds.T @ self.speeds
        changes = of_change * self.changes(z)
        gradient[1:, size:] += changes
        gradient[:-1, size:] -= changes
        return band[:, size:], gradient.ravel()[size:]


def _solve(band: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solution, or infinity where rounding leaves the matrix not positive."""
    try:
        return solveh_banded(band, right, overwrite_ab=True, lower=True, check_finite=False)
    except LinAlgError:
        return np.full(right.size, np.inf)
