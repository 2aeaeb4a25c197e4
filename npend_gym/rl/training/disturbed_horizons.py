"""What `robust_shac` learns from: horizons of random chains, sensed with noise and delay."""

# torch's stubs leave parts unknown
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from torch import nn

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.envs.starts import Draw
from npend_gym.physics import DifferentiableEnsemble
from npend_gym.rl.evaluation.rollouts import rollout
from npend_gym.rl.evaluation.settings import setting_of
from npend_gym.rl.policies.policy import Policy
from npend_gym.rl.training.disturbed_task import OF_CHAIN, DisturbedTask
from npend_gym.rl.training.short_horizons import Horizons

_PULSE_WIDTH = 0.05, 0.1  # standard deviation in time [s]
_DEMONSTRATED = 0.8  # share of the demonstrated states in the starts anywhere


def demonstrated(policy: Policy, episodes: int = 16, seconds: float = 5.5) -> FloatArray:
    """Return the states, (states, 2n), of the first seconds of a policy's episodes, and mirrored.

    From them a swing-up is learned backwards, from its end on (as in T. Salimans, R. Chen,
    "Learning Montezuma's Revenge from a single demonstration", arXiv:1812.03381).
    """
    envs = setting_of(policy.env).make(episodes)
    states: list[FloatArray] = []
    for _, _, _, info in rollout(policy, envs, *envs.reset(seed=0)):
        states.append(np.hstack([info["theta"], info["omega"]]))
        if info["time"][0] >= seconds:
            break
    envs.close()
    return np.concatenate([*states, *(-state for state in states)])


