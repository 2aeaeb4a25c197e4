"""The episodes of B environments: how they start, and one step of them; `outputs` tells of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import Chain, ChainParameters
from npend_gym.compiled.arrays import aligned_zeros
from npend_gym.envs.config import EnvConfig, task_numbers
from npend_gym.envs.hardware import MotorCalls, SensorCalls, fit_hardware
from npend_gym.envs.inputs import CART_STATE, EQUILIBRIA, KeptOptions
from npend_gym.envs.kernels import step_many, step_one
from npend_gym.envs.outputs import EpisodeStarts, Outputs
from npend_gym.envs.rows import NUMBER_OF, ROWS, Episode, Output, Pose, Setting, Task, Wiring
from npend_gym.envs.seeds import LaneNumbers, Seeds
from npend_gym.envs.settings import OF_LANES
from npend_gym.envs.snapshots import Snapshots, States
from npend_gym.envs.starts import (
    CHOSEN,
    CUSTOM,
    Draw,
    begin_episodes,
    draw_chains,
    scale_all,
    start_plan,
)
from npend_gym.envs.user_modes import judge, start_states
from npend_gym.physics import energy
from npend_gym.physics.kernels.layout import Member, Rod
from npend_gym.physics.mechanism import mechanism_of
from npend_gym.physics.memory import CallPlan, Memory

STATE = Rod.THETA, Rod.OMEGA


class Episodes:
    """The chains of B environments ("sub-environments") and the episodes that they are in.

    Nothing in an environment depends on another environment, on B or on the number of threads.
    `outputs` has the results of the last step or start. `motors` and `sensors` are None where they
    are ideal. Those of a `single` environment give plain numbers, to a mode of the user's own too.
    """

    def __init__(
        self, config: EnvConfig, count: int, threads: int = 1, max_steps: int | None = None,
        *, single: bool = False,
    ) -> None:  # fmt: skip
        self.config: EnvConfig = config
        self.count: int = count
        self._made = threads, max_steps, single
        n, joints, random = config.chain.n, config.joints, config.randomization
        poses = len(Pose) if config.mode.has_goals else 0
        base = mechanism_of([config.chain]).base
        self._memory = Memory(
            random.with_all_features, count, threads, ROWS, base, poses,
            measured=config.measure_periods,
        )  # fmt: skip
        for pose in Pose[:poses]:
            self._memory.arrays[1][:, pose] = 1.0  # of a base too, which stands nowhere
        self._kernel = step_one if count == 1 else step_many
        members, lanes = self._memory.arrays[0], self._memory.lanes
        self._settings = np.array([[getattr(config, name) or 0.0] for name in OF_LANES])
        self._memory.members[Setting[0] : Setting[-1] + 1] = self._settings
        members[Episode.HAS_BOBS] = random.has_bobs
        members[Member.WITH_COM] = config.measure_periods
        self.seeds: Seeds = Seeds(count, lanes)
        nominal = config.chain.repeated(1).stacked()[0]
        self._context = np.zeros((lanes, len(random.names)))
        self._start = start_plan(config.mode)
        self._judge = NUMBER_OF.get(type(config.mode), 0)
        self._wiring = np.zeros((len(Wiring), n + 1))
        self._wiring[Wiring.JOINT, : joints.size] = joints
        self._wiring[Wiring.PER_SPEED, :n] = 1.0 / config.speed_scale
        self._actions = aligned_zeros(joints.size, lanes)  # of the next step
        self._drawing = self.seeds.keys, nominal, random.draws, self._context, nominal.copy()
        self._beginning = n, self.seeds.keys, self._start, self._actions
        timing = config.dt, config.min_substeps, config.max_rotation
        self.motors: MotorCalls | None
        self.sensors: SensorCalls | None
        self.motors, self.sensors = fit_hardware(config, self._memory)
        self._task, observing = (
            task_numbers(
                config, self._judge, max_steps, OBSERVES=observes,
                PIECES=self.motors.pieces if self.motors else 1, SENSED=self.sensors is not None,
            )
            for observes in (False, True)
        )  # fmt: skip
        stepping = self.motors.plan if self.motors is not None else self._memory.plan(*timing)
        self._stepping = stepping, self._task
        # what acts in a step beside ideal motors
        self._driving = (self.seeds.keys, *self.motors.arrays) if self.motors else (None,) * 3
        self._looking = self._memory.plan(0.0, 0, math.inf), observing
        self.snapshots: Snapshots = Snapshots(
            config, self._memory, self.seeds.keys, self._kept_arrays
        )
        self.outputs: Outputs = Outputs(
            config, self._memory, self._context, with_quantities=self._judge == 0, single=single
        )  # fmt: skip
        self._kept = KeptOptions(count)
        # sub-environments that are not as made, by options or a state, and whether there are any
        self._altered = np.zeros(count, np.bool_)
        self.some_altered: bool = False
        self._memory.write_chain(np.arange(lanes), config.chain.repeated(1))
        scale_all(*self._memory.arrays[:2], n, np.arange(lanes))

    def _kept_arrays(self) -> dict[str, FloatArray]:
        """Return views (lanes, ...) of what belongs to the state beside the memory."""
        kept = {"actions": self._actions.T, "context": self._context}
        for part in (self.motors, self.sensors):
            kept |= part.kept if part is not None else {}
        return kept

    def renewed(self) -> Episodes:
        """Return new episodes with the seeds of these, for after an interruption."""
        threads, max_steps, single = self._made
        fresh: Episodes = type(self)(self.config, self.count, threads, max_steps, single=single)
        fresh._task[Task.NOISY] = self._task[Task.NOISY]
        fresh.seeds.take(self.seeds)
        fresh._memory.members[Episode.EPISODE] = self._memory.members[Episode.EPISODE]
        fresh._kept, fresh.some_altered = self._kept, True
        return fresh

    # -- starting ---------------------------------------------------------------------------

    def seed(self, seed: Any, mask: BoolArray) -> None:
        """Seed the lanes of `mask` as `Seeds.choose` says: where it is new, episode 0 is next."""
        self._memory.members[Episode.EPISODE, self.seeds.choose(seed, mask)] = -1.0

    @property
    def numbers(self) -> FloatArray:
        """The number of each lane's episode of its seed, (B,), from 0; -1 before the first."""
        return self._memory.members[Episode.EPISODE, : self.count].copy()

    @numbers.setter
    def numbers(self, values: FloatArray) -> None:
        self._memory.members[Episode.EPISODE, : self.count] = values

    def start(self, mask: BoolArray, options: Mapping[str, Any] | None = None) -> None:
        """Begin a new episode in the environments of `mask`, with the options of `checked_options`.

        Without any, options that persist hold. `observe` or `step` shows the new episodes.
        """
        memory, by_python = self._memory, self._start[0] == CUSTOM
        memory.arrays[0][Episode.STARTING, : self.count] = mask
        if self.motors is not None:
            self.motors.torques[:, : self.count][:, mask] = 0.0
        given = self._take_options(mask, options) if options or self.some_altered else ()
        if self._context.shape[1] > 0:
            draw_chains(*memory.arrays, *self._drawing)
        for lanes, values in given:
            self._write_settings(lanes, values.get("settings", {}))
        begin_episodes(*memory.arrays, memory.record, *self._beginning)
        if by_python:
            chosen = np.flatnonzero(mask)
            states = start_states(self.config, memory.members, self.seeds.values, chosen)
            memory.write_state(chosen, *states)
        for lanes, values in given:
            self._apply_options(lanes, values)

    def _take_options(
        self, mask: BoolArray, options: Mapping[str, Any] | None
    ) -> Sequence[tuple[NDArray[np.int64], Mapping[str, Any]]]:
        """Return lanes with the options of their new episode, earlier ones being taken back."""
        members, chosen = self._memory.arrays[0], np.flatnonzero(mask)
        self._memory.write_chain(chosen, self.config.chain.repeated(1))
        members[Episode.HAS_BOBS, chosen] = self.config.randomization.has_bobs
        members[Setting[0] : Setting[-1] + 1, chosen] = self._settings
        scale_all(*self._memory.arrays[:2], self.config.n, chosen)
        if options is not None:
            self._kept.keep(mask, options)
        given = list(self._kept.of(mask)) if options is None else [(chosen, options)]
        for lanes, values in given:
            for name, pose in zip(EQUILIBRIA, Pose, strict=True):
                if name in values:
                    own = self._memory.per_rod(pose)
                    own[self._memory.place(lanes)] = CHOSEN * values[name][lanes]
        self._altered[chosen] = False
        for lanes, _ in given:
            self._altered[lanes] = True
        self.some_altered = bool(self._altered.any())
        return given

    def choose(self, mask: BoolArray, options: Mapping[str, Any]) -> None:
        """Let the lanes of `mask` begin all later episodes with checked options."""
        self._kept.keep(mask, {**options, "persist": mask})
        self._altered |= mask
        self.some_altered = True

    def _write_settings(
        self, lanes: NDArray[np.int64], settings: Mapping[str, FloatArray]
    ) -> None:  # before the start, which depends on some
        """Change settings of some sub-environments, and the context that tells of them."""
        for name, values in settings.items():
            self._memory.arrays[0][getattr(Setting, name), lanes] = values[lanes]
            if name in self.config.context_names:
                self._context[lanes, self.config.context_names.index(name)] = values[lanes]

    def _apply_options(self, lanes: NDArray[np.int64], options: Mapping[str, Any]) -> None:
        """Change chain and state of some sub-environments, at their start, as the options say."""
        memory, draws = self._memory, self.config.randomization.draws
        if "changes" in options:
            changes = {name: values[lanes] for name, values in options["changes"].items()}
            drawn = ChainParameters(*(values[lanes] for values in memory.parameters))
            chains = drawn.changed(changes)
            memory.write_chain(lanes, chains)
            memory.arrays[0][Episode.HAS_BOBS, lanes] = chains.has_bobs
            scale_all(*memory.arrays[:2], self.config.n, lanes)
            stacked = chains.stacked()
            for j, draw in enumerate(draws):
                if draw[Draw.OF_CHAIN]:
                    self._context[lanes, j] = stacked[:, int(draw[Draw.FIELD]), int(draw[Draw.ROD])]
        theta = options.get("theta", memory.read(Rod.THETA))[lanes]
        omega = options.get("omega", memory.read(Rod.OMEGA))[lanes]
        for name, field in zip(CART_STATE, STATE, strict=True):
            if name in options:
                memory.of_base(field)[memory.place(lanes)] = options[name][lanes]
        memory.write_state(lanes, theta, omega)

    def set_states(self, lanes: LaneNumbers, states: States) -> None:
        """Put lanes into the states of records that `snapshots.check` returned, and show them."""
        self.snapshots.put(lanes, states)
        self.seeds.read_keys(lanes)
        self._altered[lanes] = True
        self.some_altered = True
        self.observe()

    def beginnings(self) -> EpisodeStarts:
        """Return how the episodes began, after `start` and before a step."""
        members, config, count = self._memory.members, self.config, self.count
        limits = np.tile(members[Setting.max_torque], (config.joints.size, 1)).T
        limits[:, config.joints == config.n] = members[Setting.max_force][:, None]
        goals = self._memory.read(Pose.GOAL) if config.mode.has_goals else np.zeros((count, 0))
        chains, context = self._memory.parameters, self._context[:count].copy()
        return EpisodeStarts(self.angles, chains, limits, goals, context, members[:, :count].copy())

    @property
    def angles(self) -> FloatArray:
        """Angles and angular velocities, then place and velocity of a cart, (B, k), new."""
        memory, cart = self._memory, STATE if self.config.has_cart else ()
        of_cart = [memory.read_base(field)[:, None] for field in cart]
        return np.hstack([*(memory.read(field) for field in STATE), *of_cart])

    @angles.setter
    def angles(self, values: FloatArray) -> None:
        memory, lanes, n = self._memory, np.arange(self.count), self.config.n
        for field, column in zip(STATE, values.T[2 * n :], strict=False):
            memory.of_base(field)[memory.place(lanes)] = column
        memory.write_state(lanes, values[:, :n], values[:, n : 2 * n])
        for past in self.sensors.kept.values() if self.sensors is not None else ():
            past[:] = np.nan  # nothing was before this state
        self.observe()  # to know the energy, which counts from here
        energy_now = self.outputs.rows[Output.ENERGY, : self.count]
        memory.members[Episode.START_ENERGY] = energy_now
        self.observe()

    def observe(self, *, reuse_buffers: bool = False) -> None:
        """Show the sub-environments that have started, and take no step.

        Results go to new arrays or, with `reuse_buffers`, into the arrays of the last step.
        """
        members = self._memory.arrays[0]
        if reuse_buffers:
            members[Episode.OBSERVED] = members[Episode.STARTING]
        else:
            members[Episode.OBSERVED] = 1.0
            self.outputs.renew()
        self._run(*self._looking)
        if self._judge == 0:
            judge(self.outputs, self._memory.members, self._task, observes=True)

    # -- stepping ---------------------------------------------------------------------------

    def step(self, action: float | FloatArray | None, starting: BoolArray | None = None) -> None:
        """Take a step under `action`, (B, joints), 1 being the limit of the torque.

        Environments that are `starting`, (B,), begin a new episode instead, whatever their action
        is.
        """
        if type(action) is float:
            self._actions[0, 0] = action  # the common case of one sub-environment, quickly
        elif action is not None:
            self._actions.T[: self.count] = action
        if starting is not None:
            self.start(starting)
        self.outputs.renew()
        self._run(*self._stepping)
        if self._judge == 0:
            judge(self.outputs, self._memory.members, self._task, observes=False)

    def set_noisy_motors(self, motors: int) -> None:
        """Let noise and ripple act on this many motors, the first, alone."""
        self._task[Task.NOISY] = motors
        if self.motors is not None:
            self.motors.forget_noise(motors)

    def _run(self, plan: CallPlan, task: FloatArray) -> None:
        """Call the step kernel, and then the sensors."""
        outputs, sensors = self.outputs, self.sensors
        written = outputs.observations, outputs.rows, outputs.flags
        arrays = self._memory.record, self._actions, *written, task, self._wiring, *self._driving
        self._memory.run(self._kernel, arrays, plan)
        if sensors is not None:
            sensors.observe(self.seeds.keys, outputs.observations, task, self._wiring, plan)

    # -- for pictures -----------------------------------------------------------------------

    def places(self, of: Callable[..., FloatArray] = energy.positions) -> FloatArray:
        """Return the positions [m], (B, k, 2), from the middle of a rail, that `of` returns.

        It is a function of `npend_gym.physics.energy`, which gives them from the pivot.
        """
        places = of(self._memory.parameters, self._memory.read(Rod.THETA))
        if self.config.has_cart:
            places[..., 0] += self._memory.read_base(Rod.THETA)[:, None]
        return places

    def action(self, lane: int) -> FloatArray:
        """Return the last action of a sub-environment, torque over its limit, (joints,)."""
        return self._actions[:, lane]

    def pushes(self) -> FloatArray:
        """Return the forces at the tips in the last step, over the largest, (B,)."""
        if self.motors is None or self.config.largest["push_force"] == 0.0:
            return np.zeros(self.count)
        return self.motors.pushes[: self.count] / self.config.largest["push_force"]

    def chain(self, lane: int) -> Chain:
        """Return the chain of a sub-environment in its episode."""
        return self._memory.chain(lane)

    def chain_length(self, lane: int) -> float:
        """Return the length of the chain of a sub-environment [m]."""
        return float(1.0 / self._memory.members[Episode.PER_LENGTH, lane])

    def close(self) -> None:
        """End the threads."""
        self._memory.close()
