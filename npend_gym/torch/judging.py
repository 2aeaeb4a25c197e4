"""The results of states, as tensors: observations, and the quantities that modes judge by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from torch import Tensor

from npend_gym._checks import FloatArray
from npend_gym.chain import ChainParameters
from npend_gym.envs import EnvConfig, Quantities
from npend_gym.envs.config import task_numbers
from npend_gym.envs.goals import MAX_KINETIC_ENERGY
from npend_gym.envs.outputs import EpisodeStarts
from npend_gym.envs.rows import Setting
from npend_gym.envs.user_modes import returned_by
from npend_gym.physics.energy import kinetic_from, kinetic_on_cart, lift_from
from npend_gym.torch.laws import exact_sincos, laws


class Lanes(NamedTuple):
    """What the episodes of the lanes began with, as tensors: a leading axis of B, or of 1."""

    rows: ChainParameters  # of arrays
    chains: Any  # the same of tensors
    bobs: bool  # whether all are point masses on massless rods
    lift: Tensor  # (B, n), that of `Chain`
    height_per_lift: Tensor  # 1/(kg m), (B,)
    tip_weights: Tensor  # what the cosine of each rod adds to the height of the tip, (B, n)
    lifting_energy: Tensor  # J, (B,)
    mass: Tensor  # of chain and cart [kg], (B,)
    limits: Tensor  # of the torques, and of the force on a cart, (B, joints)
    goals: Tensor  # (B, n), or (B, 0)
    context: Tensor  # (B, k), within -1 to 1
    numbers: Tensor  # of the rows of `Setting` among others, which laws read, (rows, B, 1)
    task: list[float]  # entries of `Task`
    per_speed: Any  # s/rad, by which the observed angular velocities are multiplied, (n,) or 1

    @classmethod
    def of(
        cls, began: EpisodeStarts, config: EnvConfig, device: torch.device, *, alike: bool
    ) -> Lanes:
        """EpisodeStarts of episodes; of the first environment only where all chains are alike."""

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
            put(chains.masses.sum(-1) + (config.cart_mass or 0.0)),
            put(limits),
            put(began.goals),
            put(config.randomization.normalised(began.context)),
            torch.from_numpy(began.numbers[..., None]),
            task_numbers(config).tolist(),
            put(1.0 / config.speed_scale) if config.observation == "scaled" else 1.0,
        )

    def setting(self, name: str) -> Tensor:
        """Values of a setting of motors or sensors, (B,)."""
        return self.numbers[getattr(Setting, name), :, 0]


@dataclass(frozen=True)
class TensorState:
    """Coordinates and rates, (..., c), of angles and of a cart, with what follows from them."""

    q: Tensor
    u: Tensor
    lanes: Lanes
    sincos: Callable[[Tensor], tuple[Tensor, Tensor]] = exact_sincos

    @property
    def n(self) -> int:
        """Number of rods."""
        return self.lanes.lift.shape[-1]

    @property
    def theta(self) -> Tensor:
        """Angles [rad], (..., n)."""
        return self.q[..., : self.n]

    @property
    def omega(self) -> Tensor:
        """Angular velocities [rad/s], (..., n)."""
        return self.u[..., : self.n]

    @property
    def place(self) -> Tensor:
        """Place of the cart [m], (..., 1), or (..., 0) without one."""
        return self.q[..., self.n :]

    @property
    def velocity(self) -> Tensor:
        """Velocity of the cart [m/s], (..., 1), or (..., 0) without one."""
        return self.u[..., self.n :]

    @cached_property
    def sines(self) -> tuple[Tensor, Tensor]:
        """Sines and cosines of the angles."""
        return self.sincos(self.theta)

    @property
    def cos(self) -> Tensor:
        """Cosines of the angles."""
        return self.sines[1]

    @cached_property
    def kinetic_energy(self) -> Tensor:
        """Kinetic energy [J], (...)."""
        lanes, (sines, cosines) = self.lanes, self.sines
        kinetic = kinetic_from(lanes.chains, sines, cosines, self.omega, bobs=lanes.bobs)
        if self.velocity.shape[-1] == 0:
            return kinetic
        momentum = (lanes.lift * cosines * self.omega).sum(-1)
        return kinetic_on_cart(kinetic, momentum, lanes.mass, self.velocity[..., 0])

    @cached_property
    def lift(self) -> Tensor:
        """Potential energy over gravity [kg m], (...)."""
        return lift_from(self.lanes.lift, self.sincos(0.5 * self.theta)[0])

    @cached_property
    def energy(self) -> Tensor:
        """Energy [J], (...)."""
        return self.kinetic_energy + self.lanes.chains.gravity * self.lift


def judge(
    config: EnvConfig, state: TensorState, start_energy: Tensor, squares: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Return reward, failed and achieved by the formulas of an environment's mode, (...) each.

    `start_energy` is what energies are a fraction of [J], `squares` the mean squared action.
    """
    mode, judged = config.mode, _quantities(state, start_energy, squares, config.rail)
    shape = judged.height.shape
    with torch.no_grad():
        plain = Quantities(*(cast("Any", x).detach() for x in judged))
        failed, achieved = (
            torch.as_tensor(x, dtype=torch.bool).expand(shape)
            for x in (returned_by(mode, method, plain) for method in ("failed", "achieved"))
        )
    sparse = config.reward_type == "sparse"
    reward = 0.0 if sparse else torch.as_tensor(returned_by(mode, "reward", judged)).expand(shape)
    place, uprightness = judged.rail_position, judged.uprightness
    return laws.ruled(state.lanes.task, place, uprightness, reward, failed, achieved)  # pyright: ignore[reportReturnType]


