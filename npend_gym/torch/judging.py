"""What is told of states, as tensors: observations, and the quantities that modes judge by."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from torch import Tensor

from npend_gym._checks import FloatArray
from npend_gym.chain import ChainParameters
from npend_gym.envs import EnvConfig, Mode, Quantities
from npend_gym.envs.episodes import Beginnings
from npend_gym.physics.energy import kinetic_from, lift_from
from npend_gym.torch.autograd import SinCos, applied


class Lanes(NamedTuple):
    """What the episodes of the lanes began with, as tensors: a leading axis of B, or of 1."""

    rows: ChainParameters  # of arrays
    chains: Any  # the same of tensors
    bobs: bool  # whether all are point masses on massless rods
    lift: Tensor  # (B, n), that of `Chain`
    height_per_lift: Tensor  # 1/(kg m), (B,)
    tip_weights: Tensor  # what the cosine of each rod adds to the height of the tip, (B, n)
    lifting_energy: Tensor  # J, (B,)
    limits: Tensor  # of the torque, (B, joints)
    goals: Tensor  # (B, n), or (B, 0)
    context: Tensor  # (B, k), within -1 to 1

    @classmethod
    def of(
        cls, began: Beginnings, config: EnvConfig, device: torch.device, *, alike: bool
    ) -> Lanes:
        """Return what episodes began with; of the first lane only where all chains are alike."""

        def put(values: FloatArray) -> Tensor:
            return torch.from_numpy(values).to(device)

        chains, limits = began.chains, began.limits
        if alike:
            chains = ChainParameters(*(field[:1] for field in chains))
            limits = limits[:1]
        lift = put(chains.lift)
        return cls(
            chains,
            ChainParameters(*(put(field.copy()) for field in chains)),  # type: ignore[arg-type]
            bool(np.all(chains.has_bobs)),
            lift,
            0.5 / lift.sum(-1),
            put(-chains.lengths / chains.lengths.sum(-1, keepdims=True)),
            put(chains.lifting_energy),
            put(limits),
            put(began.goals),
            put(config.randomization.normalised(began.context)),
        )


class State(NamedTuple):
    """Angles and velocities with what follows from them, (B, n)."""

    theta: Tensor
    omega: Tensor
    sin: Tensor
    cos: Tensor
    kinetic_energy: Tensor  # J, (B,)
    lift: Tensor  # potential energy over gravity [kg m], (B,)
    energy: Tensor  # J, (B,)

    @classmethod
    def of(cls, theta: Tensor, omega: Tensor, lanes: Lanes) -> State:
        """Return the states of chains."""
        sines, cosines = applied(SinCos, theta)
        half_sines = applied(SinCos, 0.5 * theta)[0]
        kinetic = kinetic_from(lanes.chains, sines, cosines, omega, bobs=lanes.bobs)
        lift = lift_from(lanes.lift, half_sines)
        energy = kinetic + lanes.chains.gravity * lift
        return cls(theta, omega, sines, cosines, kinetic, lift, energy)


def quantities(
    state: State, lanes: Lanes, start_energy: Tensor, squares: Tensor
) -> Quantities[Any]:
    """Return what a mode judges by.

    `start_energy` is what energies are a fraction of [J], `squares` the mean squared action.
    """
    none = torch.zeros_like(start_energy)
    closeness = distance = none
    if lanes.goals.shape[1] > 0:
        away, weights = (state.cos - lanes.goals).abs(), lanes.lift.abs()
        closeness = 1.0 - 0.5 * (weights * away).sum(-1) / weights.sum(-1)
        distance = away.amax(-1)
    return Quantities(
        height=state.lift * lanes.height_per_lift,
        tip=(lanes.tip_weights * state.cos).sum(-1),
        energy=state.energy / lanes.lifting_energy,
        kinetic_energy=state.kinetic_energy / lanes.lifting_energy,
        energy_fraction=state.energy / start_energy,
        mean_squared_action=squares,
        closeness=closeness,
        goal_distance=distance,
        rail_position=none,
        theta=cast("Any", state.theta),
        omega=cast("Any", state.omega),
    )


def judge(mode: Mode, judged: Quantities[Any], *, sparse: bool) -> tuple[Tensor, Tensor, Tensor]:
    """Return reward, failed and achieved by the formulas of a mode, (B,) each."""
    shape = judged.height.shape
    with torch.no_grad():
        plain = Quantities(*(cast("Any", x).detach() for x in judged))
        failed, achieved = (
            torch.as_tensor(x, dtype=torch.bool).expand(shape)
            for x in (mode.failed(plain), mode.achieved(plain))
        )
    reward = achieved.to(torch.float64) if sparse else mode.reward(judged)
    return torch.as_tensor(reward).expand(shape), failed, achieved


def observe(config: EnvConfig, state: State, lanes: Lanes) -> Tensor:
    """Return the observations of an environment, (B, numbers), float64."""
    if config.with_sines:
        speeds, limit = state.omega, config.speed_limit
        if config.observation == "scaled":
            factors = torch.from_numpy(1.0 / config.speed_scale).to(speeds.device)
            speeds = (speeds * factors).clamp(-limit, limit)
        parts = [state.sin, state.cos, speeds]
    else:
        turns = torch.floor((state.theta.detach() + math.pi) / (2.0 * math.pi))
        parts = [state.theta - 2.0 * math.pi * turns, state.omega]
    if not config.observe_velocities:
        parts.pop()
    if config.observes_goals:
        parts.append(lanes.goals)
    if config.observe_context:
        parts.append(lanes.context)
    return torch.cat(parts, dim=-1)
