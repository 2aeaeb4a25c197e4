"""A swing-up computed: a path to upright that the torque allows, and a controller that follows it.

The path is found by direct transcription: the states at all steps and the actions between them
are unknowns, and steps of the environment have to lead from each state to the next. The first
guess need not be a motion at all, which is what makes chains of three rods and more, whose motion
no guess can foresee, no harder than one. With the tracking it amounts to what is known for a
double and a triple pendulum on a cart: Graichen, Treuer, Zeitz, Automatica 43 (2007), 63-71, and
Glück, Eder, Kugi, Automatica 49 (2013), 801-808.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve
from tqdm import tqdm

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.envs import EnvConfig, Mode
from npend_gym.envs.batch import Batch
from npend_gym.rl.controllers import Info, StateFeedback, lqr, riccati, running_cost

LIMIT = 0.9  # of the torque, for the path: the rest is for tracking
EFFORT = 0.05  # weight of the actions
TOLERANCE = 1e-7  # of a path: rad and 0.3 rad/s
ITERATIONS = 300
WAVES = 6  # half sines in the first guess
_NUDGE = 1e-5  # for derivatives by central differences
_WILD = 60.0  # rad or rad/s, in no sensible path


class Plan(NamedTuple):
    """A motion from hanging to standing at rest, in steps of the environment."""

    states: FloatArray  # (steps + 1, 2n): theta [rad], omega [rad/s]
    actions: FloatArray  # (steps, joints), torques over their limit


@dataclass(frozen=True)
class Follower:
    """Bring the chain to rest, follow a plan by time-varying feedback, stand by LQR.

    The actions are those of the plan minus gains times the deviation from it.
    """

    plan: Plan
    gains: FloatArray  # (steps, joints, 2n)
    cost: FloatArray  # (2n, 2n): beginning away from the plan by x costs x cost x
    hang: StateFeedback
    stand: StateFeedback
    dt: float  # s
    settle: float  # time before the plan begins [s]

    def __call__(self, observation: Any, info: Info) -> FloatArray:
        """Return the actions, shape (B, joints)."""
        step = np.rint((info["time"] - self.settle) / self.dt).astype(np.int64)
        k = np.clip(step, 0, len(self.gains) - 1)
        away = np.concatenate([info["theta"], info["omega"]], axis=-1) - self.plan.states[k]
        follow = self.plan.actions[k] - np.einsum("bji,bi->bj", self.gains[k], away)
        before, after = (step < 0)[:, None], (step >= len(self.gains))[:, None]
        hang, stand = self.hang(observation, info), self.stand(observation, info)
        return np.where(before, hang, np.where(after, stand, follow))

    @property
    def sensitivity(self) -> float:
        """The cost of the worst deviation of length one at the beginning."""
        return float(np.linalg.eigvalsh(self.cost)[-1])


def planned_swing_up(
    config: EnvConfig, seconds: float = 6.0, *, settle: float = 0.0, tries: int = 4, seed: int = 0
) -> Follower:
    """Plan swing-ups and return the follower of the one that forgives most at its beginning.

    Parameters
    ----------
    config : EnvConfig
        Of the environment, whose own steps the plan is made of.
    seconds : float
        Duration of the plan.
    settle : float
        For how long LQR about hanging calms the chain before the plan begins [s].
    tries : int
        Number of first guesses, drawn from `seed`: about half of them become a plan.

    Raises
    ------
    RuntimeError
        If none of the guesses became a plan.
    """
    steps = max(2, round(_checks.positive_number("seconds", seconds) / config.dt))
    settle = _checks.nonnegative_number("settle", settle)
    task = _Transcription(config, steps)
    found: list[Follower] = []
    for attempt in tqdm(range(_checks.count("tries", tries)), "plans", leave=False, disable=None):
        plan = task.solve(np.random.default_rng([seed, attempt]))
        if plan is not None:
            found.append(follower(config, plan, *task.derivatives(*plan), settle))
    if not found:
        raise RuntimeError(
            f"no path of {steps * config.dt:g} s was found in {tries} tries: "
            "give it more seconds, tries or torque, or another seed"
        )
    return min(found, key=lambda agent: agent.sensitivity)


def follower(
    config: EnvConfig, plan: Plan, a: FloatArray, b: FloatArray, settle: float
) -> Follower:
    """Return the controller that follows `plan`, along which steps have derivatives a and b."""
    weight, effort = running_cost(config), np.eye(b.shape[2])
    s = riccati(config, np.pi, 1.0)[1]
    gains = np.empty((len(a), b.shape[2], a.shape[2]))
    for k in reversed(range(len(a))):
        gains[k] = np.linalg.solve(effort + b[k].T @ s @ b[k], b[k].T @ s @ a[k])
        s = weight + a[k].T @ s @ (a[k] - b[k] @ gains[k])
        s = 0.5 * (s + s.T)
    return Follower(plan, gains, s, lqr(config, 0.0), lqr(config), config.dt, settle)


class _Transcription:
    """Least squares for a plan: small defects, with a growing weight, and small actions.

    Unknowns are the states between the first and the last, (steps - 1, 2n), and v, (steps, joints),
    with actions LIMIT tanh v.
    """

    def __init__(self, config: EnvConfig, steps: int) -> None:
        self.n, self.joints, self.steps, self.dt = (
            config.chain.n, config.joints.size, steps, config.dt
        )  # fmt: skip
        self.inputs = 2 * self.n + self.joints
        self.step = _Stepper(config, steps)
        self.many = _Stepper(config, steps * 2 * self.inputs)
        self.end = np.zeros(2 * self.n)
        self.scale = np.tile(np.repeat([1.0, 0.3], self.n), steps)

    def solve(self, rng: np.random.Generator) -> Plan | None:
        """Return a plan, or None where none comes of the guess."""
        z = self.guess(rng)
        weight, damping = 1.0, 1e-2
        for _ in range(ITERATIONS):
            residual = self.residual(z, weight)
            z, gain, damping = self.improve(z, residual, weight, damping)
            if gain < 3e-3:  # as good as it gets with this weight
                if np.abs(self.defects(z)).max() < TOLERANCE:
                    return self.plan(z)
                weight *= 3.0
            if weight > 1e7:
                break
        return None

    def improve(
        self, z: FloatArray, residual: FloatArray, weight: float, damping: float
    ) -> tuple[FloatArray, float, float]:
        """Take a step of Levenberg and Marquardt; return z, the cost's relative fall, damping."""
        jacobian = self.jacobian(z, weight)
        matrix, slope = (jacobian.T @ jacobian).tocsc(), jacobian.T @ residual
        cost = float(residual @ residual)
        for _ in range(12):
            trial = z - spsolve(matrix + damping * sparse.eye_array(z.size, format="csc"), slope)
            if np.abs(trial).max() < _WILD:
                new = self.residual(trial, weight)
                fall = 1.0 - float(new @ new) / cost
                if fall > 0.0:
                    return trial, fall, max(damping / 3.0, 1e-10)
            damping *= 4.0
        return z, 0.0, 1e-4

    def guess(self, rng: np.random.Generator) -> FloatArray:
        """Turn every rod up, one way or the other, on a wavy path; next to no torque."""
        s = np.linspace(0.0, 1.0, self.steps + 1)[:, None]
        self.end[: self.n] = np.pi * rng.choice([1.0, 1.0, 1.0, -1.0], self.n)
        k = np.arange(1, WAVES + 1)[:, None]
        waves = np.sin(np.pi * k * s[:, None]) * rng.normal(0.0, 0.6, (WAVES, self.n))
        theta = (3.0 - 2.0 * s) * s**2 * self.end[: self.n] + np.sin(np.pi * s) * waves.sum(axis=1)
        states = np.hstack([theta, np.gradient(theta, self.dt, axis=0)])
        return np.concatenate(
            [states[1:-1].ravel(), rng.normal(0.0, 0.1, self.steps * self.joints)]
        )

    def plan(self, z: FloatArray) -> Plan:
        """Return the unknowns as states and actions."""
        inner, v = np.split(z, [(self.steps - 1) * 2 * self.n])
        states = np.vstack([np.zeros(2 * self.n), inner.reshape(-1, 2 * self.n), self.end])
        return Plan(states, LIMIT * np.tanh(v.reshape(self.steps, self.joints)))

    def defects(self, z: FloatArray) -> FloatArray:
        """Return by how much each step misses the next state, (steps * 2n,)."""
        states, actions = self.plan(z)
        return self.scale * (self.step(states[:-1], actions) - states[1:]).ravel()

    def residual(self, z: FloatArray, weight: float) -> FloatArray:
        """Return what is to be made small."""
        v = z[(self.steps - 1) * 2 * self.n :]
        return np.concatenate([weight * self.defects(z), EFFORT * v])

    def jacobian(self, z: FloatArray, weight: float) -> Any:
        """Return the residual's derivative, sparse."""
        states, actions = self.plan(z)
        a, b = self.derivatives(states, actions)
        b = b * (LIMIT - actions**2 / LIMIT)[:, None, :]  # by v
        wide = 2 * self.n
        by_state = sparse.vstack(
            [sparse.csr_array((wide, wide * (self.steps - 1))), sparse.block_diag(a[1:])]
        ) - sparse.eye_array(wide * self.steps, wide * (self.steps - 1))
        weights = sparse.diags_array(weight * self.scale)
        effort = EFFORT * sparse.eye_array(self.steps * self.joints)
        return sparse.block_array(
            [[weights @ by_state, weights @ sparse.block_diag(b)], [None, effort]], format="csr"
        )

    def derivatives(self, states: FloatArray, actions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the steps' derivatives by state, (steps, 2n, 2n), and action, (..., joints)."""
        at = np.hstack([states[:-1], actions])
        nudge = _NUDGE * np.eye(self.inputs)
        places = at[:, None, None] + np.stack([nudge, -nudge], axis=1)
        flat = places.reshape(-1, self.inputs)
        reached = self.many(flat[:, : 2 * self.n], flat[:, 2 * self.n :])
        reached = reached.reshape(self.steps, self.inputs, 2, 2 * self.n)
        slopes = np.swapaxes(reached[:, :, 0] - reached[:, :, 1], 1, 2) / (2.0 * _NUDGE)
        return slopes[..., : 2 * self.n], slopes[..., 2 * self.n :]


class _Placed(Mode):
    """Episodes begin where they are told to."""

    def start(
        self, rng: np.random.Generator, n: int, amplitude: float, spread: float
    ) -> tuple[FloatArray, FloatArray]:
        """Draw nothing."""
        del rng, amplitude, spread
        return np.zeros(n), np.zeros(n)


class _Stepper:
    """Steps of the environment from any states, all side by side."""

    def __init__(self, config: EnvConfig, count: int) -> None:
        self.batch = Batch(replace(config, mode=_Placed()), count)
        self.batch.rngs = [np.random.default_rng(0)] * count  # not drawn from
        self.everywhere = np.ones(count, np.bool_)

    def __call__(self, states: FloatArray, actions: FloatArray) -> FloatArray:
        """Return the states, (B, 2n), after a step under the actions, (B, joints)."""
        theta, omega = np.split(states, 2, axis=1)
        self.batch.start(self.everywhere, {"theta": theta, "omega": omega})
        self.batch.step(actions)
        info = self.batch.every_lane()[1]
        return np.hstack([info["theta"], info["omega"]])
