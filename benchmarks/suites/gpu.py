"""Runge-Kutta steps on a GPU: its bits beside the processor's, and its speed beside its memory."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from npend_gym import Chain
from npend_gym.physics import DeviceChains, Ensemble
from npend_gym.tools import FloatArray
from suites.timing import Job, Peers, Row, rates

LANES = (1_000, 10_000, 100_000, 1_000_000)
COUNTS = (2, 5)
MANY, COPIED = 100, 2**27  # steps in a launch; numbers copied to measure the bandwidth
_H = 1e-3  # s


def rows(peers: Peers) -> Iterator[Row]:
    """Yield the rows, or none where there is no GPU."""
    first = peers.get("the GPU", lambda: DeviceChains(Chain.uniform(2), 1))
    if first is None:
        return
    yield same_bits()
    bandwidth = rates({"": copies(first.cuda)}, rounds=5)[""]
    about = f"{first.device}: memory read and written"
    yield Row("bytes copied in its memory", "", bandwidth, math.nan, about)
    for dtype in ("float64", "float32"):
        for n in COUNTS:
            for lanes in LANES:
                for steps in (MANY, 1):
                    yield rate(n, lanes, dtype, steps, bandwidth)


def rate(n: int, lanes: int, dtype: str, steps: int, bandwidth: float) -> Row:
    """Return the steps per second, and what share that is of what the memory allows."""
    chains = DeviceChains(Chain.uniform(n), lanes, dtype=dtype)
    best = rates({"": launches(chains, steps)}, rounds=5)[""]
    # angles and velocities read and written, torques read, flags read and written
    moved = (5 * n + 2) * chains.dtype.itemsize / steps
    share = best * moved / bandwidth
    name = f"RK4 steps, N = {n}, {dtype}, {lanes} lanes, {steps} a launch"
    return Row(name, "", best, math.nan, f"{100.0 * share:.3g} % of the bandwidth")


def launches(chains: DeviceChains, steps: int) -> Job:
    """Return the job of taking `steps` steps with all chains, released from pi/4."""
    put, (size, n) = chains.cuda.to_device, (chains.size, chains.n)
    arrays = [np.full((n, size), np.pi / 4), np.zeros((n, size)), np.zeros((n, size))]
    theta, omega, torque = (put(array.astype(chains.dtype)).T for array in arrays)
    diverged = put(np.zeros(size, chains.dtype))

    def run(calls: int) -> None:
        for _ in range(calls):
            chains.advance(theta, omega, torque, diverged, _H * steps, steps)
        chains.cuda.synchronize()

    return Job(run, float(size * steps), wall=True)


def copies(cuda: Any) -> Job:
    """Return the job of copying numbers in the memory of the GPU; bytes read and written count."""
    source = cuda.to_device(np.zeros(COPIED))
    target = cuda.to_device(np.zeros(COPIED))

    def run(calls: int) -> None:
        for _ in range(calls):
            target.copy_to_device(source)
        cuda.synchronize()

    return Job(run, 16.0 * COPIED, wall=True)


def same_bits(lanes: int = 1000, steps: int = 100) -> Row:
    """Return how far the GPU's numbers are from the processor's, and how fast the latter is."""
    rng = np.random.default_rng(0)
    theta, omega = rng.uniform(-2.0, 2.0, (lanes, 5)), rng.normal(size=(lanes, 5))
    chains, ours = Chain.uniform(5, damping=0.01), Ensemble(Chain.uniform(5, damping=0.01), lanes)
    ours.set_state(slice(None), theta, omega)
    on_gpu = DeviceChains(chains, lanes)
    put = on_gpu.cuda.to_device
    state = [put(values) for values in (theta, omega, np.zeros((lanes, 5)), np.zeros(lanes))]
    for _ in range(steps):
        ours.advance(0.0, 0.01, 1)
        on_gpu.advance(*state, 0.01, 1)
    found = ulps(ours.theta, state[0].copy_to_host())
    job = Job(lambda calls: [ours.advance(0.0, 0.01, 1) for _ in range(calls)], float(lanes))
    note = f"after {steps} steps the GPU's angles differ in {np.sum(found > 0)} of {found.size}"
    best = rates({"": job}, rounds=5)[""]
    name = f"RK4 steps, N = 5, float64, {lanes} lanes, the processor"
    return Row(name, "", best, math.nan, f"{note}, by {found.max():g} ulps at most")


def ulps(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return how many units in the last place two arrays are apart."""
    return np.abs(a - b) / np.spacing(np.maximum(np.abs(a), np.abs(b)))
