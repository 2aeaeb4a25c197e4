"""Chaos: exponents beside heyoka's variational equations, and what the symmetry of the flow says.

heyoka compiles the equations itself, so they are written a second time here, for two rods of 1 m
with bobs of 1 kg.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np
from scipy.integrate import simpson

from npend_gym import Chain, theory
from npend_gym.chaos import largest_lyapunov, lyapunov_spectrum, periodic_orbits, tangents
from npend_gym.physics import mass_matrix, simulate
from npend_gym.tools import FloatArray
from suites.timing import Peers, Row, timed

ANGLE = 2.0  # rad, of both rods at the start
DURATION = 20_000.0  # s: the exponent is known to half a percent
TOGETHER = 10.0  # s, within which two integrators agree on a chaotic motion
RENORMALISED = 1.0  # s, after which the vectors of the peer are
AMPLITUDES = (math.pi / 4, 2.0)  # rad, of the nonlinear normal modes

Flow = Callable[[float, float], FloatArray]  # derivative of the state at the end by that before


def rows(peers: Peers, duration: float = DURATION, rods: int = 5) -> Iterator[Row]:
    """Yield one comparison after another; rates are seconds of motion per second."""
    chain = Chain.uniform(2)
    ours, took = timed(partial(largest_lyapunov, chain, ANGLE, duration=duration))
    found = peers.get("heyoka", partial(_peer, chain, duration))
    note, rate = f"{ours.exponent:.4f} +- {ours.error:.4f} 1/s", math.nan
    if found is not None:
        exponent, seconds, difference = found
        rate = duration / seconds
        note += (
            f", heyoka {exponent:.4f}: {abs(exponent / ours.exponent - 1.0):.1%} apart; over "
            f"{TOGETHER:g} s the derivatives differ by {difference:.0e}"
        )
    peer = "" if found is None else "heyoka, variational equations"
    yield Row("largest exponent, N = 2, 2 rad", peer, duration / took, rate, note)
    for n in (2, rods):
        yield _spectrum(Chain.uniform(n), 0.01 * duration, f"all exponents, N = {n}, 2 rad")
    yield _spectrum(Chain.uniform(2, damping=0.05), 0.001 * duration, "the same, N = 2, damped")
    for n in range(2, rods + 1):
        orbits, took = timed(partial(_orbits, n))
        note = f"pi/4 and 2 rad, closed to {max(orbit.closure for orbit in orbits):.0e}"
        yield Row(f"nonlinear normal modes, N = {n}", "", len(orbits) / took, math.nan, note)


def _spectrum(chain: Chain, duration: float, job: str) -> Row:
    """Return the row of a spectrum, with how far it is from what the flow's divergence says."""
    spectrum, took = timed(partial(lyapunov_spectrum, chain, ANGLE, duration=duration))
    exponents, above = spectrum.exponents, chain.damping
    if np.any(above):
        below = np.append(above[1:], 0.0)
        torques = np.diag(above + below) - np.diag(above[1:], 1) - np.diag(above[1:], -1)
        times = np.linspace(0.0, duration, round(1000 * duration) + 1)
        theta = simulate(chain, ANGLE, 0.0, times, rtol=1e-12, atol=1e-14).theta
        rates = np.einsum("tij,ji->t", np.linalg.inv(mass_matrix(chain, theta)), torques)
        mean = -float(simpson(rates, x=times)) / duration
        note = f"sum less the mean divergence: {abs(exponents.sum() - mean):.0e} 1/s"
    else:
        pairs = np.abs(exponents + exponents[::-1]).max()
        note = f"sum {abs(exponents.sum()):.0e} 1/s, pairs {pairs:.0e} 1/s"
    return Row(job, "", duration / took, math.nan, note)


def _orbits(n: int) -> list[Any]:
    chain = Chain.uniform(n)
    return [
        orbit for mode in range(n) for orbit in periodic_orbits(chain, mode, amplitudes=AMPLITUDES)
    ]


def _peer(chain: Chain, duration: float) -> tuple[float, float, float]:
    """Return heyoka's exponent, its time, and how far the derivatives over `TOGETHER` differ."""
    flow = _heyoka_flow(chain.gravity)
    ours = np.eye(4)
    for _ in tangents(chain, ANGLE, 0.0, [0.0, TOGETHER], ours):
        pass
    theirs = flow(0.0, TOGETHER).T
    difference = float(np.abs(ours - theirs).max() / np.abs(theirs).max())
    scale = np.repeat([1.0, 1.0 / theory.fastest_frequency(chain)], 2)
    vector, total, ends = np.ones(4) / scale, 0.0, np.arange(0.0, duration, RENORMALISED)
    begin, settled = time.process_time(), 0.0
    for k, since in enumerate(ends):
        vector = flow(since, since + RENORMALISED) @ vector
        size = float(np.linalg.norm(vector * scale))
        total, vector = total + math.log(size), vector / size
        if k == ends.size // 10:  # as in `largest_lyapunov`
            settled = total
    span = RENORMALISED * (ends.size - 1 - ends.size // 10)
    return (total - settled) / span, time.process_time() - begin, difference


def heyoka_equations(hy: Any, gravity: float) -> list[tuple[Any, Any]]:
    """Return the equations of two equal rods of 1 m, as heyoka takes them."""
    x1, x2, w1, w2 = hy.make_vars("x1", "x2", "w1", "w2")
    s, c = hy.sin(x1 - x2), hy.cos(x1 - x2)
    # 2 a1 + c a2 = -s w2^2 - 2 g sin x1,  c a1 + a2 = s w1^2 - g sin x2
    upper = -s * w2 * w2 - 2.0 * gravity * hy.sin(x1)
    lower = s * w1 * w1 - gravity * hy.sin(x2)
    determinant = 2.0 - c * c
    rates = (upper - c * lower) / determinant, (2.0 * lower - c * upper) / determinant
    return [(x1, w1), (x2, w2), (w1, rates[0]), (w2, rates[1])]


def _heyoka_flow(gravity: float) -> Flow:
    """Return the derivative of the flow along the motion from `ANGLE`, by Taylor's method."""
    hy: Any = import_module("heyoka")
    system = hy.var_ode_sys(heyoka_equations(hy, gravity), hy.var_args.vars, order=1)
    integrator = hy.taylor_adaptive(system, [ANGLE, ANGLE, 0.0, 0.0])

    def flow(since: float, until: float) -> FloatArray:
        if since == 0.0:
            integrator.time, integrator.state[:4] = 0.0, (ANGLE, ANGLE, 0.0, 0.0)
        integrator.state[4:] = np.eye(4).ravel()
        integrator.propagate_until(until)
        return np.array(integrator.state[4:]).reshape(4, 4)

    return flow
