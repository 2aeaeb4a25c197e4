"""The environments beside their peers: steps a second, one thread.

The peers do less: one Euler step (CartPole, Pendulum) or one Runge-Kutta step (Acrobot) in each
step, and none computes energies or turning points. Each job with a vector environment of this
package steps whole episodes of 1000 steps, their resets included.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from itertools import product
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from suites.timing import Job, Peers, Row, rates

EPISODE = 1001  # calls of a vector environment of this package from reset to reset
OURS = "npend_gym:NPendulum-v0"


def rows(peers: Peers) -> Iterator[Row]:
    """Yield the comparisons with the peers that are installed; Gymnasium's own always are."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", module="gymnasium")  # about the peers' spaces
        yield from single_beside_peers()
        for lanes in (64, 1024, 4096):
            yield from vector_beside_peers(lanes, peers)
        yield from two_threads()
        yield from along_n()
        yield from pictures()


def single(name: str, **options: Any) -> Job:
    """Return the job of stepping one environment as a training loop does, the action given.

    It is always the same one: `Box.sample` would take longer than a step of this package.
    """
    env = gym.make(name, **options)
    env.action_space.seed(0)
    env.reset(seed=0)
    action = env.action_space.sample()

    def run(calls: int) -> None:
        for _ in range(calls):
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()

    return Job(run)


def vector(envs: Any, lanes: int, actions: NDArray[Any], repeat: int = 1) -> Job:
    """Return the job of stepping environments side by side, which reset themselves."""
    envs.reset()

    def run(calls: int) -> None:
        for k in range(calls):
            envs.step(actions[k % len(actions)])

    return Job(run, lanes, repeat)


def ours(lanes: int, threads: int = 1, **options: Any) -> Job:
    """Return the job of stepping this package's vector environment."""
    envs = gym.make_vec(OURS, num_envs=lanes, threads=threads, **options)
    actions = np.random.default_rng(0).uniform(-1, 1, (8, lanes, 1))
    episodes_end = "max_episode_steps" not in options
    return vector(envs, lanes, actions.astype(np.float32), EPISODE if episodes_end else 1)


def vector_peers(lanes: int, peers: Peers) -> dict[str, Job]:
    """Return the jobs of the peers that are installed."""
    choices = np.random.default_rng(0).integers(0, 6, (8, lanes))

    def envpool_acrobots() -> Job:
        envpool: Any = import_module("envpool")
        envs = envpool.make_gymnasium("Acrobot-v1", num_envs=lanes, num_threads=1)
        return vector(envs, lanes, choices % 3)

    cartpole = gym.make_vec("CartPole-v1", num_envs=lanes)  # Gymnasium's own, in NumPy
    found = {
        "Gymnasium CartPole-v1": vector(cartpole, lanes, choices % 2),
        "envpool Acrobot-v1": peers.job("envpool", envpool_acrobots),
        "gymnax Acrobot-v1, float32": peers.job(
            "gymnax", lambda: gymnax_acrobots(lanes, choices % 3)
        ),
    }
    return {name: job for name, job in found.items() if job is not None}


def gymnax_acrobots(lanes: int, actions: NDArray[Any]) -> Job:
    """Return the job of stepping gymnax's Acrobot, which XLA compiles for all lanes at once."""
    jax: Any = import_module("jax")
    env, params = import_module("gymnax").make("Acrobot-v1")
    keys = jax.random.split(jax.random.key(0), lanes)
    state = jax.vmap(env.reset, (0, None))(keys, params)[1]
    step = jax.jit(jax.vmap(env.step, (0, 0, 0, None)))
    chosen = [jax.numpy.asarray(row) for row in actions]

    def run(calls: int) -> None:
        last, observation = state, None
        for k in range(calls):
            observation, last, *_ = step(keys, last, chosen[k % len(chosen)], params)
        jax.block_until_ready(observation)

    return Job(run, lanes)


def single_beside_peers() -> Iterator[Row]:
    """Yield the rows of the single double pendulum beside Gymnasium's single environments."""
    jobs = {name: single(OURS, **options) for name, options in variants("gym.make").items()}
    others = {f"Gymnasium {name}": single(name) for name in ("Acrobot-v1", "Pendulum-v1")}
    yield from compared(jobs, others)


def vector_beside_peers(lanes: int, peers: Peers) -> Iterator[Row]:
    """Yield the rows of `lanes` double pendulums beside each peer."""
    kinds = variants(f"gym.make_vec, {lanes} lanes")
    jobs = {name: ours(lanes, **options) for name, options in kinds.items()}
    yield from compared(jobs, vector_peers(lanes, peers))


def variants(kind: str) -> dict[str, dict[str, Any]]:
    """Return the keywords of the environments that are measured, by the names of their rows."""
    substeps = gym.make(OURS).unwrapped.config.min_substeps  # type: ignore[attr-defined]
    return {
        f"{kind}, N = 2, {substeps} substeps (default)": {},
        f"{kind}, N = 2, 1 substep": {"substeps": 1},
    }


def compared(jobs: dict[str, Job], others: dict[str, Job]) -> Iterator[Row]:
    """Time all in turns and yield a row for each job beside each of the others."""
    best = rates(jobs | others)
    for name, peer in product(jobs, others):
        yield Row(name, peer, best[name], best[peer])


def two_threads() -> Iterator[Row]:
    """Yield the rows of two threads beside one, by wall time, with the largest possible gain."""
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
    """Return the job of running both at the same time, each in a thread of its own."""
    pool = ThreadPoolExecutor(2)

    def run(calls: int) -> None:
        for done in [pool.submit(job.run, calls) for job in (first, second)]:
            done.result()

    return Job(run, first.items_per_call + second.items_per_call)


def along_n() -> Iterator[Row]:
    """Yield the rows of long chains: ns per rod and step, one substep each."""
    lanes = 1024
    for n in (2, 5, 20, 100):
        # small steps and torques, because a chain that has diverged is not stepped any more
        options: dict[str, Any] = {"n": n, "mode": "calm", "dt": 0.002, "substeps": 1}
        best = rates({"": ours(lanes, max_episode_steps=None, max_torque=1.0, **options)})[""]
        note = f"{1e9 / (best * n):.1f} ns per rod"
        yield Row(f"gym.make_vec, {lanes} lanes, N = {n}, 1 substep", "", best, math.nan, note)


def pictures() -> Iterator[Row]:
    """Yield the row of pictures for learning beside those of Gymnasium's cart-pole."""
    ours = gym.make(OURS, render_mode="rgb_array", render_size=84, render_plain=True)
    jobs = {"gym.make, N = 2, 84 x 84, plain, pictures a second": rendering(ours)}
    peer = gym.make("CartPole-v1", render_mode="rgb_array")
    yield from compared(jobs, {"Gymnasium CartPole-v1, 600 x 400": rendering(peer)})


def rendering(env: Any) -> Job:
    """Return the job of painting an environment."""
    env.reset(seed=0)

    def run(calls: int) -> None:
        for _ in range(calls):
            env.render()

    return Job(run)
