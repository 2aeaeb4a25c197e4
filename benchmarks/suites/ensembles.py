"""Many double pendulums for 10 s, each with steps of its own, beside SciPy and heyoka.

SciPy calls the package's own compiled right side; of its loop a few motions are timed. heyoka has
an ensemble, one integrator copied for each start, and equations that it compiles itself. Errors are
those of the energy, as a share of the lifting energy; heyoka's tolerance is the one whose error is
nearest from below to ours.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from importlib import import_module
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from npend_gym import Chain
from npend_gym.chaos import flip_times
from npend_gym.physics import right_hand_side, simulate, total_energy
from npend_gym.tools import FloatArray
from suites.chaos import heyoka_equations
from suites.timing import Peers, Row, timed

DURATION = 10.0  # s
RTOL = 1e-9
LOOP = 20  # motions of SciPy's loop that are timed
_TOLERANCES = (1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11)  # of the peers


def rows(peers: Peers, motions: int = 10_000, side: int = 1000) -> Iterator[Row]:
    """Yield one comparison after another; rates are motions per second."""
    chain = Chain.uniform(2)
    starts = np.random.default_rng(0).uniform(-3.0, 3.0, (motions, 2))
    settings: dict[str, float] = {"rtol": RTOL, "atol": 0.01 * RTOL}
    ends = [0.0, DURATION]
    simulate(chain, starts[:32], 0.0, ends, **settings)  # compiles
    ours, took = timed(lambda: simulate(chain, starts, 0.0, ends, **settings))
    error = _error(chain, starts, ours.theta[:, -1], ours.omega[:, -1])
    job = f"{motions} double pendulums, {DURATION:g} s"
    loop = _scipy_rate(chain, starts[:LOOP])
    note = f"largest error of the energy {error:.0e}, SciPy at rtol {RTOL:g} too"
    yield Row(job, "scipy.integrate.solve_ivp, DOP853, in a loop", motions / took, loop, note)
    found = peers.get("heyoka", lambda: _heyoka(chain, starts, error))
    if found is not None:
        rate, theirs, tolerance = found
        note = f"largest error of the energy {error:.0e}, heyoka {theirs:.0e} at tol {tolerance:g}"
        yield Row(job, "heyoka, ensemble", motions / took, rate, note)
    angles = (np.arange(side) + 0.5) / side * 2.0 * np.pi - np.pi
    grid = np.stack(np.meshgrid(angles, angles), axis=-1)
    flip_times(chain, grid[:4, :4], duration=1.0)
    times, took = timed(lambda: flip_times(chain, grid, duration=DURATION))
    note = f"{took:.0f} s of processor time; {np.isfinite(times).mean():.0%} turn over"
    yield Row(f"map of flips, {side} x {side}, {DURATION:g} s", "", side**2 / took, math.nan, note)


def _error(chain: Chain, starts: FloatArray, theta: FloatArray, omega: FloatArray) -> float:
    """Return the largest error of the energy, by the lifting energy."""
    before = total_energy(chain, starts, np.zeros_like(starts))
    after = total_energy(chain, theta, omega)
    return float(np.abs(after - before).max() / chain.lifting_energy)


def _scipy_rate(chain: Chain, starts: FloatArray) -> float:
    """Return motions per second, with the package's compiled right side."""
    right_side = right_hand_side(chain)
    right_side(0.0, np.zeros(4))
    begin = time.process_time()
    for start in starts:
        solve_ivp(
            right_side, (0.0, DURATION), [*start, 0.0, 0.0], method="DOP853", rtol=RTOL,
            atol=0.01 * RTOL,
        )  # fmt: skip
    return len(starts) / (time.process_time() - begin)


def _heyoka(chain: Chain, starts: FloatArray, error: float) -> tuple[float, float, float]:
    """Return motions per second, the error of the energy, and the tolerance that gives it."""
    hy: Any = import_module("heyoka")
    for tolerance in _TOLERANCES:
        integrator = hy.taylor_adaptive(
            heyoka_equations(hy, chain.gravity), [0.0] * 4, tol=tolerance
        )

        def begin_at(copy: Any, k: int) -> Any:
            copy.time = 0.0
            copy.state[:] = [*starts[k], 0.0, 0.0]
            return copy

        begin = time.process_time()
        done = hy.ensemble_propagate_until(integrator, DURATION, len(starts), begin_at)
        took = time.process_time() - begin
        states = np.array([each[0].state for each in done])
        theirs = _error(chain, starts, states[:, :2], states[:, 2:])
        if theirs <= error:
            break
    return len(starts) / took, theirs, tolerance
