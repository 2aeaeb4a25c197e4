"""The whole state of lanes as one array of records: what `get_state` returns, `set_state` takes."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.envs.config import EnvConfig
from npend_gym.envs.rows import Episode, Pose, Setting
from npend_gym.envs.seeds import LaneNumbers
from npend_gym.envs.settings import OF_LANES, OF_STARTS
from npend_gym.physics.kernels.layout import Member, Rod, Turn
from npend_gym.physics.kernels.link_terms import MODEL
from npend_gym.physics.memory import Memory

VERSION = 4  # of the record; another version of the package may have another
_SUMMED = 3  # words of a record from here on are in its checksum
_ODD = np.uint64(0x9E3779B97F4A7C15)
States = NDArray[np.void]


class Snapshots:
    """Records of the sub-environments of a memory. Every number in one has 8 bytes.

    `more` returns other arrays by name, (lanes, ...), that belong to the state, or views of such: a
    view that were kept here would not be one of the copied array in a copied environment.
    """

    def __init__(
        self, config: EnvConfig, memory: Memory, keys: NDArray[np.uint64],
        more: Callable[[], Mapping[str, FloatArray]],
    ) -> None:  # fmt: skip
        self._memory, self._keys, self._more = memory, keys, more
        self._environment = _fingerprint(config)
        per_rod = [*Rod._fields, *(Pose._fields if config.mode.has_goals else ())]
        rods = [(name.lower(), "<f8", (config.n + 1,)) for name in per_rod]
        rows = [*Member._fields, *Episode._fields, *Setting._fields]
        members: list[Any] = [(name.lower(), "<f8") for name in rows]
        parts: list[Any] = [("members", members), ("rods", rods)]
        for name, terms in zip(MODEL, memory.arrays[2] or (), strict=False):
            parts.append((name, "<f8", (terms.shape[1], terms.shape[2] // memory.width)))
        if memory.record is not None:
            turns = [(name.lower(), "<f8", (config.n + 1,)) for name in Turn._fields]
            parts.append(("record", turns))
        parts += [(name, "<f8", values.shape[1:]) for name, values in more().items()]
        head: list[Any] = [("version", "<u8"), ("environment", "<u8"), ("sum", "<u8")]
        head += [("done", "<u8"), ("key", "<u8", (2,))]
        self.dtype: np.dtype[np.void] = np.dtype([*head, *parts])
        self._first = len(head) + 1  # columns before `parts`
        one = memory.read_lanes(np.zeros(1, np.int64))
        self._shapes = [part.shape[1:] for part in (*one, *more().values())]

    def take(self, lanes: LaneNumbers, done: NDArray[np.bool_]) -> States:
        """Return the records of some sub-environments, (k,), new."""
        values = [*self._memory.read_lanes(lanes), *(v[lanes] for v in self._more().values())]
        columns = [part.reshape(lanes.size, math.prod(part.shape[1:])) for part in values]
        numbers = np.empty((lanes.size, self.dtype.itemsize // 8))
        np.concatenate(columns, axis=1, out=numbers[:, self._first :])
        states: Any = numbers.view(self.dtype)[:, 0]
        states["version"], states["environment"] = VERSION, self._environment
        states["key"], states["done"] = self._keys[:, lanes].T, done
        states["sum"] = self._sums(states)
        return states

    def _sums(self, states: States) -> NDArray[np.uint64]:
        """Return the checksums of records: each number is in them, times an odd number."""
        words = self._columns(states, "<u8")[:, _SUMMED:]
        factors = np.arange(1, 2 * words.shape[1], 2, dtype=np.uint64) * _ODD
        return (words * factors).sum(axis=1, dtype=np.uint64)

    def _columns(self, states: States, kind: str) -> NDArray[Any]:
        """Return records as numbers of 8 bytes, (k, all)."""
        numbers = np.ascontiguousarray(states).view(kind)
        return numbers.reshape(states.size, self.dtype.itemsize // 8)

    def check(self, given: Any, count: int) -> States:
        """Return records for `count` sub-environments, or say what is wrong with them."""
        names = getattr(getattr(given, "dtype", None), "names", None)
        if names is None:
            raise TypeError(f"state must come from get_state(), got {_checks.show(given)}")
        states: States = np.asarray(given)
        if "version" in names and np.any(states["version"] != VERSION):
            raise ValueError(
                f"state must have version {VERSION}, that of this package, "
                f"got {_checks.show(np.unique(states['version']).tolist())}"
            )
        if states.dtype != self.dtype:
            raise ValueError(
                "state must come from an environment with the same number of rods and kind of "
                "chain, and the same motors, sensors, randomize and measure_periods"
            )
        if states.size != count:
            raise ValueError(f"state must hold {count} sub-environments, got {states.size}")
        if np.any(states["environment"] != self._environment):
            raise ValueError(
                "state must come from an environment with the same chain, mode, dt, substeps, "
                "max_torque and randomize: make this environment with the same keywords"
            )
        checked = states.reshape(-1)
        changed = np.flatnonzero(checked["sum"] != self._sums(checked))
        if changed.size > 0:
            raise ValueError(
                "state must be what get_state() returned, because its numbers belong together; got "
                f"changed records {_checks.show(changed.tolist())}: set env.state, or reset with "
                "options, to start from another state"
            )
        return checked

    def put(self, lanes: LaneNumbers, states: States) -> None:
        """Put sub-environments into the states of checked records."""
        ends = np.cumsum([math.prod(shape) for shape in self._shapes])
        columns = np.split(self._columns(states, "<f8")[:, self._first :], ends[:-1], axis=1)
        parts = [
            part.reshape(lanes.size, *shape)
            for part, shape in zip(columns, self._shapes, strict=True)
        ]
        more = self._more()
        of_memory = len(parts) - len(more)
        self._memory.write_lanes(lanes, parts[:of_memory])
        for values, part in zip(more.values(), parts[of_memory:], strict=True):
            values[lanes] = part
        self._keys[:, lanes] = states["key"].T


def _fingerprint(config: EnvConfig) -> int:
    """Return a number that two environments share if one can go on from the other's state."""
    mode, random = type(config.mode), config.randomization
    names = ("rail", *(name for name in OF_LANES if name not in OF_STARTS))
    settings = (
        *config.chain.repeated(1), random.draws, config.joints,
        np.array([config.dt, config.min_substeps, config.max_rotation]),
        np.array([getattr(config, name) or 0.0 for name in names]),
        np.frombuffer(f"{mode.__module__}:{mode.__qualname__}".encode(), np.uint8),
    )  # fmt: skip
    digest = hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in settings))
    return int.from_bytes(digest.digest()[:8], "little")
