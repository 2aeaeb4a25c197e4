"""The estimator of a period that the paper prints (its appendix D), quirks and all."""

from __future__ import annotations

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.physics import simulate
from npend_gym.physics.kernels.listing import listing_gaps

LISTING_DURATION = 10.0  # s
MAX_LISTING_DURATION = 300.0  # s
LISTING_FRAMES_PER_SECOND = 100
_LISTING_CLOSE = 0.01  # m: heights nearer than this count as the same


def listing_periods(
    chain: Chain, theta: FloatArray, omega: FloatArray, duration: float, rtol: float
) -> FloatArray:
    """Return what the paper's get_timeperiod_y gives for every bob (appendix D)."""
    frames = max(2, round(LISTING_FRAMES_PER_SECOND * duration))
    times = np.linspace(0.0, duration, frames)
    path = simulate(chain, theta, omega, times, rtol=rtol, atol=1e-2 * rtol).positions()
    return np.array([listing_estimate(path[:, i, 1]) for i in range(chain.n)])


def listing_estimate(height: FloatArray) -> float:
    """Return the paper's printed estimate of a period [s] from a bob's heights [m], shape (T,).

    The listing counts frames as 1/100 s each though they are 10/999 s apart, compares the first
    frame with the last, and averages two unlike things: one term for the mean gap between frames
    of like height, and a term for every pair of turning points two apart. NaN where there is
    neither.
    """
    sign = np.sign(np.gradient(height))
    times: list[float] = []
    for k in np.flatnonzero(sign != np.roll(sign, 1)).tolist():
        if k - 1 not in times:  # compares a frame with seconds, as printed
            times.append(k / LISTING_FRAMES_PER_SECOND)
    total, pairs = listing_gaps(np.ascontiguousarray(height), _LISTING_CLOSE)
    gap = total / pairs / LISTING_FRAMES_PER_SECOND if pairs else np.nan
    return float(abs(np.mean([gap, *(b - a for a, b in zip(times, times[2:], strict=False))])))
