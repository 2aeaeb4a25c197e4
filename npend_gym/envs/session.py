"""What the environments share: the single one, the vector one, and that of tensors."""

from __future__ import annotations

import copy
from functools import lru_cache
from typing import Any
from weakref import ref

import numpy as np
from gymnasium import Space
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import plain_keywords
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.episodes import Episodes
from npend_gym.envs.goals import GoalReward
from npend_gym.envs.inputs import (
    checked_autoreset_mode,
    checked_episode_steps,
    checked_num_envs,
    checked_options,
    checked_state,
    given_options,
    reset_mask,
)
from npend_gym.envs.keywords import CHAIN_KEYWORDS, EnvKeywords
from npend_gym.envs.picture import Camera
from npend_gym.envs.progress import CallGuard, Progress, check_running
from npend_gym.envs.registration import ENV_ID, TASKS
from npend_gym.envs.seeds import checked_seeds
from npend_gym.envs.snapshots import States

# Keywords that leave a task as hard as it is, or are in `chain` and `max_torque`
_OF_NO_TASK = {
    *CHAIN_KEYWORDS, "n", "difficulty", "observation", "observe_velocities", "observe_context",
    "goal_env", "measure_periods", "render_size", "render_plain",
    "motors", "sensors", "cart",  # whose settings are keywords too
}  # fmt: skip


@lru_cache
def _usual(env_id: str) -> EnvConfig:
    """Return the settings for which the threshold of a task holds."""
    return EnvConfig(**TASKS[env_id].keywords)


def _task_of(config: EnvConfig) -> dict[str, Any]:
    """Return the settings on which a return depends, as plain values."""
    names = [name for name in EnvKeywords.__annotations__ if name not in _OF_NO_TASK]
    mode = type(config.mode), vars(config.mode)
    return plain_keywords({name: getattr(config, name) for name in names}) | {"mode": mode}


class PlainSpec:
    """The attribute `spec` of an environment: Gymnasium's record of how it was made.

    `EnvSpec.to_json` writes numbers, lists, dicts and texts only. So a chain among the keywords
    becomes the dict of its parameters, and an array becomes a list. `reward_threshold` is None
    where another chain, motor, reward or length makes another task of that of the id.
    """

    def __get__(self, env: object | None, owner: type) -> EnvSpec | None:
        return None if env is None else vars(env).get("spec")

    def __set__(self, env: Session, spec: EnvSpec | None) -> None:
        if spec is not None:
            spec = copy.copy(spec)
            spec.kwargs = plain_keywords(spec.kwargs)
            own = getattr(env, "max_episode_steps", spec.max_episode_steps)  # of many lanes
            other = spec.id in TASKS and _task_of(env.config) != _task_of(_usual(spec.id))
            if other or own != spec.max_episode_steps:
                spec.reward_threshold = None
        vars(env)["spec"] = spec


_live: list[ref[Session]] = []  # all environments; threads may append and remove


def kind_shown(observation: Any) -> str | None:
    """Return which `observation` an environment has just returned as this array, or a part of it.

    None for every other array, such as a copy.
    """
    given: Any = np.asarray(observation)
    for env in (each() for each in [*_live]):
        if env is not None and np.may_share_memory(env.shown, given):
            return env.config.observation
    return None


