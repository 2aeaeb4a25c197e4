"""Rollouts: a controller acts in vector environments, side by side, until all episodes are over."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
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
            The info of the vector environment, with the state in ``info["theta"]`` and
            ``info["omega"]``. It is exact where sensors are ideal and velocities are observed. Else
            it is the state as observed, and only keys that follow from it are there: see
            `Observer`.

        Returns
        -------
        ndarray, shape (B, joints)
            Torques divided by their limit; values outside [-1, 1] are clipped. With discrete
            actions (`torque_levels`) their numbers, shape (B,).
        """
        ...


class Result:
    """The base of results that are printed as one line, the means of `as_row`."""

    as_row: Any

    def __repr__(self) -> str:
        row = ", ".join(f"{name}={value:g}" for name, value in self.as_row().items())
        return f"{type(self).__name__}({row})"


class Step(NamedTuple):
    """What happened in one step of B sub-environments."""

    running: BoolArray  # sub-environments whose episode was not over before it, (B,)
    before: dict[str, Any]  # the info before it
    reward: FloatArray
    info: dict[str, Any]


def rollout(controller: Controller, envs: Any, seed: int, options: Any = None) -> Iterator[Step]:
    """Begin episodes in all sub-environments; yield every step until all are over; close `envs`.

    Parameters
    ----------
    controller : Controller
    envs : NPendulumVectorEnv
    seed : int
        Of the first sub-environment, as for `reset`.
    options : dict, optional
        For `reset`.

    Yields
    ------
    Step

    Examples
    --------
    >>> from npend_gym import rl
    >>> setting = rl.setting_of({"n": 1, "mode": "balance", "max_episode_steps": 3})
    >>> steps = rl.rollout(rl.lqr(setting.config), setting.make(2), seed=0)
    >>> [step.running.tolist() for step in steps]
    [[True, True], [True, True], [True, True]]
    """
    with closing(envs):
        observation, info = envs.reset(seed=seed, options=options)
        forget(controller, envs.num_envs)
        running = np.ones(envs.num_envs, np.bool_)
        while running.any():
            action, before = controller(observation, info), info
            observation, reward, terminated, truncated, info = envs.step(action)
            yield Step(running, before, reward, info)
            running = running & ~(terminated | truncated)


def forget(controller: Controller, num_envs: int) -> None:
    """Let a controller with a memory begin episodes in `num_envs` environments."""
    reset = getattr(controller, "reset", None)
    if reset is not None:
        reset(num_envs)


def joint_motion(info: Mapping[str, Any]) -> FloatArray:
    """Return angles and velocities of the joints, then those of a cart, (2, B, n) or more.

    They are in rad and rad/s; the place of a cart is in m, its velocity in m/s.
    """
    turned: FloatArray = np.diff([info["theta"], info["omega"]], prepend=0.0)
    if "cart_position" in info:
        cart = np.array([info["cart_position"], info["cart_velocity"]])
        turned = np.append(turned, cart[..., None], axis=-1)
    return turned


class JoinedEnvs:
    """Several vector environments as one: a controller acts on all of them at once.

    They show the same observations and take the same actions, and may differ in all else.
    """

    def __init__(self, envs: Sequence[Any]) -> None:
        self.envs: list[Any] = list(envs)
        sizes = [env.num_envs for env in self.envs]
        self.num_envs: int = sum(sizes)
        self._firsts = np.cumsum([0, *sizes[:-1]])
        self.infos: list[dict[str, Any]] = []  # the latest of each environment

    def split(self, values: NDArray[Any]) -> list[NDArray[Any]]:
        """Return the parts of an array, (B, ...), that belong to each of the environments."""
        return np.split(values, self._firsts[1:])

    def reset(self, seed: int, options: Sequence[dict[str, Any]]) -> tuple[Any, dict[str, Any]]:
        """Begin an episode in every one, of seeds `seed`, `seed` + 1, ..., with options by env."""
        given = zip(self.envs, self._firsts.tolist(), options, strict=True)
        return self._joined([env.reset(seed=seed + k, options=each) for env, k, each in given])

    def step(self, action: Any) -> tuple[Any, FloatArray, BoolArray, BoolArray, dict[str, Any]]:
        """Step all environments."""
        given = zip(self.envs, self.split(np.asarray(action)), strict=True)
        return self._joined([env.step(part) for env, part in given])

    def _joined(self, results: Sequence[tuple[Any, ...]]) -> Any:
        """Results of the environments, joined as one.

        Of info it has the keys that all have, in one shape: what is drawn differs in number.
        """
        *arrays, infos = zip(*results, strict=True)
        self.infos = list(infos)
        info = dict[str, Any]()
        for key in infos[0]:
            parts = [each[key] for each in infos if key in each]
            if len(parts) == len(infos) and len({part.shape[1:] for part in parts}) == 1:
                info[key] = np.concatenate(parts)
        return *map(np.concatenate, arrays), info

    def close(self) -> None:
        """Close all environments."""
        for env in self.envs:
            env.close()


