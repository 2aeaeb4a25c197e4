"""What surrounds the steps of double pendulums, on one thread: starts of episodes, early ends.

The package is compared with itself: the ratio of a row is that of an environment which does more
to one which does less, all actions being random.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import count
from typing import Any

import gymnasium as gym
import numpy as np

from suites.environments import OURS, compared, ours
from suites.timing import Job, Peers, Row, rates

LANES = 1024
MANY = 65_536
RANGES = {"masses": (0.8, 1.2), "lengths": (0.8, 1.2), "damping": {"low": 0.0, "high": 0.1}}
NOISE = {"angle_noise": 0.01, "velocity_noise": 0.1, "torque_noise": 0.1}
DELAYS = {"observation_delay": 1.5, "action_delay": 1.5}
HARDWARE = NOISE | DELAYS | {
    "angle_resolution": 0.001, "velocity_resolution": 0.01, "motor_lag": 0.05,
    "torque_ripple": 0.1, "ripple_cycles": 7, "push_rate": 0.5, "push_force": 1.0,
}  # fmt: skip


def rows(peers: Peers) -> Iterator[Row]:
    """Yield the rows; there are no peers, for none offers the same."""
    del peers
    yield seeds()
    yield from early_ends()
    yield from random_chains()
    yield from states()
    yield from sensors_and_motors()


def repeated(function: Callable[[], object], items_per_call: float) -> Job:
    """Return the job of calling a function without arguments."""

    def run(calls: int) -> None:
        for _ in range(calls):
            function()

    return Job(run, items_per_call)


def seeds() -> Row:
    """Return the row of a reset that seeds every one of many lanes."""
    envs: Any = gym.make_vec(OURS, num_envs=MANY)
    seed = count()
    best = rates({"": repeated(lambda: envs.reset(seed=next(seed)), MANY)})[""]
    return Row(f"reset(seed) of {MANY} lanes", "", best, math.nan, f"{MANY / best:.3g} s a call")


def early_ends() -> Iterator[Row]:
    """Yield the rows of episodes that end after some dozen steps, beside those of 1000 steps."""
    for substeps in (None, 1):
        options = {"dt": 0.02, "substeps": substeps}
        name = f"balance, {LANES} lanes, dt 0.02 s, substeps {substeps or 'by default'}"
        jobs = {name: ours(LANES, mode="balance", **options)}
        yield from compared(jobs, {"swingup": ours(LANES, mode="swingup", **options)})


def random_chains() -> Iterator[Row]:
    """Yield the rows of starts whose chains are drawn, beside those of the same chain."""
    name, peer = f"reset() of {LANES} lanes, random chains", "the same chain"
    drawn, same = vector_env(randomize=RANGES), vector_env()
    jobs = {name: repeated(drawn.reset, LANES)}
    for row in compared(jobs, {peer: repeated(same.reset, LANES)}):
        cost = 1e6 / row.ours_per_s - 1e6 / row.peer_per_s
        yield row._replace(note=f"{cost:.2g} us for a chain of {2 * len(RANGES)} numbers")
    jobs = {f"balance, {LANES} lanes, random chains": ours(LANES, mode="balance", randomize=RANGES)}
    yield from compared(jobs, {peer: ours(LANES, mode="balance")})


def states() -> Iterator[Row]:
    """Yield the rows of putting environments back to their state, beside a step of them."""
    one: Any = gym.make(OURS).unwrapped
    for env, lanes in ((one, 1), (vector_env(), LANES)):
        env.reset(seed=0)
        action = np.zeros(env.action_space.shape)
        name = f"set_state(get_state()), {lanes} lane{'s' * (lanes > 1)}"
        jobs = {name: repeated(lambda env=env: env.set_state(env.get_state()), lanes)}
        step = repeated(lambda env=env, action=action: env.step(action), lanes)
        yield from compared(jobs, {"step": step})


def sensors_and_motors() -> Iterator[Row]:
    """Yield the rows of steps with noise and delays, beside steps with ideal sensors and motors."""
    for substeps in (None, 1):
        plain = {"substeps": substeps}
        kinds = {"noise": NOISE, "noise and delays": NOISE | DELAYS, "all hardware": HARDWARE}
        name = f"{LANES} lanes, substeps {substeps or 'by default'}"
        jobs = {f"{kind}, {name}": ours(LANES, **plain, **more) for kind, more in kinds.items()}
        yield from compared(jobs, {"ideal sensors and motors": ours(LANES, **plain)})


def vector_env(**options: Any) -> Any:
    """Return an environment of some lanes that has been reset."""
    envs = gym.make_vec(OURS, num_envs=LANES, **options)
    envs.reset(seed=0)
    return envs
