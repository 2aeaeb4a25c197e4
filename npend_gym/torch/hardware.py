"""Motors and sensors that are not ideal, for tensors: what `npend_gym.envs.hardware` does.

The random numbers are drawn there. What has a gradient is computed here: the torques of late and
slow motors by the actions, and late observations by the states. Rounding counts as the identity in
gradients.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from npend_gym.compiled.philox import Keys
from npend_gym.envs import hardware
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.sensors import interpolate
from npend_gym.physics.kernels.layout import MAX_SPEED
from npend_gym.torch.judging import Lanes, wrapped

Settings = Mapping[str, Tensor]  # of the lanes, by keyword, (B,)


class Past:
    """What happened in the last steps of every lane, the newest first."""

    def __init__(self, most: float) -> None:
        self._length, self._kept = int(most) + 2, list[Tensor]()

    def begin(self, mask: Tensor, value: Tensor) -> None:
        """Let all that happened in the lanes of `mask` have been `value`."""
        kept = self._kept or [value] * self._length
        self._kept = [torch.where(mask[:, None], value, each) for each in kept]

    def add(self, value: Tensor) -> None:
        """Add what happens now."""
        self._kept = [value, *self._kept[:-1]]

    def around(self, delay: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return what was before and after a delay, in steps, (B,), and the fraction of a step."""
        whole = delay.floor()
        kept, lanes = torch.stack(self._kept), torch.arange(len(delay), device=delay.device)
        newer = kept[whole.long(), lanes]
        older = kept[(whole.long() + 1).clamp(max=self._length - 1), lanes]
        return older, newer, (delay - whole)[:, None]

    def detach(self) -> None:
        """Cut the graph."""
        self._kept = [each.detach() for each in self._kept]


class IdealMotors:
    """Motors that exert their action times the limit."""

    pieces = 1

    def __init__(self, config: EnvConfig) -> None:
        self._carts = int(config.has_cart)

    def begin(self, mask: Tensor) -> None:
        """Do nothing: these motors have no memory."""

    def act(self, action: Tensor, age: Tensor, settings: Settings) -> None:
        """Take the clipped actions, (B, joints), of a step."""
        del age, settings
        self._action = action

    def loads(self, piece: int, q: Tensor, u: Tensor, lanes: Lanes, settings: Settings) -> Tensor:
        """Return torques on joints, one at least, then the force on a cart, (B, inputs)."""
        del piece, q, u, settings
        loads = self._action * lanes.limits
        if loads.shape[1] > 0 and not self._carts:
            return loads
        force, torques = loads[:, : self._carts], loads[:, self._carts :]
        if torques.shape[1] == 0:
            torques = loads.new_zeros(len(loads), 1)
        return torch.cat([torques, force], dim=1)

    def detach(self) -> None:
        """Do nothing."""


