"""Scores in RealAIGym's own simulator, beside `npend_gym.rl.recovery` and `performance`.

    git clone https://github.com/dfki-ric-underactuated-lab/double_pendulum
    pip install ./double_pendulum/src/python
    python benchmarks/realaigym.py                  prints a table, writes results/realaigym.csv
    python benchmarks/realaigym.py MPC --episodes 5     keeps the other rows
    python benchmarks/realaigym.py NAME --score hardware        or performance

Their `Simulator` moves their `DoublePendulumPlant`, and their `GlobalPolicyTestingControllerV2`
disturbs it, with the numbers of `leaderboard/pendubot/simulation_v3`, which are also those of
`leaderboard/acrobot/simulation_v3`, or of `experiments/icra_2025`. A policy has its own motor. Our
controller sees their state every step of its own environment, 0.02 s or 0.002 s, and its torque is
held for as long. Their uptime is the score, with random numbers of their own, or the score of
`leaderboard/pendubot/simulation_v2` by their functions. Nothing of their code is in this
repository.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from csv_tables import merged_rows
from double_pendulum.analysis import leaderboard
from double_pendulum.controller.abstract_controller import AbstractController
from double_pendulum.controller.global_policy_testing_controller import (
    GlobalPolicyTestingControllerV2,
)
from double_pendulum.model.model_parameters import model_parameters
from double_pendulum.model.plant import DoublePendulumPlant
from double_pendulum.simulation.simulation import Simulator

from npend_gym.report import prepare_file, write_csv
from npend_gym.rl import (
    Controller,
    Policy,
    performance,
    pretrained_names,
    recovery,
    reference_controller,
)

SECONDS, STEP, LIMIT = 60.0, 0.002, 6.0  # s, s, N m
SWING_UP_SECONDS = 10.0
DISTURBANCES: dict[str, dict[str, Any]] = {
    "recovery": {"n_disturbances": 15, "reset_length": 0.2},
    "hardware": {
        "n_disturbances": 10, "reset_length": 1.0, "kp": 2.0, "ki": 0.0, "kd": 0.3,
        "pos_limit": 3.5 * np.pi, "vel_limit": 20.0, "pid_pos_contribution_limit": [3.0, 3.0],
    },
}  # fmt: skip
SCORES = (*DISTURBANCES, "performance")
ROBOT = Policy.pretrained("swingup-2-pendubot").env  # of controllers that are no policies
CONTROLLERS = (
    "swingup-2-pendubot-recovery", "swingup-2-pendubot", "MPC", "plan", "energy",
    "swingup-2-acrobot",
)  # fmt: skip


class Ours(AbstractController):
    """A controller of ours where one of theirs is expected.

    An environment of ours shows it the state: it makes the observation, and moves nothing.
    """

    def __init__(self, controller: Controller) -> None:
        super().__init__()
        self._controller = controller
        self._envs: Any = gym.make_vec("npend_gym:NPendulum-v0", num_envs=1, **_env(controller))
        self._config = self._envs.unwrapped.config
        forget = getattr(controller, "reset", None)
        if forget is not None:
            forget(1)
        self._due, self._torque = 0.0, np.zeros(2)

    def get_control_output_(self, x: Any, t: float = 0.0) -> Any:
        """Return the torques of both joints [N m]."""
        if t > self._due - 0.5 * STEP:
            self._due = t + self._config.dt
            state = {"theta": np.cumsum(x[:2])[None], "omega": np.cumsum(x[2:])[None]}
            observation, info = self._envs.reset(options=state)
            info["time"] = np.array([t])
            action = np.clip(self._controller(observation, info)[0], -1.0, 1.0)
            self._torque[self._config.joints] = LIMIT * action
        return self._torque.copy()


def their_score(controller: Controller, seed: int, score: str) -> float:
    """Return a score of an episode in their simulator: mostly the share for which it is up."""
    if score == "performance":
        return _their_performance(controller)
    np.random.seed(seed)  # noqa: NPY002 - their random numbers
    tested = GlobalPolicyTestingControllerV2(
        Ours(controller), goal=np.array([np.pi, 0.0, 0.0, 0.0]), t_max=SECONDS,
        mpar=_parameters([LIMIT, LIMIT]), **DISTURBANCES[score],
    )  # fmt: skip
    times, states, _ = _simulated(tested, SECONDS)
    up = leaderboard.get_uptime(times, states, mpar=_parameters([LIMIT, 0.0]))
    return float(up) / SECONDS


def _their_performance(controller: Controller) -> float:
    """Return the score of their second version, of a swing-up from hanging at rest."""
    times, states, torques = _simulated(Ours(controller), SWING_UP_SECONDS)
    parameters = _parameters([LIMIT, LIMIT])
    end = leaderboard.get_swingup_time(times, states, mpar=parameters)
    if end >= times[-1]:
        return 0.0
    costs = [
        end / 20.0,
        leaderboard.get_energy(states, torques) / 60.0,
        leaderboard.get_torque_cost(times, torques) / 20.0,
        leaderboard.get_tau_smoothness(torques) / 0.1,
        leaderboard.get_velocity_cost(times, states) / 400.0,
    ]
    return float(1.0 - np.tanh(np.pi * np.array(costs)).mean())


def our_scores(controller: Controller, episodes: int, score: str) -> Any:
    """Return the same score of episodes here."""
    if score == "performance":
        return performance(controller, _env(controller), episodes=episodes).score
    rule = "hardware" if score == "hardware" else "simulation"
    return recovery(controller, _env(controller), episodes=episodes, rule=rule).uptime


def _simulated(controller: Any, seconds: float) -> Any:
    """Return times, states and torques of all steps in their simulator, from hanging at rest."""
    simulator = Simulator(plant=DoublePendulumPlant(model_pars=_parameters([LIMIT, LIMIT])))
    found = simulator.simulate(
        t0=0.0, x0=[0.0] * 4, tf=seconds, dt=STEP, controller=controller, integrator="runge_kutta"
    )
    return [np.array(each)[: len(found[2])] for each in found]  # as their files have them


def _parameters(limits: list[float]) -> Any:
    """Return their description of the chain of the policy."""
    chain = ROBOT["chain"]
    masses, centres = np.array(chain["masses"]), np.array(chain["centres"])
    return model_parameters(
        mass=chain["masses"], length=chain["lengths"], com=chain["centres"],
        inertia=(np.array(chain["inertias"]) + masses * centres**2).tolist(), damping=[0.0, 0.0],
        cfric=[0.0, 0.0], gravity=chain["gravity"], motor_inertia=0.0, torque_limit=limits,
    )  # fmt: skip


def _env(controller: Controller) -> dict[str, Any]:
    return controller.env if isinstance(controller, Policy) else ROBOT


def _controller(name: str) -> Controller:
    return (
        Policy.pretrained(name) if name in pretrained_names() else reference_controller(name, ROBOT)
    )


def _row(name: str, score: str, where: str, scores: Any) -> dict[str, Any]:
    error = np.std(scores, ddof=1) / np.sqrt(len(scores)) if len(scores) > 1 else np.nan
    numbers = {"mean": np.mean(scores), "standard_error": error, "least": np.min(scores)}
    numbers |= {"largest": np.max(scores)}
    row: dict[str, Any] = {"controller": name, "score": score, "simulator": where}
    row["episodes"] = len(scores)
    return row | {key: round(float(value), 4) for key, value in numbers.items()}


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("controllers", nargs="*", default=CONTROLLERS, metavar="NAME")
    parser.add_argument("--score", choices=SCORES, default="recovery")
    parser.add_argument("--episodes", type=int, default=40, metavar="COUNT")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results/realaigym.csv")
    options = parser.parse_args()
    prepare_file(options.out, [".csv"])
    controllers = {name: _controller(name) for name in options.controllers}
    rows: list[dict[str, Any]] = []
    for name, controller in controllers.items():
        # their swing-ups have no random numbers
        seeds = range(1 if options.score == "performance" else options.episodes)
        theirs = [their_score(controller, seed, options.score) for seed in seeds]
        ours = our_scores(controller, options.episodes, options.score)
        for where, scores in (("RealAIGym", theirs), ("npend_gym", ours)):
            rows.append(_row(name, options.score, where, scores))
            print(rows[-1], flush=True)
        merged = merged_rows(options.out, rows, "controller", "score", "simulator")
        write_csv(options.out, merged)  # a later error leaves these


if __name__ == "__main__":
    main()
