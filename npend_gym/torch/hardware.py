"""Motors and sensors for tensors: what `npend_gym.envs.hardware` does.

The random numbers are drawn there. What has a gradient is computed here: the torques of late and
slow motors by the actions, and late observations by the states. Rounding counts as the identity in
gradients.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from npend_gym.envs import EnvConfig
from npend_gym.envs.episodes import Episodes
from npend_gym.envs.sensors import interpolate
from npend_gym.physics.kernels.layout import MAX_SPEED
from npend_gym.torch.judging import Lanes, State, wrapped

Settings = Mapping[str, Tensor]  # of the sub-environments, by keyword, (B,)


def begun(mask: Tensor, start: Tensor, kept: Tensor) -> Tensor:
    """Return `kept`, (B, k), with `start` in the lanes of `mask`, (B,).

    Where all begin, what came before is no part of the graph.
    """
    return start if mask.all() else torch.where(mask[:, None], start, kept)


class Past:
    """What happened in the last steps of every sub-environment, the newest first."""

    def __init__(self, most: float) -> None:
        self._length, self._kept = int(most) + 2, list[Tensor]()

    def begin(self, mask: Tensor, value: Tensor) -> None:
        """Let all that happened in the sub-environments of `mask` have been `value`."""
        kept = self._kept or [value] * self._length
        self._kept = [begun(mask, value, each) for each in kept]

    def add(self, value: Tensor) -> None:
        """Add what happens now."""
        self._kept = [value, *self._kept[:-1]]

    def around(self, delay: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Steps before and after a delay, (B,), and the fraction of a step between them."""
        whole = delay.floor()
        kept, lanes = torch.stack(self._kept), torch.arange(len(delay), device=delay.device)
        newer = kept[whole.long(), lanes]
        older = kept[(whole.long() + 1).clamp(max=self._length - 1), lanes]
        return older, newer, (delay - whole)[:, None]

    def detach(self) -> None:
        """Cut the graph."""
        self._kept = [each.detach() for each in self._kept]


