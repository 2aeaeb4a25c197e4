"""Many chains side by side: the part that the vector environment and the single one share."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks, theory
from npend_gym._checks import FloatArray
from npend_gym._threads import Call, Helpers
from npend_gym.chain import Chain
from npend_gym.compiled.sincos import MAX_ANGLE
from npend_gym.envs.config import CHAIN_KEYWORDS as CHAIN_OPTIONS
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.info import Info
from npend_gym.envs.modes import Quantities
from npend_gym.period import counted_speed
from npend_gym.physics.energy import positions
from npend_gym.physics.kernels import lanes as kernels
from npend_gym.physics.kernels.dynamics import pack_rods
from npend_gym.physics.kernels.stepping import MAX_PARTS, advance_many, advance_one

BoolArray = NDArray[np.bool_]

START_OPTIONS = ("theta", "omega", "amplitude")
_RODS_PER_CALL = 2_000_000  # rods times substeps in one compiled call: some tenths of a second
_PIECES = 4  # of a thread's share in a step: fewer, and all wait longer for the last one
_LIMITS = {"theta": MAX_ANGLE, "amplitude": MAX_ANGLE, "omega": kernels.MAX_SPEED}
_SCALARS = kernels.SEEN_ROWS
_BEGUN = [
    [kernels.TIME], [kernels.WORK_DONE], [kernels.COMPLETED], [kernels.EFFORT], [kernels.DIVERGED]
]  # fmt: skip
_UNKNOWN = (
    (kernels.PERIOD, np.nan), (kernels.ZERO, np.nan), (kernels.SIGN, 0.0), (kernels.RISEN, 0.0)
)  # fmt: skip
_VIEWS = ("_rows", "_rods", "_actions", "active", "_theta", "_omega")


class Batch:
    """The chains of B environments ("lanes"): start them, advance them, look at them.

    Nothing in a lane depends on another lane, on B or on the number of threads.
    """

    def __init__(self, config: EnvConfig, count: int, threads: int = 1) -> None:
        self.config, self.count, self.threads = config, count, threads
        n = config.chain.n
        self.rngs: list[np.random.Generator] = []
        self._width = kernels.group_width(count)
        self._groups = -(-count // self._width)
        lanes = self._groups * self._width  # the last group is filled up
        floats, seen = kernels.memory_sizes(lanes, n, config.joints.size)
        self._sizes = ((lanes, (3 if config.with_sines else 2) * n), seen)
        self._floats = np.zeros(floats)
        self._name_parts()
        self._advance, self._describe = (
            (advance_one, kernels.describe_one)
            if count == 1
            else (advance_many, kernels.describe_many)
        )
        self._fixed = (
            config.joints, config.max_torque, config.dt, config.min_substeps,
            1.0 / config.max_rotation, self._groups, n,
        )  # fmt: skip
        self._ideal = np.empty(count)  # s
        self._chains: dict[int, Chain] = {}  # of lanes that have one of their own
        self._set_chain(np.arange(lanes), config.chain)
        self.active[:] = 1.0
        self._scratch = [kernels.new_scratch(n, self._width) for _ in range(threads)]
        self._helpers: Helpers | None = None
        most = n * self._width * (1 if math.isinf(config.max_rotation) else int(MAX_PARTS))
        piece = max(1, _RODS_PER_CALL // most)  # substeps of a group
        share = self._groups if threads == 1 else -(-self._groups // (_PIECES * threads))
        self._per_call = (
            max(1, min(piece // config.min_substeps, share)),
            min(piece, config.min_substeps),
        )
        self._look_anew()

    def _name_parts(self) -> None:
        """Make the views of the memory: a row for every lane, and rows for the rods of groups."""
        groups, width, joints = self._groups, self._width, self.config.joints.size
        lanes = groups * width
        first, last = kernels.LANE_ROWS * lanes, self._floats.size - lanes * joints
        self._rows = self._floats[:first].reshape(-1, lanes)[:, : self.count]
        self._rods = self._floats[first:last].reshape(groups, -1, width)
        actions = self._floats[last:].reshape(groups, joints, width)
        self._actions = actions.swapaxes(1, 2)  # of the next step, (groups, width, joints)
        self.active = self._rows[kernels.ACTIVE]  # 1.0 where the next step is to be taken
        self._theta, self._omega = self._per_rod(kernels.THETA), self._per_rod(kernels.OMEGA)

    def _per_rod(self, field: int, extra: int = 0) -> FloatArray:
        """Return the rows of a field of every group, (groups, width, n)."""
        n = self.config.chain.n
        return self._rods[:, field * n : (field + 1) * n + extra].swapaxes(1, 2)

    # -- starting ---------------------------------------------------------------------------

    def start(
        self, mask: BoolArray, options: Mapping[str, FloatArray], *, anew: bool = True
    ) -> None:
        """Begin a new episode in the lanes of `mask`, with the options of `check_options`.

        What is seen goes to new arrays, or, not `anew`, to those of the last step.
        """
        config, n = self.config, self.config.chain.n
        chosen = np.flatnonzero(mask)
        place = divmod(chosen, self._width)
        self._change_chains(chosen.tolist(), options)
        amplitude = options.get("amplitude")
        for k in chosen.tolist():
            at = divmod(k, self._width)
            self._theta[at], self._omega[at] = config.mode.start(
                self.rngs[k],
                n,
                config.amplitude if amplitude is None else float(amplitude[k]),
                config.spread,
            )
        for name, target in (("theta", self._theta), ("omega", self._omega)):
            if name in options:
                target[place] = options[name][chosen]
        self._forget_turns(chosen)
        self._rows[_BEGUN, chosen] = 0.0
        self._actions[place] = 0.0
        self._rows[kernels.STARTING] = mask
        if anew:
            self._look_anew()
        self._describe(self._floats, anew, self._groups, n, self._seen, self._out, self._scratch[0])
        self._rows[kernels.STARTING] = 0.0

    def _change_chains(self, chosen: list[int], options: Mapping[str, FloatArray]) -> None:
        """Give the chosen lanes the chains of their new episode."""
        if not self._chains and not options.keys() & set(CHAIN_OPTIONS):
            return
        # all that can fail comes before anything is changed
        chains = {k: self._episode_chain(k, options) for k in chosen}
        for k, chain in chains.items():
            if chain is not self._chain_of(k):
                self._set_chain(np.array([k]), chain)
            self._chains.pop(k, None)
            if chain is not self.config.chain:
                self._chains[k] = chain

    def _chain_of(self, lane: int) -> Chain:
        return self._chains.get(lane, self.config.chain)

    def _forget_turns(self, chosen: NDArray[np.int64]) -> None:
        """Begin to look for the turning points of the chosen lanes, from their new state."""
        place = divmod(chosen, self._width)
        theta, omega = self._theta[place], self._omega[place]
        side = positions(self.config.chain, theta)[..., 0]
        speed = np.abs(omega).max(axis=1)
        threshold = _counted_velocity(self.config.chain, speed)
        for row, k in enumerate(chosen.tolist() if self._chains else ()):
            chain = self._chain_of(k)
            side[row] = positions(chain, theta[row])[:, 0]
            threshold[row] = _counted_velocity(chain, speed[row])
        self._rows[kernels.THRESHOLD, chosen] = threshold
        self._per_rod(kernels.ORIENTATION)[place] = np.where(side < 0.0, -1.0, 1.0)
        for field, unknown in _UNKNOWN:
            self._per_rod(field)[place] = unknown

    def check_options(self, options: Mapping[str, Any] | None, *, single: bool) -> dict[str, Any]:
        """Return the reset options as arrays with a leading lane axis, or say what is wrong."""
        given = dict(options or {})
        unknown = set(given) - {*CHAIN_OPTIONS, *START_OPTIONS}
        if unknown:
            raise ValueError(
                f"options must be among {', '.join((*START_OPTIONS, *CHAIN_OPTIONS))}; "
                f"got {_checks.show(sorted(map(str, unknown)))}"
            )
        n = self.config.chain.n
        checked: dict[str, Any] = {}
        for name, value in given.items():
            shape = () if name in ("amplitude", "gravity") else (n,)
            full = shape if single else (self.count, *shape)
            label = f"options[{name!r}]"
            checked[name] = _checks.broadcast(label, value, full)
            _checks.within(label, checked[name], _LIMITS.get(name, np.inf))
            if single:
                checked[name] = checked[name][None]
        for k in range(self.count if set(checked) & set(CHAIN_OPTIONS) else 0):
            self._episode_chain(k, checked)
        return checked

    def _episode_chain(self, lane: int, options: Mapping[str, FloatArray]) -> Chain:
        changes = {name: options[name][lane] for name in CHAIN_OPTIONS if name in options}
        if not changes:
            return self.config.chain
        chain = self.config.chain
        values: dict[str, Any] = {name: getattr(chain, name) for name in CHAIN_OPTIONS} | changes
        values["gravity"] = float(values["gravity"])
        return Chain(**values)

    def _set_chain(self, lanes: NDArray[np.int64], chain: Chain) -> None:
        """Give some lanes the parameters of `chain`."""
        place = divmod(lanes, self._width)
        self._per_rod(kernels.LENGTH)[place] = chain.lengths
        self._per_rod(kernels.INVERSE_LENGTH)[place] = 1.0 / chain.lengths
        self._per_rod(kernels.DAMPING)[place] = chain.damping
        self._per_rod(kernels.DRAG)[place] = chain.drag
        self._per_rod(kernels.QUADRATIC_DRAG)[place] = chain.quadratic_drag
        self._per_rod(kernels.MASS)[place] = chain.masses
        self._per_rod(kernels.CARRIED)[place] = chain.carried_masses * chain.lengths
        rods = pack_rods(chain)
        last = np.concatenate([rods.gravity, rods.inverse_mass])
        self._per_rod(kernels.GRAVITY_AND_INVERSE_MASS, 2)[place] = last
        lanes = lanes[lanes < self.count]
        self._rows[kernels.PER_UNIT, lanes] = 1.0 / chain.lifting_energy
        self._rows[kernels.PER_REACH, lanes] = 1.0 / chain.total_length
        self._rows[kernels.LIFT_SHARE, lanes] = 0.5 / float(chain.lengths @ chain.carried_masses)
        self._ideal[lanes] = theory.ideal_period(chain) if chain.gravity > 0.0 else 0.0
        self._only_ideal = float(self._ideal[0])

    # -- stepping ---------------------------------------------------------------------------

    def step(self, action: float | FloatArray | None) -> None:
        """Advance the lanes that are `active` by one step under `action`, (B, joints)."""
        if isinstance(action, np.ndarray) and self.count % self._width != 0:
            self._actions[divmod(np.arange(self.count), self._width)] = action
        elif isinstance(action, np.ndarray):
            self._actions[:] = action.reshape(self._actions.shape)
        elif action is not None:
            self._actions[:] = action
        self._look_anew()
        pieces = iter(range(0, self._groups, self._per_call[0]))
        if self.threads == 1 or self._groups == 1:
            self._advance_pieces(pieces, self._scratch[0])
            return
        if self._helpers is None:
            self._helpers = Helpers(min(self.threads, self._groups) - 1)
        self._helpers.run(
            lambda worker, call: self._advance_pieces(pieces, self._scratch[worker], call)
        )

    def _advance_pieces(
        self, pieces: Iterator[int], scratch: FloatArray, call: Call | None = None
    ) -> None:
        """Advance the groups from each of `pieces` on, as long as there are any.

        Threads share the iterator. Calls are so short that Ctrl-C is heard between them.
        """
        groups, piece, substeps = *self._per_call, self.config.min_substeps
        for first in pieces:
            last = min(first + groups, self._groups)
            for begin in range(0, substeps, piece):
                self._advance(
                    self._floats, *self._fixed, first, last, begin, min(begin + piece, substeps),
                    self._seen, self._out, scratch,
                )  # fmt: skip
                if call is not None and call.stopped:
                    return

    # -- looking ----------------------------------------------------------------------------

    @property
    def observation(self) -> NDArray[np.float32]:
        """The observations of all lanes, (B, 2n) or (B, 3n)."""
        return self._seen[: self.count]

    @property
    def diverged(self) -> BoolArray:
        """Lanes whose state has left all bounds; they keep their last sound state."""
        return self._rows[kernels.DIVERGED] != 0.0

    def every_lane(
        self,
    ) -> tuple[Quantities[FloatArray], Info[FloatArray, NDArray[np.int64], BoolArray]]:
        """Return quantities and info of all lanes, arrays (B, ...) made by the last step or start.

        The info's are handed out: they are not written again once the next step has begun.
        """
        lanes, n = self._sizes[0][0], self.config.chain.n
        split, count = _SCALARS * lanes, self.count
        rows: list[FloatArray] = list(self._out[:split].reshape(_SCALARS, lanes)[:, :count])
        periods, theta, omega = self._out[split:].reshape(3, lanes, n)[:, :count]
        quantities = Quantities(rows[0], rows[1], rows[2], rows[3], rows[4], rows[5], theta, omega)
        info: Info[FloatArray, NDArray[np.int64], BoolArray] = {
            "time": rows[kernels.SEEN_TIME],
            "energy": rows[kernels.SEEN_JOULES],
            "energy_error": rows[kernels.SEEN_DRIFT],
            "bobs_completed": rows[kernels.SEEN_COMPLETED].astype(np.int64),
            "pseudo_period": rows[kernels.SEEN_PERIOD],
            "pseudo_periods": periods,
            "ideal_period": self._ideal.copy(),
            "tip_height": rows[kernels.SEEN_TIP_METRES],
            "theta": theta,
            "omega": omega,
            "diverged": self.diverged,
            "success": np.zeros(count, np.bool_),  # the environment knows, from step to step
        }
        return quantities, info

    def only_lane(self) -> tuple[Quantities[float], Info[float, int, bool]]:
        """Return what `every_lane` does, of a batch of one, as plain numbers: the quick way."""
        out, n = self._out, self._fixed[-1]
        row: list[float] = out[:_SCALARS].tolist()
        theta, omega = out[_SCALARS + n : _SCALARS + 2 * n], out[_SCALARS + 2 * n :]
        quantities = Quantities(row[0], row[1], row[2], row[3], row[4], row[5], theta, omega)
        info: Info[float, int, bool] = {
            "time": row[kernels.SEEN_TIME],
            "energy": row[kernels.SEEN_JOULES],
            "energy_error": row[kernels.SEEN_DRIFT],
            "bobs_completed": int(row[kernels.SEEN_COMPLETED]),
            "pseudo_period": row[kernels.SEEN_PERIOD],
            "pseudo_periods": out[_SCALARS : _SCALARS + n],
            "ideal_period": self._only_ideal,
            "tip_height": row[kernels.SEEN_TIP_METRES],
            "theta": theta,
            "omega": omega,
            "diverged": row[kernels.SEEN_DIVERGED] != 0.0,
            "success": False,  # the environment knows, from step to step
        }
        return quantities, info

    def positions(self, lane: int) -> FloatArray:
        """Return the positions of the bobs of a lane [m], shape (n, 2)."""
        return positions(self._chain_of(lane), self._theta[divmod(lane, self._width)])

    def action(self, lane: int) -> FloatArray:
        """Return the last action of a lane, torque over its limit, (joints,)."""
        return self._actions[divmod(lane, self._width)]

    def reach(self, lane: int) -> float:
        """Return the length of the chain of a lane [m]."""
        return self._chain_of(lane).total_length

    def _look_anew(self) -> None:
        """Make new arrays for what is seen: those handed out before are not written again."""
        self._seen = np.empty(self._sizes[0], np.float32)
        self._out = np.empty(self._sizes[1])

    def close(self) -> None:
        """End the threads."""
        if self._helpers is not None:
            self._helpers.close()
            self._helpers = None

    def __getstate__(self) -> dict[str, Any]:
        # threads are made anew where they are needed, views of memory where it is restored
        return {k: v for k, v in self.__dict__.items() if k not in _VIEWS} | {"_helpers": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._name_parts()


def _counted_velocity(chain: Chain, fastest: FloatArray) -> FloatArray:
    """Return the speed of a bob [m/s] above which its direction counts."""
    return counted_speed(chain, fastest) * float(chain.lengths.mean())
