"""Memory for packs: the lane innermost, the first one at the beginning of a line of the cache."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from npend_gym._checks import FloatArray

_CACHE_LINE = 64  # bytes


def aligned_zeros(*shape: int) -> FloatArray:
    """Return zeros that begin where a line of the processor's cache does.

    NumPy's own begin at any multiple of 16 bytes. Where half of the reads and writes of packs go to
    two lines at once, kernels take a tenth longer.
    """
    memory = np.zeros(math.prod(shape) + _CACHE_LINE // 8)
    return np.ndarray(shape, float, memory, -memory.ctypes.data % _CACHE_LINE)


def innermost(lanes: Sequence[FloatArray] | FloatArray) -> FloatArray:
    """Return the rows of `lanes` (lanes, n) as one flat array with the lane innermost."""
    rows = np.array(lanes)
    if len(rows) == 1:
        return rows[0]
    flat = aligned_zeros(rows.size)
    flat.reshape(rows.T.shape)[:] = rows.T
    return flat
