"""Controllers of the state act on angles alone: a Kalman filter estimates the velocities."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.envs import EnvConfig
from npend_gym.rl.controllers.step_model import StepModel, check_config, wrapped
from npend_gym.rl.controllers.tracking import START
from npend_gym.rl.evaluation.rollouts import Controller, forget

_SINGLE = 1e-7  # rad: observations are of single precision


class FromAngles:
    """A controller of the state that acts on angles alone, and the place of a cart.

    An extended Kalman filter estimates the velocities, with the exact steps of the environment and
    their derivatives. Its estimate takes the place of the state in `info`. So LQR, MPC and planned
    swing-ups act with ``observe_velocities=False``, or on encoders. If the time of an environment
    is not a step later than in the previous call, its episode is new: it is taken to be at rest.

    Parameters
    ----------
    controller : Controller
        It reads the state in `info`, as `lqr`, `MPC` and `planned_swing_up` do.
    config : EnvConfig
        Settings of the environment, ``gym.make("npend/SwingUp-v1", ...).unwrapped.config``. The
        filter has its chain and its steps, with ideal motors; delays are not made up for.
    angle_std : float, optional
        Standard deviation of an angle that is observed [rad], and of the place of a cart [m]. By
        default that of the environment's `angle_noise` and `angle_resolution`, and at least 1e-7.
    action_std : float
        Standard deviation of unknown loads, over the limits of the motors. With a larger value the
        filter trusts the angles more, and the chain less.

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, or the environment has no motor.

    References
    ----------
    B. D. O. Anderson, J. B. Moore, Optimal Filtering (1979), chapter 8.

    Examples
    --------
    >>> from npend_gym import rl
    >>> task = {"n": 2, "mode": "balance", "observe_velocities": False}
    >>> config = rl.setting_of(task).config
    >>> act = rl.FromAngles(rl.lqr(config), config)
    >>> rl.evaluate(act, task, episodes=4).success_rate
    1.0
    """

    def __init__(
        self,
        controller: Controller,
        config: EnvConfig,
        *,
        angle_std: float | None = None,
        action_std: float = 0.001,
    ) -> None:
        check_config(config)
        if not callable(controller):
            raise TypeError(
                "controller must be callable with an observation and an info, as lqr(config) is; "
                f"got {_checks.show(controller)}"
            )
        if angle_std is None:
            rounding = config.angle_resolution / math.sqrt(12.0)
            angle_std = max(_SINGLE, math.hypot(config.angle_noise, rounding))
        variance = _checks.positive_number("angle_std", angle_std) ** 2
        self._action_std = _checks.nonnegative_number("action_std", action_std)
        self._controller, self._config, self._model = controller, config, StepModel(config)
        c = config.state_size // 2
        self._noise: FloatArray = variance * np.eye(c)
        self._rest: FloatArray = np.diag(np.repeat([variance, START**2], c))
        self._states: FloatArray = np.zeros((0, config.state_size))  # of the last call
        self._spread: FloatArray = np.zeros((0, config.state_size, config.state_size))
        self._actions: FloatArray = np.zeros((0, config.joints.size))
        self._time: FloatArray = np.zeros(0)

    def reset(self, num_envs: int) -> None:
        """Forget all episodes, and let the controller forget."""
        self._states = self._states[:0]
        forget(self._controller, num_envs)

    def __call__(self, observation: Any, info: dict[str, Any]) -> NDArray[Any]:
        """Return the controller's actions, for the estimated state."""
        single = np.ndim(info["theta"]) == 1
        time = np.atleast_1d(np.asarray(info["time"], np.float64))
        self._estimate(self._measured(info), time)
        q, u = np.split(self._states[0] if single else self._states, 2, axis=-1)
        n = self._config.n
        estimate: dict[str, Any] = {"theta": q[..., :n], "omega": u[..., :n]}
        if self._config.has_cart:
            estimate |= {"cart_position": q[..., n], "cart_velocity": u[..., n]}
        action = self._controller(observation, info | estimate)
        self._actions = self._shares(np.asarray(action), len(self._states))
        return action

    def _measured(self, info: dict[str, Any]) -> FloatArray:
        """Angles, and the place of a cart, (B, c)."""
        theta = np.atleast_2d(np.asarray(info["theta"], np.float64))
        if not self._config.has_cart:
            return theta
        place = np.reshape(np.asarray(info["cart_position"], np.float64), (-1, 1))
        return np.concatenate([theta, place], axis=1)

    def _shares(self, action: NDArray[Any], count: int) -> FloatArray:
        """Actions over their limits, (B, joints), of actions as the environment takes them."""
        table = self._config.action_table
        if len(table) > 0:
            return table[action.reshape(count)]
        return np.clip(action.reshape(count, -1), -1.0, 1.0)

    def _estimate(self, measured: FloatArray, time: FloatArray) -> None:
        """Estimate the states at a time from the last estimate and what is measured."""
        count, c = measured.shape
        fresh = np.concatenate([measured, np.zeros_like(measured)], axis=1)
        if len(self._states) != count:
            self._states, self._spread = fresh, np.tile(self._rest, (count, 1, 1))
            self._time = time
            return
        new = np.abs(time - self._time - self._config.dt) > 0.5 * self._config.dt
        states, a, b = self._model.linearised(self._states, self._actions)
        drive = self._action_std * b
        spread = a @ self._spread @ _transposed(a) + drive @ _transposed(drive)
        error = wrapped(self._config, measured - states[:, :c])
        seen = spread[:, :c, :c] + self._noise
        gain = _transposed(np.asarray(np.linalg.solve(seen, spread[:, :c])))
        kept = np.eye(2 * c) - np.pad(gain, [(0, 0), (0, 0), (0, c)])
        spread = kept @ spread @ _transposed(kept)  # Joseph's form
        spread += gain @ self._noise @ _transposed(gain)
        states = states + (gain @ error[..., None])[..., 0]
        new |= ~np.isfinite(states).all(axis=1)  # no estimate is left
        self._states = np.where(new[:, None], fresh, states)
        self._spread = np.where(new[:, None, None], self._rest, spread)
        self._time = time


def _transposed(matrices: NDArray[Any]) -> FloatArray:
    """The transposes of matrices, (..., k, m)."""
    return np.swapaxes(matrices, -1, -2)