class Motors:
    """Late, slow, noisy and rippled motors, and pushes at the tip, as `npend_gym.envs.motors`."""

    def __init__(self, config: EnvConfig, motors: hardware.Motors, keys: Keys) -> None:
        self.config, self._motors, self._keys = config, motors, keys
        self.pieces = motors.pieces
        self._past = Past(config.largest["action_delay"])
        self._joints = torch.from_numpy(config.joints)
        self._lagged = torch.zeros(1, config.joints.size, dtype=torch.float64)

    def begin(self, mask: Tensor) -> None:
        """Forget the actions of the lanes of `mask`."""
        idle = torch.zeros(len(mask), self._joints.numel(), dtype=torch.float64)
        self._past.begin(mask, idle)
        self._lagged = torch.where(mask[:, None], 0.0, self._lagged)

    def act(self, action: Tensor, age: Tensor, settings: Settings) -> None:
        """Take the clipped actions, (B, joints), of a step, and draw what disturbs it."""
        self._past.add(action)
        self._older, self._newer, self._fraction = self._past.around(settings["action_delay"])
        noise, push = self._motors.disturbances(self._keys, age.numpy(), self.config.dt)
        self._noise, self._push = torch.from_numpy(noise), torch.from_numpy(push)

    def loads(self, piece: int, q: Tensor, u: Tensor, lanes: Lanes, settings: Settings) -> Tensor:
        """Return the torques on all joints, and the force on a cart, (B, c), in a piece."""
        n, h = self.config.n, self.config.dt / self.pieces
        share = (self._fraction * self.pieces - piece).clamp(0.0, 1.0)
        action = share * self._older + (1.0 - share) * self._newer
        motors = lanes.limits * self._followed(action, share, h, settings["motor_lag"][:, None])
        half = q[:, :n] + 0.5 * h * u[:, :n]
        loads = torch.zeros_like(q)
        on_joint = self._joints < n
        phi = torch.diff(half, dim=1, prepend=torch.zeros_like(half[:, :1]))
        ripple = (settings["ripple_cycles"][:, None] * wrapped(phi)).sin()
        ripple = settings["torque_ripple"][:, None] * ripple
        added = torch.where(on_joint, self._noise + ripple[:, self._joints.clamp(max=n - 1)], 0.0)
        loads = loads.index_copy(1, self._joints, motors + added)
        levers = torch.flip(lanes.chains.lengths * half.cos(), (1,)).cumsum(1).flip(1)
        of_push = [levers, torch.ones_like(q[:, n:])]
        return loads + self._push[:, None] * torch.cat(of_push, dim=1)

    def _followed(self, action: Tensor, share: Tensor, h: float, lag: Tensor) -> Tensor:
        """Return the mean of what the motors follow in a piece, and follow to its end.

        Exact for lag y' = u - y with the command u older at first, then newer.
        """
        per_lag = h / torch.where(lag > 0.0, lag, 1.0)
        first, second = -torch.expm1(-share * per_lag), -torch.expm1((share - 1.0) * per_lag)
        turned = (self._older - self._lagged) * first
        middle = self._lagged + turned
        rest = (self._newer - middle) * second
        self._lagged = torch.where(lag > 0.0, middle + rest, self._newer)
        return torch.where(lag > 0.0, action - (turned + rest) / per_lag, action)

    def detach(self) -> None:
        """Cut the graph."""
        self._past.detach()
        self._lagged = self._lagged.detach()


class Sensors:
    """Late, noisy and coarse sensors, as `npend_gym.envs.sensors`."""

    def __init__(self, config: EnvConfig, sensors: hardware.Sensors, keys: Keys) -> None:
        self.config, self._sensors, self._keys = config, sensors, keys
        self._past = Past(config.largest["observation_delay"])

    def begin(self, mask: Tensor, q: Tensor, u: Tensor) -> None:
        """Begin in the lanes of `mask` with states q and u, (B, c)."""
        self._past.begin(mask, torch.cat([q, u], dim=1))

    def see(self, q: Tensor, u: Tensor) -> None:
        """Take the states q and u, (B, c), after a step."""
        self._past.add(torch.cat([q, u], dim=1))

    def sensed(self, age: Tensor, settings: Settings) -> tuple[Tensor, Tensor]:
        """Return what the sensors show of q and u, (B, c) each, in these steps of the episodes."""
        delay = torch.minimum(settings["observation_delay"], age.double())
        older, newer, fraction = self._past.around(delay)
        (q0, u0), (q1, u1), n = older.chunk(2, dim=1), newer.chunk(2, dim=1), self.config.n
        q, u = interpolate((q0, u0), (q1, u1), fraction, self.config.dt)
        q, u = torch.where(fraction > 0.0, q, q1), torch.where(fraction > 0.0, u, u1)
        drawn = self._sensors.noise(self._keys, age.numpy())
        of_angle, of_speed = torch.from_numpy(drawn[0]), torch.from_numpy(drawn[1])
        column = {name: settings[name][:, None] for name in settings}
        deviation, step = column["angle_noise"], column["angle_resolution"]
        angle = wrapped(q[:, :n] + deviation * of_angle)
        angle = torch.where(step > 0.0, wrapped(_rounded(angle, step)), angle)
        angle = torch.where((deviation == 0.0) & (step == 0.0), q[:, :n], angle)
        speed = u[:, :n] + column["velocity_noise"] * of_speed
        speed = _rounded(speed, column["velocity_resolution"]).clamp(-MAX_SPEED, MAX_SPEED)
        return torch.cat([angle, q[:, n:]], dim=1), torch.cat([speed, u[:, n:]], dim=1)

    def detach(self) -> None:
        """Cut the graph."""
        self._past.detach()


def _rounded(x: Tensor, resolution: Tensor) -> Tensor:
    """Return the nearest multiple of the resolution, with the gradient of x."""
    step: Any = torch.where(resolution > 0.0, resolution, 1.0)
    change = ((x / step).round() * step - x).detach()
    return x + torch.where(resolution > 0.0, change, 0.0)
