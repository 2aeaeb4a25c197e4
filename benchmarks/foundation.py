"""How fast the dynamics are beside MuJoCo, and the paper's job beside SciPy: ratios in one run.

    pip install -c constraints.txt -e ".[bench]"
    python benchmarks/foundation.py                 prints a table, writes results/foundation.csv

Why: the O(N) tensions are the reason for this package; here is what they buy. Each pair is timed
alternately and the best of several rounds is kept, so that a noisy machine hurts both alike.
"""

from __future__ import annotations

import csv
import platform
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import mujoco
import numba
import numpy as np
from scipy.integrate import solve_ivp

from npend_gym import Chain, simulate
from npend_gym.physics.kernels.dynamics import accelerations, new_work, pack_rods
from npend_gym.physics.kernels.rk4 import STAGE_ROWS, rk4_step

ROUNDS = 7


@numba.njit  # not cached: a cache would not see an edit in the package
def repeat_rhs(theta, omega, torque, rods, work, alpha, times):
    """Call `accelerations` many times, as an integrator does: from compiled code."""
    for _ in range(times):
        accelerations(theta, omega, torque, rods, work, alpha)


@numba.njit
def repeat_step(theta, omega, h, torque, rods, work, stages, times):
    """Take many RK4 steps."""
    for _ in range(times):
        rk4_step(theta, omega, h, torque, rods, work, stages)


def mujoco_chain(n: int, dt: float = 0.01) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return MuJoCo's model of n point masses of 1 kg on rods of 1 m, released from pi/4."""
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.integrator = dt, mujoco.mjtIntegrator.mjINT_RK4
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    body = spec.worldbody
    for i in range(n):
        body = body.add_body(pos=[0, 0, -1 if i else 0])
        body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, -1, 0])
        # MuJoCo wants some inertia; 1e-9 kg m^2 changes nothing that is seen here
        body.mass, body.ipos, body.inertia = 1.0, [0, 0, -1], [1e-9] * 3
        body.explicitinertial = True
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[0] = np.pi / 4
    return model, data


def best_of(*jobs: Callable[[], object], repeats: tuple[int, ...]) -> list[float]:
    """Return the best seconds per call of each job, the jobs taking turns."""
    best = [np.inf] * len(jobs)
    for _ in range(ROUNDS):
        for k, job in enumerate(jobs):
            start = time.process_time()
            job()
            best[k] = min(best[k], (time.process_time() - start) / repeats[k])
    return best


def state(n: int) -> tuple:
    """Return a chain of `n` rods released from pi/4, in the form the kernels take."""
    chain = Chain.uniform(n)
    y = np.concatenate([np.full(n, np.pi / 4), np.zeros(n)])
    return pack_rods(chain), y, np.zeros(n), new_work(n)


