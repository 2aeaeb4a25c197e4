"""The front of a release, and what the free end makes of it.

Times are in units of 2 sqrt(L/g), called tau. x is the square root of the height above the free end
over L. Accelerations are in units of g sin(a). At small angles the rope's acceleration is

    A(x, tau) = -2 sum_k J0(j_k x) cos(j_k tau) / (j_k J1(j_k)).

With the asymptotic forms of the Bessel functions its terms are, near tau = 1 - x, 1 + x, 3 - x and
3 + x, those of sum sin(j delta)/j and sum cos(j delta)/j: a jump, and a logarithm on both sides.
The angle of the free end is -a A(0, tau), which grows like -a sqrt(2/delta) after the front has met
it. So small angles end at delta = 2 a^2 there, and with them the logarithm.

`python -m paper.period.front` simulates releases from finite angles and writes what happens near
the returns of the front to `front.csv` beside this file, in some two minutes. `python -m
paper.period.front out.csv 400:0.4` follows 400 rods from 0.4 rad.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import j0, j1, jn_zeros

from npend_gym import Chain, simulate, theory
from npend_gym.experiments import PAPER_AMPLITUDE
from npend_gym.tools import FloatArray, count, positive_number
from paper.hesitation import front_passes
from paper.period.files import read_rows, write_rows

FILE = Path(__file__).with_name("front.csv")
RUNS = (  # rods, and angles: small ones need more rods, for what they bend is short
    (3200, 0.25), (3200, 0.3), (3200, 0.4), (1600, 0.5), (1600, 0.6), (1600, 0.7),
    (1600, PAPER_AMPLITUDE),
)  # fmt: skip
PLACES = (0.6, 0.8, 0.9)  # x
AROUND = np.linspace(-0.65, 0.1, 301)  # times around the return of the front
LEFT = 0.05  # after the free end has turned the front, all of it has
_FEW, _MANY = 20_000, 1_000_000  # modes: for a curve, and 1e-4 away from the front
_EXACT = 50  # zeros of J0, from which on McMahon's series has them to 1e-11
_CUT = 3.0  # the sum is faded out at this part of its modes, so smoothly that it converges
_RTOL = 1e-8
_FRAMES = 1000


@cache
def _zeros(count: int) -> FloatArray:
    b: FloatArray = (np.arange(1.0, count + 1.0) - 0.25) * math.pi
    zeros = b + 1.0 / (8.0 * b) - 31.0 / (384.0 * b**3)
    known = min(count, _EXACT)
    zeros[:known] = jn_zeros(0, known)
    return zeros


def acceleration(x: float, tau: ArrayLike, modes: int = _FEW) -> FloatArray:
    """Return the acceleration of a rope at small angles, in units of g a.

    Examples
    --------
    >>> from paper.period.front import acceleration
    >>> acceleration(0.6, [0.39, 0.41]).round(2).tolist()  # the front comes at 1 - 0.6
    [-1.0, 0.29]
    """
    zeros = _zeros(modes)
    faded = np.exp(-((_CUT * zeros / zeros[-1]) ** 4))
    terms = -2.0 * faded * j0(zeros * x) / (zeros * j1(zeros))
    times = np.asarray(tau, float)
    found = [float(terms @ np.cos(zeros * one)) for one in times.ravel()]
    return np.array(found).reshape(times.shape)


def passages(x: float) -> tuple[float, float, float, float]:
    """Return when the front is at x: on its way down, up, down, and up again."""
    return 1.0 - x, 1.0 + x, 3.0 - x, 3.0 + x


def beside_the_front(x: float, delta: float) -> FloatArray:
    """Return the accelerations at `delta` before and after each of the passages, shape (4, 2)."""
    times = np.add.outer(passages(x), [-delta, delta])
    return acceleration(x, times, modes=_MANY)


def smooth_part(x: float) -> float:
    """Return what the acceleration is besides its logarithm, where the front comes back to x."""
    delta = 1e-3
    log = math.log(1.0 / delta) / (math.pi * math.sqrt(x))
    return float(acceleration(x, [1.0 + x - delta, 1.0 + x + delta], modes=_MANY).mean()) - log


def before_the_front(x: float, amplitude: float, core: float) -> float:
    """Return the acceleration just before the front comes back, of a release from `amplitude`.

    It is bounded: `core` stands for the logarithm where delta is small beside a^2.
    """
    log = 2.0 * math.log(1.0 / amplitude) + core
    return smooth_part(x) + log / (math.pi * math.sqrt(x))


class Return(NamedTuple):
    """What is measured where the front of a release comes back.

    n : number of rods. amplitude : angle of the release [rad]. x : of the bob. tip : greatest angle
    of the last rod [rad]. delta : times before (negative) and after the front, (T,). values : the
    acceleration across the chain, in units of g sin(a), (T,).
    """

    n: int
    amplitude: float
    x: float
    tip: float
    delta: FloatArray
    values: FloatArray

    def core(self, scaled: ArrayLike) -> FloatArray:
        """Return what takes the place of the logarithm, at times `scaled` in units of a^2.

        The rest of the measured acceleration is that of small angles; -ln|scaled| far from 0. NaN
        where the front has not left the free end yet, whose whip pulls at all bobs at once.
        """
        delta = np.asarray(scaled, float) * self.amplitude**2
        values = np.interp(delta, self.delta, self.values)
        small = acceleration(self.x, 1.0 + self.x + delta)
        found = math.pi * math.sqrt(self.x) * (values - small) - np.log(np.abs(scaled))
        return np.where(delta > LEFT - self.x, found, math.nan)


def measured(n: int, amplitude: float, at: Sequence[float] = PLACES) -> list[Return]:
    """Simulate `n` equal rods released from `amplitude`, near the front's returns to `at` (x).

    The acceleration is a mean over two steps of `AROUND`, for single rods make waves.
    """
    chain = Chain.uniform(count("n", n, low=3))
    amplitude = positive_number("amplitude", amplitude)
    unit = 2.0 * math.sqrt((n + 0.5) * float(chain.lengths[0]) / chain.gravity)
    t1, squares = theory.fundamental_period(chain), [x**2 for x in at]
    tip, *returns = (front_passes(n, amplitude, [0.0, *squares], _FRAMES) * t1).tolist()
    windows = [one + unit * AROUND for one in (tip, *returns)]
    times = np.unique(np.concatenate([[0.0], *windows]))
    motion = simulate(chain, amplitude, 0.0, times, rtol=_RTOL, atol=1e-2 * _RTOL)
    velocities, widest = motion.velocities(), float(np.abs(motion.theta[:, -1]).max())
    found: list[Return] = []
    for x, window in zip(at, windows[1:], strict=True):
        bob = round(n - 0.5 - x**2 * (n + 0.5))
        rows = np.isin(times, window)
        change = np.gradient(velocities[rows, bob], window, axis=0)
        angle = 0.5 * (motion.theta[rows, bob] + motion.theta[rows, bob + 1])
        across = change[:, 0] * np.cos(angle) + change[:, 1] * np.sin(angle)
        values = across / (chain.gravity * math.sin(amplitude))
        height = math.sqrt((n - bob - 0.5) / (n + 0.5))
        found.append(Return(n, amplitude, height, widest, AROUND, values))
    return found


def kept() -> list[Return]:
    """Return what the file has, by angle and x."""
    return [
        Return(int(n), float(a), float(x), float(tip), AROUND, np.array(values, float))
        for n, a, x, tip, *values in (row.values() for row in read_rows(FILE))
    ]


def kept_at(amplitude: float, x: float) -> Return:
    """Return what the file has of a release from `amplitude`, at the bob nearest to `x`."""
    some = [one for one in kept() if abs(one.amplitude - amplitude) < 1e-3]
    return min(some, key=lambda one: abs(one.x - x))


def rows(n: int, amplitude: float) -> Iterator[dict[str, object]]:
    """Yield the row of each of `PLACES`."""
    for one in measured(n, amplitude):
        yield {
            "n": one.n, "angle_rad": f"{one.amplitude:.6g}", "x": f"{one.x:.6f}",
            "tip_rad": f"{one.tip:.4f}",
            **{f"{at:g}": f"{value:.4f}" for at, value in zip(AROUND, one.values, strict=True)},
        }  # fmt: skip


if __name__ == "__main__":
    write_rows(__doc__, FILE, RUNS, rows, "RAD")
