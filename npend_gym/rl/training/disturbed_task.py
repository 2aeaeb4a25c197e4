"""What a policy with memory sees of random chains through noisy and late sensors, in torch."""

# torch's stubs leave parts unknown
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

from typing import Any

import numpy as np
import torch

from npend_gym.envs import EnvConfig
from npend_gym.envs.starts import Draw
from npend_gym.rl.training.short_horizons import Task

OF_CHAIN = ("masses", "lengths", "gravity", "damping")
OF_LANE = ("max_torque", "observation_delay", "angle_noise", "velocity_noise", "torque_noise")


class DisturbedTask(Task):
    """The observations and rewards of an environment that draws its chain and its sensors.

    What the environment draws for an episode, ``info["context"]``, is the last axis of `context`.

    Attributes
    ----------
    length : int
        Number of observations that the actor is given.
    past : int
        Number of steps before the present one that these observations depend on.
    to_inputs : Tensor, shape (inputs, inputs)
        The frames of a `History` times this are what the network is given: the newest observation,
        and by how much the others changed from each to the next. Angular velocities are then as
        easy to find in the angles as in what is observed of them.
    """

    def __init__(self, config: EnvConfig, settings: Any) -> None:
        super().__init__(config, settings.gamma, settings.obs_scale)
        if config.joints.tolist() != [0] or not self.bobs or config.has_cart:
            raise ValueError(
                "the chain must be point masses on massless rods, with one motor at the base"
            )
        random = config.randomization
        self.columns = {name: _columns(random.names, name) for name in (*OF_CHAIN, *OF_LANE)}
        known = sum(len(places) for places in self.columns.values())
        if known < len(random.names):
            raise ValueError(
                f"randomize must have keys among {', '.join(self.columns)}; got {random.names}"
            )
        self.config, self.length = config, settings.length
        self.whole_delay = int(config.largest["observation_delay"])
        self.past = self.length + self.whole_delay
        self.inputs, self.contexts = self.length * (3 * self.n + 1), len(random.names)
        low, high = torch.from_numpy(random.draws[:, [Draw.LOW, Draw.HIGH]]).float().T
        self.middle, self.half = 0.5 * (low + high), (0.5 * (high - low)).clamp(min=1e-9)
        self.to_inputs = differences(self.length, self.obs_scale, settings.change_scale)

    def values(self, name: str, context: Any) -> Any:
        """Return the drawn values of a parameter, (..., numbers), or those that all lanes have."""
        if self.columns[name]:
            return context[..., self.columns[name]]
        owner = self.config.chain if name in OF_CHAIN else self.config
        always = np.atleast_1d(getattr(owner, name))
        return torch.from_numpy(always.copy()).float() if torch.is_tensor(context) else always

    def judge(self, states: torch.Tensor, context: torch.Tensor) -> torch.Tensor:
        """Return what the critic is given: the true state, and what was drawn for the episode."""
        return torch.cat([self.observe(states), (context - self.middle) / self.half], dim=-1)

    def reward(
        self, states: torch.Tensor, actions: torch.Tensor, context: torch.Tensor
    ) -> torch.Tensor:
        """Return the rewards (...) of steps to `states`, times 1 - gamma: values are below 1."""
        masses, lengths = self.values("masses", context), self.values("lengths", context)
        lift = lengths * masses.flip(-1).cumsum(-1).flip(-1)
        chain: Any = self.chain._replace(masses=masses, lengths=lengths)
        unit = 2.0 * self.values("gravity", context)[..., 0] * lift.sum(-1)
        return self._reward(chain, lift, unit, states, actions)

    def sense(
        self, states: list[torch.Tensor], context: torch.Tensor, noise: torch.Tensor
    ) -> torch.Tensor:
        """Return the observations, (B, 3n), at the last of `states`, each (B, 2n).

        As `npend_gym.envs.sensors` does: late, with `noise`, (B, 2n), over its deviation.
        """
        delay = self.values("observation_delay", context)
        newer, older = states[-1], states[-2]
        for whole in range(1, self.whole_delay + 1):
            later = delay >= whole
            newer = torch.where(later, states[-1 - whole], newer)
            older = torch.where(later, states[-2 - whole], older)
        s, dt = 1.0 - delay % 1.0, self.config.dt
        (theta, omega), (theta0, omega0) = newer.split(self.n, -1), older.split(self.n, -1)
        turned, first, last = theta - theta0, dt * omega0, dt * omega
        bend, twist = 3.0 * turned - 2.0 * first - last, first + last - 2.0 * turned
        theta = theta0 + s * (first + s * (bend + s * twist))
        omega = (first + s * (2.0 * bend + s * (3.0 * twist))) / dt
        theta = theta + self.values("angle_noise", context) * noise[:, : self.n]
        omega = omega + self.values("velocity_noise", context) * noise[:, self.n :]
        return torch.cat([theta.sin(), theta.cos(), omega], dim=-1)

    def frames(self, observations: list[torch.Tensor], actions: list[torch.Tensor]) -> torch.Tensor:
        """Return what the actor is given, (B, inputs), after observations and actions."""
        pairs = zip(observations[::-1], actions[::-1], strict=False)
        newest = [part for _, pair in zip(range(self.length), pairs, strict=False) for part in pair]
        return torch.cat(newest, dim=-1) @ self.to_inputs


def _columns(names: tuple[str, ...], name: str) -> list[int]:
    """Return where a parameter is in the context."""
    return [k for k, each in enumerate(names) if each.partition("[")[0] == name]


def differences(
    length: int, obs_scale: torch.Tensor, change_scale: tuple[float, float, float]
) -> torch.Tensor:
    """Return the matrix that makes frames, a row, the present observation and its past changes."""
    joints, size = 1, len(obs_scale)
    changes = torch.tensor(change_scale).repeat_interleave(size // 3)
    matrix = torch.zeros(length, size + joints, length, size + joints)
    entries = torch.arange(size)
    for j in range(length):
        matrix[j, size:, j, size:] = torch.eye(joints)
        matrix[j, entries, j, entries] = 1.0 / (changes if j > 0 else obs_scale)
        if j > 0:
            matrix[j - 1, entries, j, entries] = -1.0 / changes
    return matrix.reshape(length * (size + joints), -1)
