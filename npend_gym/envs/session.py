"""What the single and the vector environment share."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from npend_gym._checks import FloatArray
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.episodes import Episodes
from npend_gym.envs.goals import GoalReward
from npend_gym.envs.inputs import checked_state
from npend_gym.envs.keywords import PlainSpec
from npend_gym.envs.picture import Camera
from npend_gym.envs.progress import CallGuard, Progress
from npend_gym.envs.snapshots import States


class Session:
    """The base of both environments: their episodes, and one call at a time that changes them."""

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"]}  # noqa: RUF012
    spec: Any = PlainSpec()
    _is_single = False

    def _open(
        self, config: EnvConfig, render_mode: str | None, lanes: int = 1, threads: int = 1,
        max_steps: int | None = None,
    ) -> None:  # fmt: skip
        self.config = config
        self.metadata = Session.metadata | {"render_fps": config.render_fps}
        self.render_mode = render_mode
        self.camera = Camera(render_mode, config)
        self._episodes: Episodes = Episodes(config, lanes, threads, max_steps)
        self._calls = CallGuard()
        if config.goal_env:  # no other has it: Stable-Baselines3 would expect a Dict of them
            self.compute_reward = GoalReward(config.mode)

    def _begin(self, call: str, before: Progress) -> Episodes:
        """Begin a call that replaces everything; return the episodes for it."""
        self._calls.begin(self, call, before)
        if before is Progress.UNFINISHED:
            self._episodes = self._episodes.renewed()
        return self._episodes

    def _continue(self, states: States, lanes: NDArray[np.int64], before: Progress) -> Episodes:
        """Begin `set_state`: put lanes into states that have been checked."""
        episodes = self._begin("set_state", before)
        episodes.set_states(lanes, states)
        self.camera.forget(np.isin(np.arange(episodes.count), lanes))
        return episodes

    @property
    def state(self) -> FloatArray:
        """Angles [rad], then angular velocities [rad/s], shape (2n,), or (B, 2n) of B lanes.

        With a cart, its place [m] and velocity [m/s] follow.

        Setting it moves the chain there; pseudo-periods are measured from then on, and time, energy
        and work count from there.
        """
        self._calls.check(self, "state")
        return self._episodes.angles[0] if self._is_single else self._episodes.angles

    @state.setter
    def state(self, value: ArrayLike) -> None:
        self._calls.check(self, "state")
        shape = self._episodes.count, self.config.state_size
        checked = checked_state(value, shape, self.config.n)
        self._calls.begin(self, "state")
        self._episodes.angles = checked
        self._calls.finish()
