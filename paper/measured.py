"""Pseudo-periods of the paper's chains, each measured once and kept, and the paper's models."""

import math
from functools import cache

import numpy as np

from npend_gym import Chain, pseudo_periods, theory
from npend_gym.tools import FloatArray
from paper.estimator import LISTING_DURATION, listing_periods

PAPER_GRAVITY = 9.8  # m/s^2: the model's in the paper's last listing; its simulation has 9.81
RODS = ("1 m", "1/n m")  # the text, and the default of the paper's integrate_pendulum
_RTOL = 1e-7  # pseudo-periods right to 1e-4 s and better; the printed errors have three digits


@cache
def bob_periods(n: int, theta0: float, definition: str = "bob", rods: str = "1 m") -> FloatArray:
    """Return the pseudo-period [s] of every bob of `n` equal rods released at `theta0` [rad].

    NaN where a bob does not complete within 10 s on rods of 1/n m, or 10 sqrt(n) s on rods of 1 m.

    Scaling all lengths by s scales all times by sqrt(s), so that rods of 1/n m need no run of their
    own. "listing" does not scale, for it counts frames and compares heights with 0.01 m: it sees
    10 s of either chain. On rods of 1/n m the last seconds of chains of some 50 bobs and more are
    chaotic, and heights found there depend on the last digit.
    """
    if definition == "listing":
        chain = Chain.uniform(n, length=1.0 if rods == "1 m" else 1.0 / n)
        periods = listing_periods(chain, theta0, rtol=_RTOL)
    elif rods == "1 m":
        chain, window = Chain.uniform(n), LISTING_DURATION * math.sqrt(n)
        periods = pseudo_periods(chain, theta0, definition=definition, duration=window, rtol=_RTOL)
    else:
        periods = bob_periods(n, theta0, definition, "1 m") / math.sqrt(n)
    periods.flags.writeable = False
    return periods


@cache
def ideal_periods(count: int) -> FloatArray:
    """Return the paper's T0 [s] of chains 0..count of rods of 1 m, with its own g = 9.8 m/s^2."""
    chains = [Chain.uniform(n, gravity=PAPER_GRAVITY) for n in range(1, count + 1)]
    return np.array([0.0, *map(theory.ideal_period, chains)])


@cache
def fundamental_periods(count: int) -> FloatArray:
    """Return the period [s] of the slowest mode of chains 0..count of rods of 1 m."""
    return np.array([0.0, *map(theory.fundamental_period, map(Chain.uniform, range(1, count + 1)))])
