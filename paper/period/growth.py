"""How fast a small change of a release grows, against time, from the paper's 45 degrees.

`python -m paper.period.growth` follows four releases each of 2 to 20 rods, in some four minutes,
and writes `growth.csv` beside this file: for each number of rods, the mean rate over the windows
T/32 to T/16, ..., T/2 to T of the runs. `python -m paper.period.growth out.csv 2:640 10:320`
follows two rods for 640 s and ten for 320 s.
"""

import math
from pathlib import Path

import numpy as np

from npend_gym import Chain
from npend_gym.chaos import tangents
from npend_gym.experiments import PAPER_AMPLITUDE
from npend_gym.tools import FloatArray
from paper.period.files import write_rows

FILE = Path(__file__).with_name("growth.csv")
RUNS = {2: 32_000, 3: 32_000, 4: 16_000, 5: 16_000, 6: 16_000, 8: 16_000, 10: 8_000, 20: 4_000}
STARTS, APART = 4, 1e-4  # releases for each number of rods, and between their angles [rad]
WINDOWS = 5  # each twice as long as the one before
POINTS = 32 * 64  # instants of each run


def logarithm(n: int, seconds: float, offset: float) -> FloatArray:
    """Return ln of the length of a tangent vector at `POINTS` + 1 instants, 0 at the first.

    Tangents are carried along the release of n equal rods from pi/4 + `offset` [rad].
    """
    vectors = np.random.default_rng(n).normal(size=(1, 2 * n))
    vectors /= np.linalg.norm(vectors)
    times, found, total = np.linspace(0.0, seconds, POINTS + 1), np.zeros(POINTS + 1), 0.0
    for span, frames in tangents(Chain.uniform(n), PAPER_AMPLITUDE + offset, 0.0, times, vectors):
        found[span] = total + np.log(np.linalg.norm(frames[:, 0], axis=1))
        size = np.linalg.norm(vectors)
        total += float(np.log(size))
        vectors /= size
    return found


def rows(n: int, seconds: float) -> list[dict[str, object]]:
    """Return a row for each window: mean rate over the starts, its standard error, its range.

    `linear_per_s` is the mean rate in the window of a motion in which changes grow like time.
    """
    runs = np.array([logarithm(n, seconds, APART * k) for k in range(STARTS)])
    found: list[dict[str, object]] = []
    for k in range(WINDOWS, 0, -1):
        first, last = POINTS >> k, POINTS >> (k - 1)
        span = seconds * (last - first) / POINTS
        rates = (runs[:, last] - runs[:, first]) / span
        found.append({
            "n": n, "from_s": f"{seconds * first / POINTS:g}",
            "to_s": f"{seconds * last / POINTS:g}", "rate_per_s": f"{rates.mean():.2g}",
            "standard_error_per_s": f"{rates.std(ddof=1) / math.sqrt(STARTS):.1g}",
            "lowest_per_s": f"{rates.min():.2g}", "highest_per_s": f"{rates.max():.2g}",
            "linear_per_s": f"{math.log(2.0) / span:.1g}",
        })  # fmt: skip
    return found


if __name__ == "__main__":
    write_rows(__doc__, FILE, RUNS.items(), rows, "SECONDS")
