"""What is told of states, as tensors: observations, and the quantities that modes judge by."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from torch import Tensor

from npend_gym.chain import ChainParameters
from npend_gym.envs import EnvConfig, Mode, Quantities
from npend_gym.physics.energy import kinetic_from, lift_from
from npend_gym.torch.autograd import SinCos


class Lanes(NamedTuple):
    """What the episodes of the lanes began with, as tensors.

    The leading axis is B, or 1 where all lanes are the same.
    """

    chains: Any  # ChainParameters of tensors
    lift: Tensor  # (B, n), that of `Chain`
    per_energy: Tensor  # 1/J, (B,)
    limits: Tensor  # of the torque, (B, joints)
    goals: Tensor  # (B, n), or (B, 0)
    context: Tensor  # (B, k), within -1 to 1

    def to(self, device: torch.device) -> Lanes:
        """Return the same on a device."""
        chains = ChainParameters(*(field.to(device) for field in self.chains))
        return Lanes(chains, *(tensor.to(device) for tensor in self[1:]))


class State(NamedTuple):
    """Angles and velocities with what follows from them, (B, n)."""

    theta: Tensor
    omega: Tensor
    sin: Tensor
    cos: Tensor
    kinetic: Tensor  # J, (B,)
    lift: Tensor  # potential energy over gravity [kg m], (B,)

    @classmethod
    def of(cls, theta: Tensor, omega: Tensor, lanes: Lanes) -> State:
        """Return the states of chains."""
        s, c = cast("tuple[Tensor, Tensor]", SinCos.apply(theta))
        halves = cast("tuple[Tensor, Tensor]", SinCos.apply(0.5 * theta))
        kinetic = kinetic_from(lanes.chains, s, c, omega)
        return cls(theta, omega, s, c, kinetic, lift_from(lanes.lift, halves[0]))

    def energy(self, lanes: Lanes) -> Tensor:
        """Return the energy above hanging at rest [J], (B,)."""
        return self.kinetic + lanes.chains.gravity * self.lift


def lanes_of(
    chains: ChainParameters, limits: Any, goals: Any, context: Any, *, alike: bool
) -> Lanes:
    """Return what episodes began with, as tensors; of the first lane only where all are alike."""
    rows = slice(0, 1) if alike else slice(None)
    chains = ChainParameters(*(field[rows] for field in chains))
    return Lanes(
        ChainParameters(*(torch.from_numpy(np.array(field)) for field in chains)),  # type: ignore[arg-type]
        torch.from_numpy(chains.lift),
        torch.from_numpy(1.0 / chains.lifting_energy),
        torch.from_numpy(limits[rows]),
        torch.from_numpy(goals),
        torch.from_numpy(context),
    )


def quantities(
    state: State, lanes: Lanes, start_energy: Tensor, squares: Tensor
) -> Quantities[Tensor]:
    """Return what a mode judges by; `squares` is the mean squared action."""
    length = lanes.chains.lengths.sum(-1)
    energy = state.energy(lanes)
    at_start = torch.where(start_energy > 0.0, start_energy, 1.0 / lanes.per_energy)
    closeness = distance = torch.zeros_like(energy)
    if lanes.goals.shape[1] > 0:
        away, weights = (state.cos - lanes.goals).abs(), lanes.lift.abs()
        closeness = 1.0 - 0.5 * (weights * away).sum(-1) / weights.sum(-1)
        distance = away.amax(-1)
    return Quantities(
        height=0.5 * state.lift / lanes.lift.sum(-1),
        tip=-(lanes.chains.lengths * state.cos).sum(-1) / length,
        energy=energy * lanes.per_energy,
        kinetic_energy=state.kinetic * lanes.per_energy,
        energy_fraction=energy / at_start,
        mean_squared_action=squares,
        closeness=closeness,
        goal_distance=distance,
        rail_position=torch.zeros_like(energy),
        theta=state.theta,  # type: ignore[arg-type]
        omega=state.omega,  # type: ignore[arg-type]
    )


def judge(mode: Mode, judged: Quantities[Tensor], *, sparse: bool) -> tuple[Tensor, Tensor, Tensor]:
    """Return reward, failed and achieved by the formulas of a mode, (B,) each."""
    with torch.no_grad():
        plain = Quantities(*(x.detach() for x in judged))  # type: ignore[attr-defined]
        failed, achieved = (
            torch.as_tensor(x, dtype=torch.bool).expand(judged.height.shape)
            for x in (mode.failed(plain), mode.achieved(plain))
        )
    reward = achieved.to(torch.float64) if sparse else mode.reward(judged)
    return torch.as_tensor(reward).expand(judged.height.shape), failed, achieved


def observe(config: EnvConfig, state: State, lanes: Lanes) -> Tensor:
    """Return the observations of an environment, (B, numbers), float64."""
    if config.with_sines:
        speeds = state.omega * torch.from_numpy(1.0 / config.speed_scale).to(state.omega.device)
        limit = config.speed_limit
        parts = [state.sin, state.cos, speeds.clamp(-limit, limit)]
    else:
        turns = torch.floor((state.theta.detach() + math.pi) / (2.0 * math.pi))
        parts = [state.theta - 2.0 * math.pi * turns, state.omega]
    if config.observes_goals:
        parts.append(lanes.goals)
    if config.observe_context:
        parts.append(lanes.context)
    return torch.cat(parts, dim=-1)
