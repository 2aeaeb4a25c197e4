"""Work and precision of the paper's job: N = 100 released from pi/4, 10 s in 1001 frames.

Precision is the largest change of the energy, relative to that at the start, because it needs no
reference solution; work is CPU time. The rods are 1 m long: with the 1/100 m of the paper's listing
the motion is chaotic, and no state after 7 s is determined.

The equations of heyoka and diffrax below are a second copy of the dynamics on purpose: both
integrators compile the equations themselves and cannot call compiled code.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from importlib import import_module
from itertools import product
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from npend_gym import Chain, simulate
from npend_gym.physics import right_hand_side, total_energy
from npend_gym.tools import FloatArray
from suites.dynamics import mujoco_chain
from suites.timing import Peers

N, DURATION, FRAMES = 100, 10.0, 1001  # a frame every 0.01 s
ROUNDS = 3

Solver = Callable[[], FloatArray]  # solves the job once: theta and omega, (FRAMES, 2n)
Method = tuple[str, str, Callable[[], Solver]]  # its name, its setting, what makes its solver


class Measurement(NamedTuple):
    """One run: the method, its setting, its cost and its error."""

    method: str
    setting: str
    seconds: float  # CPU time
    energy_error: float  # largest relative change


def rows(peers: Peers, n: int = N, duration: float = DURATION) -> Iterator[Measurement]:
    """Yield the runs of every method that is installed."""
    chain, times = Chain.uniform(n), np.linspace(0.0, duration, FRAMES)
    for method, setting, make in own_methods(chain, times):
        yield _measure(method, setting, make, chain)
    for method, setting, make in peer_methods(chain, times):
        found = peers.get(method, partial(_measure, method, setting, make, chain))
        if found is not None:
            yield found


def own_methods(chain: Chain, times: FloatArray) -> Iterator[Method]:
    """Yield the package's integrators, and SciPy's on the package's compiled dynamics."""
    for rtol in (1e-5, 1e-7, 1e-9, 1e-11, 1e-13):
        yield "npend_gym, dop853", f"rtol {rtol:g}", partial(_ours, chain, times, rtol=rtol)
    for dt in (0.01, 0.005, 0.0025, 0.00125):
        yield "npend_gym, rk4", f"dt {dt:g}", partial(_ours, chain, times, method="rk4", dt=dt)
    names: tuple[Literal["DOP853"], Literal["LSODA"]] = ("DOP853", "LSODA")
    for name, rtol in product(names, (1e-5, 1e-8, 1e-11)):
        make = partial(_scipy, chain, times, name, rtol)
        yield f"SciPy {name}, our dynamics", f"rtol {rtol:g}", make


def peer_methods(chain: Chain, times: FloatArray) -> Iterator[Method]:
    """Yield the methods of libraries that may not be installed."""
    for tolerance in (1e-6, 1e-10, 1e-14):
        yield "heyoka", f"tol {tolerance:g}", partial(_heyoka, chain, times, tolerance)
    for rtol in (1e-5, 1e-8, 1e-11):
        yield "diffrax Dopri8", f"rtol {rtol:g}", partial(_diffrax, chain, times, rtol)
    yield "MuJoCo RK4", "dt 0.01", partial(_mujoco, chain.n, times)


def _measure(method: str, setting: str, make: Callable[[], Solver], chain: Chain) -> Measurement:
    run, best, frames = make(), np.inf, np.empty(0)
    for _ in range(ROUNDS):
        begin = time.process_time()
        frames = run()
        best = min(best, time.process_time() - begin)
        if best > 2.0:  # long enough to need no repetition
            break
    energies = total_energy(chain, frames[:, : chain.n], frames[:, chain.n :])
    return Measurement(method, setting, best, float(np.abs(energies / energies[0] - 1.0).max()))


def _ours(chain: Chain, times: FloatArray, **options: Any) -> Solver:
    if "rtol" in options:
        options["atol"] = 1e-2 * options["rtol"]
    simulate(chain, np.pi / 4, 0.0, times[:2], **options)  # compiled

    def run() -> FloatArray:
        path = simulate(chain, np.pi / 4, 0.0, times, **options)
        return np.hstack([path.theta, path.omega])

    return run


def _scipy(
    chain: Chain, times: FloatArray, method: Literal["DOP853", "LSODA"], rtol: float
) -> Solver:
    n = chain.n
    right_side = right_hand_side(chain)
    start = np.concatenate([np.full(n, np.pi / 4), np.zeros(n)])

    def run() -> FloatArray:
        span, atol = (times[0], times[-1]), 1e-2 * rtol
        return solve_ivp(right_side, span, start, method, times, rtol=rtol, atol=atol).y.T

    return run


