"""The episodes of B lanes: how they start, one step of them, and what is told of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym import theory
from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import ChainParameters
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.info import Info
from npend_gym.envs.kernels import EPISODE_ROWS, Episode, Output, step_many, step_one
from npend_gym.envs.modes import Quantities
from npend_gym.physics import energy
from npend_gym.physics.kernels.layout import Member, Rod
from npend_gym.physics.memory import Memory

# For `only_lane`, which has no time to look up fields: the rows from TIME on
(
    _TIME, _ENERGY, _ENERGY_ERROR, _PSEUDO_PERIOD, _TIP_HEIGHT, _COMPLETED, _DIVERGED
) = Output[Output.TIME :]  # fmt: skip


class Episodes:
    """The chains of B environments ("lanes") and the episodes that they are in.

    Nothing in a lane depends on another lane, on B or on the number of threads.
    """

    def __init__(self, config: EnvConfig, count: int, threads: int = 1) -> None:
        self.config, self.count = config, count
        self.rngs: list[np.random.Generator] = []
        n, joints = config.chain.n, config.joints
        self._memory = Memory(config.chain.repeated(1), count, threads, EPISODE_ROWS)
        self._kernel = step_one if count == 1 else step_many
        members, lanes = self._memory.arrays[0], self._memory.lanes
        members[Episode.MAX_TORQUE] = config.max_torque
        members[Episode.MOTORS] = max(1, joints.size)
        self._groups = groups, width = self._memory.groups, self._memory.width
        self._actions = np.zeros((groups, n * width))  # of the next step, at each joint
        self._shapes = (
            (lanes, (3 if config.with_sines else 2) * n), (len(Output), lanes), (3, lanes, n)
        )  # fmt: skip
        self._lanes_fill_groups = count == lanes
        self._joints: list[int] = joints.tolist()
        self._timing = config.dt, config.min_substeps, config.max_rotation
        self._varied = np.zeros(count, np.bool_)  # lanes whose chain is not the config's
        self._ideal_period = np.empty(count)  # s
        self._scale(np.arange(lanes), config.chain.repeated(lanes))
        self._new_outputs()

    # -- starting ---------------------------------------------------------------------------

    def start(
        self, mask: BoolArray, options: Mapping[str, Any], *, reuse_buffers: bool = False
    ) -> None:
        """Begin a new episode in the lanes of `mask`, with the options of `checked_options`.

        Outputs go to new arrays or, with `reuse_buffers`, into those of the last step.
        """
        config, chosen = self.config, np.flatnonzero(mask)
        self._change_chains(chosen, options.get("chains"))
        theta, omega = np.empty((2, chosen.size, config.chain.n))
        amplitude = options.get("amplitude")
        for row, k in enumerate(chosen.tolist()):
            angle = config.amplitude if amplitude is None else float(amplitude[k])
            theta[row], omega[row] = config.mode.start(
                self.rngs[k], config.chain.n, angle, config.spread
            )
        theta = options["theta"][chosen] if "theta" in options else theta
        omega = options["omega"][chosen] if "omega" in options else omega
        self._memory.write_state(chosen, theta, omega)
        members = self._memory.members
        members[Episode.MEAN_SQUARED_ACTION, chosen] = 0.0
        self._by_lane()[self._memory.place(chosen)] = 0.0
        members[Episode.STARTING] = mask
        members[Episode.OBSERVED] = mask if reuse_buffers else 1.0
        if not reuse_buffers:
            self._new_outputs()
        self._memory.run(self._kernel, self._arrays, 0.0, 0, math.inf)
        members[Episode.STARTING] = 0.0

    def _change_chains(self, chosen: NDArray[np.int64], given: ChainParameters | None) -> None:
        """Give the chosen lanes the chains of their new episode, by default that of the config."""
        if given is None and not self._varied[chosen].any():
            return
        if given is None:
            chains = self.config.chain.repeated(chosen.size)
        else:
            chains = ChainParameters(*(values[chosen] for values in given))
        self._memory.write_chain(chosen, chains)
        self._scale(chosen, chains)
        self._varied[chosen] = given is not None

    def _scale(self, lanes: NDArray[np.int64], chains: ChainParameters) -> None:
        """Set what makes quantities mean the same for the chains of some lanes."""
        members = self._memory.arrays[0]
        members[Episode.PER_ENERGY, lanes] = 1.0 / chains.lifting_energy
        members[Episode.PER_LENGTH, lanes] = 1.0 / chains.lengths.sum(axis=1)
        members[Episode.PER_LIFT, lanes] = 0.5 / np.cumsum(chains.lift, axis=1)[:, -1]
        own = lanes < self.count
        periods = theory.ideal_periods(chains)[own]
        self._ideal_period[lanes[own]] = np.where(np.isnan(periods), 0.0, periods)

    # -- stepping ---------------------------------------------------------------------------

    def step(self, action: float | FloatArray | None) -> None:
        """Advance the `active` lanes by one step under `action`, (B, joints), 1 being the limit."""
        if isinstance(action, np.ndarray):
            groups, width = self._groups
            for column, joint in enumerate(self._joints):
                if self._lanes_fill_groups:
                    by_group = action.reshape(groups, width, -1)[:, :, column]
                    self._actions[:, joint * width : (joint + 1) * width] = by_group
                else:
                    place = self._memory.place(np.arange(self.count))
                    self._by_lane()[(*place, joint)] = action.reshape(self.count, -1)[:, column]
        elif action is not None:
            self._actions[0, self._joints[0]] = action
        self._new_outputs()
        self._memory.run(self._kernel, self._arrays, *self._timing)

    @property
    def active(self) -> FloatArray:
        """1.0 for lanes in which the next step is to be taken, else 0.0; a view, shape (B,)."""
        return self._memory.members[Member.ACTIVE]

    # -- what is told -----------------------------------------------------------------------

    @property
    def observation(self) -> NDArray[np.float32]:
        """The observations of all lanes, (B, 2n) or (B, 3n)."""
        return self._arrays[1][: self.count]

    @property
    def diverged(self) -> BoolArray:
        """Lanes whose state has left all bounds; they keep their last finite state."""
        return self._arrays[2][Output.DIVERGED, : self.count] != 0.0

    def every_lane(
        self,
    ) -> tuple[Quantities[FloatArray], Info[FloatArray, NDArray[np.int64], BoolArray]]:
        """Return quantities and info of all lanes, arrays (B, ...) of the last step or start.

        They are handed out: the next step does not write to them.
        """
        rows: list[FloatArray] = list(self._arrays[2][:, : self.count])
        periods, theta, omega = self._arrays[3][:, : self.count]
        quantities = Quantities(rows[0], rows[1], rows[2], rows[3], rows[4], rows[5], theta, omega)
        info: Info[FloatArray, NDArray[np.int64], BoolArray] = {
            "time": rows[Output.TIME],
            "energy": rows[Output.ENERGY_JOULES],
            "energy_error": rows[Output.ENERGY_ERROR],
            "bobs_completed": rows[Output.COMPLETED].astype(np.int64),
            "pseudo_period": rows[Output.PSEUDO_PERIOD],
            "pseudo_periods": periods,
            "ideal_period": self._ideal_period.copy(),
            "tip_height": rows[Output.TIP_HEIGHT],
            "theta": theta,
            "omega": omega,
            "diverged": self.diverged,
            "success": np.zeros(self.count, np.bool_),  # the environment knows
        }
        return quantities, info

    def only_lane(self) -> tuple[Quantities[float], Info[float, int, bool]]:
        """Return what `every_lane` does, of one lane alone, as plain numbers: the quick way."""
        row: list[float] = self._arrays[2].ravel().tolist()
        periods, theta, omega = self._arrays[3][:, 0]
        quantities = Quantities(row[0], row[1], row[2], row[3], row[4], row[5], theta, omega)
        info: Info[float, int, bool] = {
            "time": row[_TIME],
            "energy": row[_ENERGY],
            "energy_error": row[_ENERGY_ERROR],
            "bobs_completed": int(row[_COMPLETED]),
            "pseudo_period": row[_PSEUDO_PERIOD],
            "pseudo_periods": periods,
            "ideal_period": self._ideal_period.item(),
            "tip_height": row[_TIP_HEIGHT],
            "theta": theta,
            "omega": omega,
            "diverged": row[_DIVERGED] != 0.0,
            "success": False,  # the environment knows
        }
        return quantities, info

    def positions(self) -> FloatArray:
        """Return the positions of the bobs [m], shape (B, n, 2)."""
        return energy.positions(self._memory.parameters, self._memory.read(Rod.THETA))

    def bodies(self) -> FloatArray:
        """Return the centres of mass of links that are bodies [m], (B, n, 2); else (B, 0, 2)."""
        return energy.bodies(self._memory.parameters, self._memory.read(Rod.THETA))

    def action(self, lane: int) -> FloatArray:
        """Return the last action of a lane, torque over its limit, (joints,)."""
        group, place = self._memory.place(np.array(lane))
        return self._by_lane()[group, place][self.config.joints]

    def chain_length(self, lane: int) -> float:
        """Return the length of the chain of a lane [m]."""
        return float(1.0 / self._memory.members[Episode.PER_LENGTH, lane])

    def _by_lane(self) -> FloatArray:
        """Return a view of the actions, shape (groups, width, n)."""
        groups, n = self._actions.shape[0], self.config.chain.n
        return self._actions.reshape(groups, n, -1).swapaxes(1, 2)

    def _new_outputs(self) -> None:
        """Make new arrays for what is told: those handed out before are not written again."""
        observation, quantities, per_rod = self._shapes
        self._arrays = (
            self._actions, np.empty(observation, np.float32), np.empty(quantities),
            np.empty(per_rod),
        )  # fmt: skip

    def close(self) -> None:
        """End the threads."""
        self._memory.close()