class Motors:
    """The motors of an environment, and pushes at the tip, as `npend_gym.envs.motors`.

    Each of the `pieces` of a step has loads on `joints`, all where a push or ripple may turn them.
    """

    def __init__(self, episodes: Episodes, device: torch.device) -> None:
        self._motors, self._keys, config = episodes.motors, episodes.seeds.keys, episodes.config
        self.config: EnvConfig = config
        n = config.n
        acted = config.joints.tolist()
        if self._motors is None:
            self.pieces, self.joints = 1, [joint for joint in acted if joint < n] or [0]
        else:
            self.pieces: int = self._motors.pieces
            self.joints: list[int] = list(range(n))
        columns = {joint: k for k, joint in enumerate((*self.joints, n))}  # of loads; n: a cart
        places = torch.tensor([columns[joint] for joint in acted], dtype=torch.int64)
        self._places = places.to(device)
        self._past = Past(config.largest["action_delay"])
        self._lagged = torch.zeros(1, len(acted), dtype=torch.float64)

    def begin(self, mask: Tensor) -> None:
        """Forget the actions of the sub-environments of `mask`."""
        if self._motors is not None:
            idle = torch.zeros(len(mask), len(self._places), dtype=torch.float64)
            self._past.begin(mask, idle)
            self._lagged = begun(mask, idle, self._lagged)

    def act(self, action: Tensor, age: Tensor, settings: Settings) -> None:
        """Take the clipped actions, (B, joints), of a step, and draw what disturbs it."""
        self._newer = action
        if self._motors is not None:
            self._past.add(action)
            self._older, self._newer, self._fraction = self._past.around(settings["action_delay"])
            noise, push = self._motors.disturbances(self._keys, age.numpy(), self.config.dt)
            self._noise, self._push = torch.from_numpy(noise), torch.from_numpy(push)

    def loads(self, piece: int, q: Tensor, u: Tensor, lanes: Lanes, settings: Settings) -> Tensor:
        """Return the torques on `joints`, and the force on a cart, (B, inputs), in a piece."""
        loads = q.new_zeros(len(q), len(self.joints) + self.config.has_cart)
        if self._motors is None:
            return loads.index_copy(1, self._places, lanes.limits * self._newer)
        n, h = self.config.n, self.config.dt / self.pieces
        share = (self._fraction * self.pieces - piece).clamp(0.0, 1.0)
        action = share * self._older + (1.0 - share) * self._newer
        motors = lanes.limits * self._followed(action, share, h, settings["motor_lag"][:, None])
        half = q[:, :n] + 0.5 * h * u[:, :n]
        on_joint, joint = self._places < n, self._places.clamp(max=n - 1)
        phi = torch.diff(half, dim=1, prepend=torch.zeros_like(half[:, :1]))
        ripple = (settings["ripple_cycles"][:, None] * wrapped(phi)).sin()
        ripple = settings["torque_ripple"][:, None] * ripple
        added = torch.where(on_joint, self._noise + ripple[:, joint], 0.0)
        loads = loads.index_copy(1, self._places, motors + added)
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
    """The sensors of an environment, as `npend_gym.envs.sensors`."""

    def __init__(self, episodes: Episodes) -> None:
        self._sensors, self._keys, config = episodes.sensors, episodes.seeds.keys, episodes.config
        self._dt, self._past = config.dt, Past(config.largest["observation_delay"])

    def begin(self, mask: Tensor, q: Tensor, u: Tensor) -> None:
        """Begin in the sub-environments of `mask` with states q and u, (B, c)."""
        if self._sensors is not None:
            self._past.begin(mask, torch.cat([q, u], dim=1))

    def see(self, q: Tensor, u: Tensor) -> None:
        """Take the states q and u, (B, c), after a step."""
        if self._sensors is not None:
            self._past.add(torch.cat([q, u], dim=1))

    def shown(self, state: State, age: Tensor, settings: Settings) -> State:
        """Readings of the sensors of a true state, in these steps of the episodes."""
        if self._sensors is None:
            return state
        column = {name: settings[name][:, None] for name in settings}
        delay = torch.minimum(settings["observation_delay"], age.double())
        older, newer, fraction = self._past.around(delay)
        (q0, u0), (q1, u1), n = older.chunk(2, dim=1), newer.chunk(2, dim=1), state.n
        q, u = interpolate((q0, u0), (q1, u1), fraction, self._dt)
        q, u = torch.where(fraction > 0.0, q, q1), torch.where(fraction > 0.0, u, u1)
        drawn = self._sensors.noise(self._keys, age.numpy())
        of_angle, of_speed = torch.from_numpy(drawn[0]), torch.from_numpy(drawn[1])
        deviation, step = column["angle_noise"], column["angle_resolution"]
        angle = wrapped(q[:, :n] + deviation * of_angle)
        angle = torch.where(step > 0.0, wrapped(_rounded(angle, step)), angle)
        angle = torch.where((deviation == 0.0) & (step == 0.0), q[:, :n], angle)
        speed = u[:, :n] + column["velocity_noise"] * of_speed
        speed = _rounded(speed, column["velocity_resolution"]).clamp(-MAX_SPEED, MAX_SPEED)
        q, u = torch.cat([angle, q[:, n:]], dim=1), torch.cat([speed, u[:, n:]], dim=1)
        return State(q, u, state.lanes)

    def detach(self) -> None:
        """Cut the graph."""
        self._past.detach()


def _rounded(x: Tensor, resolution: Tensor) -> Tensor:
    """Return the nearest multiple of the resolution, with the gradient of x."""
    step: Any = torch.where(resolution > 0.0, resolution, 1.0)
    change = ((x / step).round() * step - x).detach()
    return x + torch.where(resolution > 0.0, change, 0.0)
