"""The swings after the first: when the centre of mass reverses, again and again.

At small angles the momentum of a chain that is released from rest is a sum of sines. The slowest of
them outweighs all others, in the straight release of equal rods, so that no reversal is ever far
from the slowest mode's: the swings keep its period on average, and not that of the first swing.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import CubicSpline

from npend_gym import Chain, simulate, theory
from npend_gym.theory import normal_modes
from npend_gym.tools import FloatArray

_PER_TURN = 8  # samples in a period of the fastest mode
_HALVINGS = 50  # of the time between two samples
_FRAMES = 400  # of a simulated motion, in a period of the slowest mode


def reversals(omega: FloatArray, strengths: FloatArray, count: int) -> FloatArray:
    """Return the first `count` roots after 0 of sum_k strengths_k sin(omega_k t).

    Raises
    ------
    ValueError
        If fewer are within ten and `count` half periods of the slowest mode.
    """
    step = 2.0 * math.pi / (_PER_TURN * float(omega[-1]))
    found: list[float] = []
    first, block = 1, 512
    while len(found) < count:
        if step * first > (10 + count) * math.pi / float(omega[0]):
            raise ValueError(f"the momentum must reverse {count} times, got {len(found)} reversals")
        times = step * np.arange(first, first + block + 1)
        positive = np.sin(np.outer(times, omega)) @ strengths > 0.0
        for k in np.flatnonzero(positive[1:] != positive[:-1]):
            low, high = float(times[k]), float(times[k + 1])
            for _ in range(_HALVINGS):
                middle = 0.5 * (low + high)
                same = (float(np.sin(omega * middle) @ strengths) > 0.0) == bool(positive[k])
                low, high = (middle, high) if same else (low, middle)
            found.append(0.5 * (low + high))
        first += block
    return np.array(found[:count])


def small_swings(chain: Chain, count: int) -> FloatArray:
    """Return how long [s] each of the first `count` swings takes after a small straight release."""
    omega, modes = normal_modes(chain)
    share = (chain.lift @ modes) ** 2 / (chain.lift @ modes**2)
    ends = reversals(omega, share * omega, 2 * count)[1::2]
    return np.diff(ends, prepend=0.0)


def measured_swings(chain: Chain, amplitude: float, count: int, rtol: float = 1e-11) -> FloatArray:
    """Return how long [s] each of the first swings takes after a straight release, by simulation.

    A swing ends with every second reversal of the centre of mass.
    """
    window = (1.15 * count + 1.0) * theory.fundamental_period(chain)
    times = np.linspace(0.0, window, math.ceil(_FRAMES * (1.15 * count + 1.0)))
    motion = simulate(chain, amplitude, 0.0, times, rtol=rtol, atol=1e-2 * rtol)
    along: FloatArray = motion.velocities()[:, :, 0] @ chain.masses
    roots: FloatArray = CubicSpline(times, along).roots(extrapolate=False)
    return np.diff(roots[roots > times[1]][1 : 2 * count : 2], prepend=0.0)
