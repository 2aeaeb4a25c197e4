"""Rollouts: a controller acts in vector environments, side by side, until all episodes are over."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.envs.config import EnvConfig
from npend_gym.physics import energy
from npend_gym.rl.angles import wrap


class Controller(Protocol):
    """Anything that chooses actions: a `Policy`, a regulator, or a function of one's own.

    One with a memory has a method ``reset(num_envs)`` too, called before the first step.
    """

    def __call__(self, observation: NDArray[np.float32], info: dict[str, Any]) -> NDArray[Any]:
        """Return the actions of all environments.

        Parameters
        ----------
        observation : ndarray, float32, shape (B, k)
        info : dict
            The info of the vector environment, with the exact state in ``info["theta"]`` and
            ``info["omega"]``.

        Returns
        -------
        ndarray, shape (B, joints)
            Torques divided by their limit; values outside [-1, 1] are clipped. With discrete
            actions (`torque_levels`) their numbers, shape (B,).
        """
        ...


class Step(NamedTuple):
    """What happened in one step of B lanes."""

    running: BoolArray  # lanes whose episode was not over before it, (B,)
    action: NDArray[Any]
    reward: FloatArray
    info: dict[str, Any]


def rollout(
    controller: Controller, envs: Any, observation: Any, info: dict[str, Any]
) -> Iterator[Step]:
    """Step `envs`, which have just been reset, and yield every step until all episodes are over."""
    forget = getattr(controller, "reset", None)
    if forget is not None:
        forget(envs.num_envs)
    running = np.ones(envs.num_envs, np.bool_)
    while running.any():
        action = controller(observation, info)
        observation, reward, terminated, truncated, info = envs.step(action)
        yield Step(running, action, reward, info)
        running = running & ~(terminated | truncated)


class Lanes:
    """Several vector environments as one: a controller acts on the lanes of all of them at once.

    They show the same observations and take the same actions, and may differ in all else.
    """

    def __init__(self, envs: Sequence[Any]) -> None:
        self._envs = list(envs)
        sizes = [env.num_envs for env in self._envs]
        self.num_envs, self._firsts = sum(sizes), np.cumsum([0, *sizes[:-1]])

    def reset(self, seed: int, options: Sequence[dict[str, Any]]) -> tuple[Any, dict[str, Any]]:
        """Begin an episode in every lane, of seeds `seed`, `seed` + 1, ..., with options by env."""
        told = [
            env.reset(seed=seed + int(first), options=given)
            for env, first, given in zip(self._envs, self._firsts, options, strict=True)
        ]
        return np.concatenate([observation for observation, _ in told]), _joined(
            [info for _, info in told]
        )

    def step(self, action: Any) -> tuple[Any, FloatArray, BoolArray, BoolArray, dict[str, Any]]:
        """Step all environments."""
        parts = np.split(np.asarray(action), self._firsts[1:])
        told = [env.step(part) for env, part in zip(self._envs, parts, strict=True)]
        observation, reward, terminated, truncated = (
            np.concatenate([each[k] for each in told]) for k in range(4)
        )
        return observation, reward, terminated, truncated, _joined([each[4] for each in told])

    def close(self) -> None:
        """Close all environments."""
        for env in self._envs:
            env.close()


def _joined(infos: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the keys that all have, each with the lanes of all."""
    common = [key for key in infos[0] if all(key in info for info in infos)]
    return {key: np.concatenate([info[key] for info in infos]) for key in common}


_OF_VELOCITIES = "omega", "cart_velocity", "energy"  # keys of `info`


class Observer:
    """A controller that is told the state as its sensors show it, in place of the exact one.

    Noise and delay then reach controllers that read ``info["theta"]`` and ``info["omega"]``. The
    angles observed are joined to a path without jumps; "energy" is that of this state. Of the other
    keys only "time" and "goal" are passed on. Velocities that are not observed are not told.

    Parameters
    ----------
    controller : callable
    config : EnvConfig
        Of the environment as made, without errors of the model.
    """

    def __init__(self, controller: Controller, config: EnvConfig) -> None:
        self._controller, self._config = controller, config
        self._theta: FloatArray | None = None

    def reset(self, num_envs: int) -> None:
        """Forget the angles observed, and let the controller forget."""
        self._theta = None
        forget = getattr(self._controller, "reset", None)
        if forget is not None:
            forget(num_envs)

    def __call__(self, observation: NDArray[np.float32], info: dict[str, Any]) -> NDArray[Any]:
        """Return the actions of the controller."""
        told = {key: info[key] for key in ("time", "goal") if key in info}
        told |= self._state(np.asarray(observation, np.float64))
        try:
            return self._controller(observation, told)
        except KeyError as error:
            if self._config.observe_velocities or error.args[0] not in _OF_VELOCITIES:
                raise
            raise ValueError(
                f"observe_velocities must be True for a controller that reads info[{error}], got "
                "False"
            ) from error

    def _state(self, seen: FloatArray) -> dict[str, Any]:
        """Return what observations, (B, k), say of the state."""
        config, n = self._config, self._config.n
        theta, rest = seen[:, :n], seen[:, n:]
        if config.with_sines:
            theta, rest = np.arctan2(theta, seen[:, n : 2 * n]), seen[:, 2 * n :]
        if self._theta is not None:
            theta = self._theta + wrap(theta - self._theta)
        self._theta = theta
        told: dict[str, Any] = {"theta": theta}
        speeds = n if config.observe_velocities else 0
        if config.rail is not None:
            told["cart_position"] = rest[:, speeds] * config.rail
        if not config.observe_velocities:
            return told
        omega, velocity = rest[:, :n] * config.speed_scale, None
        if config.rail is not None:
            velocity = told["cart_velocity"] = rest[:, n + 1] / config.cart_speed_factor
        kinetic = energy.kinetic_of_motion(config.chain, theta, omega, velocity, None, None)
        return told | {
            "omega": omega, "energy": kinetic + energy.potential_energy(config.chain, theta)
        }  # fmt: skip
