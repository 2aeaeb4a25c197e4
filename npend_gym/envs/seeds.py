"""The seeds of the sub-environments, and their keys."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import BoolArray
from npend_gym.compiled.philox import Keys, key_of, keys_of

LaneNumbers = NDArray[np.int64]


def checked_seed(seed: Any) -> int | None:
    """Return one seed as an int, or None; Gymnasium takes no integers of NumPy, for example."""
    return None if seed is None else _checks.count("seed", seed, low=0)


def checked_seeds(seed: Any, count: int) -> Any:
    """Return the seed of lane 0 of `count` as an int, a list with that of every lane, or None."""
    of_lanes = seed.ndim > 0 if isinstance(seed, np.ndarray) else isinstance(seed, Sequence)
    if not of_lanes or isinstance(seed, (str, bytes)):
        return checked_seed(seed)
    given = cast("Sequence[Any]", seed)
    if len(given) != count:
        raise ValueError(
            f"seed must have an entry for each of the {count} sub-environments, got {len(given)}"
        )
    return [checked_seed(one) for one in given]


class Seeds:
    """The seed of each of `count` sub-environments: sub-environment k of seed s has s + k.

    `lanes` has those that fill up the last group too, see `Memory`.
    """

    def __init__(self, count: int, lanes: int) -> None:
        self._count = count
        self.values: list[int] = []  # until the first `choose`
        self.keys: Keys = np.zeros((2, lanes), np.uint64)
        self._generators: tuple[np.random.Generator, ...] | None = None

    def choose(self, seed: Any, lanes: BoolArray) -> LaneNumbers:
        """Seed some lanes (B,) as `checked_seeds` has it; return those whose seed is new.

        An environment without a seed keeps the one it has. The first is drawn from the system where
        none was given.
        """
        given: list[Any] = [None] * self._count if seed is None else seed
        if isinstance(seed, int):
            new, given = lanes, list(range(seed, seed + self._count))
        else:
            new = lanes & np.array([one is not None for one in given])
        if not self.values:
            entropy = seeding.np_random(None)[1] if any(one is None for one in given) else 0
            self.values = [entropy + lane if one is None else one for lane, one in enumerate(given)]
            new = np.ones(self._count, np.bool_)
        elif new.all():
            self.values = given
        else:
            self.values = [
                given[lane] if chosen else old
                for lane, (chosen, old) in enumerate(zip(new.tolist(), self.values, strict=True))
            ]
        if new.any():
            self._generators = None
        chosen = np.flatnonzero(new)
        if isinstance(seed, int):
            self.keys[:, chosen] = keys_of(seed, self._count)[:, chosen]
        elif chosen.size > 0:
            keys = [key_of(self.values[lane]) for lane in chosen.tolist()]
            self.keys[:, chosen] = np.array(keys, np.uint64).T
        return chosen

    def take(self, other: Seeds) -> None:
        """Take over the seeds of all sub-environments."""
        self.values, self.keys[:], self._generators = other.values, other.keys, None

    def read_keys(self, lanes: LaneNumbers) -> None:
        """Give some sub-environments the seeds of which their keys were made."""
        self.values = self.values or [0] * self._count
        for lane, (low, high) in zip(lanes.tolist(), self.keys[:, lanes].T.tolist(), strict=True):
            self.values[lane] = low + (high << 64)
        self._generators = None

    @property
    def generators(self) -> tuple[np.random.Generator, ...]:
        """NumPy's generators of the seeds, for the user: the environment draws from none."""
        if self._generators is None:
            self._generators = tuple(seeding.np_random(seed)[0] for seed in self.values)
        return self._generators
