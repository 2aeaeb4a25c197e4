"""The random generators of the lanes of a vector environment."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray

from npend_gym import _checks


class Generators:
    """A generator for each lane, with its seed; made by the first call that needs them."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._pairs: list[tuple[np.random.Generator, int]] = []

    def checked_seeds(self, seed: Any) -> list[int | None]:
        """Return the seed of every lane: seed + k, or seed[k]; None leaves a generator alone."""
        if seed is None:
            return [None] * self._count
        if not isinstance(seed, (list, tuple, np.ndarray)):
            first = _checks.count("seed", seed, low=0)
            return [first + lane for lane in range(self._count)]
        listed: list[Any] = list(seed)  # pyright: ignore[reportUnknownArgumentType]
        if len(listed) != self._count:
            raise ValueError(
                f"seed must have an entry for each of the {self._count} lanes, got {len(listed)}"
            )
        return [None if s is None else _checks.count("seed", s, low=0) for s in listed]

    def seed(self, seeds: list[int | None], lanes: NDArray[np.bool_]) -> None:
        """Seed the generators of some lanes (B,); a lane without a seed keeps its generator."""
        if not self._pairs:
            self._pairs = [seeding.np_random(seed) for seed in seeds]
            return
        for lane in np.flatnonzero(lanes).tolist():
            if seeds[lane] is not None:
                # generator and seed in one assignment, which no signal can divide
                self._pairs[lane] = seeding.np_random(seeds[lane])

    def pairs(self) -> list[tuple[np.random.Generator, int]]:
        """Return the generators and their seeds, drawn from the system where none were given."""
        if not self._pairs:
            self.seed([None] * self._count, np.ones(self._count, np.bool_))
        return self._pairs
