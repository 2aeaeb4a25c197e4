"""NPendulumVectorEnv: many environments in one, stepped together by compiled code."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import ArrayLike, NDArray
from typing_extensions import Unpack

from npend_gym import _checks
from npend_gym._checks import BoolArray, FloatArray
from npend_gym.envs.config import make_config
from npend_gym.envs.inputs import checked_action, checked_numbers
from npend_gym.envs.keywords import EnvKeywords, with_config_keywords
from npend_gym.envs.observing import ObsArray
from npend_gym.envs.outputs import final_info
from npend_gym.envs.progress import Progress, lanes_are_done
from npend_gym.envs.session import ManyLanes
from npend_gym.envs.snapshots import States


@with_config_keywords
class NPendulumVectorEnv(ManyLanes, VectorEnv[ObsArray, Any, Any]):
    """Many N-pendulums in one object, stepped together by compiled code.

    This is what `gym.make_vec("npend/SwingUp-v1", num_envs=B)` returns. Every sub-environment is an
    `NPendulumEnv`, to the last bit: number k of a vector environment reset with seed s shows what
    the single environment reset with seed s + k shows, whatever `num_envs` and `threads` are.

    Parameters
    ----------
    num_envs : int
        Number of sub-environments B.
    max_episode_steps : int or None
        Steps after which a sub-environment is truncated; None for never.
    autoreset_mode : gymnasium.vector.AutoresetMode or str
        NEXT_STEP (default): the next step resets an environment that is done, and ignores its
        action. SAME_STEP: the same step resets it; its last observation and info are in
        ``info["final_obs"]`` and ``info["final_info"]``. DISABLED: the caller resets it with
        ``reset(options={"reset_mask": done})``.
    threads : int
        Threads that share the sub-environments. No result depends on their number.
    **keywords
        As for `NPendulumEnv`.

    Notes
    -----
    Each key of `Info` has an array with a leading axis of B, and a mask (B,) named ``_key``, those
    of Gymnasium's `SyncVectorEnv`: True in the environments that have an info. A reset by mask has
    none of the other sub-environments, and ``info["final_info"]`` only of sub-environments that are
    done.

    One thread at a time: a call during the `step` or `reset` of another thread raises `EnvInUse`.
    After a fork the threads of an environment start again where they are needed.

    Examples
    --------
    >>> from npend_gym import NPendulumVectorEnv
    >>> envs = NPendulumVectorEnv(64, n=2)
    >>> observation, info = envs.reset(seed=0)
    >>> envs.step(envs.action_space.sample())[1].shape
    (64,)
    """

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
        self.closed: bool = True  # until there is something to close
        config = make_config(NPendulumVectorEnv, keywords)
        self._open_lanes(config, num_envs, max_episode_steps, autoreset_mode, render_mode, threads)
        self._done = np.zeros(self.num_envs, np.bool_)  # sub-environments whose episode is over
        self.closed = False

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[ObsArray, dict[str, Any]]:
        """Begin a new episode in every sub-environment, or in those of ``options["reset_mask"]``.

        Errors and returns are those of `NPendulumEnv.reset`, of all sub-environments.

        Parameters
        ----------
        seed : int or sequence of int, optional
            Environment k is seeded with seed + k, or with seed[k]; without one, the next episode of
            its last seed begins.
        options : dict, optional
            "reset_mask", bool (B,); "theta", "omega" and the parameters of the chain (B, n);
            "gravity", "spread", "max_torque" and the other numbers (B,); a number stands for all.
            With "persist", bool or (B,), they hold in later episodes too, until the environment is
            reset with options.
        """
        mask, checked = self._begin_lanes(seed, options)
        episodes = self._episodes
        episodes.start(mask, checked)
        episodes.observe()
        self.camera.forget(mask)
        self._done = self._done & ~mask
        result = episodes.outputs.observation, episodes.outputs.masked_info(mask.copy())
        self._calls.finish()
        return result

    def step(
        self, actions: Any
    ) -> tuple[ObsArray, FloatArray, BoolArray, BoolArray, dict[str, Any]]:
        """Advance every sub-environment by `dt`; actions beyond the box are clipped.

        Errors are those of `NPendulumEnv.step`. With autoreset disabled, `ResetNeeded` is also
        raised while a sub-environment is done.
        """
        ready = self._calls.ready
        if not ready:
            raise self._calls.refuse(self, "step")
        config = self.config
        action = checked_action(actions, (self.num_envs, config.joints.size), config.action_table)
        try:
            ready.pop()  # as CallGuard.begin does, in less time
        except IndexError:
            raise self._calls.refuse(self, "step") from None
        episodes, waiting = self._episodes, self._done
        if self.autoreset_mode is AutoresetMode.DISABLED and waiting.any():
            ready.append(True)
            raise lanes_are_done(waiting)
        if np.count_nonzero(waiting) > 0:  # autoreset of NEXT_STEP
            episodes.step(action, waiting)
        else:
            episodes.step(action)
        reward, terminated, truncated = episodes.outputs.outcome
        done = self._done = terminated | truncated
        begun = waiting
        if self.autoreset_mode is AutoresetMode.SAME_STEP and np.count_nonzero(done) > 0:
            info, begun = self._reset_now(done), done
        else:
            info = episodes.outputs.masked_info()
        if self.render_mode is not None:
            self.camera.follow(episodes, begun)
        result = episodes.outputs.observation, reward, terminated, truncated, info
        ready.append(True)
        return result

    def _reset_now(self, done: BoolArray) -> dict[str, Any]:
        """Begin the next episode of lanes that are done; return the info with their last one."""
        episodes = self._episodes
        final = final_info(episodes.outputs.observation, episodes.outputs.masked_info(done), done)
        episodes.start(done)
        episodes.observe(reuse_buffers=True)
        self._done = np.zeros(self.num_envs, np.bool_)
        return episodes.outputs.masked_info() | final

    def set_noisy_motors(self, motors: int) -> None:
        """Let `torque_noise` and `torque_ripple` act on this many motors, the first, alone.

        The others then stand for torques that no motor exerts.
        """
        count = _checks.count("motors", motors, low=0, high=self.config.joints.size)
        self._episodes.set_noisy_motors(count)

    def get_state(self, which: ArrayLike | None = None) -> States:
        """The whole state of all environments, or of some, by number or as a mask: records (k,).

        See `NPendulumEnv.get_state`. A record fits any sub-environment, and the single environment.
        """
        self._calls.check(self, "get_state")
        chosen = checked_numbers(which, self.num_envs)
        return self._episodes.snapshots.take(chosen, self._done[chosen])

    def set_state(
        self, state: States, which: ArrayLike | None = None
    ) -> tuple[ObsArray, dict[str, Any]]:
        """Let all sub-environments, or some, continue from states: records (k,).

        Errors and returns are those of `NPendulumEnv.set_state`, of all sub-environments.

        Parameters
        ----------
        state : ndarray, shape (k,)
            From `get_state` of environments made with the same keywords.
        which : array_like of int or bool, optional
            The k sub-environments; all by default, as they must be before the first reset.
        """
        chosen = checked_numbers(which, self.num_envs)
        before = self._calls.progress
        if before is not Progress.READY and np.unique(chosen).size < self.num_envs:
            raise self._calls.refuse(self, "set_state of some sub-environments")
        checked = self._episodes.snapshots.check(state, chosen.size)
        episodes = self._continue(checked, chosen, before)
        self._done = self._done.copy()
        self._done[chosen] = checked["done"] > 0
        self._calls.finish()
        moved = np.isin(np.arange(self.num_envs), chosen)
        return episodes.outputs.observation, episodes.outputs.masked_info(moved)

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:  # type: ignore[override]
        """Return a picture (H, W, 3) of every environment; in "human" mode show them in one window.

        Without a `render_mode` this warns and returns None, as in Gymnasium's own environments.
        """
        return self.camera.render(self, self._episodes, self._calls)

    def call(self, name: str) -> tuple[Any, ...]:
        """Return a picture of every sub-environment for "render", as `SyncVectorEnv.call` does.

        Some trainers render in this way. Sub-environments have no other methods of their own.
        """
        if name != "render":
            raise ValueError(
                f'name must be "render", got {_checks.show(name)}: sub-environments are one '
                "object, so use its own methods and attributes, such as get_state and config"
            )
        return self.render() or (None,) * self.num_envs

    def close_extras(self, **kwargs: Any) -> None:
        """End threads and window."""
        del kwargs
        self._episodes.close()
        self.camera.close()

    @property
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """A generator for each sub-environment, for callers: the environment uses none of them."""
        return self._episodes.seeds.generators

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seeds of the sub-environments."""
        return tuple(self._episodes.seeds.values)