def against_mujoco(n: int, step: bool) -> tuple[float, float]:
    """Return seconds of one evaluation (or RK4 step) here and in MuJoCo."""
    rods, y, torque, work = state(n)
    model, data = mujoco_chain(n)
    ours_times, theirs_times = max(1, 200_000 // n), max(5, 3_000 // n)
    if step:
        stages = np.zeros((STAGE_ROWS, n))
        repeat_step(y[:n], y[n:], 1e-6, torque, rods, work, stages, 1)

        def ours():
            repeat_step(y[:n], y[n:], 1e-6, torque, rods, work, stages, ours_times)
    else:
        alpha = np.zeros(n)
        repeat_rhs(y[:n], y[n:], torque, rods, work, alpha)

        def ours():
            repeat_rhs(y[:n], y[n:], torque, rods, work, alpha, ours_times)

    call = mujoco.mj_step if step else mujoco.mj_forward

    def theirs():
        for _ in range(theirs_times):
            call(model, data)

    a, b = best_of(ours, theirs, repeats=(ours_times, theirs_times))
    return a, b


def slope_in_n() -> float:
    """Return the slope of log time against log N from 10 to 100 000 rods."""
    counts = np.array([100, 1_000, 10_000, 100_000])
    seconds = []
    for n in counts:
        rods, y, torque, work = state(n)
        alpha = np.zeros(n)
        times = max(1, 2_000_000 // n)
        job = lambda: repeat_rhs(y[:n], y[n:], torque, rods, work, alpha, times)  # noqa: E731, B023
        seconds += best_of(job, repeats=(times,))
    return float(np.polyfit(np.log(counts), np.log(seconds), 1)[0])


def dense_rhs(length: float, n: int) -> Callable[[float, np.ndarray], np.ndarray]:
    """Return the paper's dense system A theta'' = b (mended) in NumPy."""
    i, j = np.indices((n, n))
    below = n - np.maximum(i, j)

    def rhs(_t: float, y: np.ndarray) -> np.ndarray:
        difference = y[:n, None] - y[None, :n]
        matrix = length * below * np.cos(difference)
        force = -9.81 * np.arange(n, 0, -1) * np.sin(y[:n])
        force -= (length * below * np.sin(difference)) @ y[n:] ** 2
        return np.concatenate([y[n:], np.linalg.solve(matrix, force)])

    return rhs


def papers_job(length: float) -> tuple[float, float, float, float]:
    """Return CPU seconds and energy error of N = 100 for 10 s in 1000 frames: here, and SciPy's.

    SciPy integrates the first second only, for patience; its time is scaled up.
    """
    n, times = 100, np.linspace(0.0, 10.0, 1000)
    chain = Chain.uniform(n, length=length)
    simulate(chain, np.pi / 4, 0.0, times[:2])  # compiled
    (ours,) = best_of(lambda: simulate(chain, np.pi / 4, 0.0, times), repeats=(1,))
    energy = simulate(chain, np.pi / 4, 0.0, times).energy()
    start = np.concatenate([np.full(n, np.pi / 4), np.zeros(n)])
    part = times[times <= 1.0]
    begin = time.process_time()
    solution = solve_ivp(
        dense_rhs(length, n), (0.0, part[-1]), start, "DOP853", part, rtol=1e-10, atol=1e-12
    )
    theirs = (time.process_time() - begin) * times[-1] / part[-1]
    assert solution.success
    here = simulate(chain, np.pi / 4, 0.0, part)
    gap = np.abs(solution.y[:n].T - here.theta).max()
    return ours, theirs, float(np.abs(energy / energy[0] - 1).max()), float(gap)


def main() -> None:
    """Measure, print and write."""
    rows = []
    for step, name in ((False, "one evaluation"), (True, "one RK4 step")):
        for n in (2, 5, 20, 100, 1000):
            ours, theirs = against_mujoco(n, step)
            rows.append((f"{name}, N = {n}", "MuJoCo", ours, theirs, theirs / ours))
    for length in (1.0, 0.01):
        ours, theirs, energy, gap = papers_job(length)
        name = f"10 s of N = 100, rods of {length:g} m (energy error {energy:.0e})"
        rows.append((name, f"SciPy, dense (gap {gap:.0e} rad)", ours, theirs, theirs / ours))
    rows.append(("slope of log time against log N, 100 to 100 000", "", slope_in_n(), "", ""))
    write(rows)


def write(rows: list[tuple]) -> None:
    """Print the table and keep it as CSV, with what made it."""
    about = (
        f"npend_gym {version('npend-gym')}, numba {version('numba')}, "
        f"mujoco {version('mujoco')}, scipy {version('scipy')}, {platform.machine()}, {cpu()}"
    )
    print(about)
    for name, peer, ours, theirs, ratio in rows:
        times = f"{ours:10.3g} s {theirs:10.3g} s {ratio:8.1f} x" if peer else f"{ours:10.3f}"
        print(f"{name:62s} {times}  {peer}")
    path = Path(__file__).parent / "results" / "foundation.csv"
    path.parent.mkdir(exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["job", "peer", "ours_s", "peer_s", "ratio", "made_by"])
        writer.writerows([*row, about] for row in rows)


def cpu() -> str:
    """Return the processor's name, with its widest vectors."""
    info = Path("/proc/cpuinfo")
    if not info.exists():
        return platform.processor()
    text = info.read_text()
    name = text.split("model name\t: ", 1)[-1].split("\n", 1)[0]
    return f"{name}, {'AVX-512' if 'avx512f' in text else 'AVX2' if 'avx2' in text else 'SSE'}"


if __name__ == "__main__":
    main()
