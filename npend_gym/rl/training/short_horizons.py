"""What `shac` learns from: short horizons, simulated with the Jacobians of their steps."""

# torch's stubs leave parts unknown
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import nn

from npend_gym._checks import FloatArray
from npend_gym.chain import ChainParameters
from npend_gym.envs import EnvConfig
from npend_gym.envs.modes import Quantities
from npend_gym.physics import DifferentiableEnsemble, Ensemble
from npend_gym.physics.energy import kinetic_from, lift_from
from npend_gym.rl.angles import wrap

_STIFFNESS, _DAMPING = 10.0 / 6.0, 1.0 / 6.0  # N m/rad and N m s/rad over the torque limit


class Task:
    """Observations and rewards of an environment as functions of states and actions, in torch.

    States (..., 2n) are angles, then angular velocities.
    """

    def __init__(self, config: EnvConfig, gamma: float, obs_scale: tuple[float, ...]) -> None:
        self.n, self.mode, self.gamma = config.n, config.mode, gamma
        self.bobs = config.chain.has_bobs
        self.obs_scale = torch.tensor(obs_scale).repeat_interleave(self.n)
        # of the states: near pi a sine is its angle
        self.state_scale = torch.tensor([1.0, obs_scale[2]]).repeat_interleave(self.n)
        chain = config.chain.repeated(1)
        tensors: list[Any] = [torch.from_numpy(values.copy()).float() for values in chain]
        self.chain: Any = ChainParameters(*tensors)
        self.lift = torch.tensor(config.chain.lift).float()
        self.unit = config.chain.lifting_energy
        self.inputs, self.contexts = 3 * self.n, 0  # of the actor; of the critic, beside these

    def observe(self, states: torch.Tensor) -> torch.Tensor:
        """Return the observations, (..., 3n), over their scale."""
        theta, omega = states.split(self.n, dim=-1)
        return torch.cat([theta.sin(), theta.cos(), omega], dim=-1) / self.obs_scale

    def judge(self, states: torch.Tensor, context: torch.Tensor) -> torch.Tensor:
        """Return what the critic is given, (..., 3n + contexts)."""
        return torch.cat([self.observe(states), context], dim=-1)

    def reward(
        self, states: torch.Tensor, actions: torch.Tensor, context: torch.Tensor
    ) -> torch.Tensor:
        """Return the rewards (...) of steps to `states`, times 1 - gamma: values are below 1."""
        del context  # the chain is always the same
        return self._reward(self.chain, self.lift, self.unit, states, actions)

    def _reward(
        self, chain: Any, lift: Any, unit: Any, states: torch.Tensor, actions: torch.Tensor
    ) -> torch.Tensor:
        """Return the rewards of chains with this `Chain.lift` and `Chain.lifting_energy`."""
        theta, omega = states.split(self.n, dim=-1)
        lifted = lift_from(lift, (0.5 * theta).sin())
        kinetic = kinetic_from(chain, theta.sin(), theta.cos(), omega, bobs=self.bobs)
        quantities: Any = dict.fromkeys(Quantities._fields) | {
            "height": 0.5 * lifted / lift.sum(-1),
            "kinetic_energy": kinetic / unit,
            "mean_squared_action": actions.square().mean(-1),
        }
        return (1.0 - self.gamma) * self.mode.reward(Quantities(**quantities))


class Horizons(NamedTuple):
    """Steps that were simulated, float32; the leading axes are horizon and step.

    States and actions begin with those of `past` steps before the horizon, for an actor that
    remembers them; for others `past` is 0.
    """

    states: torch.Tensor  # (..., 2n), one more than past and steps
    actions: torch.Tensor  # (..., m), those of past and steps
    jacobians: torch.Tensor  # of the state after a step by state and action, (..., 2n, 2n + m)
    context: torch.Tensor  # what was drawn for the episode, (horizons, contexts)


def knocked_down(
    config: EnvConfig, rng: np.random.Generator, count: int = 2000, seconds: float = 0.2
) -> FloatArray:
    """Return states, (count, 2n), in which upright chains are left by a knock-down.

    A proportional-differential controller with compensation of gravity turns all joints. It is
    simpler than the motors of `recovery`: its steps are those of the environment, and it turns
    joints the short way.
    """
    n, goal = config.n, rng.uniform(-math.pi, math.pi, (count, config.n))
    lanes = Ensemble(config.chain, count, joints=range(n))
    lanes.set_state(
        slice(None), rng.normal(math.pi, 0.05, (count, n)), rng.normal(0.0, 0.2, (count, n))
    )
    for _ in range(round(seconds / config.dt)):
        torque = _turning(config, goal, lanes.theta, lanes.omega)
        lanes.advance(torque, config.dt, config.substeps)
    return np.hstack([lanes.theta, lanes.omega])


