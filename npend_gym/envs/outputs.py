"""The results of B environments: observations, rewards and infos, in arrays that are handed out."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable
from operator import attrgetter
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import BoolArray, FloatArray
from npend_gym.chain import ChainParameters
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.goals import of_lane, with_goals
from npend_gym.envs.hardware import MotorCalls
from npend_gym.envs.info import COUNTS, NUMBERS, OF_RODS, TABLE, TRUTHS, BatchInfo, Info
from npend_gym.envs.modes import Quantities
from npend_gym.envs.rows import OF_LANE, Block, Flag, Output, Pose, first_row
from npend_gym.physics.kernels.layout import Rod
from npend_gym.physics.memory import Memory

_ROWS, _REWARD = len(Output), Output.REWARD  # the reward is the last of these rows
_TERMINATED, _TRUNCATED = int(Flag.TERMINATED), int(Flag.TRUNCATED)


def _rows_of(block: int, n: int) -> slice:
    """Return the rows of a block with one for each rod."""
    return slice(first_row(block, n), first_row(block + 1, n))


def _info_maker(keys: Iterable[str], n: int, *, many: bool) -> Callable[..., Any]:
    """Return a function that makes an info: from `Outputs`, rows, numbers among them, and flags.

    It makes that of all environments, or, where these are not `many`, of the only one as plain
    numbers. It is written as text, as namedtuples are, because a loop over the keys takes twice as
    long.
    """
    entries: list[str] = []
    for name in keys:
        if name in TRUTHS:
            value = f"flags[{getattr(Flag, name.upper())}]"
        elif name in OF_RODS:
            rods = _rows_of(getattr(Block, name.upper()), n)
            value = f"rows[{rods.start}:{rods.stop}]" + (".T" if many else "")
        elif name in NUMBERS:
            value = f"numbers[{getattr(Output, name.upper())}]"
            if name in COUNTS:
                value = f"{value}.astype(np.int64)" if many else f"int({value})"
        else:
            value = f"outputs.{TABLE[name][1].read}({'' if many else 0})"
        entries.append(f"{name!r}: {value}")
    return eval(f"lambda outputs, rows, numbers, flags: {{{', '.join(entries)}}}")  # noqa: S307


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
    there are goals, or `with_quantities`.
    """

    def __init__(
        self, config: EnvConfig, memory: Memory, motors: MotorCalls | None, context: FloatArray,
        *, with_quantities: bool,
    ) -> None:  # fmt: skip
        self.config: EnvConfig = config
        self.count: int = memory.size
        n = config.n
        self._memory, self._motors, self._context = memory, motors, context
        joints = config.joints
        first = np.array_equal(np.arange(joints.size), joints)
        # where the only environment has its torques: of the first joints in a slice, which is
        # quicker
        self._acted = 0, int(Rod.TORQUE), slice(joints.size) if first else joints
        self._goal_env = config.goal_env
        self._shows_context = config.observe_context and context.shape[1] > 0
        self._is_plain = not (self._shows_context or self._goal_env)
        self._judged_by = slice(
            first_row(Block.QUANTITIES, n), first_row(Block.QUANTITIES, n) + OF_LANE
        )
        rows = (
            self._judged_by.stop
            if with_quantities or config.mode.has_goals
            else first_row(Block.COSINES, n)
        )
        self._shapes = (
            (memory.lanes, config.observed), (rows, memory.columns), (len(Flag), memory.lanes)
        )  # fmt: skip
        self._per_rod = {key: _rows_of(getattr(Block, key.upper()), n) for key in OF_RODS}
        self._shown = tuple(
            name for name, (_, key) in TABLE.items() if not key.when or attrgetter(key.when)(config)
        )
        self._everywhere = np.ones(self.count, np.bool_)
        self._masks = [f"_{name}" for name in self._shown]
        self._make_functions()
        self.renew()

    def _make_functions(self) -> None:
        self._info_of_one = _info_maker(self._shown, self.config.n, many=False)
        self._info_of_all = _info_maker(self._shown, self.config.n, many=True)

    def __getstate__(self) -> dict[str, Any]:  # functions cannot be pickled
        return self.__dict__ | {"_info_of_one": None, "_info_of_all": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._make_functions()

    def renew(self) -> None:
        """Make new arrays: those handed out before are not written again."""
        observations, rows, flags = self._shapes
        self.observations: NDArray[np.float32] = np.empty(observations, np.float32)
        self.rows: FloatArray = np.empty(rows)  # of `Output`, then of the blocks of `Block`
        self.flags: BoolArray = np.empty(flags, np.bool_)

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
        cosines = self.rows[_rows_of(Block.COSINES, self.config.n), : self.count].T
        goals = self._memory.read(Pose.GOAL)
        return with_goals(observation, cosines, self.quantities().kinetic_energy, goals)

    @property
    def outcome(self) -> tuple[FloatArray, BoolArray, BoolArray]:
        """Reward, terminated and truncated of the last step, (B,) each."""
        rewards, flags = self.rows[Output.REWARD], self.flags[:, : self.count]
        return rewards[: self.count], flags[Flag.TERMINATED], flags[Flag.TRUNCATED]

    def quantities(self, *, of_only_lane: bool = False) -> Quantities[Any]:
        """Quantities that a mode judges: arrays (B, ...), or plain numbers of a single lane."""
        outputs = self.rows[:, 0] if of_only_lane else self.rows[:, : self.count]
        theta, omega = (outputs[self._per_rod[key]].T for key in ("theta", "omega"))
        rows = outputs[self._judged_by]
        each: list[Any] = rows.tolist() if of_only_lane else list(rows)
        return Quantities(*each, theta, omega)  # pyright: ignore[reportCallIssue]

    def masked_info(self, present: BoolArray | None = None) -> dict[str, Any]:
        """Return the info of all sub-environments with its masks, arrays (B,).

        They are True in the sub-environments where info is `present`, by default all.
        """
        info = cast("dict[str, Any]", self.info())
        if present is None:
            present = self._everywhere.copy()
        info.update(dict.fromkeys(self._masks, present))
        return info

    def info(self) -> BatchInfo:
        """Return the info of all sub-environments, arrays (B, ...) of the last step or start.

        They are handed out: the next step does not write to them.
        """
        rows = self.rows[:, : self.count]
        return self._info_of_all(self, rows, rows, self.flags[:, : self.count])

    def only_lane(self) -> tuple[Any, float, bool, bool, Info[float, int, bool]]:
        """Result of `step` for the only sub-environment, as plain numbers: the quick way."""
        lane, flags = self.rows[:, 0], self.flags[:, 0].tolist()
        numbers = lane[:_ROWS].tolist()
        info = self._info_of_one(self, lane, numbers, flags)
        observation = self.observations[0] if self._is_plain else of_lane(self.observation, 0)
        return observation, numbers[_REWARD], flags[_TERMINATED], flags[_TRUNCATED], info

    # -- what the table of the info names ---------------------------------------------------

    def torques(self, lanes: Any = ...) -> FloatArray:
        """Return the mean torque of each motor in the last step [N m], or force [N], (B, m)."""
        if self._motors is None and lanes == 0:  # as below, in less time
            return self._memory.arrays[1][self._acted].astype(np.float64)
        if self._motors is not None:
            acted = self._motors.torques[:, : self.count].T[lanes]
        else:
            acted = self._memory.read_at(Rod.TORQUE, self.config.joints)[lanes]
        # in a copied environment too of NumPy's own float64, so that pickles are the same bytes
        return acted.astype(np.float64, order="C")

    def context(self, lanes: Any = ...) -> FloatArray:
        """Return the numbers drawn for the episodes, (B, k)."""
        return self._context[: self.count][lanes].copy()

    def goals(self, lanes: Any = ...) -> FloatArray:
        """Return the angles, 0 or pi, that the rods are to reach [rad], (B, n)."""
        return np.where(self._memory.read(Pose.GOAL) < 0.0, math.pi, 0.0)[lanes]


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
