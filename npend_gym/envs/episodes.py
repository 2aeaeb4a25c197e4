"""The episodes of B lanes: how they start, one step of them, and what is told of it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import ChainParameters
from npend_gym.compiled.philox import Keys, Purpose, generator
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.info import Info
from npend_gym.envs.kernels import (
    EPISODE_ROWS,
    NUMBER_OF,
    Episode,
    Output,
    Task,
    step_many,
    step_one,
)
from npend_gym.envs.modes import Quantities
from npend_gym.envs.starts import BY_PYTHON, begin_episodes, scale_all, start_plan
from npend_gym.physics import energy
from npend_gym.physics.kernels.layout import Member, Rod
from npend_gym.physics.memory import Memory

# For `only_lane`, which has no time to look up fields: the rows from TIME on
(
    _TIME, _ENERGY, _ENERGY_ERROR, _PSEUDO_PERIOD, _IDEAL_PERIOD, _TIP_HEIGHT, _COMPLETED,
    _DIVERGED, _SUCCESS, _REWARD, _TERMINATED, _TRUNCATED,
) = Output[Output.TIME :]  # fmt: skip
_ROWS = len(Output)


class Episodes:
    """The chains of B environments ("lanes") and the episodes that they are in.

    Nothing in a lane depends on another lane, on B or on the number of threads.

    Parameters
    ----------
    config : EnvConfig
    count : int
        Number of lanes B.
    threads : int
    max_steps : int, optional
        Steps after which a lane is truncated.

    Attributes
    ----------
    seeds : sequence of int
        The seed of every lane.
    """

    def __init__(
        self, config: EnvConfig, count: int, threads: int = 1, max_steps: int | None = None
    ) -> None:
        self.config, self.count, self._max_steps = config, count, max_steps
        n, joints = config.chain.n, config.joints
        self._memory = Memory(config.chain.repeated(1), count, threads, EPISODE_ROWS)
        self._kernel = step_one if count == 1 else step_many
        members, lanes = self._memory.arrays[0], self._memory.lanes
        members[Episode.MAX_TORQUE] = config.max_torque
        members[Episode.HAS_BOBS] = config.chain.has_bobs
        self.seeds: Sequence[int] = [0] * count
        self._keys: Keys = np.zeros((2, lanes), np.uint64)
        self._nominal = config.chain.repeated(1).stacked()[0]
        self._draws, self._context = np.zeros((0, 4)), np.zeros((lanes, 0))
        self._judge = NUMBER_OF.get(type(config.mode), 0)
        self._start = start_plan(config)
        self._task = np.array([
            self._judge, math.inf if max_steps is None else max_steps, config.hold_steps, *joints,
        ])  # fmt: skip
        self._actions = np.zeros((lanes, joints.size))  # of the next step
        self._shapes = (lanes, (3 if config.with_sines else 2) * n), (_ROWS + 3 * n, lanes)
        self._timing = config.dt, config.min_substeps, config.max_rotation
        self._varied = np.zeros(count, np.bool_)  # lanes whose chain is not the config's
        self._per_rod = [slice(_ROWS + k * n, _ROWS + (k + 1) * n) for k in range(3)]
        scale_all(*self._memory.arrays[:2], n, np.arange(lanes))
        self._new_outputs()

    def renewed(self) -> Episodes:
        """Return new episodes with the seeds of these, for after an interruption."""
        fresh = Episodes(self.config, self.count, self._memory.threads, self._max_steps)
        fresh.seeds, fresh._keys = self.seeds, self._keys
        fresh._memory.members[Episode.EPISODE] = self._memory.members[Episode.EPISODE]
        return fresh

    # -- starting ---------------------------------------------------------------------------

    def seed(self, lanes: NDArray[np.int64], seeds: Sequence[int], keys: Keys) -> None:
        """Give `lanes` new keys (2, k), `seeds` being those of all: their next episode is 0."""
        self.seeds = seeds
        self._keys[:, lanes] = keys
        self._memory.members[Episode.EPISODE, lanes] = -1.0

    def start(self, mask: BoolArray, options: Mapping[str, Any]) -> None:
        """Begin a new episode in the lanes of `mask`, with the options of `checked_options`.

        `observe` or `step` shows it.
        """
        memory, config = self._memory, self.config
        members, rods, model = memory.arrays
        members[Episode.STARTING, : self.count] = mask
        chosen = np.flatnonzero(mask)
        self._actions[chosen] = 0.0
        if "chains" in options or self._varied.any():
            self._change_chains(chosen, options.get("chains"))
        members[Episode.AMPLITUDE] = config.amplitude
        if "amplitude" in options:
            members[Episode.AMPLITUDE, chosen] = options["amplitude"][chosen]
        begin_episodes(
            members, rods, model, self._keys, self._nominal, self._draws, self._start,
            self._context,
        )  # fmt: skip
        by_python = self._start[0] == BY_PYTHON
        if by_python or "theta" in options or "omega" in options:
            theta, omega = memory.read(Rod.THETA)[chosen], memory.read(Rod.OMEGA)[chosen]
            if by_python:
                theta, omega = self._states_by_python(chosen)
            theta = options["theta"][chosen] if "theta" in options else theta
            omega = options["omega"][chosen] if "omega" in options else omega
            memory.write_state(chosen, theta, omega)

    def _states_by_python(self, chosen: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
        """Return the starting states of a mode of one's own."""
        theta, omega = np.empty((2, chosen.size, self.config.chain.n))
        members = self._memory.members
        for row, k in enumerate(chosen.tolist()):
            episode = int(members[Episode.EPISODE, k])
            theta[row], omega[row] = self.config.mode.start(
                generator(self.seeds[k], 0, Purpose.START, episode), self.config.chain.n,
                float(members[Episode.AMPLITUDE, k]), self.config.spread,
            )  # fmt: skip
        return theta, omega

    def _change_chains(self, chosen: NDArray[np.int64], given: ChainParameters | None) -> None:
        """Give the chosen lanes the chains of their new episode, by default that of the config."""
        if given is None:
            chains = self.config.chain.repeated(chosen.size)
        else:
            chains = ChainParameters(*(values[chosen] for values in given))
        members, rods, _ = self._memory.arrays
        self._memory.write_chain(chosen, chains)
        members[Episode.HAS_BOBS, chosen] = chains.has_bobs
        scale_all(members, rods, self.config.chain.n, chosen)
        self._varied[chosen] = given is not None

    def observe(self, *, reuse_buffers: bool = False) -> None:
        """Show the lanes that have started, and take no step.

        What is told goes to new arrays or, with `reuse_buffers`, into those of the last step.
        """
        members = self._memory.arrays[0]
        if reuse_buffers:
            members[Episode.OBSERVED] = members[Episode.STARTING]
        else:
            members[Episode.OBSERVED] = 1.0
            self._new_outputs()
        self._memory.run(self._kernel, self._arrays, 0.0, 0, math.inf)
        self._judge_by_python(observes=True)
        members[Episode.STARTING] = 0.0

    # -- stepping ---------------------------------------------------------------------------

    def step(self, action: float | FloatArray | None, starting: BoolArray | None = None) -> None:
        """Take a step under `action`, (B, joints), 1 being the limit of the torque.

        The lanes of `starting`, for which `start` was called, do not move and are shown as new.
        """
        members = self._memory.arrays[0]
        if action is not None:
            self._actions[: self.count] = action
        if starting is not None:
            self._actions[: self.count][starting] = 0.0
            members[Member.ACTIVE, : self.count] = ~starting
        self._new_outputs()
        self._memory.run(self._kernel, self._arrays, *self._timing)
        self._judge_by_python(observes=False)
        if starting is not None:
            members[Member.ACTIVE] = 1.0
            members[Episode.STARTING] = 0.0

    def _judge_by_python(self, *, observes: bool) -> None:
        """Write reward, end and success as a mode of one's own judges."""
        if self._judge > 0:
            return
        mode, outputs = self.config.mode, self._arrays[2][:, : self.count]
        members = self._memory.members
        quantities = self.quantities() if self.count > 1 else self.quantities_of_only_lane()
        held, starts = members[Episode.STEPS_HELD], members[Episode.STARTING] > 0.0
        judged = starts if observes else np.ones(self.count, np.bool_)
        held[judged] *= np.broadcast_to(mode.achieved(quantities), (self.count,))[judged]
        outputs[Output.SUCCESS] = held > self._task[Task.HOLD_STEPS]
        if not observes:
            outputs[Output.REWARD] = mode.reward(quantities)
            outputs[Output.TERMINATED] = mode.failed(quantities)
            outputs[[[Output.REWARD], [Output.TERMINATED]], starts] = 0.0

    # -- what is told -----------------------------------------------------------------------

    @property
    def observation(self) -> NDArray[np.float32]:
        """The observations of all lanes, (B, 2n) or (B, 3n)."""
        return self._arrays[1][: self.count]

    @property
    def outcome(self) -> tuple[FloatArray, BoolArray, BoolArray]:
        """Reward, terminated and truncated of the last step, (B,) each."""
        rows = self._arrays[2][_REWARD:_ROWS, : self.count]
        return rows[0], rows[1] != 0.0, rows[2] != 0.0

    def quantities(self) -> Quantities[FloatArray]:
        """Return what a mode judges by, arrays (B, ...)."""
        outputs = self._arrays[2][:, : self.count]
        rows: list[FloatArray] = list(outputs[:_TIME])
        _, theta, omega = (outputs[rods].T for rods in self._per_rod)
        return Quantities(*rows, theta, omega)  # pyright: ignore[reportCallIssue]

    def quantities_of_only_lane(self) -> Quantities[float]:
        """Return what `quantities` does, of one lane alone, as plain numbers."""
        outputs = self._arrays[2][:, 0]
        _, theta, omega = (outputs[rods] for rods in self._per_rod)
        plain: list[float] = outputs[:_TIME].tolist()
        return Quantities(*plain, theta, omega)  # pyright: ignore[reportCallIssue]

    def info(self) -> Info[FloatArray, NDArray[np.int64], BoolArray]:
        """Return the info of all lanes, arrays (B, ...) of the last step or start.

        They are handed out: the next step does not write to them.
        """
        outputs = self._arrays[2][:, : self.count]
        periods, theta, omega = (outputs[rods].T for rods in self._per_rod)
        return {
            "time": outputs[_TIME],
            "energy": outputs[_ENERGY],
            "energy_error": outputs[_ENERGY_ERROR],
            "bobs_completed": outputs[_COMPLETED].astype(np.int64),
            "pseudo_period": outputs[_PSEUDO_PERIOD],
            "pseudo_periods": periods,
            "ideal_period": outputs[_IDEAL_PERIOD],
            "tip_height": outputs[_TIP_HEIGHT],
            "theta": theta,
            "omega": omega,
            "diverged": outputs[_DIVERGED] != 0.0,
            "success": outputs[_SUCCESS] != 0.0,
        }

    def only_lane(self) -> tuple[float, bool, bool, Info[float, int, bool]]:
        """Return reward, terminated, truncated and info of the only lane, as plain numbers."""
        outputs = self._arrays[2][:, 0]
        row: list[float] = outputs[:_ROWS].tolist()
        periods, theta, omega = self._per_rod
        info: Info[float, int, bool] = {
            "time": row[_TIME],
            "energy": row[_ENERGY],
            "energy_error": row[_ENERGY_ERROR],
            "bobs_completed": int(row[_COMPLETED]),
            "pseudo_period": row[_PSEUDO_PERIOD],
            "pseudo_periods": outputs[periods],
            "ideal_period": row[_IDEAL_PERIOD],
            "tip_height": row[_TIP_HEIGHT],
            "theta": outputs[theta],
            "omega": outputs[omega],
            "diverged": row[_DIVERGED] != 0.0,
            "success": row[_SUCCESS] != 0.0,
        }
        return row[_REWARD], row[_TERMINATED] != 0.0, row[_TRUNCATED] != 0.0, info

    def positions(self) -> FloatArray:
        """Return the positions of the bobs [m], shape (B, n, 2)."""
        return energy.positions(self._memory.parameters, self._memory.read(Rod.THETA))

    def bodies(self) -> FloatArray:
        """Return the centres of mass of links that are bodies [m], (B, n, 2); else (B, 0, 2)."""
        return energy.bodies(self._memory.parameters, self._memory.read(Rod.THETA))

    def action(self, lane: int) -> FloatArray:
        """Return the last action of a lane, torque over its limit, (joints,)."""
        return self._actions[lane]

    def chain_length(self, lane: int) -> float:
        """Return the length of the chain of a lane [m]."""
        return float(1.0 / self._memory.members[Episode.PER_LENGTH, lane])

    def _new_outputs(self) -> None:
        """Make new arrays for what is told: those handed out before are not written again."""
        observation, outputs = self._shapes
        self._arrays = (
            self._actions, np.empty(observation, np.float32), np.empty(outputs), self._task,
        )  # fmt: skip

    def close(self) -> None:
        """End the threads."""
        self._memory.close()
