"""The data of the paper's figures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.experiments.law import Law, Scan, fit_law, scan
from npend_gym.experiments.paper import KANE_N
from npend_gym.experiments.paper.chaos import Growth, runs_from
from npend_gym.experiments.paper.fits import exponent
from npend_gym.experiments.paper.grid import AMPLITUDES, grid
from npend_gym.experiments.paper.integrators import STEPS, runge_kutta_errors
from npend_gym.experiments.paper.kane import OUR_COUNTS, kane_costs, our_seconds
from npend_gym.experiments.paper.measured import bob_periods, fundamental_periods, ideal_periods
from npend_gym.experiments.paper.periods import listing_bars
from npend_gym.experiments.release import PAPER_AMPLITUDE, PAPER_N
from npend_gym.period import LISTING_DURATION
from npend_gym.physics import Trajectory, simulate

SHORT_ROD = 1.0 / 3.0  # m, each of three in the paper's listing


@dataclass(frozen=True, eq=False)
class Series:
    """One of Figures 4-7: pseudo-periods of chains 1..N in three trials, with the model.

    Attributes
    ----------
    counts : ndarray, shape (N,)
        Numbers of pendulums, 1..N.
    starts : ndarray, shape (3,)
        Starting angle of each trial [rad].
    measured : ndarray, shape (3, N)
        Mean over the bobs [s], reading "bob", rods of 1 m.
    ideal, fundamental : ndarray, shape (N,)
        The paper's T0 and the period of the slowest mode [s].
    bars : ndarray, shape (N,)
        The paper's error bars [s], to either side of T0.
    """

    counts: NDArray[np.int64]
    starts: FloatArray
    measured: FloatArray
    ideal: FloatArray
    fundamental: FloatArray
    bars: FloatArray

    def outside(self, fraction: float) -> int:
        """Return how many points are further from T0 than `fraction` of it."""
        return int((np.abs(self.measured - self.ideal) > fraction * self.ideal).sum())


def series(n: int) -> Series:
    """Return the data of the figure for `n`, one of 5, 10, 20, 100."""
    starts = AMPLITUDES[:, PAPER_N.index(n)]
    counts = np.arange(1, n + 1)
    measured = np.array(
        [
            [float(bob_periods(k, a, "bob", "1 m").mean()) for k in counts.tolist()]
            for a in starts.tolist()
        ]
    )
    ideal, fundamental = ideal_periods(n)[1:], fundamental_periods(n)[1:]
    return Series(counts, starts, measured, ideal, fundamental, listing_bars() * ideal)


@dataclass(frozen=True, eq=False)
class Figure2:
    """The trajectory of three pendulums, and how far a start beside it drifts away.

    Attributes
    ----------
    motion : Trajectory
        Ten seconds, as many as the paper shows.
    times, growth : ndarray, shape (T,)
        Instants [s], and the greatest distance so far from a motion started beside it, over the
        distance at the start.
    """

    motion: Trajectory
    times: FloatArray
    growth: FloatArray

    @property
    def exponent(self) -> float:
        """Slope of ln growth against ln time, without the start: 1 for a regular motion."""
        late = self.times > 0.05 * self.times[-1]
        return exponent(self.times[late], self.growth[late])


@cache
def figure2(length: float = SHORT_ROD, duration: float = 200.0, nudge: float = 1e-8) -> Figure2:
    """Return the data of Figure 2: three rods of `length` [m] released at pi/4.

    `duration` [s] is how long the neighbour, whose first rod starts `nudge` [rad] off, is followed.
    """
    chain = Chain.uniform(3, length=length)
    shown = simulate(chain, PAPER_AMPLITUDE, 0.0, np.linspace(0.0, LISTING_DURATION, 1001))
    times = np.linspace(0.0, duration, max(2, round(20 * duration)))
    near = PAPER_AMPLITUDE + nudge * np.array([1.0, 0.0, 0.0])
    paths = [
        simulate(chain, start, 0.0, times, rtol=1e-13, atol=1e-14).theta
        for start in (PAPER_AMPLITUDE, near)
    ]
    growth = np.abs(paths[1] - paths[0]).max(axis=1) / nudge
    return Figure2(shown, times[1:], np.maximum.accumulate(growth)[1:])


def law() -> tuple[Scan, Law]:
    """Return the pseudo-periods over N and angle, and the law fitted to them."""
    data = scan()
    return data, fit_law(data)


def kane_cost(
    largest: int = KANE_N,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return numbers of rods and seconds: of Kane's derivation, and of our dynamics."""
    costs = kane_costs(largest)
    ours = np.array(OUR_COUNTS, float), our_seconds()
    return np.array([c.n for c in costs], float), np.array([c.seconds for c in costs]), *ours


def lyapunov() -> dict[str, dict[int, Growth]]:
    """Return the growth of a small change along releases from the paper's angle and a larger."""
    return {"45°": runs_from(PAPER_AMPLITUDE), "2 rad": runs_from(2.0)}


# The data of every figure by its name. What the findings have measured is not measured again.
SOURCES: dict[str, Callable[[], Any]] = {
    "trajectory": figure2,
    "pseudo_periods": lambda: [series(n) for n in PAPER_N],
    "readings": grid,
    "law_against_n": law,
    "law_against_angle": law,
    "runge_kutta": lambda: (STEPS, *runge_kutta_errors()),
    "kane_cost": kane_cost,
    "lyapunov": lyapunov,
}
