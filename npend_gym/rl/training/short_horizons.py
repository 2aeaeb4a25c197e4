"""What `shac` learns from: short horizons, simulated with the Jacobians of their steps."""

# torch's stubs leave parts unknown
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import ChainParameters
from npend_gym.envs import EnvConfig
from npend_gym.envs.episodes import Episodes
from npend_gym.envs.modes import Calm
from npend_gym.envs.outputs import EpisodeStarts
from npend_gym.physics import DifferentiableEnsemble
from npend_gym.physics.energy import lift_from
from npend_gym.rl.controllers.step_model import (
    joined,
    loads_of,
    motors,
    of_actions,
    set_states,
    states_of,
)
from npend_gym.rl.evaluation.performance import UP
from npend_gym.rl.evaluation.seeds import episode_seeds
from npend_gym.rl.training.knock_downs import knocked_down
from npend_gym.rl.training.tasks import observation_scale
from npend_gym.torch.judging import Lanes, TensorState, judge, observe

# Of `Lanes`, beside the chains
_OF_LANES = (
    "lift", "height_per_lift", "tip_weights", "lifting_energy", "mass", "goals", "context",
)  # fmt: skip
_UP_WIDTH = 0.04  # of the length, within which `uptime` begins to pay
_TOO_FAST = 20.0  # steps upright that a joint at twice the `max_speed` costs in a step
_MIDDLE = 0.5  # of half the rail, where carts start


