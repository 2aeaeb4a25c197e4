"""The numbers of our paper, registered by their keys where they are computed."""

from collections.abc import Callable
from typing import Any

NUMBERS: dict[str, Callable[[bool], Any]] = {}


def number(key: str) -> Callable[[Callable[[bool], Any]], Callable[[bool], Any]]:
    """Register a function of `quick` that returns a number of the paper, or several."""

    def register(compute: Callable[[bool], Any]) -> Callable[[bool], Any]:
        NUMBERS[key] = compute
        return compute

    return register
