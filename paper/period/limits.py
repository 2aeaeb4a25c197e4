"""How far the law of the centre of mass holds for heavy links, other starts, and other chains."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from npend_gym import Chain, pseudo_periods, theory
from npend_gym.experiments import PAPER_AMPLITUDE
from npend_gym.theory import normal_modes
from npend_gym.tools import FloatArray
from paper.third_order import amplitude_growth

RODS = 20
SMALL = 1e-3  # rad: the greatest angle from which the limit of small angles is measured
RANDOM_N, CHAINS = (2, 3, 5, 10, 20), 40
ANGLES = (0.5, PAPER_AMPLITUDE, 1.0)  # rad


def measured(chain: Chain, theta: FloatArray | float) -> float:
    """Return the pseudo-period [s] of the centre of mass after a release from rest at `theta`."""
    return float(pseudo_periods(chain, theta, definition="com", rtol=1e-10)[0])


def starts() -> dict[str, FloatArray]:
    """Return the shapes of some starts of 20 rods: the angle of each rod over the greatest."""
    down: FloatArray = (np.arange(RODS) + 0.5) / RODS  # of the middle of each rod
    shapes = {
        "straight": np.ones(RODS),
        "the slowest mode": normal_modes(Chain.uniform(RODS))[1][:, 0],
        "from a/2 at the pivot to a at the tip": 1.0 + down,
        "from a at the pivot to a/2 at the tip": 2.0 - down,
        "lower half at a, upper half at rest": np.where(down > 0.5, 1.0, 0.0),
    }
    return {name: shape / shape.max() for name, shape in shapes.items()}


def start_errors(shape: FloatArray, angles: tuple[float, ...] = ANGLES[1:]) -> FloatArray:
    """Return the error [%] of the pendulum's factor for a start that is not straight.

    The period at small angles, of this start, times the factor of the greatest angle, over the
    measured period, less one.
    """
    chain = Chain.uniform(RODS)
    limit = measured(chain, SMALL * shape)
    law = limit * theory.pendulum_factor(angles)
    periods = [measured(chain, a * shape) for a in angles]
    return 100.0 * (law / np.array(periods) - 1.0)


def chain_errors(chain: Chain) -> FloatArray:
    """Return the error of `theory.com_period`, over the measured period [%], at `ANGLES`."""
    return np.array(
        [100.0 * (float(theory.com_period(chain, a)) / measured(chain, a) - 1.0) for a in ANGLES]
    )


def random_chains(n: int) -> Iterator[Chain]:
    """Return 40 chains of `n` rods; masses and lengths are drawn between 0.5 and 2."""
    rng = np.random.default_rng(n)
    return (Chain(*rng.uniform(0.5, 2.0, (2, n))) for _ in range(CHAINS))


def random_errors(n: int) -> tuple[FloatArray, FloatArray]:
    """Return the median and the largest absolute errors [%] of those chains, at `ANGLES`."""
    errors = np.abs([chain_errors(chain) for chain in random_chains(n)])
    return np.median(errors, axis=0), errors.max(axis=0)


def links(n: int) -> Chain:
    """Return `n` uniform rods of 1 m and 1 kg, which carry no bobs."""
    return Chain.rods(np.ones(n), np.ones(n))


def links_constant(n: int) -> float:
    """Return the small-angle period of the centre of mass of `n` links, over 2 pi sqrt(L/g)."""
    return float(theory.com_period(links(n))) / theory.single_period(float(n))


def links_error(n: int, angles: tuple[float, ...]) -> float:
    """Return the largest error of the rope's law for `n` links, over the measured period [%]."""
    law = theory.large_n_com_period(n, angles, n / (n + 0.5))  # links of n metres, as a rope
    errors = law / [measured(links(n), a) for a in angles] - 1.0
    return 100.0 * float(np.abs(errors).max())


def tip_growth(n: int, tip: float) -> float:
    """Return b [1/rad^2] of `n` equal rods and bobs with `tip` times their mass at the last bob."""
    masses: FloatArray = np.ones(n)
    masses[-1] += n * tip
    return amplitude_growth(Chain(masses, np.ones(n))).com
