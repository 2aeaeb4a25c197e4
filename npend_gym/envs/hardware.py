"""Motors and sensors that are not ideal: their keywords, and the compiled calls that act for them.

`motors` and `sensors` have the kernels. An environment that is given none of the keywords has
neither object.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.compiled.arrays import aligned_zeros
from npend_gym.compiled.philox import Keys
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.motors import Command, draw_disturbances
from npend_gym.envs.rows import Episode
from npend_gym.envs.sensors import draw_sensor_noise, sense_many, sense_one
from npend_gym.envs.settings import ERRORS_OF_MOTORS, OF_PUSHES, OF_SENSORS
from npend_gym.physics.calls import CallPlan, Cut, plan_of
from npend_gym.physics.memory import Memory


def fit_hardware(config: EnvConfig, memory: Memory) -> tuple[MotorCalls | None, SensorCalls | None]:
    """Return motors and sensors where they are not ideal, else None."""
    driven = any(config.largest[name] > 0.0 for name in (*ERRORS_OF_MOTORS, *OF_PUSHES))
    sensed = any(config.largest[name] > 0.0 for name in OF_SENSORS)
    return MotorCalls(config, memory) if driven else None, SensorCalls(
        config, memory
    ) if sensed else None


def changes_torques_in_steps(config: EnvConfig) -> bool:
    """Return whether torques may change within a step."""
    largest = config.largest
    varies = largest["motor_lag"] > 0.0 or largest["torque_ripple"] > 0.0
    return varies or config.action_delay % 1.0 > 0.0 or "action_delay" in config.context_names


def _slots(delay: float) -> int:
    """Return how many steps are kept for a delay: a power of two, so that a mask finds a step."""
    return 1 << (int(delay) + 1).bit_length()


class MotorCalls:
    """The motors of many lanes, and what pushes them: their part in the step kernel."""

    def __init__(self, config: EnvConfig, memory: Memory) -> None:
        self._memory, self._joints, substeps = memory, config.joints, config.min_substeps
        count = config.joints.size
        # where torques change within a step, it is divided into pieces of one substep
        self.pieces: int = substeps if changes_torques_in_steps(config) else 1
        piece = Cut(config.dt / self.pieces, substeps // self.pieces, config.max_rotation)
        rods = memory.n * memory.width * self.pieces  # a call takes all pieces
        self.plan: CallPlan = plan_of(piece, rods, memory.groups, memory.threads)  # of a piece
        self.past: FloatArray = np.zeros(
            (memory.lanes, _slots(config.largest["action_delay"]), count)
        )
        self._commands = aligned_zeros(len(Command), max(1, count), memory.lanes)

    @property
    def arrays(self) -> tuple[FloatArray, tuple[FloatArray]]:
        """What the step kernel takes."""
        return self.past, (self._commands,)

    @property
    def kept(self) -> dict[str, FloatArray]:
        """Views (lanes, ...) of what belongs to the state of an environment."""
        lagged, torques = (self._commands[block].T for block in (Command.LAGGED, Command.TORQUE))
        return {"past_actions": self.past, "lagged_actions": lagged, "mean_torques": torques}

    @property
    def torques(self) -> FloatArray:
        """The mean torque of each motor in the last step [N m], or force [N], (joints, lanes)."""
        return self._commands[Command.TORQUE, : self._joints.size]

    @property
    def pushes(self) -> FloatArray:
        """The force at the tip of each sub-environment in the last step [N], (lanes,)."""
        return self._commands[Command.PUSH, 0]

    def forget_noise(self, motors: int) -> None:
        """Take the noise from all motors but this many, the first."""
        self._commands[Command.NOISE, motors:] = 0.0

    def disturbances(
        self, keys: Keys, steps: NDArray[Any], dt: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return the noise of the torques [N m], (B, joints), and the forces at the tips [N], (B,).

        They are those that a step draws for the environments in these steps of their episodes,
        (B,).
        """
        memory, motors = self._memory, self._joints.size
        memory.members[Episode.STEPS] = steps
        draw_disturbances(memory.arrays[0], keys, dt, motors, self._commands)
        noise, push = self._commands[Command.NOISE, :motors], self.pushes
        return noise[:, : memory.size].T.copy(), push[: memory.size].copy()


class SensorCalls:
    """The sensors of many lanes."""

    def __init__(self, config: EnvConfig, memory: Memory) -> None:
        self._memory, self._dt = memory, config.dt
        self._sense = sense_one if memory.size == 1 else sense_many
        delay = config.largest["observation_delay"]
        size = memory.n + 1 if config.has_cart else memory.n
        self._history = np.zeros((memory.lanes, _slots(delay) if delay > 0.0 else 0, 2, size))

    @property
    def kept(self) -> dict[str, FloatArray]:
        """Arrays (lanes, ...) that belong to the state of an environment."""
        lanes, slots = self._history.shape[:2]
        return {"past_states": self._history.reshape(lanes, slots, -1)} if slots > 0 else {}

    def noise(self, keys: Keys, steps: NDArray[Any]) -> tuple[FloatArray, FloatArray]:
        """Return the noise of angles and velocities over its deviations, (B, n) each.

        It is that which `observe` draws for the environments in these steps of their episodes,
        (B,).
        """
        memory = self._memory
        memory.members[Episode.STEPS] = steps
        first, second = np.zeros((2, memory.size, memory.n))
        draw_sensor_noise(memory.arrays[0], keys, first, second)
        return first, second

    def observe(
        self, keys: Keys, observation: NDArray[np.float32], task: FloatArray,
        wiring: FloatArray, plan: CallPlan,
    ) -> None:  # fmt: skip
        """Write the observations, after a call of the step kernel with the same `plan`."""
        arrays = keys, self._history, observation, task, wiring, self._dt
        self._memory.run(self._sense, arrays, plan)
