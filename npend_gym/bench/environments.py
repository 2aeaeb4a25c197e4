"""The environments beside their peers: steps a second, one thread.

The peers do less: one Euler step (CartPole, Pendulum) or one Runge-Kutta step (Acrobot) in each
step, and none tells energies or turning points. Each job of ours with a vector environment holds
whole episodes of 1000 steps with their resets.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from npend_gym.bench.timing import Job, Row, rates

EPISODE = 1001  # calls of a vector environment of ours from reset to reset
OURS = "npend_gym:NPendulum-v0"


def rows() -> Iterator[Row]:
    """Yield the comparisons; without envpool those with Gymnasium alone."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", module="gymnasium")  # of the peers' spaces
        for lanes in (None, 64, 1024, 4096):
            yield from beside_peers(lanes)
        yield from two_threads()
        yield from along_n()


def single(name: str, **options: Any) -> Job:
    """Return the job of stepping one environment as a training loop does."""
    env = gym.make(name, **options)
    env.action_space.seed(0)
    env.reset(seed=0)
    actions = [env.action_space.sample() for _ in range(64)]

    def take(calls: int) -> None:
        for k in range(calls):
            _, _, terminated, truncated, _ = env.step(actions[k % 64])
            if terminated or truncated:
                env.reset()

    return Job(take)


def vector(envs: Any, lanes: int, actions: NDArray[Any], multiple: int = 1) -> Job:
    """Return the job of stepping environments side by side, which reset themselves."""
    envs.reset()

    def take(calls: int) -> None:
        for k in range(calls):
            envs.step(actions[k % len(actions)])

    return Job(take, lanes, multiple)


def ours(lanes: int, threads: int = 1, **options: Any) -> Job:
    """Return the job of stepping our vector environment."""
    envs = gym.make_vec(OURS, num_envs=lanes, threads=threads, **options)
    actions = np.random.default_rng(0).uniform(-1, 1, (8, lanes, 1))
    whole = "max_episode_steps" not in options
    return vector(envs, lanes, actions.astype(np.float32), EPISODE if whole else 1)


def peers(lanes: int) -> dict[str, Job]:
    """Return the jobs of the peers that there are."""
    choices = np.random.default_rng(0).integers(0, 6, (8, lanes))
    cartpole = gym.make_vec("CartPole-v1", num_envs=lanes)  # Gymnasium's own, in NumPy
    jobs = {"Gymnasium CartPole-v1": vector(cartpole, lanes, choices % 2)}
    try:
        envpool: Any = import_module("envpool")
        acrobot = envpool.make_gymnasium("Acrobot-v1", num_envs=lanes, num_threads=1)
        jobs["envpool Acrobot-v1"] = vector(acrobot, lanes, choices % 3)
    except Exception as error:  # noqa: BLE001  not there, or not for this Gymnasium
        print(f"envpool skipped: {error!r}")
    if find_spec("gymnax"):
        jobs["gymnax Acrobot-v1, float32"] = gymnax_acrobots(lanes, choices % 3)
    return jobs


def gymnax_acrobots(lanes: int, actions: NDArray[Any]) -> Job:
    """Return the job of stepping gymnax's Acrobot, which XLA compiles for all lanes at once."""
    jax: Any = import_module("jax")
    env, params = import_module("gymnax").make("Acrobot-v1")
    keys = jax.random.split(jax.random.key(0), lanes)
    state = jax.vmap(env.reset, (0, None))(keys, params)[1]
    step = jax.jit(jax.vmap(env.step, (0, 0, 0, None)))
    chosen = [jax.numpy.asarray(row) for row in actions]

    def take(calls: int) -> None:
        last, seen = state, None
        for k in range(calls):
            seen, last, *_ = step(keys, last, chosen[k % len(chosen)], params)
        jax.block_until_ready(seen)

    return Job(take, lanes)


def beside_peers(lanes: int | None) -> Iterator[Row]:
    """Yield the rows of the double pendulum beside each peer; `lanes` None: a single env."""
    substeps = gym.make(OURS).unwrapped.config.substeps  # type: ignore[attr-defined]
    kind = "gym.make" if lanes is None else f"gym.make_vec, {lanes} lanes"
    mine: dict[str, dict[str, Any]] = {f"{kind}, N = 2, {substeps} substeps (default)": {}}
    mine[f"{kind}, N = 2, 1 substep"] = {"substeps": 1}
    if lanes is None:
        jobs = {name: single(OURS, **options) for name, options in mine.items()}
        others = {f"Gymnasium {name}": single(name) for name in ("Acrobot-v1", "Pendulum-v1")}
    else:
        jobs = {name: ours(lanes, **options) for name, options in mine.items()}
        others = peers(lanes)
    best = rates(jobs | others)
    for name in jobs:
        for peer in others:
            yield Row(name, peer, best[name], best[peer])


def two_threads() -> Iterator[Row]:
    """Yield the rows of two threads beside one, by time on the wall, and what there is to gain."""
    lanes = 4096
    for n in (2, 20):
        options: dict[str, Any] = {"max_episode_steps": None, "n": n}
        alone = ours(lanes, **options)
        jobs = {"one": alone, "two": ours(lanes, 2, **options)}
        jobs["apart"] = side_by_side(alone, ours(lanes, **options))
        best = rates({name: job._replace(wall=True) for name, job in jobs.items()})
        name, peer = f"gym.make_vec, {lanes} lanes, N = {n}, two threads", "itself on one thread"
        note = f"two of one thread each, side by side: {best['apart'] / best['one']:.2f} x"
        yield Row(name, peer, best["two"], best["one"], note)


def side_by_side(first: Job, second: Job) -> Job:
    """Return the job of doing both at the same time, each in a thread of its own."""
    pool = ThreadPoolExecutor(2)

    def take(calls: int) -> None:
        for done in [pool.submit(job.take, calls) for job in (first, second)]:
            done.result()

    return Job(take, first.units + second.units)


def along_n() -> Iterator[Row]:
    """Yield the rows of long chains: ns per rod and step, one substep each."""
    lanes = 1024
    for n in (2, 5, 20, 100):
        # small steps and torques, for a chain that diverges is not stepped
        options: dict[str, Any] = {
            "n": n,
            "mode": "calm",
            "dt": 0.002,
            "substeps": 1,
            "max_torque": 1.0,
        }
        best = rates({"": ours(lanes, max_episode_steps=None, **options)})[""]
        note = f"{1e9 / (best * n):.1f} ns per rod"
        yield Row(f"gym.make_vec, {lanes} lanes, N = {n}, 1 substep", "", best, math.nan, note)
