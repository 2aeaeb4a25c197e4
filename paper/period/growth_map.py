"""How the growth of the period with the angle depends on the masses of a rope and on its start.

The law has a pendulum's growth, 16 b = 1. Here b is that of the third order. There are `RODS` equal
rods; the masses of the bobs are a power of their height above the free end, with a mass at the tip
besides. The angle of a start is the angle of the line from the pivot to the centre of mass: the
pendulum that the centre of mass resembles has it.

`python -m paper.period.growth_map` writes `growth_map.csv` beside this file, in some two minutes.
`python -m paper.period.growth_map out.csv 30:0.5` has 30 rods and half their mass at the tip.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import Chain
from npend_gym.theory import normal_modes
from npend_gym.tools import FloatArray, vector
from paper.period.files import read_rows, write_rows
from paper.third_order import amplitude_growth

FILE = Path(__file__).with_name("growth_map.csv")
RODS = 30
TIPS: FloatArray = np.linspace(0.0, 1.0, 26)  # over the mass of the other bobs
POWERS: FloatArray = np.linspace(-0.8, 2.0, 15)  # of the height
BENDS: FloatArray = np.linspace(-1.0, 1.0, 17)  # see `bent`


def profile(power: float, tip: float, rods: int = RODS) -> Chain:
    """Return a chain with masses like height^`power`, and `tip` times their sum at the last bob."""
    height: FloatArray = (np.arange(rods, 0.0, -1.0) - 0.5) / (rods + 0.5)
    masses: FloatArray = height**power
    masses /= masses.sum()
    masses[-1] += tip
    return Chain(masses, np.ones(rods))


def bent(rods: int, bend: float) -> FloatArray:
    """Return angles that change along the chain by `bend` times the angle of its middle."""
    down: FloatArray = (np.arange(rods) + 0.5) / rods
    return 1.0 + bend * (down - 0.5)


def slowest(chain: Chain) -> FloatArray:
    """Return the angles of the slowest mode."""
    return normal_modes(chain)[1][:, 0]


def growth(chain: Chain, shape: ArrayLike = 1.0) -> float:
    """Return 16 b of a start with angles like `shape`, straight if left out."""
    start = vector("shape", shape, chain.n)
    middle = chain.lift @ start / chain.lift.sum()  # the angle of the centre of mass
    return 16.0 * amplitude_growth(chain, start / middle).com


def rows(rods: int, tip: float) -> Iterator[dict[str, Any]]:
    """Yield the rows of a mass at the tip: start, power, bend, mass at the tip, and 16 b."""
    for power in POWERS.tolist():
        chain = profile(power, tip, rods)
        yield _row("straight", tip, power, 0.0, growth(chain))
        yield _row("slowest mode", tip, power, 0.0, growth(chain, slowest(chain)))
    chain = profile(0.0, tip, rods)
    for bend in BENDS.tolist():
        yield _row("bent", tip, 0.0, bend, growth(chain, bent(rods, bend)))


def _row(name: str, tip: float, power: float, bend: float, found: float) -> dict[str, Any]:
    return {
        "start": name, "power": f"{power:g}", "bend": f"{bend:g}", "tip": f"{tip:g}",
        "growth": f"{found:.3f}",
    }  # fmt: skip


def kept(name: str) -> FloatArray:
    """Return the 16 b of the start `name` in the file: tips in rows, powers or bends in columns."""
    found = [float(row["growth"]) for row in read_rows(FILE) if row["start"] == name]
    return np.array(found).reshape(TIPS.size, -1)


if __name__ == "__main__":
    write_rows(__doc__, FILE, ((RODS, tip) for tip in TIPS.tolist()), rows, "MASS")
