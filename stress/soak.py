"""The long runs behind docs/reliability.md: equal bits, random calls, a day of steps and so on.

Each prints one line that says what was run and found. The exit code is 1 where a promise is
broken::

    python stress/soak.py bits --steps 1000000
    python stress/soak.py fuzz --calls 1000000
    python stress/soak.py steps --steps 4300000
    python stress/soak.py batch --steps 1000000000
    python stress/soak.py make --times 10000
    python stress/soak.py files --flips 100000
    python stress/soak.py properties --cases 10000 --seed 1
"""

from __future__ import annotations

import argparse
import copy
import pickle
import random
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import psutil

from npend_gym import Chain, Trajectory, simulate

COUNTS = (1, 2, 5, 10, 50)  # rods
SEEDS = 100
MAX_GROWTH = 8.0  # MiB after the first fifth
LANES = 4096  # of `batch`
LEAST = {"steps": 5, "batch": 5 * LANES, "make": 5}  # a look after each fifth
TESTS = str(Path(__file__).parent.parent / "tests")
_ENV = "npend_gym:NPendulum-v0"


def main() -> int:
    """Run what the command line names; return 1 where a promise is broken."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="what", required=True)
    for name, (_, option, default) in RUNS.items():
        command = commands.add_parser(name)
        command.add_argument(f"--{option}", dest="amount", type=int, default=default)
        command.add_argument("--seed", type=int, default=0, help="of fuzz and properties (0)")
    arguments = parser.parse_args()
    if arguments.amount < (least := LEAST.get(arguments.what, 1)):
        parser.error(f"{arguments.what} needs at least {least}, got {arguments.amount}")
    random.seed(arguments.seed)
    start_time = time.process_time()
    kept, text = RUNS[arguments.what][0](arguments.amount)
    took = time.process_time() - start_time
    print(f"{arguments.what}: {text}; {took:.0f} s of CPU time: {'kept' if kept else 'BROKEN'}")
    return 0 if kept else 1


def bits(steps: int) -> tuple[bool, str]:
    """Compare copies and lanes of vector envs with single envs, `steps` steps in total."""
    each = max(1, steps // (len(COUNTS) * SEEDS))
    differing = compared = 0
    for n in COUNTS:
        envs = gym.make_vec(_ENV, num_envs=SEEDS, n=n, max_episode_steps=None, threads=2)
        envs.reset(seed=0)
        actions = np.random.default_rng(n).uniform(-1.0, 1.0, (each, SEEDS, 1))
        lanes = [envs.step(action)[0] for action in actions]
        envs.close()
        for seed in range(SEEDS):
            env = gym.make(_ENV, n=n, max_episode_steps=-1)
            env.reset(seed=seed)
            ended = False
            for k in range(each):
                if k == each // 3:
                    env = copy.deepcopy(env)
                if k == each // 2:
                    env = pickle.loads(pickle.dumps(env))
                if ended:  # as the vector env resets itself; these actions make long chains diverge
                    observation, ended = env.reset()[0], False
                else:
                    observation, _, terminated, truncated, _ = env.step(actions[k, seed])
                    ended = terminated or truncated
                differing += int(
                    np.sum(observation.view(np.uint8) != lanes[k][seed].view(np.uint8))
                )
                compared += 1
    text = f"{differing} bytes differ over {compared} steps, {SEEDS} seeds, n = {COUNTS}"
    return differing == 0, text


def fuzz(calls: int) -> tuple[bool, str]:
    """Make random calls in random order; an undeclared error ends the run with its example."""
    sys.path.insert(0, TESTS)
    import test_promises_fuzz as fuzzing

    warnings.simplefilter("ignore")
    made, seeds, shown = {False: 0, True: 0}, random.getrandbits(32), time.monotonic()
    while sum(made.values()) < calls:
        extras = seeds % 4 > 0
        made[extras] += fuzzing.fuzz(100, seeds, extras=extras)
        seeds += 1
        if time.monotonic() - shown > 60.0:
            shown = time.monotonic()
            print(f"{sum(made.values())} calls so far, {made[True]} with keywords", flush=True)
    return True, (
        f"{sum(made.values())} calls answered or refused as declared, {made[True]} of them of "
        "environments with the keywords of carts, goals, motors, sensors, pushes and "
        "randomisation; all observations finite"
    )


def _watched(work: Callable[[int], Iterator[int]]) -> Callable[[int], tuple[bool, str]]:
    """Compare the memory, files and threads of the process after each fifth of some work."""

    def run(amount: int) -> tuple[bool, str]:
        process, held, done = psutil.Process(), [], 0
        for done in work(amount):  # noqa: B007
            now = process.num_fds(), process.num_threads(), len(process.children(recursive=True))
            held.append((process.memory_info().rss / 2**20, *now))
        growth = max(row[0] for row in held) - held[0][0]
        same = all(row[1:] == held[0][1:] for row in held)
        text = (
            f"{done} done, memory +{growth:.2f} MiB after the first fifth, descriptors, threads "
            f"and children {'the same' if same else [row[1:] for row in held]}"
        )
        return growth < MAX_GROWTH and same, text

    return run


@_watched
def steps(amount: int) -> Iterator[int]:
    """Step one env, resetting it whenever it ends."""
    env = gym.make(_ENV, n=2, dt=0.02)
    env.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (997, 1)).astype(np.float32)
    for k in range(1, amount + 1):
        _, _, terminated, truncated, _ = env.step(actions[k % 997])
        if terminated or truncated:
            env.reset()
        if k % (amount // 5) == 0:
            yield k


@_watched
def batch(amount: int) -> Iterator[int]:
    """Step a vector env with autoreset, in two threads."""
    envs = gym.make_vec(_ENV, num_envs=LANES, n=2, substeps=1, threads=2)
    envs.reset(seed=0)
    action = np.random.default_rng(0).uniform(-1.0, 1.0, (LANES, 1))
    calls = amount // LANES
    for k in range(1, calls + 1):
        envs.step(action)
        if k % (calls // 5) == 0:
            yield k * LANES
    envs.close()


@_watched
def make(amount: int) -> Iterator[int]:
    """Make, reset, step and close envs, single and vectorised."""
    for k in range(1, amount + 1):
        env: Any = gym.make_vec(_ENV, num_envs=3, threads=2) if k % 2 else gym.make(_ENV)
        env.reset(seed=k)
        env.step(env.action_space.sample())
        env.close()
        if k % (amount // 5) == 0:
            yield k


def files(flips: int) -> tuple[bool, str]:
    """Flip single bits of a trajectory's file; each must be refused, or change nothing read."""
    sys.path.insert(0, TESTS)
    from damage import flipped

    path = simulate(Chain.uniform(3), 1.0, 0.0, np.linspace(0.0, 5.0, 50))
    rng, refused, lies = np.random.default_rng(0), 0, 0
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "path.npz"
        path.save(file)
        whole = file.read_bytes()
        for damaged in flipped(whole, rng.integers(0, 8 * len(whole), flips).tolist()):
            file.write_bytes(damaged)
            try:
                read = Trajectory.load(file)
            except ValueError:
                refused += 1
                continue
            lies += not (
                np.array_equal(read.theta, path.theta)
                and np.array_equal(read.omega, path.omega)
                and np.array_equal(read.times, path.times)
                and (read.chain, read.provenance) == (path.chain, path.provenance)
            )
    return lies == 0, f"of {flips} flipped bits {refused} refused, {lies} read as something else"


def properties(cases: int) -> tuple[bool, str]:
    """Check the engine against itself; a case that breaks a property ends the run with it."""
    sys.path.insert(0, TESTS)
    import test_promises_symmetries as symmetries

    seed, count = random.getrandbits(32), len(symmetries.PROPERTIES)
    for name in symmetries.PROPERTIES:
        symmetries.run(name, -(-cases // count), seed)
    return True, f"{-(-cases // count)} cases of each of {count} properties, seed {seed}"


RUNS = {
    "bits": (bits, "steps", 1_000_000),
    "fuzz": (fuzz, "calls", 1_000_000),
    "steps": (steps, "steps", 4_300_000),
    "batch": (batch, "steps", 1_000_000_000),
    "make": (make, "times", 10_000),
    "files": (files, "flips", 10_000),
    "properties": (properties, "cases", 10_000),
}

if __name__ == "__main__":
    raise SystemExit(main())