class TensorTask:
    """Observations and rewards of an environment as functions of states and actions, in torch.

    States (q, u), (..., 2c), are angles and the place of a cart, then the rates of these. Contexts,
    (..., k), say what differs between episodes: chains that were drawn, and goals; where nothing
    does, k is 0.
    """

    def __init__(
        self,
        config: EnvConfig,
        gamma: float,
        obs_scale: tuple[float, float, float],
        uptime: float = 0.0,
        max_speed: float = 0.0,
    ) -> None:
        self.config: EnvConfig = config
        self.gamma: float = gamma
        self.uptime: float = uptime
        self.max_speed: float = max_speed
        self.varied: bool = bool(config.randomization.names) or config.mode.has_goals
        self.obs_scale: torch.Tensor = observation_scale(config, obs_scale)
        # of the states: near pi a sine is its angle; on a cart a metre is as far as a length
        of_q = torch.ones(config.state_size // 2)
        of_q[config.n :] = config.chain.total_length
        self.state_scale: torch.Tensor = torch.cat([of_q, obs_scale[2] * of_q])
        self.start: float = config.amplitude + 0.5 * config.spread  # of a release
        episodes = Episodes(config, 1)
        episodes.seeds.read_keys(np.arange(1))  # no seed is chosen, and modes in Python need one
        episodes.start(np.ones(1, np.bool_))
        began = episodes.beginnings()
        self._own = self._lanes_of(began)
        self._parts = [part.float() for part in _parts(self._own)]
        self._own = self._with(self._parts)
        self.inputs: int = len(self.obs_scale)  # of the actor
        drawn = 0 if config.observe_context else len(config.randomization.names)
        self.judged: int = self.inputs + drawn  # of the critic
        if config.reward_type == "dense":
            self._check_gradient(self.context_of(began))

    def _lanes_of(self, began: EpisodeStarts) -> Lanes:
        return Lanes.of(began, self.config, torch.device("cpu"), alike=not self.varied)

    def context_of(self, began: EpisodeStarts) -> torch.Tensor:
        """Return the contexts of episodes, (B, k), float32."""
        if not self.varied:
            return torch.zeros(len(began.state), 0)
        parts = _parts(self._lanes_of(began))
        rows = [part if part.ndim > 1 else part[:, None] for part in parts]
        return torch.cat(rows, 1).float()

    def _with(self, parts: list[torch.Tensor]) -> Lanes:
        count = len(self._own.chains)
        of_lanes = dict(zip(_OF_LANES, parts[count:], strict=True))
        chains: Any = ChainParameters(*parts[:count])  # pyright: ignore[reportArgumentType]
        return self._own._replace(chains=chains, **of_lanes)

    def _lanes(self, context: torch.Tensor) -> Lanes:
        """Context of episodes, as `context_of` has it."""
        if not self.varied:
            return self._own
        widths = [part.shape[1] if part.ndim > 1 else 1 for part in self._parts]
        parts = zip(context.split(widths, dim=-1), self._parts, strict=True)
        return self._with([part if like.ndim > 1 else part[..., 0] for part, like in parts])

    def _state(self, states: torch.Tensor, context: torch.Tensor) -> TensorState:
        q, u = states.chunk(2, dim=-1)
        return TensorState(q, u, self._lanes(context), _sincos)

    def _check_gradient(self, context: torch.Tensor) -> None:
        """Raise a ValueError where a mode of the user's own has a reward without a gradient."""
        states = torch.full((1, self.config.state_size), 0.5, requires_grad=True)
        actions = torch.zeros(1, self.config.joints.size)
        try:
            if self.reward(states, actions, context).requires_grad:
                return
        except RuntimeError as error:  # of PyTorch, where NumPy takes a tensor
            if "numpy()" not in str(error):
                raise
        raise ValueError(
            f"reward of mode {self.config.mode.name!r} must have a gradient for shac: write it "
            "with + - * /, ** and abs, without functions of NumPy; or train by an algorithm "
            "without gradients"
        )

    def observe(self, states: torch.Tensor, context: torch.Tensor) -> torch.Tensor:
        """Return the observations, (..., inputs), over their scale."""
        state = self._state(states, context)
        return observe(self.config, state) / self.obs_scale

    def critic_inputs(self, states: torch.Tensor, context: torch.Tensor) -> torch.Tensor:
        """Inputs of the critic, (..., judged): it knows the chain."""
        seen = self.observe(states, context)
        if self.judged == self.inputs:
            return seen
        return torch.cat([seen, self._lanes(context).context], -1)

    def ended(self, states: torch.Tensor, context: torch.Tensor) -> torch.Tensor:
        """Return where an episode terminates, (...): off the rail, or where the mode says so."""
        return self._judge(states, torch.zeros_like(states[..., :1]), context)[1]

    def reward(
        self, states: torch.Tensor, actions: torch.Tensor, context: torch.Tensor
    ) -> torch.Tensor:
        """Return the rewards (...) of steps to `states`, times 1 - gamma: values are below 1.

        A share `uptime` of them is for a tip above the line of `recovery`. Joints faster than
        `max_speed` [rad/s] cost reward.
        """
        reward = self._judge(states, actions, context)[0]
        if self.uptime > 0.0:
            cosines, weights = states[..., : self.config.n].cos(), self._lanes(context).tip_weights
            above = (weights * cosines).sum(-1) - UP
            reward = (1.0 - self.uptime) * reward + self.uptime * (above / _UP_WIDTH).sigmoid()
        if self.max_speed > 0.0:
            omega = states.chunk(2, dim=-1)[1][..., : self.config.n]
            joints = omega.diff(dim=-1, prepend=torch.zeros_like(omega[..., :1])).abs()
            reward = reward - _TOO_FAST * (joints / self.max_speed - 1.0).clamp(min=0.0).sum(-1)
        return (1.0 - self.gamma) * reward

    def _judge(
        self, states: torch.Tensor, actions: torch.Tensor, context: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        state = self._state(states, context)
        lanes, squares = state.lanes, actions.square().mean(-1)
        released = torch.full_like(state.theta, self.start)
        start = lanes.chains.gravity * lift_from(lanes.lift, (0.5 * released).sin())
        start = torch.where(start > 0.0, start, lanes.lifting_energy)  # as environments have it
        reward, failed, _ = judge(self.config, state, start, squares)
        return reward, failed


def _parts(lanes: Lanes) -> list[Any]:
    return [*lanes.chains, *(getattr(lanes, name) for name in _OF_LANES)]


def _sincos(angles: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    return angles.sin(), angles.cos()


class Horizons(NamedTuple):
    """Steps that were simulated, float32; the leading axes are horizon and step."""

    states: torch.Tensor  # (..., 2c), one more than steps
    actions: torch.Tensor  # (..., m)
    jacobians: torch.Tensor  # of the state after a step by state and action, (..., 2c, 2c + m)
    context: torch.Tensor  # what was drawn for the episode, (horizons, k)


class Collector:
    """Simulates many lanes with the actor and noise, and keeps the Jacobians of all steps."""

    changes: tuple[str, ...] = ("rng", "numbers", "states", "noise", "age")

    def __init__(self, config: EnvConfig, task: TensorTask, settings: Any) -> None:
        self.config: EnvConfig = config
        self.task: TensorTask = task
        self.settings: Any = settings  # of `shac`
        self.rng: np.random.Generator = np.random.default_rng(settings.seed)
        size = settings.num_envs
        self.episodes: Episodes = Episodes(config, size)
        first = episode_seeds("training", size, run=settings.seed, spacing=1000).start
        everywhere = np.ones(size, np.bool_)
        self.episodes.seed(first, everywhere)
        self.lanes: DifferentiableEnsemble = DifferentiableEnsemble(
            config.with_all_features, size, joints=motors(config)
        )
        self.noise = np.zeros((size, config.joints.size))
        self.knocked = np.zeros((0, config.state_size))  # states to start from
        if settings.knocked > 0.0:
            self.knocked: FloatArray = knocked_down(
                config, self.rng, rule=settings.rule, turns=settings.turns
            )
        self.restart(everywhere)
        self.age: NDArray[np.int64] = self.rng.integers(0, settings.episode, size)

    @property
    def numbers(self) -> FloatArray:
        """The numbers of the episodes, which determine their random draws."""
        return self.episodes.numbers

    @numbers.setter
    def numbers(self, values: FloatArray) -> None:
        self.episodes.numbers = values - 1.0
        self._begin(np.ones(len(values), np.bool_))

    @property
    def states(self) -> FloatArray:
        """The states of all sub-environments, (lanes, 2c)."""
        return states_of(self.config, self.lanes)

    @states.setter
    def states(self, values: FloatArray) -> None:
        set_states(self.config, self.lanes, slice(None), values)

    def restart(self, mask: BoolArray) -> None:
        """Begin new episodes: a quarter as the task does, a quarter near its goal, half anywhere.

        A share of all, `settings.knocked`, begins just after the chain was disturbed instead. Where
        an episode would be over at once, it begins as the task does.
        """
        began = self._begin(mask)
        config, rng, settings = self.config, self.rng, self.settings
        lanes, n, rates = np.flatnonzero(mask), config.n, config.state_size // 2
        theta, omega, of_cart = np.split(began.state[lanes], (n, 2 * n), axis=1)
        own = joined(theta, omega, of_cart.T)
        shape, kind = theta.shape, rng.integers(4, size=(lanes.size, 1))
        goal = np.where(began.goals[lanes] < 0.0, math.pi, 0.0)
        if not config.mode.has_goals:
            goal = np.full(shape, 0.0 if isinstance(config.mode, Calm) else math.pi)
        anywhere = rng.uniform(-math.pi, math.pi, shape), rng.normal(0.0, settings.speed, shape)
        near = rng.normal(goal, 0.3), rng.normal(0.0, 1.0, shape)
        states, columns = own.copy(), (slice(n), slice(rates, rates + n))
        for part, *drawn in zip(columns, near, anywhere, strict=True):
            states[:, part] = np.where(kind == 0, own[:, part], np.where(kind == 1, *drawn))
        if config.rail is not None:  # a cart is anywhere on the middle of its rail
            own[:, n] = states[:, n] = config.rail * rng.uniform(-_MIDDLE, _MIDDLE, lanes.size)
            states[:, -1] *= 0.0
        if len(self.knocked):
            down = rng.random(lanes.size) < settings.knocked
            states[down] = self.knocked[rng.integers(len(self.knocked), size=down.sum())]
        over = self.task.ended(torch.from_numpy(states).float(), self.context[lanes]).numpy()
        states[over] = own[over]
        set_states(config, self.lanes, lanes, states)
        self.noise[lanes] = 0.0

    def _begin(self, mask: BoolArray) -> EpisodeStarts:
        """Draw what belongs to new episodes."""
        self.episodes.start(mask)
        began = self.episodes.beginnings()
        self.context: torch.Tensor = self.task.context_of(began)
        self.limits: FloatArray = began.limits
        if self.config.randomization.names:
            rows = ChainParameters(*(field[mask] for field in began.chains))
            self.lanes.set_chain(np.flatnonzero(mask), rows)
        return began

    @torch.no_grad()
    def collect(self, actor: nn.Module, exploration: float) -> Horizons:
        """Return a horizon of every environment; `exploration` is the deviation of the noise."""
        states, actions, jacobians = [self._tensors()], [], []
        config, context, limits = self.config, self.context, self.limits
        for _ in range(self.settings.horizon):
            self.noise: FloatArray = 0.8 * self.noise + 0.6 * self.rng.normal(size=self.noise.shape)
            action = torch.tanh(actor(self.task.observe(states[-1], context))).double().numpy()
            action = np.clip(action + exploration * self.noise, -1.0, 1.0)
            torque, force = loads_of(config, action, limits)
            step = self.lanes.step_jacobian(torque, config.dt, config.substeps, force=force)
            self.states = np.hstack([step.theta, step.omega])
            states.append(self._tensors())
            actions.append(torch.from_numpy(action).float())
            jacobian = np.concatenate([step.A, of_actions(config, step.B, limits)], axis=-1)
            jacobians.append(torch.from_numpy(jacobian).float())
        self.age += self.settings.horizon
        stacked = torch.stack(states, 1)
        over = self.age >= self.settings.episode
        over |= self.task.ended(stacked, context[:, None]).any(1).numpy()
        self.age[over] = 0
        if over.any():
            self.restart(over)
        return Horizons(stacked, torch.stack(actions, 1), torch.stack(jacobians, 1), context)

    def _tensors(self) -> torch.Tensor:
        return torch.from_numpy(self.states).float()
