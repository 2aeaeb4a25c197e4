"""Stable-Baselines3's VecEnv over any Gymnasium vector environment.

This file imports nothing of the package: it can be taken into sb3-contrib as it is, with
tests/test_gymnasium_vec_env.py.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv
from numpy.typing import NDArray
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices

Array = NDArray[Any]
# options of N-pendulums with a number for each rod, as some parameters of their `chain` have it
_OF_RODS = "theta", "omega", "start", "goal"


class SB3VecEnv(VecEnv):
    """A Gymnasium vector environment for the algorithms of Stable-Baselines3.

    The infos report the end of an episode in SB3's form, and its
    statistics as SB3's `VecMonitor` does, so no other wrapper is needed.

    Parameters
    ----------
    venv : gymnasium.vector.VectorEnv
        With the autoreset mode SAME_STEP, which SB3 assumes.
    info_keys : sequence of str
        Keys of the info that are passed on in every step. The last info of an episode is passed on
        in full. Passing on all keys in every step, as one dict for each environment, would take
        longer than the step itself.

    Raises
    ------
    ValueError
        If `venv` has another autoreset mode. `step_wait` raises one if the info lacks a key.
    TypeError
        If `venv` is no vector environment of Gymnasium, or `info_keys` is a text.

    Examples
    --------
    >>> import gymnasium as gym
    >>> from gymnasium.vector import AutoresetMode
    >>> from stable_baselines3 import PPO
    >>> same_step = {"autoreset_mode": AutoresetMode.SAME_STEP}
    >>> venv = gym.make_vec("CartPole-v1", 4, vectorization_mode="sync", vector_kwargs=same_step)
    >>> model = PPO("MlpPolicy", SB3VecEnv(venv), n_steps=32)
    >>> model.learn(256).num_timesteps
    256
    """

    def __init__(self, venv: VectorEnv[Any, Any, Any], info_keys: Sequence[str] = ()) -> None:
        _check_many(venv)
        mode = venv.metadata.get("autoreset_mode")
        if mode != AutoresetMode.SAME_STEP:
            raise ValueError(
                f"venv must have autoreset_mode SAME_STEP, got {mode}: "
                'make it with gym.make_vec(..., autoreset_mode="SAME_STEP")'
            )
        if isinstance(info_keys, str):
            raise TypeError(f"info_keys must be a sequence of keys, got the text {info_keys!r}")
        self.venv = venv
        self.info_keys: tuple[str, ...] = tuple(info_keys)
        self._actions: Array | None = None
        self._returns = np.zeros(venv.num_envs)
        self._lengths = np.zeros(venv.num_envs, np.int64)
        self._start_time = time.time()
        super().__init__(venv.num_envs, venv.single_observation_space, venv.single_action_space)

    def reset(self) -> Any:
        """Start all episodes, with the seeds and options set by `seed` and `set_options`."""
        options = self._merged_options()
        seed: Any = None if all(s is None for s in self._seeds) else list(self._seeds)
        given: tuple[Any, Any] = self.venv.reset(seed=seed, options=options or None)
        observation, info = given
        if isinstance(info, list):
            raise TypeError(
                "the info of venv must be a dict, got a list: leave out the wrapper DictInfoToList"
            )
        self.reset_infos: list[dict[str, Any]] = [_lane_info(info, k) for k in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        self._returns[:], self._lengths[:] = 0.0, 0
        return observation

    def step_async(self, actions: Array) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, Array, Array, list[dict[str, Any]]]:
        """Return observations, float32 rewards, dones and a dict of infos for every environment."""
        observation, reward, terminated, truncated, info = self.venv.step(self._actions)
        done: Array = terminated | truncated
        infos, final = self._selected(info), info.get("final_info", {})
        self._returns += reward
        self._lengths += 1
        for lane in np.flatnonzero(done).tolist():
            last = _lane_info(final, lane)
            if "success" in last:
                last["is_success"] = last["success"]  # the key whose rate SB3 logs
            infos[lane] |= last | {
                "terminal_observation": info["final_obs"][lane],
                "TimeLimit.truncated": bool(truncated[lane] and not terminated[lane]),
                "episode": {
                    "r": float(self._returns[lane]),
                    "l": int(self._lengths[lane]),
                    "t": round(time.time() - self._start_time, 6),
                },
            }
        self._returns[done], self._lengths[done] = 0.0, 0
        return observation, reward.astype(np.float32), done, infos

    def _selected(self, info: dict[str, Any]) -> list[dict[str, Any]]:
        """Return a new dict for every lane with the keys that are passed on in every step."""
        if not self.info_keys:
            return [{} for _ in range(self.num_envs)]
        try:
            columns = [info[key] for key in self.info_keys]
        except KeyError as error:
            keys = ", ".join(key for key in info if not key.startswith("_"))
            raise ValueError(f"info_keys must be keys of the info: {keys}; got {error}") from None
        return [dict(zip(self.info_keys, row, strict=True)) for row in zip(*columns, strict=True)]

    def _merged_options(self) -> dict[str, Any]:
        """Return the environments' options as one dict of arrays with a leading environment axis.

        Gymnasium's own vector environments pass the same options to every environment.
        """
        keys = {key for options in self._options for key in options}
        for key in keys:
            if not all(key in options for options in self._options):
                raise ValueError(f"options[{key!r}] must be given for every environment or none")
        if isinstance(self.venv.unwrapped, (SyncVectorEnv, AsyncVectorEnv)):
            for key in keys:
                first, *others = [options[key] for options in self._options]
                if not all(each is first or np.array_equal(each, first) for each in others):
                    raise ValueError(
                        f"options[{key!r}] must be the same for every environment, because "
                        f"{type(self.venv.unwrapped).__name__} passes one value to all of them"
                    )
            return dict(self._options[0])
        chain = getattr(getattr(self.venv.unwrapped, "config", None), "chain", None)
        of_rods = {k for k in keys if k in _OF_RODS or np.ndim(getattr(chain, k, 0.0)) == 1}
        rods = getattr(chain, "n", None)
        return {
            key: _joined([each[key] for each in self._options], rods if key in of_rods else None)
            for key in sorted(keys)
        }

    def close(self) -> None:
        """Close the vector environment."""
        self.venv.close()

    def get_images(self) -> Sequence[Array | None]:
        """Return a picture of every sub-environment."""
        pictures: Any = self.venv.render()
        return pictures or ()

    # -- SB3 asks single environments for these; a native vector environment is one object --------

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return an attribute of the chosen environments; native ones share it."""
        lanes, bare = self._chosen_lanes(indices)
        if hasattr(bare, "get_attr"):
            values = bare.get_attr(attr_name)
            return [values[lane] for lane in lanes]
        holder = self.venv if hasattr(self.venv, attr_name) else bare
        return [getattr(holder, attr_name)] * len(lanes)

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the chosen environments; native ones only all at once."""
        lanes, bare = self._chosen_lanes(indices)
        if hasattr(bare, "set_attr"):
            values = self.get_attr(attr_name)
            for lane in lanes:
                values[lane] = value
            bare.set_attr(attr_name, values)
            return
        self._refuse_some(lanes, "attribute")
        setattr(bare, attr_name, value)

    def env_method(
        self,
        method_name: str,
        *method_args: Any,
        indices: VecEnvIndices = None,
        **method_kwargs: Any,
    ) -> list[Any]:
        """Call a method of all environments; native ones share one call."""
        lanes, bare = self._chosen_lanes(indices)
        if method_name != "compute_reward":  # of goal environments: it has no state
            self._refuse_some(lanes, "method")
        if hasattr(bare, "get_attr"):  # a native one may have a `call` for `render` alone
            return list(bare.call(method_name, *method_args, **method_kwargs))
        holder = self.venv if hasattr(self.venv, method_name) else bare
        return [getattr(holder, method_name)(*method_args, **method_kwargs)] * len(lanes)

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """Return True for SB3's Monitor, whose statistics are in the infos."""
        return [issubclass(wrapper_class, Monitor)] * len(self._chosen_lanes(indices)[0])

    def _chosen_lanes(self, indices: VecEnvIndices) -> tuple[list[int], Any]:
        """Return the chosen sub-environments and the vector environment without its wrappers."""
        return list(self._get_indices(indices)), self.venv.unwrapped

    def _refuse_some(self, lanes: list[int], what: str) -> None:
        if lanes != list(range(self.num_envs)):
            raise ValueError(f"indices must be all environments or None: they share the {what}")


