"""What is told of B lanes: observations, rewards and infos, in arrays that are handed out."""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.goals import of_lane, with_goals
from npend_gym.envs.hardware import Motors
from npend_gym.envs.info import BatchInfo, Info, mask_names
from npend_gym.envs.modes import Quantities
from npend_gym.envs.rows import QUANTITIES, Flag, Output
from npend_gym.physics.kernels.layout import Rod
from npend_gym.physics.memory import Memory

_ROWS = len(Output)
_REWARD = Output.REWARD


class Outputs:
    """The arrays that the step kernel writes, read.

    Parameters
    ----------
    config : EnvConfig
    memory : Memory
    motors : Motors, optional
        Where they are not ideal.
    context : ndarray, shape (lanes, numbers)
        What is drawn of each lane's chain.
    with_quantities : bool
        Whether what modes judge by is kept.

    Attributes
    ----------
    observations : ndarray, float32, shape (lanes, numbers)
    rows : ndarray, shape (rows, columns)
        Those of `Output` and what follows them.
    flags : ndarray, bool, shape (len(Flag), lanes)
    """

    def __init__(
        self, config: EnvConfig, memory: Memory, motors: Motors | None, context: FloatArray,
        *, with_quantities: bool,
    ) -> None:  # fmt: skip
        self.config, self.count, n = config, memory.size, config.n
        self._memory, self._motors, self._context = memory, motors, context
        joints = config.joints
        self._joints, self._has_motors = joints, joints.size > 0
        first = np.array_equal(np.arange(joints.size), joints)
        # where the only lane has its torques: of the first joints in a slice, which is quicker
        self._acted = 0, int(Rod.TORQUE), slice(joints.size) if first else joints
        self._measures_com = config.mode.measures_com
        self._is_random, self._has_cart = context.shape[1] > 0, config.has_cart
        self._has_goals, self._goal_env = config.mode.has_goals, config.goal_env
        self._shows_context = config.observe_context and self._is_random
        self._is_plain = not (self._shows_context or self._goal_env)
        with_quantities |= self._has_goals
        rows = _ROWS + (4 if self._has_goals else 3) * n + (QUANTITIES if with_quantities else 0)
        self._shapes = (
            (memory.lanes, config.observed), (rows, memory.columns), (len(Flag), memory.lanes)
        )  # fmt: skip
        self._judged_by = slice(_ROWS + 3 * n, _ROWS + 3 * n + QUANTITIES)
        self._per_rod = [slice(_ROWS + k * n, _ROWS + (k + 1) * n) for k in range(3)]
        self._everywhere = np.ones(self.count, np.bool_)
        self._masks = mask_names({
            "torque": self._has_motors, "context": self._is_random, "goal": self._has_goals,
            "pseudo_period_com": self._measures_com,
            "cart_position": self._has_cart, "cart_velocity": self._has_cart,
        })  # fmt: skip
        self.renew()

    def renew(self) -> None:
        """Make new arrays: those handed out before are not written again."""
        observations, rows, flags = self._shapes
        self.observations, self.rows = np.empty(observations, np.float32), np.empty(rows)
        self.flags = np.empty(flags, np.bool_)

    @property
    def observation(self) -> Any:
        """The observations of all lanes, (B, numbers), or the Dict that has them with goals."""
        observation = self.observations[: self.count]
        if self._is_plain:
            return observation
        if self._shows_context:
            shown = self.config.randomization.normalised(self._context[: self.count])
            observation[:, observation.shape[1] - shown.shape[1] :] = shown
        if not self._goal_env:
            return observation
        outputs, n = self.rows[:, : self.count], self.config.n
        kinetic_energy, goals = self.quantities().kinetic_energy, self._memory.members[-n:]
        return with_goals(observation, outputs[-n:].T, kinetic_energy, goals.T)

    @property
    def outcome(self) -> tuple[FloatArray, BoolArray, BoolArray]:
        """Reward, terminated and truncated of the last step, (B,) each."""
        rewards, flags = self.rows[Output.REWARD], self.flags[:, : self.count]
        return rewards[: self.count], flags[Flag.TERMINATED], flags[Flag.TRUNCATED]

    def quantities(self) -> Quantities[FloatArray]:
        """Return what a mode judges by, arrays (B, ...)."""
        outputs = self.rows[:, : self.count]
        rows: list[FloatArray] = list(outputs[self._judged_by])
        _, theta, omega = (outputs[rods].T for rods in self._per_rod)
        return Quantities(*rows, theta, omega)  # pyright: ignore[reportCallIssue]

    def quantities_of_only_lane(self) -> Quantities[float]:
        """Return what `quantities` does, of one lane alone, as plain numbers."""
        outputs = self.rows[:, 0]
        _, theta, omega = (outputs[rods] for rods in self._per_rod)
        plain: list[float] = outputs[self._judged_by].tolist()
        return Quantities(*plain, theta, omega)  # pyright: ignore[reportCallIssue]

    def masked_info(self, present: BoolArray | None = None) -> dict[str, Any]:
        """Return the info of all lanes with its masks, arrays (B,).

        They are True in the lanes where info is `present`, by default all; those of the
        pseudo-periods where a bob, or the centre of mass, has completed besides.
        """
        info = cast("dict[str, Any]", self.info())
        measured = self.flags[Flag.MEASURED, : self.count]
        if present is None:
            present = self._everywhere.copy()
        else:
            measured = measured & present
        info.update(dict.fromkeys(self._masks, present))
        info["_pseudo_period"] = info["_pseudo_periods"] = measured
        if self._measures_com:
            info["_pseudo_period_com"] = (info["pseudo_period_com"] > 0.0) & present
        return info

    def info(self) -> BatchInfo:
        """Return the info of all lanes, arrays (B, ...) of the last step or start.

        They are handed out: the next step does not write to them.
        """
        outputs = self.rows[:, : self.count]
        periods, theta, omega = (outputs[rods].T for rods in self._per_rod)
        (
            time, energy, error, period, ideal, tip, completed, place, velocity, of_com
        ) = outputs[:_REWARD]  # fmt: skip
        flags = self.flags[:, : self.count]
        info: BatchInfo = {
            "time": time,
            "energy": energy,
            "energy_error": error,
            "bobs_completed": completed.astype(np.int64),
            "pseudo_period": period,
            "pseudo_periods": periods,
            "ideal_period": ideal,
            "tip_height": tip,
            "theta": theta,
            "omega": omega,
            "diverged": flags[Flag.DIVERGED],
            "success": flags[Flag.SUCCESS],
        }
        if self._measures_com:
            info["pseudo_period_com"] = of_com
        if self._has_motors:
            info["torque"] = self._torques()
        if self._is_random:
            info["context"] = self._context[: self.count].copy()
        if self._has_goals:
            info["goal"] = self._goals()
        if self._has_cart:
            info["cart_position"], info["cart_velocity"] = place, velocity
        return info

    def only_lane(self) -> tuple[Any, float, bool, bool, Info[float, int, bool]]:
        """Return what `step` tells of the only lane, as plain numbers: the quick way."""
        outputs = self.rows[:, 0]
        periods, theta, omega = self._per_rod
        (
            time, energy, error, period, ideal, tip, completed, place, velocity, of_com, reward
        ) = outputs[:_ROWS].tolist()  # fmt: skip
        _, diverged, success, terminated, truncated = self.flags[:, 0].tolist()
        info: Info[float, int, bool] = {
            "time": time,
            "energy": energy,
            "energy_error": error,
            "bobs_completed": int(completed),
            "pseudo_period": period,
            "pseudo_periods": outputs[periods],
            "ideal_period": ideal,
            "tip_height": tip,
            "theta": outputs[theta],
            "omega": outputs[omega],
            "diverged": diverged,
            "success": success,
        }
        if self._measures_com:
            info["pseudo_period_com"] = of_com
        if self._has_motors and self._motors is None:  # as `_torques`, in less time
            info["torque"] = self._memory.arrays[1][self._acted].astype(np.float64)
        elif self._has_motors:
            info["torque"] = self._torques()[0]
        if self._is_random:
            info["context"] = self._context[0].copy()
        if self._has_goals:
            info["goal"] = self._goals()[0]
        if self._has_cart:
            info["cart_position"], info["cart_velocity"] = place, velocity
        observation = self.observations[0] if self._is_plain else of_lane(self.observation, 0)
        return observation, reward, terminated, truncated, info

    def _torques(self) -> FloatArray:
        """Return the mean torque of each motor in the last step [N m], or force [N], (B, m)."""
        if self._motors is None:
            acted = self._memory.read_at(Rod.TORQUE, self._joints)
        else:
            acted = self._motors.torques[:, : self.count].T
        # in a copied environment too of NumPy's own float64, so that pickles are the same bytes
        return acted.astype(np.float64, order="C")

    def _goals(self) -> FloatArray:
        """Return the angles, 0 or pi, that the rods are to reach [rad], (B, n)."""
        cosines = self._memory.members[-self.config.n :].T
        return np.array([0.0, math.pi])[(cosines < 0.0).astype(np.int64)]