class Session:
    """The base of all environments: their episodes, and one call at a time that changes them."""

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"]}  # noqa: RUF012
    spec: Any = PlainSpec()
    env_id: str = ENV_ID  # of `gym.make_vec`, for another one like it
    _is_single = False
    _kind: type[Episodes] = Episodes
    _done: Any = np.zeros(1, np.bool_)  # lanes whose episode is over; a single environment has none

    def _open(
        self, config: EnvConfig, render_mode: str | None, lanes: int = 1, threads: int = 1,
        max_steps: int | None = None,
    ) -> None:  # fmt: skip
        self.config = config
        self.metadata = Session.metadata | {"render_fps": config.render_fps}
        self.render_mode = render_mode
        self.camera: Camera = Camera(render_mode, config)
        self._episodes: Episodes = self._kind(
            config, lanes, threads, max_steps, single=self._is_single
        )
        self._calls = CallGuard()
        _live.append(ref(self, _live.remove))
        if config.goal_env:  # no other has it: Stable-Baselines3 would expect a Dict of them
            self.compute_reward: GoalReward = GoalReward(config.mode, config.n)

    def _begin(self, call: str, before: Progress) -> Episodes:
        """Begin a call that replaces everything; return the episodes for it."""
        self._calls.begin(self, call, before)
        if before is Progress.UNFINISHED:
            self._episodes = self._episodes.renewed()
        return self._episodes

    def _continue(self, states: States, lanes: NDArray[np.int64], before: Progress) -> Episodes:
        """Begin `set_state`: put sub-environments into states that have been checked."""
        episodes = self._begin("set_state", before)
        episodes.set_states(lanes, states)
        self.camera.forget(np.isin(np.arange(episodes.count), lanes))
        return episodes

    def _checked_options(self, given: dict[str, Any]) -> dict[str, Any] | None:
        """Return options of a reset, checked; None where there are none."""
        lanes = None if self._is_single else self._episodes.count
        return checked_options(given, self.config, lanes) if given else None

    def set_options(self, options: dict[str, Any] | None) -> None:
        """Choose the options of all later episodes; the present ones go on as they are.

        They hold after resets and autoresets, until a reset with options, or another call.

        Parameters
        ----------
        options : dict or None
            As for `reset`; of B environments with "reset_mask", those whose options they are.

        Raises
        ------
        ValueError, TypeError
            If an option breaks a rule.
        ResetNeeded
            Before the first reset.

        Examples
        --------
        >>> from npend_gym import NPendulumEnv
        >>> env = NPendulumEnv(mode="swingup")
        >>> _ = env.reset(seed=0)
        >>> env.set_options({"max_torque": 30.0, "spread": 0.5})
        >>> env.reset()[1]["theta"].round(2)  # now within 0.5 rad of hanging
        array([-0.16,  0.08])
        """
        given, count = given_options(options), self._episodes.count
        chosen = None if self._is_single else given.pop("reset_mask", None)
        mask = reset_mask(chosen, count, every=False)
        checked = self._checked_options(given) or {}
        self._calls.begin(self, "set_options")
        self._episodes.choose(mask, checked)
        self._calls.finish()

    @property
    def shown(self) -> NDArray[np.float32]:
        """The observations that the last call has returned, of all sub-environments."""
        return self._episodes.outputs.observations

    @property
    def state(self) -> FloatArray:
        """Angles [rad], then angular velocities [rad/s], shape (2n,), or (B, 2n) of B environments.

        With a cart, its place [m] and velocity [m/s] follow.

        Setting it moves the chain there; time, energy, work and pseudo-periods count from there. It
        raises a ValueError while a sub-environment is done, until it is reset.
        """
        self._calls.check(self, "state")
        return self._episodes.angles[0] if self._is_single else self._episodes.angles

    @state.setter
    def state(self, value: ArrayLike) -> None:
        self._calls.check(self, "state")
        shape = self._episodes.count, self.config.state_size
        checked = checked_state(value, shape, self.config.n)
        check_running(self._done)
        self._calls.begin(self, "state")
        self._episodes.angles = checked
        self._calls.finish()


class ManyLanes(Session):
    """The base of the environments with many sub-environments, of arrays or of tensors."""

    def _open_lanes(
        self, config: EnvConfig, num_envs: int, max_episode_steps: int | None,
        autoreset_mode: AutoresetMode | str, render_mode: str | None = None, threads: int = 1,
    ) -> None:  # fmt: skip
        self.num_envs: int = checked_num_envs(num_envs, config.n)
        self.max_episode_steps: int | None = checked_episode_steps(max_episode_steps)
        self.autoreset_mode: AutoresetMode = checked_autoreset_mode(autoreset_mode)
        self._open(config, render_mode, self.num_envs, threads, self.max_episode_steps)
        self.metadata: dict[str, Any] = self.metadata | {"autoreset_mode": self.autoreset_mode}
        self.single_action_space: Space[Any] = config.action_space
        self.single_observation_space: Space[Any] = config.observation_space
        self.action_space: Space[Any] = batch_space(self.single_action_space, self.num_envs)
        self.observation_space: Space[Any] = batch_space(
            self.single_observation_space, self.num_envs
        )

    def _begin_lanes(
        self, seed: Any, options: dict[str, Any] | None
    ) -> tuple[BoolArray, dict[str, Any] | None]:
        """Begin `reset`: seed lanes; return those that begin an episode, and their options."""
        given, before = given_options(options), self._calls.progress
        every = before is not Progress.READY
        mask = reset_mask(given.pop("reset_mask", None), self.num_envs, every=every)
        checked = self._checked_options(given)
        seeds = checked_seeds(seed, self.num_envs)
        self._begin("reset", before).seed(seeds, mask)
        return mask, checked