def _check_many(venv: Any) -> None:
    """Raise a TypeError for what is no vector environment of Gymnasium, with the way to one."""
    if isinstance(venv, VectorEnv) or hasattr(venv, "single_observation_space"):
        return
    if isinstance(venv, VecEnv):
        way = "a VecEnv of Stable-Baselines3 goes to the algorithm as it is"
    else:
        spec = getattr(venv, "spec", None)
        given = venv if isinstance(venv, str) else getattr(spec, "id", "npend/SwingUp-v1")
        way = f'gym.make_vec({given!r}, num_envs=32, autoreset_mode="SAME_STEP") makes one'
    raise TypeError(f"venv must be a vector environment of Gymnasium, got {venv!r}: {way}")


def _joined(values: Sequence[Any], rods: int | None) -> Any:
    """Return the values of all environments as an array, or the one number that all of them are.

    One number of a sub-environment stands for all its `rods`.
    """
    first = values[0]
    if np.ndim(first) == 0 and all(np.ndim(value) == 0 and value == first for value in values):
        return first
    if rods is not None:
        values = [np.full(rods, each) if np.ndim(each) == 0 else each for each in values]
    return np.stack(values)


def _lane_info(infos: Any, lane: int) -> dict[str, Any]:
    """Return the info of one lane from that of a vector environment, as Python's own numbers."""
    info: dict[str, Any] = {}
    for key, value in infos.items():
        if key.startswith("_") or not infos[f"_{key}"][lane]:
            continue
        entry = _lane_info(value, lane) if isinstance(value, dict) else value[lane]
        info[key] = entry.item() if isinstance(entry, np.generic) else entry
    return info
