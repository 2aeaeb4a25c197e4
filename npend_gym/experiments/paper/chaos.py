"""Chaos: Lyapunov exponents by tangent dynamics, eigenvalues at rest, volume in phase space."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np

from npend_gym import theory
from npend_gym._checks import FloatArray
from npend_gym.chain import Chain
from npend_gym.experiments.paper.finding import Finding, Verdict
from npend_gym.experiments.paper.fits import exponent, show
from npend_gym.experiments.paper.formula import uneven_chains
from npend_gym.physics import linearise, simulate

ANGLES = (0.1, math.pi / 4, 1.2, 1.5, 2.0)  # rad, from which two rods are released
# Number of rods -> periods of the slowest mode for which their motion is followed
FROM_QUARTER = {1: 150, 2: 400, 3: 2000, 5: 600, 10: 200, 20: 60}
FROM_TWO = {2: 400, 3: 200, 5: 60, 10: 15, 20: 12}
STEP = 0.1  # of the tangent equation, in radians of the fastest normal mode
_ENTRIES = 200_000  # of the matrices held at once: they stay in the processor's cache


@dataclass(frozen=True, eq=False)
class Growth:
    """How a small change of the start grows along a motion.

    Attributes
    ----------
    times : ndarray, shape (T,)
        Instants [s], the first being a step after the start.
    logarithm : ndarray, shape (T,)
        Logarithm of the length of the tangent vector, by that at the start.
    """

    times: FloatArray
    logarithm: FloatArray

    def exponent(self, until: float = 1.0) -> float:
        """Return the largest Lyapunov exponent [1/s] as estimated at the fraction `until`."""
        k = max(1, round(until * self.times.size)) - 1
        return float(self.logarithm[k] / self.times[k])

    @property
    def rate(self) -> float:
        """Mean rate of growth [1/s] over the second half: ln 2 / (T/2) if growth is linear."""
        half = self.times.size // 2
        span = self.times[-1] - self.times[half - 1]
        return float((self.logarithm[-1] - self.logarithm[half - 1]) / span)

    @property
    def bound(self) -> float:
        """Rate [1/s] below which this run cannot tell chaos from the linear growth of order.

        Linear growth, with swings of a factor of 30 on top, over the second half.
        """
        return math.log(2.0 * 30.0) / (0.5 * float(self.times[-1]))

    @property
    def chaotic(self) -> bool:
        """Whether the growth is faster than a regular motion's."""
        return self.rate > self.bound


def propagators(chain: Chain, theta: FloatArray, omega: FloatArray, step: float) -> FloatArray:
    """Return the matrices that carry tangent vectors over each step, shape (steps, 2n, 2n).

    The variational equation V' = A(t) V by RK4, with A from states half a step apart: `theta` and
    `omega` have shape (2 steps + 1, n).
    """
    a = linearise(chain, theta, omega).A
    start, middle, end = a[:-1:2], a[1::2], a[2::2]
    one = np.eye(2 * chain.n)
    k2 = middle @ (one + 0.5 * step * start)
    k3 = middle @ (one + 0.5 * step * k2)
    k4 = end @ (one + step * k3)
    return one + step / 6.0 * (start + 2.0 * (k2 + k3) + k4)


