"""Arrays for packs: the lane innermost, from the beginning of a line of the cache, and views."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from npend_gym._checks import FloatArray

_CACHE_LINE = 64  # bytes

_T = TypeVar("_T")

NumbersOf = Callable[[Any], Any]  # `packs` or `bare`


def aligned_zeros(*shape: int) -> FloatArray:
    """Return zeros that begin where a line of the processor's cache does.

    NumPy's own begin at any multiple of 16 bytes. Where half of the reads and writes of packs go to
    two lines at once, kernels take a tenth longer.
    """
    memory = np.zeros(math.prod(shape) + _CACHE_LINE // 8)
    return np.ndarray(shape, float, memory, -memory.ctypes.data % _CACHE_LINE)


def innermost(lanes: FloatArray) -> FloatArray:
    """Return rows of each lane, (..., lanes, n), as (..., n lanes) with the lane innermost."""
    *leading, count, n = np.shape(lanes)
    if count == 1:
        return np.array(lanes)[..., 0, :]
    flat = aligned_zeros(*leading, n * count)
    flat.reshape(*leading, n, count)[:] = np.swapaxes(lanes, -1, -2)
    return flat


def bare(array: _T) -> _T:
    """Return a view of `array` that does not keep it alive; its caller must.

    Views of it cost nothing, where others count references, some ns each.
    """
    return array


def packs(array: _T) -> _T:
    """Return a bare view of `array` (..., m WIDTH), contiguous, as packs (..., m).

    Of floats or bools. Of a tuple, also of tuples: a view of each array; `bare` and `lane` do
    the same.
    """
    return array


def lane(array: _T, k: int) -> _T:
    """Lane `k` of an array of packs, as a bare view; floats are one lane."""
    del k
    return array
