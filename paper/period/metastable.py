"""How long a released chain moves regularly before it becomes chaotic, from the paper's 45 degrees.

`python -m paper.period.metastable` follows chains of 2 to 20 rods for hours of their time, in some
20 minutes, and writes `lyapunov.csv` beside this file. `python -m paper.period.metastable out.csv
2:100 10:50:1e-9` follows two rods for 100 s, and ten that start 1e-9 rad higher for 50 s.
"""

import csv
import math
import sys
from pathlib import Path

import numpy as np

from npend_gym import Chain
from npend_gym.chaos import Growth, tangents

RUNS = (  # rods, seconds, and how far the start is from pi/4 [rad]
    (2, 300_000, 0.0), (3, 50_000, 0.0), (4, 50_000, 0.0), (5, 50_000, 0.0), (6, 20_000, 0.0),
    (7, 20_000, 0.0), (8, 20_000, 0.0), (10, 10_000, 0.0), (10, 10_000, 1e-9), (10, 10_000, 2e-9),
    (10, 10_000, 3e-9), (12, 8_000, 0.0), (15, 5_000, 0.0), (20, 5_000, 0.0), (20, 4_000, 1e-9),
    (20, 4_000, 2e-9), (20, 4_000, 3e-9),
)  # fmt: skip
POINTS = 4000  # instants of each run


def follow(n: int, seconds: float, offset: float) -> Growth:
    """Return how a small change grows along the release of n equal rods."""
    vectors = np.random.default_rng(n).normal(size=(1, 2 * n))
    vectors /= np.linalg.norm(vectors)
    times, logarithm, total = np.linspace(0.0, seconds, POINTS + 1), np.zeros(POINTS + 1), 0.0
    start = math.pi / 4 + offset
    for span, frames in tangents(Chain.uniform(n), start, 0.0, times, vectors):
        logarithm[span] = total + np.log(np.linalg.norm(frames[:, 0], axis=1))
        size = np.linalg.norm(vectors)
        total += float(np.log(size))
        vectors /= size
    return Growth(times[1:], logarithm[1:])


def summary(n: int, offset: float, run: Growth) -> dict[str, object]:
    """Return a row of the table: the exponent, or when fast growth begins and its exponent."""
    onset = run.onset()
    return {
        "n": n, "offset_rad": offset, "seconds": round(float(run.times[-1])),
        "exponent_of_the_second_half_per_s": f"{run.rate:.3g}",
        "resolved_above_per_s": f"{run.bound:.2g}",
        "onset_s": "" if onset is None else round(onset),
        "exponent_after_onset_per_s": "" if onset is None else f"{run.rate_after(onset):.3g}",
    }  # fmt: skip


if __name__ == "__main__":
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("lyapunov.csv")
    asked = [tuple(map(float, one.split(":"))) for one in sys.argv[2:]] or RUNS
    with out.open("w", newline="", encoding="utf-8") as file:
        table = None
        for n, seconds, *rest in asked:
            offset = rest[0] if rest else 0.0
            row = summary(int(n), offset, follow(int(n), seconds, offset))
            if table is None:
                table = csv.DictWriter(file, list(row), lineterminator="\n")
                table.writeheader()
            table.writerow(row)
            file.flush()
            print(row, flush=True)
