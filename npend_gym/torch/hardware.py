"""Motors and sensors for tensors: what `npend_gym.envs.hardware` does.

The random numbers are drawn there. What has a gradient is computed here: the torques of late and
slow motors by the actions, and late observations by the states. Rounding counts as the identity in
gradients.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from npend_gym.envs import EnvConfig
from npend_gym.envs.episodes import Episodes
from npend_gym.torch.judging import Lanes, TensorState
from npend_gym.torch.laws import ALL, laws


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


class TensorMotors:
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

    def act(self, action: Tensor, age: Tensor, lanes: Lanes) -> None:
        """Take the clipped actions, (B, joints), of a step, and draw what disturbs it."""
        self._newer = action
        if self._motors is not None:
            self._past.add(action)
            self._older, self._newer, _ = self._past.around(lanes.setting("action_delay"))
            noise, push = self._motors.disturbances(self._keys, age.numpy(), self.config.dt)
            self._noise, self._push = torch.from_numpy(noise), torch.from_numpy(push)

    def loads(self, piece: int, q: Tensor, u: Tensor, lanes: Lanes) -> Tensor:
        """Return the torques on `joints`, and the force on a cart, (B, inputs), in a piece."""
        loads = q.new_zeros(len(q), len(self.joints) + self.config.has_cart)
        if self._motors is None:
            return loads.index_copy(1, self._places, lanes.limits * self._newer)
        n, h, largest = self.config.n, self.config.dt / self.pieces, self.config.largest
        of_lanes, older, newer = (lanes.numbers, ALL), self._older, self._newer
        share = laws.older_share(*of_lanes, piece, self.pieces)
        action = share * older + (1.0 - share) * newer
        if largest["motor_lag"] > 0.0:
            response = laws.lag_response(*of_lanes, share, h)
            action, self._lagged = laws.followed(
                *of_lanes, response, older, newer, self._lagged, action
            )
        half = q[:, :n] + 0.5 * h * u[:, :n]
        torque = laws.exerted(*of_lanes, action, self._noise)
        if largest["torque_ripple"] > 0.0:
            phi = torch.diff(half, dim=1, prepend=torch.zeros_like(half[:, :1]))
            torque = torque + laws.ripple(*of_lanes, phi[:, self._places.clamp(max=n - 1)])
        if self.config.has_cart:
            on_joint = self._places < n
            torque = torch.where(on_joint, torque, laws.exerted_on_cart(*of_lanes, action))
        loads = loads.index_copy(1, self._places, torque)
        if largest["push_rate"] == 0.0:
            return loads
        levers = torch.flip(lanes.chains.lengths * half.cos(), (1,)).cumsum(1).flip(1)
        of_push = [levers, torch.ones_like(q[:, n:])]
        return loads + self._push[:, None] * torch.cat(of_push, dim=1)

    def detach(self) -> None:
        """Cut the graph."""
        self._past.detach()
        self._lagged = self._lagged.detach()


class TensorSensors:
    """The sensors of an environment, as `npend_gym.envs.sensors`."""

    def __init__(self, episodes: Episodes) -> None:
        self._sensors, self._keys, config = episodes.sensors, episodes.seeds.keys, episodes.config
        self._dt, largest = config.dt, config.largest
        self._delays = largest["observation_delay"] > 0.0
        self._noisy = largest["angle_noise"] > 0.0 or largest["velocity_noise"] > 0.0
        self._past = Past(largest["observation_delay"])

    def begin(self, mask: Tensor, q: Tensor, u: Tensor) -> None:
        """Begin in the sub-environments of `mask` with states q and u, (B, c)."""
        if self._delays:
            self._past.begin(mask, torch.cat([q, u], dim=1))

    def see(self, q: Tensor, u: Tensor) -> None:
        """Take the states q and u, (B, c), after a step."""
        if self._delays:
            self._past.add(torch.cat([q, u], dim=1))

    def shown(self, state: TensorState, age: Tensor) -> TensorState:
        """Readings of the sensors of a true state, in these steps of the episodes."""
        if self._sensors is None:
            return state
        numbers, n, q, u = state.lanes.numbers, state.n, state.q, state.u
        if self._delays:
            delay = laws.age_shown(numbers, ALL, age.double()[:, None])[:, 0]
            older, newer, fraction = self._past.around(delay)
            before, (q, u) = older.chunk(2, dim=1), newer.chunk(2, dim=1)
            between, late = laws.interpolate(before, (q, u), fraction, self._dt), fraction > 0.0
            q, u = torch.where(late, between[0], q), torch.where(late, between[1], u)
        noise: Any = 0.0, 0.0
        if self._noisy:
            noise = [torch.from_numpy(x) for x in self._sensors.noise(self._keys, age.numpy())]
        angle, speed = laws.reading(
            numbers, ALL, q[:, :n], u[:, :n], noise, laws.rounds(numbers, ALL)
        )
        q, u = torch.cat([angle, q[:, n:]], dim=1), torch.cat([speed, u[:, n:]], dim=1)
        return TensorState(q, u, state.lanes)

    def detach(self) -> None:
        """Cut the graph."""
        self._past.detach()