class DisturbedCollector:
    """Simulates many lanes, each with a chain, sensors and disturbances of its own.

    Parameters
    ----------
    task : DisturbedTask
    settings : Settings
        Those of `robust_shac`.
    """

    changes = (
        "rng", "calls", "context", "states", "actions", "observations", "noise", "time", "pulses",
        "age", "lanes",
    )  # fmt: skip

    def __init__(self, task: DisturbedTask, settings: Any) -> None:
        self.task, self.config, self.settings = task, task.config, settings
        self.rng, size = np.random.default_rng(settings.seed), settings.num_envs
        self.iterations = max(1, settings.total_timesteps // (size * settings.horizon))
        config, self.calls = self.config, 0
        self.nominal = np.concatenate([
            np.ravel(getattr(config.chain if name in OF_CHAIN else config, name))
            for name in dict.fromkeys(each.partition("[")[0] for each in config.context_names)
        ])  # fmt: skip
        chains = [config.chain] * size
        self.lanes = DifferentiableEnsemble(chains, joints=range(config.n))
        self.context = np.tile(self.nominal, (size, 1))
        self.states: list[torch.Tensor] = [torch.zeros(size, 2 * config.n)] * (task.past + 1)
        self.actions: list[torch.Tensor] = [torch.zeros(size, 1)] * task.past
        self.observations: list[torch.Tensor] = [torch.zeros(size, 3 * config.n)] * task.length
        self.demonstrated = np.zeros((0, 2 * config.n))  # states to start from
        if settings.demonstrator:
            self.demonstrated = demonstrated(Policy.pretrained(settings.demonstrator))
        self.noise, self.time = np.zeros(size), np.zeros(size)
        self.pulses = np.zeros((4, size))  # time of the peak, width, peak, joint
        self.restart(np.ones(size, np.bool_))
        steps = self.rng.integers(0, settings.episode // settings.horizon, size)
        self.age = settings.horizon * steps

    @property
    def level(self) -> float:
        """How large disturbances are at present, 0 to 1."""
        first, done = self.settings.first_level, self.calls / self.iterations
        begin, end = self.settings.ramp
        return first + (1.0 - first) * min(1.0, max(0.0, (done - begin) / (end - begin)))

    def restart(self, over: BoolArray) -> None:
        """Begin new episodes, with new chains, sensors and disturbances, in some lanes."""
        rng, count, n = self.rng, int(over.sum()), self.config.n
        draws = self.config.randomization.draws
        drawn = rng.uniform(draws[:, Draw.LOW], draws[:, Draw.HIGH], (count, len(draws)))
        ideal = rng.random(count) < self.settings.ideal_share
        scale = np.where(ideal, 0.0, self.level)[:, None]
        self.context[over] = self.nominal + scale * (drawn - self.nominal)
        lanes = np.flatnonzero(over)
        self._set_chains(lanes)
        theta, omega = self.starts(count)
        self.lanes.set_state(lanes, theta, omega)
        self.noise[over], self.time[over] = rng.normal(size=count), 0.0
        self.pulses[:, over] = np.array([-1.0, 1.0, 0.0, 0.0])[:, None]
        begun = torch.from_numpy(np.hstack([theta, omega])).float()
        mask, drawn = torch.from_numpy(over)[:, None], self.context_tensor()
        filled = torch.zeros(len(over), 2 * n)
        filled[mask[:, 0]] = begun
        self.states = [torch.where(mask, filled, each) for each in self.states]
        self.actions = [torch.where(mask, 0.0, each) for each in self.actions]
        shown = self.task.sense(self.states, drawn, torch.randn(len(over), 2 * n))
        self.observations = [torch.where(mask, shown, each) for each in self.observations]

    def _set_chains(self, lanes: np.ndarray) -> None:
        """Give some lanes the chains that were drawn."""
        context = self.context[lanes]
        changes = {k: self.task.values(k, context) for k in OF_CHAIN if self.task.columns[k]}
        if "gravity" in changes:
            changes["gravity"] = changes["gravity"][:, 0]
        self.lanes.set_chain(lanes, self.config.chain.repeated(lanes.size).changed(changes))

    def restored(self) -> None:
        """Renew the chains; their states stay what they are."""
        theta, omega = self.lanes.theta, self.lanes.omega
        self._set_chains(np.arange(len(self.noise)))
        self.lanes.set_state(slice(None), theta, omega)

    def starts(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return angles and speeds: some as the task starts, some near upright, some anywhere.

        With a demonstrator most of the last are near the states of its swing-ups.
        """
        rng, n, settings = self.rng, self.config.n, self.settings
        theta, omega = rng.uniform(-math.pi, math.pi, (count, n)), rng.normal(0.0, 2.5, (count, n))
        kind, (of_task, upright) = rng.random(count), settings.starts
        for k in np.flatnonzero(kind < of_task):
            drawn = self.config.mode.start(rng, n, self.config.amplitude, self.config.spread)
            theta[k], omega[k] = drawn
        near = (kind >= of_task) & (kind < of_task + upright)
        angle, speed = settings.nearness
        theta[near] = rng.normal(math.pi, angle, (near.sum(), n))
        omega[near] = rng.normal(0.0, speed, (near.sum(), n))
        if len(self.demonstrated) > 0:
            on_way = (kind >= of_task + upright) & (rng.random(count) < _DEMONSTRATED)
            shown = self.demonstrated[rng.integers(len(self.demonstrated), size=on_way.sum())]
            theta[on_way] = shown[:, :n] + rng.normal(0.0, 0.05, (on_way.sum(), n))
            omega[on_way] = shown[:, n:] + rng.normal(0.0, 0.2, (on_way.sum(), n))
        return theta, omega

    def disturbances(self, exploration: float) -> FloatArray:
        """Return the torques of a step beside those of the actor [N m], (lanes, n)."""
        rng, settings, size = self.rng, self.settings, len(self.noise)
        self.noise = 0.5 * self.noise + math.sqrt(0.75) * rng.normal(size=size)
        limit, dt = self.config.max_torque, self.config.dt
        torques = np.zeros((size, self.config.n))
        deviation = self.task.values("torque_noise", self.context)[..., 0]
        torques[:, 0] = (deviation + exploration * limit) * self.noise
        time, width, peak, joint = self.pulses
        begins = (rng.random(size) < settings.pulse_rate * dt) & (self.time > time + 0.4)
        count = int(begins.sum())
        peaks = self.level * settings.pulse * limit * rng.uniform(-1.0, 1.0, count)
        widths, joints = rng.uniform(*_PULSE_WIDTH, count), rng.integers(self.config.n, size=count)
        self.pulses[:, begins] = [self.time[begins] + 0.2, widths, peaks, joints]
        shape = np.exp(-0.5 * ((self.time + 0.5 * dt - time) / width) ** 2)
        torques[np.arange(size), joint.astype(int)] += peak * shape
        self.time += dt
        return torques

    @torch.no_grad()
    def collect(self, actor: nn.Module, exploration: float) -> Horizons:
        """Return a horizon of every lane; `exploration` is a deviation of the torque's noise."""
        task, horizon, jacobians = self.task, self.settings.horizon, []
        context, limit = self.context_tensor(), self.task.values("max_torque", self.context)
        states, actions, observations = self.states, self.actions, self.observations
        for _ in range(horizon):
            action = actor(task.frames(observations, actions)).tanh()
            torques = self.disturbances(exploration)
            torques[:, :1] += limit * action.double().numpy()
            step = self.lanes.step_jacobian(torques, self.config.dt, self.config.substeps)
            self.lanes.set_state(slice(None), step.theta, step.omega)
            state = torch.from_numpy(np.hstack([step.theta, step.omega])).float()
            states, actions = [*states, state], [*actions, action]
            seen = task.sense(states, context, torch.randn(state.shape))
            observations = [*observations, seen]
            by_action = step.B[..., :1] * np.reshape(limit, (-1, 1, 1))
            jacobian = np.concatenate([step.A, by_action], axis=-1)
            jacobians.append(torch.from_numpy(jacobian).float())
        self.states, self.actions = states[horizon:], actions[horizon:]
        self.observations = observations[horizon:]
        parts = states, actions, jacobians
        collected = Horizons(*(torch.stack(part, 1) for part in parts), context=context)
        self.calls += 1
        self.age += horizon
        over = self.age >= self.settings.episode
        self.age[over] = 0
        if over.any():
            self.restart(over)
        return collected

    def context_tensor(self) -> torch.Tensor:
        """Return what was drawn for the episodes, (lanes, contexts)."""
        return torch.from_numpy(self.context.copy()).float()
