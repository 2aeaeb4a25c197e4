"""NPendulumVectorEnv: many environments in one, stepped together by compiled code."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray
from typing_extensions import Unpack

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.envs.config import make_config
from npend_gym.envs.episodes import Episodes
from npend_gym.envs.generators import Generators
from npend_gym.envs.info import BatchInfo, final_info, with_masks
from npend_gym.envs.inputs import (
    checked_action,
    checked_autoreset_mode,
    checked_episode_steps,
    checked_num_envs,
    checked_options,
    reset_mask,
)
from npend_gym.envs.keywords import EnvKeywords, PlainSpec, with_config_keywords
from npend_gym.envs.picture import Camera
from npend_gym.envs.progress import Progress, lanes_are_done

_READY, _UNFINISHED = Progress.READY, Progress.UNFINISHED

ObsArray = NDArray[np.float32]


@with_config_keywords
class NPendulumVectorEnv(VectorEnv[ObsArray, Any, Any]):
    """Many N-pendulums in one object, stepped together by compiled code.

    This is what `gym.make_vec("NPendulum-v0", num_envs=B)` returns. Every lane is an
    `NPendulumEnv`, to the last bit: lane k of a vector environment reset with seed s shows what
    the single environment reset with seed s + k shows, whatever `num_envs` and `threads` are.

    Parameters
    ----------
    num_envs : int
        Number of lanes B.
    max_episode_steps : int or None
        Steps after which a lane is truncated; None for never.
    autoreset_mode : gymnasium.vector.AutoresetMode or str
        NEXT_STEP (default): the next step resets a lane that is done, and ignores its action.
        SAME_STEP: the same step resets it; its last observation and info are in
        ``info["final_obs"]`` and ``info["final_info"]``. DISABLED: the caller resets it with
        ``reset(options={"reset_mask": done})``.
    threads : int
        Threads that share the lanes. No result depends on their number.
    **keywords
        As for `NPendulumEnv`.

    Notes
    -----
    Each key of `Info` has an array with a leading axis of B, and a mask (B,) named ``_key``.
    ``_pseudo_period`` and ``_pseudo_periods`` are True only in lanes where a bob has completed.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"]}  # noqa: RUF012
    spec: Any = PlainSpec()

    def __init__(
        self,
        num_envs: int = 1,
        *,
        render_mode: str | None = None,
        max_episode_steps: int | None = 1000,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int = 1,
        **keywords: Unpack[EnvKeywords],
    ) -> None:
        self.closed = True  # until there is something to close
        config = make_config(NPendulumVectorEnv, keywords)
        self.num_envs = checked_num_envs(num_envs, config.chain.n)
        self.max_episode_steps = checked_episode_steps(max_episode_steps)
        self.autoreset_mode = checked_autoreset_mode(autoreset_mode)
        self.config = config
        self.single_action_space = config.action_space
        self.single_observation_space = config.observation_space
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.metadata = NPendulumVectorEnv.metadata | {
            "render_fps": config.render_fps,
            "autoreset_mode": self.autoreset_mode,
        }
        self.camera = Camera(render_mode, config.render_fps)
        self.render_mode = render_mode
        self._threads = threads
        self._episodes: Episodes = Episodes(config, self.num_envs, threads)
        self._generators = Generators(self.num_envs)
        self._steps = np.zeros(self.num_envs, np.int64)
        self._hold_steps = config.hold_steps
        self._steps_held = np.zeros(self.num_envs, np.int64)  # instants in a row with the goal met
        self._done = np.zeros(self.num_envs, np.bool_)  # lanes whose episode is over
        self._progress = Progress.NEW
        self.closed = False

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[ObsArray, dict[str, Any]]:
        """Begin a new episode in every lane, or in those of ``options["reset_mask"]``.

        Parameters
        ----------
        seed : int or sequence of int, optional
            Lane k is seeded with seed + k, or with seed[k]; without one, its generator continues.
        options : dict, optional
            "reset_mask", bool (B,); "theta", "omega" and the parameters of the chain (B, n);
            "amplitude", "gravity" (B,); one number stands for all.

        Returns
        -------
        observation : ndarray, float32, shape (B, 2n) or (B, 3n)
        info : dict

        Raises
        ------
        ValueError, TypeError
            If seed or options break a rule; no lane has then changed.
        """
        given = dict(options or {})
        every = self._progress is not _READY
        mask = reset_mask(given.pop("reset_mask", None), self.num_envs, every=every)
        broken = self._progress is _UNFINISHED
        episodes = Episodes(self.config, self.num_envs, self._threads) if broken else self._episodes
        checked = checked_options(given, self.config, self.num_envs)
        seeds = self._generators.checked_seeds(seed)
        self._progress = _UNFINISHED
        self._episodes = episodes
        self._generators.seed(seeds, mask)
        episodes.rngs = [generator for generator, _ in self._generators.pairs()]
        self._begin(mask, checked)
        self._done = self._done & ~mask
        result = episodes.observation, self._info_of(mask)
        self._progress = _READY
        return result

    def step(
        self, actions: Any
    ) -> tuple[ObsArray, FloatArray, BoolArray, BoolArray, dict[str, Any]]:
        """Advance every lane by `dt`; actions beyond the box are clipped.

        Raises
        ------
        ValueError, TypeError
            If the actions are not numbers, not finite or of the wrong shape; no lane has then
            changed.
        ResetNeeded
            Before the first reset, after a call of `step` or `reset` that was interrupted, or
            with autoreset disabled where a lane is done.
        """
        if self._progress is not _READY:
            raise self._progress.refuse("step")
        waiting = self._done
        if self.autoreset_mode is AutoresetMode.DISABLED and waiting.any():
            raise lanes_are_done(waiting)
        episodes = self._episodes
        action = checked_action(actions, (self.num_envs, self.config.joints.size))
        some_wait = np.count_nonzero(waiting) > 0
        self._progress = _UNFINISHED
        if some_wait:
            episodes.active[waiting] = 0.0
        episodes.step(action)
        self._steps += 1
        if some_wait:  # autoreset of NEXT_STEP
            episodes.active[waiting] = 1.0
            self._begin(waiting, {}, reuse_buffers=True)
        quantities, info = episodes.every_lane()
        # new arrays, even where a mode returns one number, or one of the quantities as it is
        reward, terminated = np.empty(self.num_envs), np.empty(self.num_envs, np.bool_)
        reward[:] = self.config.mode.reward(quantities)
        terminated[:] = self.config.mode.failed(quantities)
        if some_wait:
            reward[waiting], terminated[waiting] = 0.0, False
            self._steps_held[waiting] = 0
        self._steps_held += 1
        self._steps_held *= self.config.mode.achieved(quantities)
        truncated = episodes.diverged
        if self.max_episode_steps is not None:
            truncated |= self._steps >= self.max_episode_steps
        done = self._done = terminated | truncated
        shown = self._autoreset(info, done)
        if self.render_mode is not None:
            self.camera.follow(episodes)
        result = episodes.observation, reward, terminated, truncated, shown
        self._progress = _READY
        return result

    def _autoreset(self, info: BatchInfo, done: BoolArray) -> dict[str, Any]:
        """Return the info of the step, lanes that are done having been reset in SAME_STEP."""
        info["success"] = self._steps_held > self._hold_steps
        if self.autoreset_mode is not AutoresetMode.SAME_STEP or np.count_nonzero(done) == 0:
            return with_masks(info, np.ones(self.num_envs, np.bool_))
        final = final_info(self._episodes.observation, info, done)
        self._begin(done, {}, reuse_buffers=True)
        self._done = np.zeros(self.num_envs, np.bool_)
        return self._info_of(np.ones(self.num_envs, np.bool_)) | final

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:  # type: ignore[override]
        """Return a picture (H, W, 3) of every lane; in "human" mode show them in one window.

        Without a `render_mode` this warns and returns None, as in Gymnasium's own environments.
        """
        return self.camera.render(self, self._episodes, self._progress)

    def close_extras(self, **kwargs: Any) -> None:
        """End threads and window."""
        del kwargs
        self._episodes.close()
        self.camera.close()

    @property
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The generators of the lanes."""
        return tuple(generator for generator, _ in self._generators.pairs())

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seeds of the lanes."""
        return tuple(seed for _, seed in self._generators.pairs())

    def _begin(
        self, lanes: BoolArray, options: dict[str, FloatArray], *, reuse_buffers: bool = False
    ) -> None:
        """Begin a new episode in some lanes; with `reuse_buffers` in the step's own arrays."""
        self._episodes.start(lanes, options, reuse_buffers=reuse_buffers)
        self._steps[lanes] = 0
        achieved = self.config.mode.achieved(self._episodes.every_lane()[0])
        self._steps_held[lanes] = np.broadcast_to(achieved, lanes.shape)[lanes]
        self.camera.forget(lanes)

    def _info_of(self, lanes: BoolArray) -> dict[str, Any]:
        """Return the info after a reset of some lanes."""
        info = self._episodes.every_lane()[1]
        info["success"] = self._steps_held > self._hold_steps
        return with_masks(info, lanes.copy())
