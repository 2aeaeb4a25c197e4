"""What a policy with memory acts on: the last observations, and the actions between them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import BoolArray

Float32Array = NDArray[np.float32]


class History:
    """The last observations of B environments, each with the action before it.

    The `frames`, (B, length, observed + joints), have the newest first: an observation, then the
    action that was taken before it. Before the start of an episode the observation was that of the
    start, and the action 0.
    """

    def __init__(self, shape: tuple[int, ...], joints: int) -> None:
        self._shape, self._observed = shape, shape[1] - joints  # (length, observed + joints)
        self.reset(0)

    def reset(self, num_envs: int) -> None:
        """Forget everything: the next observations begin episodes of `num_envs` environments."""
        length, entries = self._shape
        self.frames: Float32Array = np.zeros((num_envs, length, entries), np.float32)
        self._action: Float32Array = np.zeros((num_envs, entries - self._observed), np.float32)
        self._begins: BoolArray = np.ones(num_envs, np.bool_)

    def remember(self, observation: Float32Array, info: Mapping[str, Any] | None) -> Float32Array:
        """Return the frames with the newest observations; `info` shows where episodes begin.

        Raises
        ------
        ValueError
            If the observations are not of as many environments as those before.
        """
        begins = np.atleast_1d(info["time"]) == 0.0 if info and "time" in info else None
        if begins is not None and begins.all():
            self.reset(begins.size)
        if not len(self.frames):
            raise ValueError("call reset(num_envs) before a policy with memory acts")
        expected = (len(self.frames), self._observed)
        if np.shape(observation) != expected:
            raise ValueError(
                f"observation must have the shape {expected}, because the policy has a "
                f"memory for {len(self.frames)} environments; got {np.shape(observation)}: "
                "call reset(num_envs) before others"
            )
        return self.observe(observation, begins)

    def observe(self, observation: Float32Array, begins: BoolArray | None = None) -> Float32Array:
        """Return the frames, (B, length, entries), with the newest observations, (B, observed).

        `begins`, (B,), says in which environments an episode begins: what was before is forgotten.
        """
        frames, size = self.frames, self._observed
        first = self._begins if begins is None else self._begins | begins
        frames[:, 1:] = frames[:, :-1].copy()
        frames[:, 0, :size], frames[:, 0, size:] = observation, self._action
        frames[first, :, :size] = observation[first, None]
        frames[first, :, size:] = 0.0
        self._begins[:] = False
        return frames

    def act(self, action: Float32Array) -> None:
        """Keep the actions, (B, joints), that will lead to the next observations."""
        self._action[:] = action