def _heyoka(chain: Chain, times: FloatArray, tolerance: float) -> Solver:
    """Return Taylor's method on the equations of the tensions, solved by the same elimination."""
    hy: Any = import_module("heyoka")
    n = chain.n
    theta, omega = (
        hy.make_vars(*[f"x{i}" for i in range(n)]),
        hy.make_vars(*[f"w{i}" for i in range(n)]),
    )
    sines = [hy.sin(theta[0])] + [hy.sin(theta[i] - theta[i - 1]) for i in range(1, n)]
    cosines = [hy.cos(theta[0])] + [hy.cos(theta[i] - theta[i - 1]) for i in range(1, n)]
    g = chain.gravity
    # rods of 1 m and bobs of 1 kg: diagonal 1 at the pivot, 2 below
    pivots: list[Any] = []
    reduced: list[Any] = []
    for i in range(n):
        right = omega[i] * omega[i] + (g * cosines[0] if i == 0 else 0.0)
        if i == 0:
            pivots.append(hy.expression(1.0))
            reduced.append(right)
        else:
            factor = cosines[i] / pivots[-1]
            pivots.append(2.0 - cosines[i] * factor)
            reduced.append(right + factor * reduced[-1])
    tensions: list[Any] = [None] * n
    tensions[-1] = reduced[-1] / pivots[-1]
    for i in range(n - 2, -1, -1):
        tensions[i] = (reduced[i] + cosines[i + 1] * tensions[i + 1]) / pivots[i]
    system = [(theta[i], omega[i]) for i in range(n)]
    for i in range(n):
        below = tensions[i + 1] * sines[i + 1] if i + 1 < n else 0.0
        above = tensions[i - 1] * sines[i] if i > 0 else g * sines[0]
        system.append((omega[i], below - above))
    start = np.concatenate([np.full(n, np.pi / 4), np.zeros(n)])
    integrator = hy.taylor_adaptive(system, start, tol=tolerance, compact_mode=True)

    def run() -> FloatArray:
        integrator.time, integrator.state[:] = 0.0, start
        return integrator.propagate_grid(times)[-1]

    return run


def _diffrax(chain: Chain, times: FloatArray, rtol: float) -> Solver:
    """Return Dormand and Prince's method of order 8 in JAX; LAPACK's gtsv gives the tensions."""
    jax: Any = import_module("jax")
    dfx: Any = import_module("diffrax")
    jax.config.update("jax_enable_x64", True)
    jnp, n, g = jax.numpy, chain.n, chain.gravity
    # rods of 1 m and bobs of 1 kg: diagonal 1 at the pivot, 2 below
    diagonal = jnp.full(n, 2.0).at[0].set(1.0)

    def right_side(_t: Any, y: Any, _args: Any) -> Any:
        theta, omega = y[:n], y[n:]
        bend = jnp.diff(theta)
        s, c = jnp.sin(bend), jnp.cos(bend)
        right = omega**2
        right = right.at[0].add(g * jnp.cos(theta[0]))
        off = jnp.pad(-c, (1, 1))
        tension = jax.lax.linalg.tridiagonal_solve(off[:n], diagonal, off[1:], right[:, None])[:, 0]
        alpha = jnp.append(tension[1:] * s, 0.0) - jnp.append(
            g * jnp.sin(theta[0]), tension[:-1] * s
        )
        return jnp.concatenate([omega, alpha])

    start = jnp.concatenate([jnp.full(n, jnp.pi / 4), jnp.zeros(n)])

    @jax.jit
    def solve() -> Any:
        return dfx.diffeqsolve(
            dfx.ODETerm(right_side),
            dfx.Dopri8(),
            times[0],
            times[-1],
            None,
            start,
            saveat=dfx.SaveAt(ts=times),
            stepsize_controller=dfx.PIDController(rtol=rtol, atol=1e-2 * rtol),
            max_steps=1_000_000,
        ).ys

    def run() -> FloatArray:
        return np.asarray(solve())

    run()  # compiled
    return run


def _mujoco(n: int, times: FloatArray) -> Solver:
    mujoco: Any = import_module("mujoco")

    def run() -> FloatArray:
        model, data = mujoco_chain(n, float(times[1] - times[0]))
        frames = np.empty((times.size, 2 * n))
        for frame in frames:
            # joint angles are relative
            frame[:n], frame[n:] = np.cumsum(data.qpos), np.cumsum(data.qvel)
            mujoco.mj_step(model, data)
        return frames

    return run
