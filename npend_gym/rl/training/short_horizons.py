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
from npend_gym.envs.cart import cart_speed_factor
from npend_gym.envs.modes import Calm, Quantities, left_rail, rail_factor
from npend_gym.envs.rows import MAX_CART_ENTRY
from npend_gym.physics import DifferentiableEnsemble, Ensemble
from npend_gym.physics.energy import kinetic_from, kinetic_on_cart, lift_from, potential_energy
from npend_gym.rl.angles import wrap
from npend_gym.rl.controllers.step_model import (
    loads_of,
    motors,
    of_actions,
    set_states,
    states_of,
)
from npend_gym.rl.training.tasks import observation_scale

_MIDDLE = 0.5  # of half the rail, where carts start
_STIFFNESS, _DAMPING = 10.0 / 6.0, 1.0 / 6.0  # N m/rad and N m s/rad over the torque limit


class Task:
    """Observations and rewards of an environment as functions of states and actions, in torch.

    States (q, u), (..., 2c), are angles and the place of a cart, then the rates of these.
    """

    def __init__(
        self, config: EnvConfig, gamma: float, obs_scale: tuple[float, float, float]
    ) -> None:
        self.n, self.mode, self.gamma = config.n, config.mode, gamma
        self.bobs, self.rail = config.chain.has_bobs, config.rail
        self.obs_scale = observation_scale(config, obs_scale)
        # of the states: near pi a sine is its angle; on a cart a metre is as far as a length
        of_q = torch.ones(config.state_size // 2)
        of_q[self.n :] = config.chain.total_length
        self.state_scale = torch.cat([of_q, obs_scale[2] * of_q])
        self.cart_speed = cart_speed_factor(config)
        self.mass = (config.cart_mass or 0.0) + float(config.chain.masses.sum())
        chain = config.chain.repeated(1)
        tensors: list[Any] = [torch.from_numpy(values.copy()).float() for values in chain]
        self.chain: Any = ChainParameters(*tensors)
        self.lift = torch.tensor(config.chain.lift).float()
        self.unit = config.chain.lifting_energy
        start = config.amplitude + 0.5 * config.spread  # of a release
        self.release_energy = float(potential_energy(config.chain, np.full(self.n, start)))
        self.observed = self.inputs = len(self.obs_scale)  # of the actor
        self.contexts = 0  # of the critic, beside what is observed

    def observe(self, states: torch.Tensor) -> torch.Tensor:
        """Return the observations, (..., observed), over their scale."""
        q, u = states.chunk(2, dim=-1)
        theta, omega = q[..., : self.n], u[..., : self.n]
        parts = [theta.sin(), theta.cos(), omega]
        if self.rail is not None:
            parts += [
                (part[..., self.n :] * factor).clamp(-MAX_CART_ENTRY, MAX_CART_ENTRY)
                for part, factor in ((q, 1.0 / self.rail), (u, self.cart_speed))
            ]
        return torch.cat(parts, dim=-1) / self.obs_scale

    def ended(self, states: torch.Tensor) -> torch.Tensor:
        """Return where an episode terminates, (...): off the rail, or where the mode says so."""
        quantities = self._quantities(self.chain, self.lift, self.unit, states, states[..., :1])
        failed = torch.as_tensor(self.mode.failed(quantities))
        over = failed | left_rail(torch.as_tensor(quantities.rail_position))
        return over.expand(states.shape[:-1])

    def judge(self, states: torch.Tensor, context: torch.Tensor) -> torch.Tensor:
        """Return what the critic is given, (..., observed + contexts)."""
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
        quantities = self._quantities(chain, lift, unit, states, actions)
        reward, place = (1.0 - self.gamma) * self.mode.reward(quantities), quantities.rail_position
        return reward if self.rail is None else reward * rail_factor(place) * ~left_rail(place)

    def _quantities(
        self, chain: Any, lift: Any, unit: Any, states: torch.Tensor, actions: torch.Tensor
    ) -> Quantities[Any]:
        q, u = states.chunk(2, dim=-1)
        theta, omega = q[..., : self.n], u[..., : self.n]
        lifted = lift_from(lift, (0.5 * theta).sin())
        cosines, place = theta.cos(), 0.0
        kinetic = kinetic_from(chain, theta.sin(), cosines, omega, bobs=self.bobs)
        if self.rail is not None:
            momentum = (lift * cosines * omega).sum(-1)
            kinetic = kinetic_on_cart(kinetic, momentum, self.mass, u[..., self.n])
            place = q[..., self.n] / self.rail
        energy = kinetic + chain.gravity * lifted
        total = chain.lengths.sum(-1)
        return Quantities(
            height=0.5 * lifted / lift.sum(-1),
            tip=-(chain.lengths * cosines).sum(-1) / total,
            energy=energy / unit,
            kinetic_energy=kinetic / unit,
            energy_fraction=energy / self.release_energy,
            mean_squared_action=actions.square().mean(-1),
            closeness=None,
            goal_distance=None,
            rail_position=place,
            theta=theta,  # pyright: ignore[reportArgumentType] - tensors
            omega=omega,  # pyright: ignore[reportArgumentType]
        )


class Horizons(NamedTuple):
    """Steps that were simulated, float32; the leading axes are horizon and step.

    States and actions begin with those of `past` steps before the horizon, for an actor that
    remembers them; for others `past` is 0.
    """

    states: torch.Tensor  # (..., 2c), one more than past and steps
    actions: torch.Tensor  # (..., m), those of past and steps
    jacobians: torch.Tensor  # of the state after a step by state and action, (..., 2c, 2c + m)
    context: torch.Tensor  # what was drawn for the episode, (horizons, contexts)


def knocked_down(
    config: EnvConfig, rng: np.random.Generator, count: int = 2000, seconds: float = 0.2
) -> FloatArray:
    """Return states, (count, 2c), in which upright chains are left by a knock-down.

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
    return states_of(config, lanes)


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
        self.lanes = DifferentiableEnsemble(config.chain, size, joints=motors(config))
        self.noise = np.zeros((size, config.joints.size))
        self.knocked = np.zeros((0, config.state_size))  # states to start from
        if settings.knocked > 0.0:
            self.knocked = knocked_down(config, self.rng)
        self.restart(np.arange(size))
        self.age = self.rng.integers(0, settings.episode, size)

    def restart(self, lanes: np.ndarray) -> None:
        """Begin new episodes: a quarter as the task does, a quarter near its goal, half anywhere.

        A share of all, `settings.knocked`, begins just after the chain was knocked down instead.
        Where an episode would be over at once, it begins as the task does.
        """
        for lane in lanes.tolist():
            state = self._start()
            if self._ended(state):
                state = self._state(*self._start_of_task())
            set_states(self.config, self.lanes, [lane], state[None])
        self.noise[lanes] = 0.0

    def _start(self) -> FloatArray:
        """Return a state to start from, (2c,)."""
        n, rng, settings = self.config.n, self.rng, self.settings
        theta, omega = rng.uniform(-math.pi, math.pi, n), rng.normal(0.0, settings.speed, n)
        kind = rng.integers(4)
        if kind == 0:
            theta, omega = self._start_of_task()
        elif kind == 1:
            goal = 0.0 if isinstance(self.config.mode, Calm) else math.pi
            theta, omega = rng.normal(goal, 0.3, n), rng.normal(0.0, 1.0, n)
        if settings.knocked > 0.0 and rng.random() < settings.knocked:
            return self.knocked[rng.integers(len(self.knocked))]
        return self._state(theta, omega)

    def _start_of_task(self) -> tuple[FloatArray, FloatArray]:
        config = self.config
        return config.mode.start(self.rng, config.n, config.amplitude, config.spread)

    def _state(self, theta: FloatArray, omega: FloatArray) -> FloatArray:
        """Return the state with these angles; a cart is anywhere on the middle of its rail."""
        if self.config.rail is None:
            return np.concatenate([theta, omega])
        place = self.config.rail * self.rng.uniform(-_MIDDLE, _MIDDLE)
        return np.concatenate([theta, [place], omega, [0.0]])

    def _ended(self, state: FloatArray) -> bool:
        return bool(self.task.ended(torch.from_numpy(state[None]).float()))

    @torch.no_grad()
    def collect(self, actor: nn.Module, exploration: float) -> Horizons:
        """Return a horizon of every lane; `exploration` is the deviation of the noise."""
        states, actions, jacobians = [self.states()], [], []
        config = self.config
        for _ in range(self.settings.horizon):
            self.noise = 0.8 * self.noise + 0.6 * self.rng.normal(size=self.noise.shape)
            action = torch.tanh(actor(self.task.observe(states[-1]))).double().numpy()
            action = np.clip(action + exploration * self.noise, -1.0, 1.0)
            torque, force = loads_of(config, action)
            step = self.lanes.step_jacobian(torque, config.dt, config.substeps, force=force)
            set_states(config, self.lanes, slice(None), np.hstack([step.theta, step.omega]))
            states.append(self.states())
            actions.append(torch.from_numpy(action).float())
            jacobian = np.concatenate([step.A, of_actions(config, step.B)], axis=-1)
            jacobians.append(torch.from_numpy(jacobian).float())
        self.age += self.settings.horizon
        over = self.age >= self.settings.episode
        over |= self.task.ended(torch.stack(states, 1)).any(1).numpy()
        self.age[over] = 0
        self.restart(np.flatnonzero(over))
        nothing = torch.zeros(len(self.noise), 0)
        return Horizons(*(torch.stack(p, 1) for p in (states, actions, jacobians)), context=nothing)

    def states(self) -> torch.Tensor:
        """Return the states of all lanes, (lanes, 2c)."""
        return torch.from_numpy(states_of(self.config, self.lanes)).float()
