"""Swing-ups that are planned: a trajectory to upright within the torque limit, tracked by LQR.

`transcription.py` finds the trajectory. With the tracking, this is what is known for a double and a
triple pendulum on a cart: Graichen, Treuer, Zeitz, Automatica 43 (2007), 63-71, and Glück, Eder,
Kugi, Automatica 49 (2013), 801-808.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.envs import EnvConfig
from npend_gym.rl.controllers import StateFeedback, lqr, riccati, state_weights
from npend_gym.rl.transcription import NominalTrajectory, Transcription


@dataclass(frozen=True)
class PlannedSwingUp:
    """Bring the chain to rest, track a nominal trajectory by time-varying LQR, stand by LQR.

    While tracking, the actions are the nominal ones minus gains times the deviation of the state.
    """

    nominal: NominalTrajectory
    gains: FloatArray  # (steps, joints, 2n)
    initial_cost: FloatArray  # (2n, 2n): x initial_cost x is the cost of a deviation x at the start
    hang: StateFeedback
    stand: StateFeedback
    dt: float  # s
    settle: float  # time before the trajectory begins [s]

    def __call__(self, observation: Any, info: dict[str, Any]) -> FloatArray:
        """Return the actions, shape (B, joints)."""
        step = np.rint((info["time"] - self.settle) / self.dt).astype(np.int64)
        k = np.clip(step, 0, len(self.gains) - 1)
        state = np.concatenate([info["theta"], info["omega"]], axis=-1)
        deviation = state - self.nominal.states[k]
        track = self.nominal.actions[k] - np.einsum("bji,bi->bj", self.gains[k], deviation)
        before, after = (step < 0)[:, None], (step >= len(self.gains))[:, None]
        hang, stand = self.hang(observation, info), self.stand(observation, info)
        return np.where(before, hang, np.where(after, stand, track))

    @property
    def sensitivity(self) -> float:
        """The cost of the worst deviation of length one at the start."""
        return float(np.linalg.eigvalsh(self.initial_cost)[-1])


def planned_swing_up(
    config: EnvConfig,
    seconds: float = 6.0,
    *,
    settle: float = 0.0,
    tries: int = 4,
    seed: int = 0,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> PlannedSwingUp:
    """Plan swing-ups and return the one that is least sensitive to deviations at its start.

    Parameters
    ----------
    config : EnvConfig
        Of the environment, ``gym.make("NPendulum-v0", ...).unwrapped.config``: the trajectory is
        made of its own steps.
    seconds : float
        Duration of the trajectory.
    settle : float
        Time [s] for which LQR about hanging calms the chain before the trajectory begins.
    tries : int
        Number of first guesses, drawn from `seed`; about half of them lead to a trajectory.
    seed : int
        Seed of the guesses.
    progress : callable
        May wrap the iteration over the guesses, as tqdm does.

    Returns
    -------
    PlannedSwingUp

    Raises
    ------
    RuntimeError
        If none of the guesses leads to a trajectory.
    """
    steps = max(2, round(_checks.positive_number("seconds", seconds) / config.dt))
    settle = _checks.nonnegative_number("settle", settle)
    problem = Transcription(config, steps)
    found: list[PlannedSwingUp] = []
    for attempt in progress(range(_checks.count("tries", tries))):
        nominal = problem.solve(np.random.default_rng([seed, attempt]))
        if nominal is not None:
            slopes = problem.model.derivatives(nominal.states[:-1], nominal.actions)
            found.append(track(config, nominal, *slopes, settle))
    if not found:
        raise RuntimeError(
            f"no trajectory of {steps * config.dt:g} s was found in {tries} tries: "
            "give it more seconds, tries or torque, or another seed"
        )
    return min(found, key=lambda controller: controller.sensitivity)


def track(
    config: EnvConfig, nominal: NominalTrajectory, a: FloatArray, b: FloatArray, settle: float
) -> PlannedSwingUp:
    """Return the controller that tracks `nominal`, along which steps have derivatives a and b."""
    weights, action_weights = state_weights(config), np.eye(b.shape[2])
    s = riccati(config, np.pi, 1.0)[1]
    gains = np.empty((len(a), b.shape[2], a.shape[2]))
    for k in reversed(range(len(a))):
        gains[k] = np.linalg.solve(action_weights + b[k].T @ s @ b[k], b[k].T @ s @ a[k])
        s = weights + a[k].T @ s @ (a[k] - b[k] @ gains[k])
        s = 0.5 * (s + s.T)
    return PlannedSwingUp(nominal, gains, s, lqr(config, 0.0), lqr(config), config.dt, settle)
