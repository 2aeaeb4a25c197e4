"""Disturbances: torques at all joints, beside or in place of those of a controller."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import Chain
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.inputs import checked_action
from npend_gym.rl.evaluation.settings import EnvSetting

# Over the torque limit, which was 6 N m there: RealAIGym, `robustness_v2/benchmark_controller.py`
# and `simulation/perturbations.py` of dfki-ric-underactuated-lab/double_pendulum
_PLACES, _PULSES = 6, 3  # in time; for each joint
_AMPLITUDE = (0.5 / 6.0, 5.0 / 6.0)
_WIDTH = (0.05, 0.1)  # standard deviation [s]


# What acts on the joints in a step, by its number and the info before it: torques [N m], (B, n),
# and in which sub-environments the controller acts as well, (B,)
Disturbance = Callable[[int, dict[str, Any]], tuple[FloatArray, BoolArray]]


def holding_torques(chain: Chain, theta: FloatArray) -> FloatArray:
    """Return the torques at all joints that hold the rods where they are [N m], (B, n)."""
    weight = chain.gravity * chain.lift * np.sin(theta)
    return np.cumsum(weight[:, ::-1], axis=1)[:, ::-1]


class DisturbedEnvs:
    """A vector environment whose joints all take a disturbance beside the controller's torques.

    To a controller it is the environment of the same setting. That behind it has a motor at every
    joint, with twice the torque limit, so that a disturbance can exceed the controller's limit.
    Where the setting has no motor there is no noise.
    """

    def __init__(self, setting: EnvSetting, num_envs: int, disturbance: Disturbance) -> None:
        config = setting.config
        if config.max_torque == 0.0:
            raise ValueError(
                "max_torque must be greater than zero, because disturbances are torques in "
                "proportion to it; got 0"
            )
        self.config: EnvConfig = config
        self.num_envs: int = num_envs
        self.disturbance: Disturbance = disturbance
        own = config.joints[config.joints < config.n].tolist()
        rest = [joint for joint in range(config.n) if joint not in own]
        every: dict[str, Any] = {"actuated": (*own, *rest), "max_torque": 2.0 * config.max_torque}
        every |= {"difficulty": None, "torque_levels": None}
        drawn: Any = config.randomize or {}
        ends = drawn.get("max_torque")
        if hasattr(ends, "keys"):  # values, not factors
            doubled = {end: 2.0 * np.asarray(ends[end]) for end in ("low", "high")}
            every["randomize"] = {**drawn, "max_torque": doubled}
        if config.has_cart:
            every["max_force"] = config.max_force
        self._envs = setting.make(num_envs, **every)
        self._envs.unwrapped.set_noisy_motors(config.joints.size)
        behind: EnvConfig = self._envs.unwrapped.config
        self._joints = behind.joints[behind.joints < config.n]
        self._of_joints = behind.joints < config.n
        self._columns = slice(config.joints.size)  # the controller's motors are the first
        limits = behind.action_limits[self._columns]
        # a cart without force stays without
        self._ratio = config.action_limits / np.where(limits > 0.0, limits, 1.0)
        self._limit = behind.max_torque
        self._step, self._info = 0, dict[str, Any]()

    def reset(self, **arguments: Any) -> tuple[Any, dict[str, Any]]:
        """Begin an episode in every sub-environment."""
        observation, self._info = self._envs.reset(**arguments)
        self._step = 0
        self._show_own_motors()
        return observation, self._info

    def step(self, action: Any) -> tuple[Any, FloatArray, BoolArray, BoolArray, dict[str, Any]]:
        """Step all sub-environments."""
        config, shape = self.config, (self.num_envs, self.config.joints.size)
        taken = np.clip(np.asarray(checked_action(action, shape, config.action_table)), -1.0, 1.0)
        torque, active = self.disturbance(self._step, self._info)
        whole = np.zeros((self.num_envs, self._of_joints.size))
        whole[:, self._columns] = np.where(active[:, None], taken * self._ratio, 0.0)
        whole[:, self._of_joints] += torque[:, self._joints] / self._limit
        result = self._envs.step(whole)
        self._step, self._info = self._step + 1, result[-1]
        self._show_own_motors()
        return result

    def _show_own_motors(self) -> None:
        """Keep the torques at the joints that the controller drives; disturbances are in them."""
        self._info["torque"] = self._info["torque"][:, self._columns]

    def close(self) -> None:
        """Close the environment."""
        self._envs.close()


class Pulses:
    """Short torques in every episode at random times, three at each of some joints, at most six.

    Each is a Gaussian in time, with a standard deviation of 0.05 to 0.1 s and a peak of 1/12 to 5/6
    of the torque limit in either direction. The times are six random ones, or some of these: the
    first after a tenth of the whole or later, each a tenth or more before the next, and the end.
    `torques` has the mean torque in each step [N m], (steps, lanes, n).
    """

    def __init__(
        self, config: EnvConfig, joints: ArrayLike, steps: int, lanes: int, seed: int
    ) -> None:
        rng, pushed = np.random.default_rng([seed, 1]), np.asarray(joints)
        time = steps * config.dt
        least, spare = 0.1 * time, time * (0.9 - 0.1 * _PLACES) / _PLACES
        places = np.cumsum(least + spare * rng.random((lanes, _PLACES)), axis=1)
        centres = rng.permuted(places, axis=1)[:, : _PULSES * pushed.size]
        widths = rng.uniform(*_WIDTH, centres.shape)
        peaks = config.max_torque * rng.uniform(*_AMPLITUDE, centres.shape)
        peaks *= rng.choice([-1.0, 1.0], centres.shape)
        first = rng.integers(pushed.size, size=(lanes, 1))
        dealt = pushed[(first + np.arange(centres.shape[1])) % pushed.size]
        edges = config.dt * np.arange(steps + 1)[:, None, None]
        passed = ndtr((edges - centres) / widths)  # share of each pulse before an edge
        means = peaks * widths * np.sqrt(2.0 * np.pi) * np.diff(passed, axis=0) / config.dt
        acts = dealt[:, :, None] == np.arange(config.n)
        self.torques: FloatArray = np.einsum("tbp,bpi->tbi", means, acts)
        self._all = np.ones(lanes, np.bool_)

    def __call__(self, step: int, info: dict[str, Any]) -> tuple[FloatArray, BoolArray]:
        """Return the torques of a step, beside which the controller always acts."""
        del info
        return self.torques[step], self._all
