"""How long a release stays in the slowest mode, against time, from the paper's 45 degrees.

`python -m paper.period.modes` follows four releases each of 2 to 20 rods, in some five minutes, and
writes `modes.csv` beside this file. It has, for each release, the mean share of the slowest mode in
the energy over the windows T/32 to T/16, ..., T/2 to T. It also says when this is below one half.
`python -m paper.period.modes out.csv 2:640 10:320` follows two rods for 640 s and ten for 320 s.
"""

from pathlib import Path

import numpy as np

from npend_gym import Chain, simulate
from npend_gym.experiments import PAPER_AMPLITUDE
from npend_gym.theory import normal_modes
from npend_gym.tools import FloatArray
from paper.period.files import write_rows
from paper.period.growth import APART, STARTS, WINDOWS

FILE = Path(__file__).with_name("modes.csv")
RUNS = {2: 16_000, 5: 16_000, 6: 16_000, 8: 16_000, 10: 16_000, 20: 8_000}
POINTS = 8192  # instants of each run
MEAN = 64  # of them, over which the share is averaged before it is compared with one half
_RTOL = 1e-10


def shares(chain: Chain, theta: FloatArray, omega: FloatArray) -> FloatArray:
    """Return the share of each normal mode in the energy, shape (T, n).

    The modes are those of small angles. The sines of the angles stand for the angles, and their
    rates for the angular velocities: a rod that has turned over once is where it was.
    """
    frequencies, modes = normal_modes(chain)
    weight = chain.lift @ modes**2
    q = (np.sin(theta) * chain.lift) @ modes
    rate = (np.cos(theta) * omega * chain.lift) @ modes
    energy: FloatArray = (q**2 + (rate / frequencies) ** 2) / weight
    return energy / energy.sum(axis=1, keepdims=True)


def row(n: int, seconds: float, offset: float) -> dict[str, object]:
    """Return the row of a release of n equal rods from pi/4 + `offset` [rad]."""
    chain = Chain.uniform(n)
    times = np.linspace(0.0, seconds, POINTS + 1)
    motion = simulate(chain, PAPER_AMPLITUDE + offset, 0.0, times, rtol=_RTOL, atol=1e-2 * _RTOL)
    share = shares(chain, motion.theta, motion.omega)
    windows = [share[POINTS >> k : POINTS >> (k - 1), 0].mean() for k in range(WINDOWS, 0, -1)]
    below = np.flatnonzero(np.convolve(share[:, 0], np.full(MEAN, 1.0 / MEAN), "valid") < 0.5)
    last = share[-POINTS // 8 :].mean(axis=0)
    return {
        "n": n, "seconds": f"{seconds:g}", "offset_rad": f"{offset:g}",
        **{f"share_{k + 1}": f"{one:.3f}" for k, one in enumerate(windows)},
        "below_half_s": f"{times[below[0] + MEAN // 2]:.0f}" if below.size else "",
        "lowest_last": f"{last.min():.3f}", "highest_last": f"{last.max():.3f}",
    }  # fmt: skip


if __name__ == "__main__":
    starts = APART * np.arange(STARTS)
    write_rows(__doc__, FILE, RUNS.items(), lambda n, t: (row(n, t, a) for a in starts), "SECONDS")
