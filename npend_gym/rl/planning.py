"""Swing-ups that are planned: a trajectory to upright within the torque limit, tracked by LQR.

`transcription.py` finds the trajectory. With the tracking, this is what is known for a double and a
triple pendulum on a cart: Graichen, Treuer, Zeitz, Automatica 43 (2007), 63-71, and Glück, Eder,
Kugi, Automatica 49 (2013), 801-808.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.envs import EnvConfig
from npend_gym.rl.controllers import StateFeedback, lqr, riccati, state_weights
from npend_gym.rl.mpc import MPC
from npend_gym.rl.step_model import StepModel
from npend_gym.rl.transcription import NominalTrajectory, Transcription

GUESSES = "waves", "mpc"
_START = 0.05  # rad and rad/s from hanging at rest, as far as environments start from it


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
    guess: str = "waves",
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
        Number of first guesses, drawn from `seed`.
    guess : str
        "waves", random paths that are no motions, of which about half lead to a trajectory; or
        "mpc", swing-ups by `MPC` from starts near hanging, which take longer to guess. Nearly all
        of them lead to a trajectory, with up to six rods.
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
    _checks.choice("guess", guess, GUESSES)
    problem = Transcription(config, steps)
    rngs = [np.random.default_rng([seed, k]) for k in range(_checks.count("tries", tries))]
    motions = swing_ups(config, steps, rngs) if guess == "mpc" else []
    begun = [problem.unknowns(*each) for each in motions] or [*map(problem.wavy_guess, rngs)]
    found: list[PlannedSwingUp] = []
    for attempt in progress(range(tries)):
        nominal = problem.solve(*begun[attempt])
        if nominal is not None:
            slopes = problem.model.derivatives(nominal.states[:-1], nominal.actions)
            found.append(track(config, nominal, *slopes, settle))
    if not found:
        raise RuntimeError(
            f"no trajectory of {steps * config.dt:g} s was found in {tries} tries: "
            "give it more seconds, tries or torque, or another seed"
        )
    return min(found, key=lambda controller: controller.sensitivity)


def swing_ups(
    config: EnvConfig, steps: int, rngs: Sequence[np.random.Generator]
) -> list[NominalTrajectory]:
    """Return swing-ups by `MPC`, side by side, from starts near hanging that are drawn."""
    n, step = config.chain.n, StepModel(config)
    controller = MPC(config)
    states = np.stack([rng.uniform(-_START, _START, 2 * n) for rng in rngs])
    motions, actions = [states], list[FloatArray]()
    for k in range(steps):
        time = np.full(len(states), k * config.dt)
        info = {"theta": states[:, :n], "omega": states[:, n:], "time": time}
        actions.append(controller(None, info))
        states = step(states, actions[-1])
        motions.append(states)
    pairs = zip(np.stack(motions, axis=1), np.stack(actions, axis=1), strict=True)
    return [NominalTrajectory(*pair) for pair in pairs]


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
