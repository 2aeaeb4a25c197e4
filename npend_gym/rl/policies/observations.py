"""What an environment would observe of measured angles and velocities, for controllers outside."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from npend_gym import _checks
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.rows import MAX_CART_ENTRY
from npend_gym.envs.session import kind_shown
from npend_gym.rl.angles import wrap


def observation_of(
    config: EnvConfig,
    theta: ArrayLike,
    omega: ArrayLike,
    *,
    relative: bool = False,
    cart_position: ArrayLike = 0.0,
    cart_velocity: ArrayLike = 0.0,
    goal: ArrayLike | None = None,
) -> NDArray[np.float32]:
    """Return the observation of an environment, for angles and velocities that were measured.

    Parameters
    ----------
    config : EnvConfig
        Settings of the environment: ``EnvConfig(**policy.env)``, or ``env.unwrapped.config``.
    theta, omega : array_like, shape (n,) or (B, n)
        Angles [rad], zero where a rod hangs, and angular velocities [rad/s]; these are not used
        with ``observe_velocities=False``.
    relative : bool
        Whether angles and velocities are relative to the rod above, as encoders between two rods
        measure them.
    cart_position, cart_velocity : array_like, shape () or (B,)
        Of a cart [m], [m/s].
    goal : array_like, shape (n,) or (B, n), optional
        ``info["goal"]``, in the mode "transition"; left out with `goal_env`, where the goal is an
        entry of its own.

    Returns
    -------
    ndarray, float32, shape (k,) or (B, k)

    Raises
    ------
    ValueError, TypeError
        If a shape is wrong or a number not finite; if the goal is missing; if a cart or a goal is
        given that the environment does not have; or if it observes its context.

    Examples
    --------
    >>> from npend_gym.envs import EnvConfig
    >>> from npend_gym.rl import observation_of
    >>> config = EnvConfig(n=2, observation="sincos")
    >>> observation_of(config, [0.0, 0.0], [1.0, 2.0]).tolist()
    [0.0, 0.0, 1.0, 1.0, 1.0, 2.0]
    """
    if not isinstance(config, EnvConfig):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise TypeError(
            "config must be the settings of an environment, policy.config, env.unwrapped.config or "
            f"EnvConfig(...); got {_checks.show(config)}"
        )
    if config.observe_context:
        raise ValueError("observe_context must be False, because sensors do not measure it")
    angles, speeds = _rows("theta", theta, config.n), _rows("omega", omega, config.n)
    if angles.shape != speeds.shape:
        raise ValueError(f"omega must have the shape of theta, {angles.shape}, got {speeds.shape}")
    if relative:
        angles, speeds = np.cumsum(angles, axis=-1), np.cumsum(speeds, axis=-1)
    turned, limit = np.float32(wrap(angles)), config.speed_limit
    parts: dict[str, Any] = {
        "angles": np.where(turned >= np.float32(np.pi), -np.float32(np.pi), turned),
        "sines": np.sin(angles),
        "cosines": np.cos(angles),
        "speeds": np.clip(speeds / config.speed_scale, -limit, limit),
    }
    lead = angles.shape[:-1]
    place = _checks.broadcast("cart_position", cart_position, lead)
    velocity = _checks.broadcast("cart_velocity", cart_velocity, lead)
    if config.rail is not None:
        entries = np.stack([place / config.rail, velocity * config.cart_speed_factor], axis=-1)
        seen = entries if config.observe_velocities else entries[..., :1]
        parts["cart"] = np.clip(seen, -MAX_CART_ENTRY, MAX_CART_ENTRY)
    elif np.any(place) or np.any(velocity):
        raise ValueError("cart_position and cart_velocity must be 0 for a chain without a cart")
    if (goal is not None) != config.observes_goals:
        needed = "given" if config.observes_goals else "left out"
        where = "with goal_env=True" if config.goal_env else f"in mode {config.mode.name!r}"
        raise ValueError(f"goal must be {needed} {where}")
    if goal is not None:
        goals = _rows("goal", goal, config.n)
        try:
            parts["goals"] = np.broadcast_to(np.cos(goals), angles.shape)
        except ValueError as error:
            wanted = f"({config.n},)" + (f" or {angles.shape}" if angles.ndim == 2 else "")
            raise ValueError(
                f"goal must have the shape {wanted} for theta of shape {angles.shape}, "
                f"got {goals.shape}"
            ) from error
    return np.concatenate([parts[name] for name in config.columns], axis=-1).astype(np.float32)


def check_observation(
    config: EnvConfig, observation: ArrayLike, info: Mapping[str, Any] | None
) -> None:
    """Raise an error if the first observations of episodes are certainly not those of `config`.

    Observations with sines have as many entries if their velocities are scaled as if they are not.
    With noise or delay an observation fits no velocities, and nothing is certain. A chain at rest
    shows nothing in its first observation, so the second is looked at too.
    """
    if info is None:
        kind = kind_shown(observation)
        if kind not in (None, config.observation):
            raise _other_kind(config, repr(kind))
        return
    if not {"time", "theta", "omega"} <= info.keys() or np.min(info["time"]) > 1.5 * config.dt:
        return
    n, shown = config.n, None
    if np.shape(info["theta"])[-1:] != (n,):
        shown = f"that of {np.shape(info['theta'])[-1]} rods"
    elif config.with_sines and config.observe_velocities:
        seen, speeds = np.asarray(observation)[..., 2 * n : 3 * n], np.asarray(info["omega"])
        if seen.shape == speeds.shape and not _are(seen, speeds, config):
            other = "scaled" if config.observation == "sincos" else "sincos"
            if _are(seen, speeds, EnvConfig(chain=config.chain, observation=other)):
                shown = repr(other)
    if shown is not None:
        raise _other_kind(config, shown)


def _other_kind(config: EnvConfig, shown: str) -> ValueError:
    return ValueError(
        f"observation must be {config.observation!r} of {config.n} rods, on which the policy was "
        f"trained, got {shown}: make the environment with the policy's keywords, "
        "gym.make(..., **policy.env)"
    )


def _are(seen: NDArray[Any], speeds: NDArray[Any], config: EnvConfig) -> bool:
    """Return whether velocities observed are these [rad/s], to the rounding of float32."""
    limit = config.speed_limit
    own = np.clip(speeds / config.speed_scale, -limit, limit)
    return np.allclose(seen, own, rtol=1e-5, atol=1e-9)


def _rows(name: str, given: ArrayLike, n: int) -> NDArray[np.float64]:
    """Return numbers of n rods, one state or several."""
    numbers = _checks.array(name, given)
    if numbers.ndim not in (1, 2) or numbers.shape[-1] != n:
        raise ValueError(f"{name} must have the shape ({n},) or (B, {n}), got {numbers.shape}")
    return numbers
