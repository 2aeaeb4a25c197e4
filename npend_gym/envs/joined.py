"""Several vector environments as one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space

from npend_gym import _checks
from npend_gym._checks import BoolArray
from npend_gym.envs.inputs import given_options, reset_mask
from npend_gym.envs.seeds import checked_seeds


class JoinedVectorEnv(VectorEnv[Any, Any, Any]):
    """Several vector environments as one, such as chains of several lengths in `VectorPadRods`.

    Its sub-environments are those of the first environment, then those of the second, and so on.
    Where arrays of an info have fewer columns than others, zeros follow.

    Parameters
    ----------
    envs : sequence of gymnasium.vector.VectorEnv
        With equal spaces of a sub-environment, and the same autoreset mode.

    Raises
    ------
    TypeError, ValueError
        If the spaces or the autoreset modes differ, one comes twice, is no vector environment or
        observes no array.

    Examples
    --------
    >>> import gymnasium as gym
    >>> import npend_gym
    >>> from npend_gym.envs import JoinedVectorEnv, VectorPadRods
    >>> each = [gym.make_vec("npend/Balance-v1", num_envs=4, n=n) for n in (1, 2)]
    >>> envs = JoinedVectorEnv([VectorPadRods(one, n_max=2) for one in each])
    >>> observations, info = envs.reset(seed=0)
    >>> observations.shape, info["theta"].shape
    ((8, 8), (8, 2))
    """

    def __init__(self, envs: Sequence[Any]) -> None:
        self.envs: list[Any] = _checks.listed("envs", envs, "[envs, other_envs]")
        if not self.envs:
            raise ValueError("envs must have at least one vector environment, got none")
        if len({id(getattr(each, "unwrapped", each)) for each in self.envs}) < len(self.envs):
            raise ValueError(
                "envs must be different environments, got one twice: make one for each"
            )
        first = self.envs[0]
        for each in self.envs:
            if not hasattr(each, "single_action_space"):
                raise TypeError(f"envs must be vector environments, got {_checks.show(each)}")
            if not isinstance(each.single_observation_space, Box):
                raise ValueError(
                    "envs must observe arrays: leave out goal_env, whose Dict has none; got "
                    f"{each.single_observation_space}"
                )
            for name in ("single_observation_space", "single_action_space"):
                own, other = getattr(first, name), getattr(each, name)
                if own != other:
                    raise ValueError(f"envs must have equal spaces, got {own} and {other}")
            own, other = (one.metadata.get("autoreset_mode") for one in (first, each))
            if own != other:
                raise ValueError(f"envs must have one autoreset mode, got {own} and {other}")
        self.num_envs: int = sum(each.num_envs for each in self.envs)
        self._parts = np.cumsum([each.num_envs for each in self.envs])[:-1]
        self._last: list[Any] = []
        self.metadata = first.metadata
        self.render_mode: str | None = first.render_mode
        self.single_observation_space = first.single_observation_space
        self.single_action_space = first.single_action_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:  # fmt: skip
        """Begin episodes: sub-environment k with seed + k, or seed[k].

        Of `options`, "reset_mask" is of all sub-environments; others go to every environment.
        """
        given = checked_seeds(seed, self.num_envs)
        if isinstance(given, int):
            given = [given + k for k in range(self.num_envs)]
        seeds = np.split(np.array(given, object), self._parts) if given is not None else None
        mask = given_options(options).get("reset_mask")
        masks = np.split(reset_mask(mask, self.num_envs, every=not self._last), self._parts)
        results: list[tuple[Any, dict[str, Any]]] = []
        for k, (env, mask) in enumerate(zip(self.envs, masks, strict=True)):
            if not mask.any():
                results.append((self._last[k], {}))
                continue
            own = options and options | ({"reset_mask": mask} if "reset_mask" in options else {})
            results.append(env.reset(seed=seeds and seeds[k].tolist(), options=own))
        return self._joined(results)

    def step(self, actions: Any) -> tuple[Any, Any, BoolArray, BoolArray, dict[str, Any]]:
        """Take a step of all environments, one after the other."""
        given = np.asarray(actions)
        if given.shape[:1] != (self.num_envs,):
            raise ValueError(
                f"action must have a row for each of the {self.num_envs} sub-environments, got the "
                f"shape {given.shape}"
            )
        if given.dtype.kind == "f" and not np.isfinite(given).all():  # before any takes the step
            raise ValueError(f"action must be finite, got {_checks.show(actions)}")
        parts = zip(self.envs, np.split(given, self._parts), strict=True)
        results = [env.step(own) for env, own in parts]
        reward, terminated, truncated = (
            np.concatenate([each[k] for each in results]) for k in (1, 2, 3)
        )
        observation, info = self._joined([(each[0], each[-1]) for each in results])
        return observation, reward, terminated, truncated, info

    def _joined(self, results: list[tuple[Any, dict[str, Any]]]) -> tuple[Any, dict[str, Any]]:
        self._last = [observation for observation, _ in results]
        sizes = [each.num_envs for each in self.envs]
        return np.concatenate(self._last), _joined([info for _, info in results], sizes)

    def render(self) -> tuple[Any, ...] | None:
        """Return the pictures of all sub-environments."""
        pictures = [each.render() for each in self.envs]
        return None if None in pictures else sum(pictures, ())

    def close_extras(self, **kwargs: Any) -> None:
        """Close the environments."""
        for each in self.envs:
            each.close(**kwargs)


def _joined(infos: Sequence[dict[str, Any]], sizes: Sequence[int]) -> dict[str, Any]:
    """Return the infos of vector environments as one; zeros stand where one lacks a key."""
    joined: dict[str, Any] = {}
    for key in dict.fromkeys(key for info in infos for key in info):
        given = [info.get(key) for info in infos]
        some: Any = next(value for value in given if value is not None)
        if isinstance(some, dict):
            joined[key] = _joined([value or {} for value in given], sizes)
            continue
        arrays: list[Any] = [value for value in given if value is not None]
        kind = np.result_type(*(value.dtype for value in arrays))
        shape = max(value.shape[1:] for value in arrays)
        out = np.full((sum(sizes), *shape), None if kind.kind == "O" else 0, kind)
        for value, end, size in zip(given, np.cumsum(sizes), sizes, strict=True):
            if value is not None:
                out[(slice(end - size, end), *map(slice, np.shape(value)[1:]))] = value
        joined[key] = out
    return joined
