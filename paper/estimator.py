"""The estimator of a period that the paper prints (its appendix D), quirks and all."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from npend_gym import Chain, simulate
from npend_gym.tools import FloatArray

LISTING_DURATION = 10.0  # s
LISTING_FRAMES_PER_SECOND = 100
_CLOSE = 0.01  # m: heights nearer than this count as the same


def listing_periods(chain: Chain, theta: ArrayLike, rtol: float = 1e-10) -> FloatArray:
    """Return what the paper's get_timeperiod_y gives for every bob [s], released at rest.

    It is about half a swing, see the finding "estimator"; it is here for what the paper did.

    Examples
    --------
    >>> from npend_gym import Chain
    >>> from paper.estimator import listing_periods
    >>> listing_periods(Chain.uniform(2), 0.5).round(2).tolist()
    [1.24, 1.24]
    """
    times = np.linspace(0.0, LISTING_DURATION, round(LISTING_FRAMES_PER_SECOND * LISTING_DURATION))
    heights = simulate(chain, theta, 0.0, times, rtol=rtol, atol=1e-2 * rtol).positions()[:, :, 1]
    return np.array([listing_estimate(height) for height in heights.T])


def listing_estimate(height: FloatArray) -> float:
    """Return the paper's printed estimate of a period [s] from a bob's heights [m], shape (T,).

    The listing counts frames as 1/100 s each though they are 10/999 s apart, compares the first
    frame with the last, and averages two unlike things: one term for the mean gap between frames
    of like height, and a term for every pair of turning points two apart. NaN where no two frames
    are of like height, whatever the turning points.
    """
    sign = np.sign(np.gradient(height))
    times: list[float] = []
    for k in np.flatnonzero(sign != np.roll(sign, 1)).tolist():
        if k - 1 not in times:  # compares a frame with seconds, as printed
            times.append(k / LISTING_FRAMES_PER_SECOND)
    total, pairs = _gaps(np.ascontiguousarray(height), _CLOSE)
    gap = total / pairs / LISTING_FRAMES_PER_SECOND if pairs else np.nan
    return float(abs(np.mean([gap, *(b - a for a, b in zip(times, times[2:], strict=False))])))


@njit(cache=True)
def _gaps(height: FloatArray, close: float) -> tuple[int, int]:
    """Return the sum of the gaps [frames] that the listing collects, and their number.

    For every pair of frames p < q of like height the listing appends both to a list that it never
    clears. It removes the least entry, and notes how far the next least is from it. The list is a
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