_OF_VELOCITIES = "omega", "cart_velocity", "energy"  # keys of `info`
_PASSED = "time", "goal", "context"  # on to controllers: sensors have no part in these


class Observer:
    """A controller that is given the state as its sensors show it, in place of the exact one.

    Noise and delay then reach controllers that read ``info["theta"]`` and ``info["omega"]``. The
    angles observed are joined to a path without jumps; "energy" and "tip_height" are those of this
    state. Of the other keys only "time", "goal" and an observed "context" are passed on. Velocities
    that are not observed are left out. `config` is that of the environment as made, without errors
    of the model.
    """

    def __init__(self, controller: Controller, config: EnvConfig) -> None:
        self._controller, self._config = controller, config
        self._theta: FloatArray | None = None

    def reset(self, num_envs: int) -> None:
        """Forget the angles observed, and let the controller forget."""
        self._theta = None
        forget(self._controller, num_envs)

    def __call__(self, observation: Any, info: dict[str, Any]) -> NDArray[Any]:
        """Return the actions of the controller."""
        config = self._config
        passed = _PASSED if config.observe_context else _PASSED[:-1]
        observed = {key: info[key] for key in passed if key in info}
        seen = observation["observation"] if config.goal_env else observation
        observed |= self._state(np.asarray(seen, np.float64))
        try:
            return self._controller(observation, observed)
        except KeyError as error:
            key = error.args[0]
            if not config.observe_velocities and key in _OF_VELOCITIES:
                raise ValueError(
                    f"observe_velocities must be True for a controller that reads info[{error}], "
                    "got False: FromAngles(controller, config) estimates velocities"
                ) from error
            if key not in info or key in observed:
                raise
            raise ValueError(
                f"model must read only what sensors show, which are {', '.join(observed)}; got "
                f"info[{error}]: compute it from these, or leave errors of sensors out of env"
            ) from error

    def _state(self, seen: FloatArray) -> dict[str, Any]:
        """State that observations, (B, k), show."""
        config = self._config
        shown = {name: seen[:, columns] for name, columns in config.columns.items()}
        theta = (
            np.arctan2(shown["sines"], shown["cosines"]) if config.with_sines else shown["angles"]
        )
        if self._theta is not None:
            theta = self._theta + wrap(theta - self._theta)
        self._theta = theta
        tip = energy.positions(config.chain, theta)[:, -1, 1]
        state: dict[str, Any] = {"theta": theta, "tip_height": tip}
        if config.rail is not None:
            state["cart_position"] = shown["cart"][:, 0] * config.rail
        if not config.observe_velocities:
            return state
        omega, velocity = shown["speeds"] * config.speed_scale, None
        if config.rail is not None:
            velocity = state["cart_velocity"] = shown["cart"][:, 1] / config.cart_speed_factor
        kinetic = energy.kinetic_of_motion(config.chain, theta, omega, velocity, None, None)
        return state | {
            "omega": omega, "energy": kinetic + energy.potential_energy(config.chain, theta)
        }  # fmt: skip