def _quantities(
    state: TensorState, start_energy: Tensor, squares: Tensor, rail: float | None
) -> Quantities[Any]:
    lanes = state.lanes
    none = torch.zeros_like(start_energy)
    closeness = distance = none
    if lanes.goals.shape[-1] > 0:
        away, weights = (state.cos - lanes.goals).abs(), lanes.lift.abs()
        closeness = 1.0 - 0.5 * (weights * away).sum(-1) / weights.sum(-1)
        distance = away.amax(-1)
    tip, reach = ((lanes.tip_weights * each).sum(-1) for each in (state.cos, state.sines[0]))
    return Quantities(
        height=state.lift * lanes.height_per_lift,
        tip=tip,
        energy=state.energy / lanes.lifting_energy,
        kinetic_energy=state.kinetic_energy / lanes.lifting_energy,
        energy_fraction=state.energy / start_energy,
        mean_squared_action=squares,
        closeness=closeness,
        goal_distance=distance,
        rail_position=none if rail is None else state.place[..., 0] / rail,
        uprightness=-state.cos.amax(-1),
        tip_distance=torch.hypot(reach, 1.0 - tip),
        cart_velocity=none if rail is None else state.velocity[..., 0],
        theta=cast("Any", state.theta),
        omega=cast("Any", state.omega),
    )


def observe(config: EnvConfig, state: TensorState) -> Tensor:
    """Return the observations of an environment, (..., numbers)."""
    lanes = state.lanes
    shown = {"speeds": state.omega, "goals": lanes.goals, "context": lanes.context}
    if config.with_sines:
        shown["sines"], shown["cosines"] = state.sines
        shown["speeds"] = laws.speed_entry(state.omega, lanes.per_speed, lanes.task)
    else:
        shown["angles"] = laws.angle_entry(state.theta)
    if config.has_cart:
        entries = laws.cart_entries(state.place, state.velocity, lanes.task)
        shown["cart"] = torch.cat(entries, dim=-1) if config.observe_velocities else entries[0]
    return torch.cat([shown[name] for name in config.columns], dim=-1)


def with_goals(observation: Tensor, state: TensorState) -> dict[str, Tensor]:
    """Return observations with what has been achieved, and what is desired, as a `goal_env`."""
    lanes = state.lanes
    kinetic = (state.kinetic_energy / lanes.lifting_energy).clamp(max=MAX_KINETIC_ENERGY)
    at_rest = torch.zeros_like(kinetic)[:, None]
    return {
        "observation": observation,
        "achieved_goal": torch.cat([state.cos, kinetic[:, None]], dim=-1),
        "desired_goal": torch.cat([lanes.goals, at_rest], dim=-1),
    }
