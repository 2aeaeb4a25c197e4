"""The results of B environments: observations, rewards and infos, in arrays that are handed out."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from operator import attrgetter, itemgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import ChainParameters
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.goals import of_lane, with_goals
from npend_gym.envs.info import COUNTS, NUMBERS, OF_RODS, TABLE, TRUTHS, Info
from npend_gym.envs.modes import Quantities
from npend_gym.envs.rows import OF_LANE, Block, Flag, Output, Pose, first_row
from npend_gym.physics.memory import Memory

_REWARD = Output.REWARD
_TERMINATED, _TRUNCATED = int(Flag.TERMINATED), int(Flag.TRUNCATED)


def _rows_of(block: int, n: int, size: int) -> slice:
    """Return the first `size` rows of a block."""
    return slice(first_row(block, n), first_row(block, n) + size)


class EpisodeStarts(NamedTuple):
    """How the present episodes of B sub-environments began, new arrays."""

    state: FloatArray  # as `Episodes.angles` has it, (B, 2c)
    chains: ChainParameters  # (B, n)
    limits: FloatArray  # torque, or force on a cart, of the action 1, (B, joints)
    goals: FloatArray  # cosines, +-1, of the equilibrium to reach, (B, n), or (B, 0) without goals
    context: FloatArray  # the numbers drawn, (B, k)
    numbers: FloatArray  # by row: of `Member`, `Episode` and `Setting`, (rows, B)


class Outputs:
    """The arrays that the step kernel writes, read.

    `context`, (lanes, numbers), is what is drawn for each lane. What modes judge by is kept where
    there are goals, or `with_quantities`. The `only_lane` of a single environment is read from
    rows and flags that stay, whose numbers are copied.
    """

    def __init__(
        self, config: EnvConfig, memory: Memory, context: FloatArray, *, with_quantities: bool,
        single: bool,
    ) -> None:  # fmt: skip
        self.config: EnvConfig = config
        self.count: int = memory.size
        n, self._is_single = config.n, single
        self._memory, self._context = memory, context
        self._shows_context = config.observe_context and context.shape[1] > 0
        self._is_plain = not (self._shows_context or config.goal_env)
        first = first_row(Block.QUANTITIES, n)
        self._judged_by = slice(first, first + OF_LANE)
        judges = with_quantities or config.mode.has_goals
        rows = self._judged_by.stop if judges else first_row(Block.COSINES, n)
        self._shapes = (
            (memory.lanes, config.observed), (rows, memory.columns), (len(Flag), memory.lanes)
        )  # fmt: skip
        shown = self._shown = tuple(
            name for name, (_, key) in TABLE.items() if not key.when or attrgetter(key.when)(config)
        )
        self._everywhere = np.ones(self.count, np.bool_)
        self._keys = *shown, *(f"_{name}" for name in shown)  # with the masks
        self._counts = [name for name in COUNTS if name in shown]
        self._counted = [NUMBERS.index(name) for name in self._counts]
        size = {"torque": config.joints.size}
        self._blocks = {
            name: _rows_of(getattr(Block, name.upper()), n, size.get(name, n))
            for name in OF_RODS if name in shown
        }  # fmt: skip
        self._read = [name for name in shown if TABLE[name][1].read]
        self._rows_shown, self._flags_shown = (
            {name: getattr(rows, name.upper()) for name in names if name in shown}
            for rows, names in ((Output, NUMBERS), (Flag, TRUTHS))
        )  # fmt: skip
        kept = *self._rows_shown, *self._flags_shown, *self._blocks, *self._read
        self._in_order = itemgetter(*map(kept.index, shown))
        values = *Output._fields, *Flag._fields, *map(str.upper, (*self._blocks, *self._read))
        self._pick = itemgetter(*(values.index(name.upper()) for name in shown))
        self._renew_rows()
        self.renew()
        self._bind()

    def _bind(self) -> None:
        """Find the arrays that infos are made of: in a copied environment they are others.

        Copies of a view as float64 have NumPy's own dtype there too: their pickles are the same.
        """
        memory, lanes = self._memory, 0 if self._is_single else slice(self.count)
        reads: dict[str, Callable[[], FloatArray]] = {
            "context": self._context[lanes].view(np.float64).copy,
            "goal": lambda: np.where(memory.read(Pose.GOAL) < 0.0, math.pi, 0.0)[lanes],
        }
        self._reads = [reads[name] for name in self._read]
        if self._is_single:
            lane = self.rows[:, 0].view(np.float64)
            self._numbers, self._flags = lane[: len(Output)], self.flags[:, 0]
            self._reads = [*(lane[block].copy for block in self._blocks.values()), *self._reads]

    def __getstate__(self) -> dict[str, Any]:
        bound = "_reads", "_numbers", "_flags"
        return {name: value for name, value in self.__dict__.items() if name not in bound}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._bind()

    def renew(self) -> None:
        """Make new arrays: those handed out before are not written again."""
        self.observations: NDArray[np.float32] = np.empty(self._shapes[0], np.float32)
        if not self._is_single:
            self._renew_rows()

    def _renew_rows(self) -> None:
        self.rows: FloatArray = np.empty(self._shapes[1])  # of `Output`, then the blocks of `Block`
        self.flags: BoolArray = np.empty(self._shapes[2], np.bool_)

    @property
    def observation(self) -> Any:
        """The observations of all lanes, (B, numbers), or the Dict that has them with goals."""
        observation = self.observations[: self.count]
        if self._is_plain:
            return observation
        if self._shows_context:
            shown = self.config.randomization.normalised(self._context[: self.count])
            observation[:, self.config.columns["context"]] = shown
        if not self.config.goal_env:
            return observation
        n = self.config.n
        cosines = self.rows[_rows_of(Block.COSINES, n, n), : self.count].T
        goals = self._memory.read(Pose.GOAL)
        return with_goals(observation, cosines, self.quantities().kinetic_energy, goals)

    @property
    def outcome(self) -> tuple[FloatArray, BoolArray, BoolArray]:
        """Reward, terminated and truncated of the last step, (B,) each."""
        rewards, flags = self.rows[Output.REWARD], self.flags[:, : self.count]
        return rewards[: self.count], flags[Flag.TERMINATED], flags[Flag.TRUNCATED]

    def quantities(self) -> Quantities[Any]:
        """Quantities that a mode judges: arrays (B, ...), or plain numbers of the only lane."""
        outputs = self.rows[:, 0].copy() if self._is_single else self.rows[:, : self.count]
        theta, omega = (outputs[self._blocks[key]].T for key in ("theta", "omega"))
        rows = outputs[self._judged_by]
        each: list[Any] = rows.tolist() if self._is_single else list(rows)
        return Quantities(*each, theta, omega)  # pyright: ignore[reportCallIssue]

    def masked_info(self, present: BoolArray | None = None) -> dict[str, Any]:
        """Return the info of all sub-environments with its masks, arrays (B,).

        They are True in the sub-environments where info is `present`, by default all. The arrays,
        (B, ...) of the last step or start, are handed out: the next step does not write to them.
        """
        rows, flags = self.rows[:, : self.count], self.flags[:, : self.count]
        values: list[Any] = [rows[row] for row in self._rows_shown.values()]
        values += [flags[row] for row in self._flags_shown.values()]
        values += [rows[block].T for block in self._blocks.values()]
        values += [read() for read in self._reads]
        present = self._everywhere.copy() if present is None else present
        masks = (present,) * len(self._shown)
        info: dict[str, Any] = dict(zip(self._keys, self._in_order(values) + masks, strict=True))
        for name in self._counts:
            info[name] = info[name].astype(np.int64)
        return info

    def only_lane(self) -> tuple[Any, float, bool, bool, Info[float, int, bool]]:
        """Result of `step` for the only sub-environment, as plain numbers: the quick way."""
        numbers, flags = self._numbers.tolist(), self._flags.tolist()
        for row in self._counted:
            numbers[row] = int(numbers[row])
        values = numbers + flags
        for read in self._reads:  # quicker than a list
            values.append(read())
        info: Any = dict(zip(self._shown, self._pick(values)))  # noqa: B905  strict takes 0.2 us
        observation = self.observations[0] if self._is_plain else of_lane(self.observation, 0)
        return observation, numbers[_REWARD], flags[_TERMINATED], flags[_TRUNCATED], info


def final_info(observation: Any, info: dict[str, Any], done: BoolArray) -> dict[str, Any]:
    """Return the keys that tell the last observation of episodes that are over, and their info."""
    last = np.full(done.size, None, dtype=object)
    for lane in np.flatnonzero(done).tolist():
        last[lane] = copy.deepcopy(of_lane(observation, lane))
    return {
        "final_obs": last,
        "_final_obs": done.copy(),
        "final_info": {
            key: np.where(done.reshape(-1, *[1] * (value.ndim - 1)), value, np.zeros_like(value))
            for key, value in info.items()
        },
        "_final_info": done.copy(),
    }
