"""The inner loop of the paper's printed estimator (appendix D, get_timeperiod_y)."""

from __future__ import annotations

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.compiled.jit import kernel


@kernel
def listing_gaps(height: FloatArray, close: float) -> tuple[int, int]:
    """Return the sum of the gaps [frames] that the listing collects, and their number.

    For every pair of frames p < q of like height the listing appends both to a list that it never
    clears, removes the least entry, and notes how far the next least is from it. The list is a
    multiset of frames: counted here, so that its least entry is found without a search.
    """
    frames = height.size
    held = np.zeros(frames + 1, np.int64)
    held[frames] = 1  # a stop for the searches
    least = frames
    total = 0
    pairs = 0
    for p in range(frames):
        for q in range(p + 1, frames):
            if abs(height[p] - height[q]) < close:
                held[p] += 1
                held[q] += 1
                least = min(least, p)
                while held[least] == 0:
                    least += 1
                held[least] -= 1
                following = least
                while held[following] == 0:
                    following += 1
                total += following - least
                pairs += 1
                least = following
    return total, pairs
