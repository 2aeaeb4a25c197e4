"""Simulate what a class measures: the horizontal force at the pivot of a released ball chain.

    python examples/ball_chain.py ball_chain.csv

Release 0 is the chain hanging at rest. In the others a thread pulls the lowest ball aside, and is
burnt. The sensor has an offset that drifts, a wrong scale, a tilted axis, noise and samples; the
balls hang a little farther apart than the class thinks, and move in air.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from npend_gym import Chain, simulate
from npend_gym.physics import accelerations

BALLS = Chain.spheres(
    10, radius=0.010, spacing=0.0501, density=7800.0,
    fluid_density=1.2, viscosity=1.8e-5, drag_coefficient=0.4,
)  # fmt: skip
PULL, DIRECTION = 10.0, np.radians(50.0)  # of the thread [N], from the downward vertical
INTERVAL, HELD, AFTER = 0.01, 0.3, 2.0  # s
OFFSET, DRIFT, NOISE = 0.150, 0.003, 0.02  # N
SCALE, TILT = 1.03, np.radians(1.0)

Array = NDArray[np.float64]


def held_angles() -> Array:
    """Return the angles of the rods [rad] in which weights and thread are in balance."""
    hanging = np.cumsum(BALLS.masses[::-1])[::-1] * BALLS.gravity
    down = PULL * np.cos(DIRECTION) + hanging
    return np.arctan2(PULL * np.sin(DIRECTION), down)


def pull_at_pivot(theta: Array, omega: Array) -> Array:
    """Return the force of the moving chain on the pivot [N], sideways and up, shape (..., 2).

    It is weight less mass times acceleration, summed over the balls. Drag, less than 1e-3 of it,
    is left out.
    """
    alpha = accelerations(BALLS, theta, omega)
    s, c = np.sin(theta), np.cos(theta)
    across = np.cumsum(BALLS.lengths * (c * alpha - s * omega**2), axis=-1) @ BALLS.masses
    up = np.cumsum(BALLS.lengths * (s * alpha + c * omega**2), axis=-1) @ BALLS.masses
    return np.stack([-across, -up - BALLS.masses.sum() * BALLS.gravity], axis=-1)


def shown(force: Array, rng: np.random.Generator) -> Array:
    """Return what the sensor shows [N] of forces (..., 2)."""
    along = np.cos(TILT) * force[..., 0] - np.sin(TILT) * force[..., 1]
    offset = OFFSET + DRIFT * rng.normal()
    return SCALE * along + offset + NOISE * rng.normal(size=along.shape)


def release(theta: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return times [s] and what the sensor shows [N] of a chain that is held, and released."""
    burnt = HELD + INTERVAL * rng.uniform()  # the samples know nothing of this instant
    times = INTERVAL * np.arange(round((HELD + AFTER) / INTERVAL))
    moving = times > burnt
    motion = simulate(BALLS, theta, 0.0, np.concatenate([[0.0], times[moving] - burnt]))
    force = np.empty((times.size, 2))
    weight = BALLS.masses.sum() * BALLS.gravity
    force[~moving] = PULL * np.sin(DIRECTION), -PULL * np.cos(DIRECTION) - weight
    force[moving] = pull_at_pivot(motion.theta, motion.omega)[1:]
    return times, shown(force, rng)


def main(path: Path, seed: int = 0, releases: int = 5) -> None:
    """Write a table of samples: release, time [s], force [N]."""
    rng = np.random.default_rng(seed)
    times = INTERVAL * np.arange(200)
    still = np.zeros((times.size, BALLS.n))
    rows = [(0, times, shown(pull_at_pivot(still, still), rng))]
    for number in range(1, releases + 1):
        theta = held_angles() + np.radians(0.5) * rng.normal()
        rows.append((number, *release(theta, rng)))
    lines = [
        f"{number},{t:.2f},{f:.3f}"
        for number, times, forces in rows
        for t, f in zip(times, forces, strict=True)
    ]
    path.write_text("\n".join(["release,time,force", *lines, ""]), encoding="utf-8")
    print(
        f"{path}: {releases} releases of rods held at {np.degrees(held_angles()).round()} degrees"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("csv", type=Path, help="file of the table")
    main(parser.parse_args().csv)
