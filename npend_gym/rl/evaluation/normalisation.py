"""Statistics by which a model normalised what it observed in its training."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from gymnasium.wrappers.vector import NormalizeObservation

from npend_gym.envs.config import EnvConfig
from npend_gym.rl.evaluation.wrappers import WAY_OUT, changing_wrappers, is_normalizing

_ROUNDING = 1e-3  # more than that of a sine and a cosine in float32


def trained_through(model: Any, config: EnvConfig) -> tuple[Any, ...]:
    """Return the wrappers through which a model observed in its training."""
    env = model.get_env()
    wrappers = () if env is None else changing_wrappers(env)
    if not any(map(is_normalizing, wrappers)) and _saw_normalised(model, config):
        raise _without_statistics(model)
    return wrappers


def check_statistics(model: Any, wrappers: Sequence[Any]) -> None:
    """Raise an error if a trained model would observe through a normalisation that saw nothing."""
    if any(map(_is_new, wrappers)) and getattr(model, "num_timesteps", 1) > 0:
        raise _without_statistics(model)


def _without_statistics(model: Any) -> ValueError:
    return ValueError(
        "the model must have the statistics of its observations, because it was trained with "
        "VecNormalize: load it with them, "
        f"{type(model).__name__}.load(path, env=VecNormalize.load(path_of_statistics, venv)), "
        f"give NormalizeObservation the obs_rms of the training, {WAY_OUT}"
    )


def _is_new(wrapper: Any) -> bool:
    """Return whether a wrapper normalises by statistics of no observation at all."""
    if isinstance(wrapper, NormalizeObservation):
        return cast("Any", wrapper).obs_rms.count < 1.0
    if not is_normalizing(wrapper) or not wrapper.norm_obs:
        return False
    kept, keys = wrapper.obs_rms, wrapper.norm_obs_keys  # keys of a Dict, else None
    return any(part.count < 1.0 for part in ([kept] if keys is None else map(kept.get, keys)))


def _saw_normalised(model: Any, config: EnvConfig) -> bool:
    """Return whether a model tells that its last training had a VecNormalize, which is missing.

    Stable-Baselines3 keeps the last observation before its normalisation. Off-policy algorithms
    keep one without a VecNormalize too. There the last observation itself tells, where it is one
    that no environment shows: beyond its bounds, or a sine and a cosine of no angle.
    """
    original = getattr(model, "_last_original_obs", None)
    last: Any = getattr(model, "_last_obs", None)
    if original is None or not hasattr(model, "replay_buffer"):
        return original is not None
    space, n = model.observation_space, config.n
    if np.shape(last)[1:] != (config.observed,):  # none, or of a goal_env
        return False
    if config.with_sines:
        radius = np.hypot(last[:, :n], last[:, n : 2 * n])
        return bool(np.any(np.abs(radius - 1.0) > _ROUNDING))
    return bool(np.any((last < space.low) | (last > space.high)))
