"""The batched kernels beside C written by hand: the same Runge-Kutta steps, in one run.

    python benchmarks/yardstick.py        prints a table, writes results/yardstick.csv

Why: the package's kernels are Python compiled by Numba. `yardstick.c`, compiled here with gcc for
this machine, takes the same steps by the same algorithm with vector types; both must compute the
same bits. C is tried with vectors of 4, 8 and 16 lanes; the best counts.
"""

from __future__ import annotations

import argparse
import ctypes
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

from npend_gym.compiled.arrays import bare, packs
from npend_gym.compiled.jit import kernel
from npend_gym.compiled.packs import WIDTH
from npend_gym.physics.kernels.rk4 import RK4_ROWS, rk4_step
from npend_gym.physics.kernels.tensions import ChainArrays
from npend_gym.report import prepare_file, write_csv
from npend_gym.tools import machine

LANES, STEPS, H, GRAVITY = 256, 20, 1e-3, 9.81
ROUNDS = 60
HERE = Path(__file__).parent


@kernel
def ours(groups, n, steps, h, theta, omega, torque, v, l, inverse_l, damping, g, scratch):
    """Take `steps` steps with each group of WIDTH chains, arrays [group][rod][lane]."""
    scratch, torque, damping, g = (
        packs(bare(scratch)), packs(torque), packs(damping), packs(g)
    )  # fmt: skip
    theta, omega, v, l, inverse_l = (
        packs(theta), packs(omega), packs(v), packs(l), packs(inverse_l)
    )  # fmt: skip
    for group in range(groups):
        first, last = group * n, (group + 1) * n
        rods = ChainArrays(
            v[first + group : last + group + 1],
            l[first:last],
            inverse_l[first:last],
            damping,
            g,
            damping[:0],  # no drag
            damping[:0],
        )
        for _ in range(steps):
            rk4_step(0.0, theta[first:last], omega[first:last], h, torque, rods, scratch)


def chains(n: int, width: int) -> list[np.ndarray]:
    """Return theta, omega, v, l and 1/l of LANES different chains, [group][rod][lane]."""
    rng = np.random.default_rng(n)
    theta = rng.uniform(-1.0, 1.0, (LANES, n))
    masses, lengths = rng.uniform(0.5, 2.0, (2, LANES, n))
    v = np.hstack([np.zeros((LANES, 1)), 1.0 / masses])
    per_lane = (theta, np.zeros((LANES, n)), v, lengths, 1.0 / lengths)
    return [x.reshape(-1, width, x.shape[1]).swapaxes(1, 2).ravel() for x in per_lane]


def numba_job(n: int):
    """Return our job, and the angles that it leaves behind."""
    theta, omega, *rods = chains(n, WIDTH)
    spare = [np.zeros(n * WIDTH), np.zeros(n * WIDTH), np.full(WIDTH, GRAVITY)]
    torque, damping, g = spare
    scratch = np.zeros((RK4_ROWS, (n + 2) * WIDTH))

    def job():
        ours(
            LANES // WIDTH, n, STEPS, H, theta, omega, torque, *rods, damping, g, scratch
        )  # fmt: skip

    return job, theta.reshape(-1, n, WIDTH)


def c_job(n: int, width: int, folder: Path):
    """Return the job of C with vectors of `width` lanes, and the angles that it leaves behind."""
    library = folder / f"yardstick{width}.so"
    flags = ["-O3", "-march=native", "-ffp-contract=off", "-shared", "-fPIC", f"-DWIDTH={width}"]
    if not library.exists():
        subprocess.run(["gcc", *flags, "-w", "-o", library, HERE / "yardstick.c"], check=True)
    arrays = chains(n, width)
    pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in arrays]
    rk4 = ctypes.CDLL(str(library)).rk4

    def job():
        rk4(LANES // width, n, STEPS, ctypes.c_double(H), ctypes.c_double(GRAVITY), *pointers)

    return job, arrays[0].reshape(-1, n, width)


def by_lane(theta: np.ndarray) -> np.ndarray:
    """Return angles [group][rod][lane] as (lanes, n)."""
    return theta.swapaxes(1, 2).reshape(LANES, -1)


def measure(n: int, folder: Path) -> tuple[float, dict[int, float]]:
    """Return ns per link and right side, ours and C's for each width, the jobs taking turns."""
    mine, angles = numba_job(n)
    theirs = {width: c_job(n, width, folder) for width in (4, 8, 16)}
    jobs = [mine, *(job for job, _ in theirs.values())]
    best = [np.inf] * len(jobs)
    for k in range(ROUNDS):
        for j, job in enumerate(jobs):
            begin = time.perf_counter()
            job()
            took = time.perf_counter() - begin
            best[j] = min(best[j], took) if k else np.inf  # the first compiles
    for _, others in theirs.values():
        np.testing.assert_array_equal(by_lane(angles), by_lane(others))
    per_link = [1e9 * took / (LANES * STEPS * 4 * n) for took in best]
    return per_link[0], dict(zip(theirs, per_link[1:], strict=True))


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=HERE / "results" / "yardstick.csv")
    out = parser.parse_args().out
    prepare_file(out, [".csv"])
    about = machine()
    print(about)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for n in (2, 5, 20, 100):
            mine, theirs = measure(n, Path(folder))
            width = min(theirs, key=lambda w: theirs[w])
            row = {"n": n, "ns_per_link": mine, "c_ns_per_link": theirs[width], "c_lanes": width}
            rows.append(row | {"ratio": mine / theirs[width], "made_by": about})
            print(
                f"N = {n:3d}: {mine:5.2f} ns per link and right side, C {theirs[width]:5.2f} "
                f"({width} lanes): {mine / theirs[width]:.2f} times as long"
            )
    write_csv(out, rows)


if __name__ == "__main__":
    main()