def _turning(
    config: EnvConfig, goal: FloatArray, theta: FloatArray, omega: FloatArray
) -> FloatArray:
    """Return the torques at all joints [N m], (B, n), that turn them to their goals [rad]."""
    angle = np.diff(theta, axis=1, prepend=0.0)
    speed = np.diff(omega, axis=1, prepend=0.0)
    error = wrap(goal - angle)
    drive = config.max_torque * (_STIFFNESS * error - _DAMPING * speed)
    weight = config.chain.gravity * config.chain.lift * np.sin(theta)
    drive += np.cumsum(weight[:, ::-1], axis=1)[:, ::-1]
    return np.clip(drive, -config.max_torque, config.max_torque)


class Collector:
    """Simulates many lanes with the actor and noise, and keeps the Jacobians of all steps.

    Parameters
    ----------
    config : EnvConfig
    task : Task
    settings : Settings
        Those of `shac`.
    """

    changes = ("rng", "lanes", "noise", "age")

    def __init__(self, config: EnvConfig, task: Task, settings: Any) -> None:
        self.config, self.task, self.settings = config, task, settings
        self.rng, size = np.random.default_rng(settings.seed), settings.num_envs
        self.lanes = DifferentiableEnsemble(config.chain, size, joints=config.joints.tolist())
        self.noise = np.zeros((size, config.joints.size))
        self.knocked = np.zeros((0, 2 * config.n))  # states to start from
        if settings.knocked > 0.0:
            self.knocked = knocked_down(config, self.rng)
        self.restart(np.arange(size))
        self.age = self.rng.integers(0, settings.episode, size)

    def restart(self, lanes: np.ndarray) -> None:
        """Begin new episodes: a quarter as the task does, a quarter upright, half anywhere.

        A share of all, `settings.knocked`, begins just after the chain was knocked down instead.
        """
        n, rng, settings = self.config.n, self.rng, self.settings
        for lane in lanes.tolist():
            theta, omega = rng.uniform(-math.pi, math.pi, n), rng.normal(0.0, settings.speed, n)
            kind = rng.integers(4)
            if kind == 0:
                start = self.config.amplitude, self.config.spread
                theta, omega = self.config.mode.start(rng, n, *start)
            elif kind == 1:
                theta, omega = rng.normal(math.pi, 0.3, n), rng.normal(0.0, 1.0, n)
            if settings.knocked > 0.0 and rng.random() < settings.knocked:
                theta, omega = np.split(self.knocked[rng.integers(len(self.knocked))], 2)
            self.lanes.set_state([lane], theta, omega)
        self.noise[lanes] = 0.0

    @torch.no_grad()
    def collect(self, actor: nn.Module, exploration: float) -> Horizons:
        """Return a horizon of every lane; `exploration` is the deviation of the noise."""
        states, actions, jacobians = [self.states()], [], []
        limits = self.config.action_limits
        for _ in range(self.settings.horizon):
            self.noise = 0.8 * self.noise + 0.6 * self.rng.normal(size=self.noise.shape)
            action = torch.tanh(actor(self.task.observe(states[-1]))).double().numpy()
            action = np.clip(action + exploration * self.noise, -1.0, 1.0)
            step = self.lanes.step_jacobian(action * limits, self.config.dt, self.config.substeps)
            self.lanes.set_state(slice(None), step.theta, step.omega)
            states.append(self.states())
            actions.append(torch.from_numpy(action).float())
            jacobian = np.concatenate([step.A, step.B * limits], axis=-1)
            jacobians.append(torch.from_numpy(jacobian).float())
        self.age += self.settings.horizon
        over = self.age >= self.settings.episode
        self.age[over] = 0
        self.restart(np.flatnonzero(over))
        nothing = torch.zeros(len(self.noise), 0)
        return Horizons(*(torch.stack(p, 1) for p in (states, actions, jacobians)), context=nothing)

    def states(self) -> torch.Tensor:
        """Return the states of all lanes, (lanes, 2n)."""
        return torch.from_numpy(np.hstack([self.lanes.theta, self.lanes.omega])).float()
