"""What an environment would observe of measured angles and velocities, for controllers outside."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from npend_gym import _checks
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.rows import MAX_CART_ENTRY
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
        Of the environment: ``EnvConfig(**policy.env)``, or ``env.unwrapped.config``.
    theta, omega : array_like, shape (n,) or (B, n)
        Angles [rad], zero where a rod hangs, and angular velocities [rad/s]; these are not used
        with ``observe_velocities=False``.
    relative : bool
        Whether they are those of the joints, as encoders between two rods measure them.
    cart_position, cart_velocity : array_like, shape () or (B,)
        Of a cart [m], [m/s].
    goal : array_like, shape (n,) or (B, n), optional
        ``info["goal"]``, in the mode "transition".

    Returns
    -------
    ndarray, float32, shape (k,) or (B, k)

    Raises
    ------
    ValueError
        If a shape is wrong or a number not finite, if the goal is missing, or if the environment
        observes its context.

    Examples
    --------
    >>> from npend_gym.envs import EnvConfig
    >>> from npend_gym.rl import observation_of
    >>> config = EnvConfig(n=2, observation="sincos")
    >>> observation_of(config, [0.0, 0.0], [1.0, 2.0]).tolist()
    [0.0, 0.0, 1.0, 1.0, 1.0, 2.0]
    """
    if config.observe_context:
        raise ValueError("observe_context must be False: nobody measures what was drawn")
    angles, speeds = _rows("theta", theta, config.n), _rows("omega", omega, config.n)
    if angles.shape != speeds.shape:
        raise ValueError(f"omega must have the shape of theta, {angles.shape}, got {speeds.shape}")
    if relative:
        angles, speeds = np.cumsum(angles, axis=-1), np.cumsum(speeds, axis=-1)
    parts: list[Any] = [np.sin(angles), np.cos(angles)]
    if not config.with_sines:
        turned = np.float32(wrap(angles))
        parts = [np.where(turned >= np.float32(np.pi), -np.float32(np.pi), turned)]
    if config.observe_velocities:
        limit = config.speed_limit
        parts.append(np.clip(speeds / config.speed_scale, -limit, limit))
    lead = angles.shape[:-1]
    if config.rail is not None:
        entries = [np.asarray(cart_position) / config.rail]
        if config.observe_velocities:
            entries.append(np.asarray(cart_velocity) * config.cart_speed_factor)
        clipped = (np.clip(entry, -MAX_CART_ENTRY, MAX_CART_ENTRY) for entry in entries)
        parts += [np.broadcast_to(entry, lead)[..., None] for entry in clipped]
    if config.observes_goals:
        if goal is None:
            raise ValueError(f"goal must be given in mode {config.mode.name!r}")
        parts.append(np.broadcast_to(np.cos(_rows("goal", goal, config.n)), angles.shape))
    return np.concatenate(parts, axis=-1).astype(np.float32)


def _rows(name: str, given: ArrayLike, n: int) -> NDArray[np.float64]:
    """Return numbers of n rods, one state or several."""
    numbers = _checks.array(name, given)
    if numbers.ndim not in (1, 2) or numbers.shape[-1] != n:
        raise ValueError(f"{name} must have the shape ({n},) or (B, {n}), got {numbers.shape}")
    return numbers