@cache
def growth(n: int, theta0: float, periods: float, length: float = 1.0) -> Growth:
    """Return the growth along the release of `n` equal rods from rest at `theta0` [rad].

    Followed for `periods` periods of the slowest mode. The motion comes from the error-controlled
    integrator; the tangent vector starts in a random direction, seeded.
    """
    chain = Chain.uniform(n, length=length)
    step = STEP / theory.fastest_frequency(chain)
    count = int(np.ceil(periods * theory.fundamental_period(chain) / step))
    vector = np.random.default_rng(n).normal(size=2 * n)
    vector /= np.linalg.norm(vector)
    logarithm = np.empty(count)
    theta, omega, total = np.full(n, theta0), np.zeros(n), 0.0
    chunk = min(1000, max(10, _ENTRIES // n**2))
    for first in range(0, count, chunk):
        steps = min(chunk, count - first)
        times = 0.5 * step * np.arange(2 * steps + 1)
        path = simulate(chain, theta, omega, times, rtol=1e-11, atol=1e-13)
        theta, omega = path.theta[-1], path.omega[-1]
        for k, matrix in enumerate(propagators(chain, path.theta, path.omega, step), first):
            vector = matrix @ vector
            size = float(np.linalg.norm(vector))
            vector /= size
            total += np.log(size)
            logarithm[k] = total
    return Growth(step * np.arange(1.0, count + 1.0), logarithm)


@cache
def runs_from(theta0: float) -> dict[int, Growth]:
    """Return the runs that the audit judges: from pi/4 or from 2 rad, by number of rods."""
    plan = FROM_QUARTER if theta0 == math.pi / 4 else FROM_TWO
    return {n: growth(n, theta0, periods) for n, periods in plan.items()}


def growth_rows(points: int = 200) -> list[dict[str, float]]:
    """Return the tidy table of the estimates, at about so many `points` of every run."""
    return [
        {"angle_rad": angle, "n": n, "time_s": float(run.times[k]),
         "exponent_so_far_per_s": float(run.logarithm[k] / run.times[k])}
        for angle in (math.pi / 4, 2.0)
        for n, run in runs_from(angle).items()
        for k in np.unique(np.geomspace(1, run.times.size, points).astype(np.int64)) - 1
    ]  # fmt: skip


def volume_change(chain: Chain, theta0: float = 1.0, duration: float = 2.0) -> float:
    """Return by how much volume in phase space changes along a release, relatively.

    The determinant of the flow's derivative in (theta, omega), times that of the mass matrix at
    the end by that at the start: the volume in angles and momenta.
    """
    steps = 8 * math.ceil(duration * theory.fastest_frequency(chain) / STEP)
    times = np.linspace(0.0, duration, 2 * steps + 1)
    path = simulate(chain, theta0, 0.5, times, rtol=1e-12, atol=1e-13)
    logarithm = _log_mass_determinant(chain, path.theta[-1])
    logarithm -= _log_mass_determinant(chain, path.theta[0])
    matrices = propagators(chain, path.theta, path.omega, duration / steps)
    return float(np.exp(logarithm + np.linalg.slogdet(matrices)[1].sum()) - 1.0)


def neighbour_growth(
    n: int, duration: float = 10.0, nudge: float = 1e-8, length: float = 1.0
) -> float:
    """Return how much a random change of the start by `nudge` [rad] grows at most.

    Within `duration` [s] after the paper's release of `n` rods of `length` [m]: the largest
    change of an angle, by the largest at the start.
    """
    change = np.random.default_rng(n).uniform(-nudge, nudge, n)
    times = np.linspace(0.0, duration, 201)
    paths = [
        simulate(Chain.uniform(n, length=length), start, 0.0, times, rtol=1e-13, atol=1e-14).theta
        for start in (np.full(n, math.pi / 4), math.pi / 4 + change)
    ]
    return float(np.max(np.abs(paths[1] - paths[0])) / np.max(np.abs(change)))


def _log_mass_determinant(chain: Chain, theta: FloatArray) -> float:
    mu = chain.carried_masses
    mass = np.minimum.outer(mu, mu) * np.cos(theta[:, None] - theta[None, :])
    return float(np.linalg.slogdet(mass)[1])


def findings() -> Iterator[Finding]:
    """Yield the findings about chaos; half a minute."""
    yield _attraction()
    by_angle = [growth(2, angle, 200) for angle in ANGLES]
    yield _with_energy(by_angle)
    two = runs_from(2.0)
    yield _no_solution(two[2])
    yield _with_n(runs_from(math.pi / 4), two)
    yield _within_the_window()


def _attraction() -> Finding:
    chain = uneven_chains()[0]
    real = float(np.max(np.abs(np.linalg.eigvals(linearise(chain, 0.0).A).real)))
    volume = abs(volume_change(chain))
    return Finding(
        "attracting-point", "text before Figure 2",
        "real parts of the eigenvalues below one make an attracting fixed point, as in Lorenz's "
        "system", "less than unity",
        f"real parts at rest: {real:.0e} 1/s; volume in phase space after 2 s changed by "
        f"{volume:.0e}",
        Verdict.of(real > 1e-6 or volume > 1e-6),
        "Without friction nothing attracts: the eigenvalues at rest are imaginary and volume is "
        "kept (Liouville), while Lorenz's system contracts it. A flow needs real parts below "
        "zero to attract; below one is the rule for maps.",
    )  # fmt: skip


def _with_energy(runs: list[Growth]) -> Finding:
    chaotic = [run.chaotic for run in runs]
    return Finding(
        "chaos-energy", "text before Figure 2",
        "small oscillations are regular, chaos comes with energy", "-",
        f"N = 2 from {show(ANGLES)} rad: largest exponents "
        f"{show((run.rate for run in runs), 2)} 1/s, told from zero above {runs[0].bound:.3f}",
        Verdict.of(chaotic == sorted(chaotic) and not chaotic[0] and chaotic[-1]),
        "Tangent dynamics over 200 periods of the slowest mode, rate over the second half.",
    )  # fmt: skip


def _no_solution(run: Growth) -> Finding:
    return Finding(
        "no-solution", "text after Eq. (17)", "the equations have no analytic solution", "-",
        f"N = 2 from 2 rad: largest exponent {run.rate:.2f} 1/s",
        Verdict.of(run.rate < run.bound, Verdict.CORRECTED),
        "Chaos rules out the conserved quantities that a closed solution needs, for N >= 2. "
        "One pendulum has its solution, see `elliptic`.",
    )  # fmt: skip


def _with_n(quarter: dict[int, Growth], two: dict[int, Growth]) -> Finding:
    counts = np.array(list(two), float)
    rates = np.array([run.rate for run in two.values()])
    regular = [str(n) for n, run in quarter.items() if not run.chaotic]
    shown = ", ".join(
        f"{n}: {run.exponent(0.25):.2g} -> {run.exponent(0.5):.2g} -> {run.exponent():.2g}"
        for n, run in quarter.items()
    )
    return Finding(
        "chaos-n", "text", "the system becomes exponentially unstable as N increases", "-",
        f"largest exponents [1/s] from 2 rad: {show(rates, 2)} for N = {', '.join(map(str, two))}, "
        f"as N^{exponent(counts, rates):.2f}; from pi/4, estimates after a quarter, half and all "
        f"of the run: {shown}; not told from regular: N = {', '.join(regular)}",
        Verdict.of(bool(np.all(np.diff(rates) > 0.0)), Verdict.FAILS)
        if len(regular) == 0 else Verdict.CORRECTED,
        "Chaos grows with N, as a power of it. From the paper's angle few rods move regularly or "
        "nearly so, and long chains do for a while: their estimates rise along the run, and are "
        "lower bounds. The rates of chaotic runs scatter by some 10 %.",
    )  # fmt: skip


def _within_the_window() -> Finding:
    counts = (5, 20, 100)
    factors = [neighbour_growth(n) for n in counts]
    return Finding(
        "chaos-errors", "text after Table 3",
        "beats and chaos of many pendulums make the errors of Tables 1-3 large", "0.376",
        f"a change of the start grows {show(factors, 2)}-fold within the paper's 10 s, for N = "
        f"{', '.join(map(str, counts))} on rods of 1 m",
        Verdict.of(max(factors) > 1e6),
        "Rounding and truncation, 1e-7 rad, stay invisible. Beats, moreover, are regular: sums of "
        "normal modes.",
    )  # fmt: skip
