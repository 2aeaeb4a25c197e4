"""NPendulumVectorEnv: many environments in one, stepped together by compiled code."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray
from typing_extensions import Unpack

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.envs.batch import Batch, BoolArray
from npend_gym.envs.config import EnvKeywords, make_config, with_config_keywords
from npend_gym.envs.info import Info
from npend_gym.envs.inputs import (
    Progress,
    ResetNeeded,
    checked_action,
    checked_autoreset_mode,
    lane_seeds,
    reset_mask,
)
from npend_gym.envs.picture import Camera, warn_of_no_render_mode

MAX_LANES = 10_000_000
MAX_RODS_IN_ALL = 50_000_000  # some 15 GB
MAX_THREADS = 1024
_READY, _UNFINISHED = Progress.READY, Progress.UNFINISHED

ObsArray = NDArray[np.float32]
BatchInfo = Info[FloatArray, NDArray[np.int64], BoolArray]


@with_config_keywords
class NPendulumVectorEnv(VectorEnv[ObsArray, Any, Any]):
    """Many N-pendulums stepped at once, natively: what `gym.make_vec("NPendulum-v0")` returns.

    Every lane is an `NPendulumEnv`, to the last bit: lane k of a vector env reset with seed s is
    the single env reset with seed s + k, whatever `num_envs` and `threads` are.

    Parameters
    ----------
    num_envs : int
        Number of lanes B.
    max_episode_steps : int or None
        Steps after which a lane is truncated; None for never.
    autoreset_mode : gymnasium.vector.AutoresetMode or str
        NEXT_STEP (default): a lane that is done is reset by the next step, whose action it
        ignores. SAME_STEP: it is reset at once, its last observation and info being in
        ``info["final_obs"]`` and ``info["final_info"]``. DISABLED: the caller resets it with
        ``reset(options={"reset_mask": done})``.
    threads : int
        Threads that share the lanes. No result depends on it.
    **others
        As for `NPendulumEnv`.

    Notes
    -----
    Infos are those of the single env with a leading axis of B, each with its mask ``_key``.
    ``_pseudo_period`` and ``_pseudo_periods`` are True only in lanes where a bob has completed.
    `reset` takes the options of the single env with a leading axis of B, or numbers for all lanes,
    and ``reset_mask`` (B,), the lanes to reset.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"]}  # noqa: RUF012

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
        self.num_envs = _checks.count("num_envs", num_envs, high=MAX_LANES)
        if self.num_envs * config.chain.n > MAX_RODS_IN_ALL:
            raise ValueError(
                f"num_envs times n must be at most {MAX_RODS_IN_ALL}, "
                f"got {self.num_envs} times {config.chain.n}"
            )
        if max_episode_steps is not None:
            max_episode_steps = _checks.count(
                "max_episode_steps", max_episode_steps, high=2**63 - 1
            )
        self.max_episode_steps = max_episode_steps
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
        threads = _checks.count("threads", threads, high=MAX_THREADS)
        self._threads = threads
        self._batch = Batch(config, self.num_envs, threads)
        self._generators: list[tuple[np.random.Generator, int]] = []  # of the lanes, and its seed
        self._steps = np.zeros(self.num_envs, np.int64)
        self._hold_steps = config.hold_steps
        self._steps_held = np.zeros(self.num_envs, np.int64)  # instants in a row with the goal met
        self._done = np.zeros(self.num_envs, np.bool_)  # lanes whose episode is over
        self._progress = Progress.NEW
        self.closed = False

    # -- Gymnasium's interface --------------------------------------------------------------

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
            Lane k is seeded with seed + k, or with seed[k]; without, its generator goes on.
        options : dict, optional
            "reset_mask", bool (B,); "theta", "omega", "masses", "lengths", "damping", "drag",
            "quadratic_drag" (B, n); "amplitude", "gravity" (B,); one number stands for all.

        Returns
        -------
        observation : ndarray, float32, shape (B, 2n) or (B, 3n)
        info : dict

        Raises
        ------
        ValueError, TypeError
            If seed or options break a rule; no lane has changed then.
        """
        given = dict(options or {})
        mask = reset_mask(given.pop("reset_mask", None), self.num_envs)
        if self._progress is not _READY and not mask.all():
            raise ValueError(
                "options['reset_mask'] must be all True in the first reset and in the one after "
                "an interruption"
            )
        broken = self._progress is _UNFINISHED
        batch = Batch(self.config, self.num_envs, self._threads) if broken else self._batch
        checked = batch.check_options(given, single=False)
        seeds = lane_seeds(seed, self.num_envs)
        self._progress = _UNFINISHED
        self._batch = batch
        self._seed(seeds, mask)
        batch.rngs = [generator for generator, _ in self._generators]
        self._begin(mask, checked)
        self._done = self._done & ~mask
        result = batch.observation, self._with_masks(batch.every_lane()[1], mask)
        self._progress = _READY
        return result

    def step(
        self, actions: Any
    ) -> tuple[ObsArray, FloatArray, BoolArray, BoolArray, dict[str, Any]]:
        """Advance every lane by `dt`; actions beyond the box are clipped.

        Raises
        ------
        ValueError, TypeError
            If the actions are not numbers, not finite or of the wrong shape; nothing has changed
            then.
        ResetNeeded
            Before the first reset, after a call of `step` or `reset` that was interrupted, or
            with autoreset disabled where a lane is done.
        """
        if self._progress is not _READY:
            raise self._progress.refuse("step")
        waiting = self._done
        if self.autoreset_mode is AutoresetMode.DISABLED and waiting.any():
            raise ResetNeeded(
                "autoreset is disabled and lanes "
                f"{_checks.show(np.flatnonzero(waiting).tolist())} are done: reset them with "
                'reset(options={"reset_mask": done})'
            )
        batch = self._batch
        action = checked_action(actions, (self.num_envs, self.config.joints.size))
        some_wait = np.count_nonzero(waiting) > 0
        self._progress = _UNFINISHED
        if some_wait:
            batch.active[waiting] = 0.0
        batch.step(action)
        self._steps += 1
        if some_wait:  # autoreset of NEXT_STEP
            batch.active[waiting] = 1.0
            self._begin(waiting, {}, anew=False)
        quantities, info = batch.every_lane()
        # new arrays, even where a mode returns one number, or one of the quantities as it is
        reward, terminated = np.empty(self.num_envs), np.empty(self.num_envs, np.bool_)
        reward[:] = self.config.mode.reward(quantities)
        terminated[:] = self.config.mode.failed(quantities)
        if some_wait:
            reward[waiting], terminated[waiting] = 0.0, False
            self._steps_held[waiting] = 0
        self._steps_held += 1
        self._steps_held *= self.config.mode.achieved(quantities)
        truncated = batch.diverged
        if self.max_episode_steps is not None:
            truncated |= self._steps >= self.max_episode_steps
        done = self._done = terminated | truncated
        shown = self._after_step(info, done)
        if self.render_mode is not None:
            self.camera.follow(batch)
        result = batch.observation, reward, terminated, truncated, shown
        self._progress = _READY
        return result

    def _after_step(self, info: BatchInfo, done: BoolArray) -> dict[str, Any]:
        """Return the info, lanes that are done having been reset where the mode says so."""
        if self.autoreset_mode is not AutoresetMode.SAME_STEP or np.count_nonzero(done) == 0:
            return self._with_masks(info)
        last = self._with_masks(info, done)
        observation = self._batch.observation
        final_obs = np.full(self.num_envs, None, dtype=object)
        for lane in np.flatnonzero(done).tolist():
            final_obs[lane] = observation[lane].copy()
        final_info: dict[str, Any] = {
            key: np.where(done.reshape(-1, *[1] * (value.ndim - 1)), value, np.zeros_like(value))
            for key, value in last.items()
        }
        self._begin(done, {}, anew=False)
        self._done = np.zeros(self.num_envs, np.bool_)
        return self._with_masks(self._batch.every_lane()[1]) | {
            "final_obs": final_obs,
            "_final_obs": done.copy(),
            "final_info": final_info,
            "_final_info": done.copy(),
        }

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:  # type: ignore[override]
        """Return a picture (H, W, 3) of every lane; in "human" mode show them in one window.

        Without a `render_mode` this warns and returns None, as in Gymnasium's own environments.
        """
        if self.render_mode is None:
            warn_of_no_render_mode(self)
            return None
        if self._progress is not _READY:
            raise self._progress.refuse("render")
        return self.camera.render(self._batch)

    def close_extras(self, **kwargs: Any) -> None:
        """End threads and window."""
        del kwargs
        self._batch.close()
        self.camera.close()

    @property
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The generators of the lanes."""
        return tuple(generator for generator, _ in self._seeded())

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seeds of the lanes."""
        return tuple(seed for _, seed in self._seeded())

    # -- parts ------------------------------------------------------------------------------

    def _seeded(self) -> list[tuple[np.random.Generator, int]]:
        """Return the generators of the lanes and their seeds, which the first call draws."""
        if not self._generators:
            self._seed([None] * self.num_envs, np.ones(self.num_envs, np.bool_))
        return self._generators

    def _seed(self, seeds: list[int | None], mask: BoolArray) -> None:
        """Make the generators of the lanes of `mask` that are given a seed or have none."""
        if not self._generators:
            self._generators = [seeding.np_random(seed) for seed in seeds]
            return
        for lane in np.flatnonzero(mask).tolist():
            if seeds[lane] is not None:
                self._generators[lane] = seeding.np_random(seeds[lane])

    def _begin(
        self, lanes: BoolArray, options: dict[str, FloatArray], *, anew: bool = True
    ) -> None:
        """Begin a new episode in some lanes; what is seen goes to new arrays where `anew`."""
        self._batch.start(lanes, options, anew=anew)
        self._steps[lanes] = 0
        achieved = self.config.mode.achieved(self._batch.every_lane()[0])
        self._steps_held[lanes] = np.broadcast_to(achieved, lanes.shape)[lanes]
        self.camera.forget(lanes)

    def _with_masks(self, info: BatchInfo, mask: BoolArray | None = None) -> dict[str, Any]:
        """Return the info with the successes and a mask for every key: `mask`, or all lanes."""
        info["success"] = self._steps_held > self._hold_steps
        present = np.ones(self.num_envs, np.bool_) if mask is None else mask.copy()
        measured = present & (info["bobs_completed"] > 0)
        return {
            **info,
            **dict.fromkeys([f"_{key}" for key in info], present),
            "_pseudo_period": measured,
            "_pseudo_periods": measured.copy(),
        }
