"""Many chains side by side: the part that the vector environment and the single one share."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks, theory
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.envs.config import Config
from npend_gym.envs.modes import Quantities, lifting_energy
from npend_gym.period import counted_speed
from npend_gym.physics.energy import positions
from npend_gym.physics.kernels import lanes as kernels
from npend_gym.physics.kernels.dynamics import pack_rods
from npend_gym.physics.kernels.sincos import MAX_ANGLE
from npend_gym.physics.kernels.stepping import advance

BoolArray = NDArray[np.bool_]

CHAIN_OPTIONS = ("masses", "lengths", "gravity", "damping")
START_OPTIONS = ("theta", "omega", "amplitude")
_LIMITS = {"theta": MAX_ANGLE, "amplitude": MAX_ANGLE, "omega": kernels.MAX_SPEED}
_SCALARS = kernels.SCALARS


class Batch:
    """The chains of B environments ("lanes"): start them, advance them, look at them.

    Nothing in a lane depends on another lane, on B or on the number of threads.
    """

    def __init__(self, config: Config, count: int, threads: int = 1) -> None:
        self.config, self.count, self.threads = config, count, threads
        n = config.chain.n
        self.rngs: list[np.random.Generator] = []
        self._fixed = (config.max_torque, config.dt, config.substeps, count, n)
        floats, integers, seen = kernels.memory_sizes(count, n, config.joints.size)
        self._sizes = ((count, (3 if config.with_sines else 2) * n), seen)
        self._floats, self._integers = np.zeros(floats), np.zeros(integers, np.int64)
        self._lanes = kernels.lanes_of(self._floats, self._integers, count, n)
        self._lanes.joints[:] = config.joints
        self.action, self.active = self._lanes.action, self._lanes.active  # for the next step
        self.active[:] = 1
        self._ideal = np.empty(count)  # s
        self._chains: dict[int, Chain] = {}  # of lanes that have one of their own
        for first in range(0, count, kernels.TILE):
            self._set_chain(first, config.chain, min(kernels.TILE, count - first))
        self._scratch = [kernels.new_scratch(n, count) for _ in range(threads)]
        self._pool: ThreadPoolExecutor | None = None
        self._look_anew()

    # -- starting ---------------------------------------------------------------------------

    def start(
        self, mask: BoolArray, options: Mapping[str, FloatArray], *, anew: bool = True
    ) -> None:
        """Begin a new episode in the lanes of `mask`, with the options of `check_options`.

        What is seen goes to new arrays, or, not `anew`, to those of the last step.
        """
        lanes, config = self._lanes, self.config
        n = config.chain.n
        chosen = np.flatnonzero(mask)
        self._change_chains(chosen.tolist(), options)
        amplitude = options.get("amplitude")
        for k in chosen.tolist():
            lanes.theta[k], lanes.omega[k] = config.mode.start(
                self.rngs[k],
                n,
                config.amplitude if amplitude is None else float(amplitude[k]),
                config.spread,
            )
        for name, target in (("theta", lanes.theta), ("omega", lanes.omega)):
            if name in options:
                target[chosen] = options[name][chosen]
        self._forget_turns(chosen)
        for array in (lanes.time, lanes.work_done, lanes.completed, lanes.diverged, lanes.action):
            array[mask] = 0
        if anew:
            self._look_anew()
        kernels.describe(
            self._floats, self._integers, mask.astype(np.int64), anew, n, self.observation,
            self._out, self._scratch[0],
        )  # fmt: skip

    def _change_chains(self, chosen: list[int], options: Mapping[str, FloatArray]) -> None:
        """Give the chosen lanes the chains of their new episode."""
        if not self._chains and not options.keys() & set(CHAIN_OPTIONS):
            return
        # all that can fail comes before anything is changed
        chains = {k: self._episode_chain(k, options) for k in chosen}
        for k, chain in chains.items():
            if chain is not self._chain_of(k):
                self._set_chain(k, chain)
            self._chains.pop(k, None)
            if chain is not self.config.chain:
                self._chains[k] = chain

    def _chain_of(self, lane: int) -> Chain:
        return self._chains.get(lane, self.config.chain)

    def _forget_turns(self, chosen: NDArray[np.int64]) -> None:
        """Begin to look for the turning points of the chosen lanes, from their new state."""
        lanes, n = self._lanes, self.config.chain.n
        turns = lanes.turns
        side = positions(self.config.chain, lanes.theta[chosen])[..., 0]
        speed = np.abs(lanes.omega[chosen]).max(axis=1)
        threshold = _counted_velocity(self.config.chain, speed)
        for row, k in enumerate(chosen.tolist() if self._chains else ()):
            chain = self._chain_of(k)
            side[row] = positions(chain, lanes.theta[k])[:, 0]
            threshold[row] = _counted_velocity(chain, speed[row])
        lanes.threshold[chosen] = threshold
        turns.orientation.reshape(-1, n)[chosen] = np.where(side < 0.0, -1.0, 1.0)
        turns.period.reshape(-1, n)[chosen] = np.nan
        turns.zero.reshape(-1, n)[chosen] = np.nan
        turns.sign.reshape(-1, n)[chosen] = 0
        turns.risen.reshape(-1, n)[chosen] = 0

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
            checked[name] = _checks.broadcast(f"options[{name!r}]", value, full)
            limit = _LIMITS.get(name, np.inf)
            if np.any(np.abs(checked[name]) > limit):
                raise ValueError(
                    f"options[{name!r}] must lie within {limit:g}, got {_checks.show(value)}"
                )
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

    def _set_chain(self, lane: int, chain: Chain, count: int = 1) -> None:
        """Give `count` lanes from `lane` on, all of one tile, the parameters of `chain`."""
        first = lane - lane % kernels.TILE
        width = min(kernels.TILE, self.count - first)
        some = slice(lane, lane + count)

        def put(target: FloatArray, values: FloatArray) -> None:
            rows = values.size
            tile = target[first * rows : (first + width) * rows].reshape(rows, width)
            tile[:, lane - first : lane - first + count] = values[:, None]

        for target, values in zip(self._lanes.rods, pack_rods(chain), strict=True):
            put(target, values)
        put(self._lanes.mass, chain.masses)
        put(self._lanes.carried, chain.carried_masses * chain.lengths)
        self._lanes.per_unit[some] = 1.0 / lifting_energy(chain)
        self._lanes.per_reach[some] = 1.0 / chain.total_length
        self._lanes.lift_share[some] = 0.5 / float(chain.lengths @ chain.carried_masses)
        self._ideal[some] = theory.ideal_period(chain) if chain.gravity > 0.0 else 0.0
        self._only_ideal = float(self._ideal[0])

    # -- stepping ---------------------------------------------------------------------------

    def step(self) -> None:
        """Advance the lanes that are `active` by one step under `action`, which is clipped."""
        if self.threads == 1:  # without the calls below, which a single environment would feel
            self.observation = np.empty(self._sizes[0], np.float32)
            self._out = np.empty(self._sizes[1])
            advance(
                self._floats, self._integers, *self._fixed, 0, self.count, self.observation,
                self._out, self._scratch[0],
            )  # fmt: skip
            return
        self._look_anew()
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self.threads, "npend_gym")
        jobs = [
            self._pool.submit(self._advance, *share, scratch)
            for share, scratch in zip(self._shares(), self._scratch, strict=False)
        ]
        for job in jobs:
            job.result()

    def _advance(self, first: int, last: int, scratch: FloatArray) -> None:
        advance(
            self._floats, self._integers, *self._fixed, first, last, self.observation, self._out,
            scratch,
        )  # fmt: skip

    def _shares(self) -> list[tuple[int, int]]:
        """Return the lanes (first, last + 1) that each thread works on, in whole tiles."""
        tiles = -(-self.count // kernels.TILE)
        workers = min(self.threads, tiles)
        edges = [kernels.TILE * (tiles * k // workers) for k in range(workers)] + [self.count]
        return list(pairwise(edges))

    # -- looking ----------------------------------------------------------------------------

    @property
    def diverged(self) -> BoolArray:
        """Lanes whose state has left all bounds; they keep their last sound state."""
        return self._lanes.diverged != 0

    def quantities(self) -> Quantities[FloatArray]:
        """Return what a mode judges by, an entry for every lane."""
        scalars, per_rod = self._parts()
        q = scalars  # the first rows are the fields of Quantities, in order
        return Quantities(q[0], q[1], q[2], q[3], q[4], q[5], per_rod[1], per_rod[2])

    def _parts(self) -> tuple[FloatArray, FloatArray]:
        """Return what is seen: scalars (SCALARS, B), and periods, theta and omega (3, B, n)."""
        split = _SCALARS * self.count
        return (
            self._out[:split].reshape(_SCALARS, self.count),
            self._out[split:].reshape(3, self.count, self.config.chain.n),
        )

    def info(self) -> dict[str, Any]:
        """Return the info of every lane: arrays with a leading lane axis, all of them fresh."""
        scalars, per_rod = self._parts()
        return {
            "time": scalars[kernels.TIME],
            "energy": scalars[kernels.JOULES],
            "energy_error": scalars[kernels.DRIFT],
            "bobs_completed": self._lanes.completed.copy(),
            "pseudo_period": scalars[kernels.PERIOD],
            "pseudo_periods": per_rod[0],
            "ideal_period": self._ideal.copy(),
            "tip_height": scalars[kernels.TIP_METRES],
            "theta": per_rod[1],
            "omega": per_rod[2],
            "diverged": self.diverged,
        }

    def only_lane(self) -> tuple[Quantities[float], dict[str, Any]]:
        """Return quantities and info of a batch of one lane, as plain numbers: the quick way."""
        out, n = self._out, self._fixed[4]
        row: list[float] = out[:_SCALARS].tolist()
        theta, omega = out[_SCALARS + n : _SCALARS + 2 * n], out[_SCALARS + 2 * n :]
        quantities = Quantities(row[0], row[1], row[2], row[3], row[4], row[5], theta, omega)
        info = {
            "time": row[kernels.TIME],
            "energy": row[kernels.JOULES],
            "energy_error": row[kernels.DRIFT],
            "bobs_completed": int(row[kernels.COMPLETED]),
            "pseudo_period": row[kernels.PERIOD],
            "pseudo_periods": out[_SCALARS : _SCALARS + n],
            "ideal_period": self._only_ideal,
            "tip_height": row[kernels.TIP_METRES],
            "theta": theta,
            "omega": omega,
            "diverged": row[kernels.DIVERGED] != 0.0,
        }
        return quantities, info

    def positions(self, lane: int) -> FloatArray:
        """Return the positions of the bobs of a lane [m], shape (n, 2)."""
        return positions(self._chain_of(lane), self._lanes.theta[lane])

    def reach(self, lane: int) -> float:
        """Return the length of the chain of a lane [m]."""
        return self._chain_of(lane).total_length

    def _look_anew(self) -> None:
        """Make new arrays for what is seen: those handed out before are not written again."""
        self.observation = np.empty(self._sizes[0], np.float32)
        self._out = np.empty(self._sizes[1])

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None

    def __getstate__(self) -> dict[str, Any]:
        # threads are made anew where they are needed, views of memory where it is restored
        views = ("_lanes", "action", "active")
        return {k: v for k, v in self.__dict__.items() if k not in views} | {"_pool": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._lanes = kernels.lanes_of(
            self._floats, self._integers, self.count, self.config.chain.n
        )
        self.action, self.active = self._lanes.action, self._lanes.active


def _counted_velocity(chain: Chain, fastest: FloatArray) -> FloatArray:
    """Return the speed of a bob [m/s] above which its direction counts."""
    return counted_speed(chain, fastest) * float(chain.lengths.mean())
