"""What streams of random numbers are for, so that no two are the same."""

from __future__ import annotations

from typing import NamedTuple


class Purposes(NamedTuple):
    """What a stream of random numbers is for: a word of its counter."""

    START: int = 0  # the state in which an episode starts
    CHAIN: int = 1  # the parameters of a random chain
    SENSOR: int = 2
    MOTOR: int = 3
    PUSH: int = 4
    GOAL: int = 5


Purpose = Purposes()
