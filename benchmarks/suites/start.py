"""The wait before the first step, each program in a process of its own, and in every call.

"Kept" means that an earlier process has compiled. Functions of users are compiled once in a
process: a call with one is compared with a call without.
"""

from __future__ import annotations

import math
import os
import statistics
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from npend_gym import Chain, Event, simulate
from suites.timing import Job, Peers, Row, rates

RUNS = 5
WORKERS = 8
OURS = "npend/SwingUp-v1"
# Run in a process: what is waited for, its own time [s], and its memory [MB]: on Linux that of the
# program alone, for `ru_maxrss` begins with the memory of the process that started it
STEP = """
import pathlib, re, resource, sys, time
{imports}
{make}
env.reset()
env.step({action})
most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
if sys.platform == "linux":
    status = pathlib.Path("/proc/self/status").read_text()
    most = int(re.search(r"VmHWM:\\s+(\\d+) kB", status)[1])
elif sys.platform == "darwin":
    most /= 1024
print(time.process_time(), most / 1024)
"""
GYMNASIUM = STEP.format(
    imports="import gymnasium as gym\n{package}",
    make="env = gym.make({env_id!r})",
    action="env.action_space.sample()",
)
DM_CONTROL = STEP.format(
    imports="from dm_control import suite\nimport numpy as np",
    make="env = suite.load('acrobot', 'swingup')",
    action="np.zeros(1)",
)
AT_ONCE = """
import time
from functools import partial
import gymnasium as gym
{package}
from stable_baselines3.common.vec_env import SubprocVecEnv

if __name__ == "__main__":
    begin = time.perf_counter()
    make = partial(gym.make, "{package_of}{env_id}")
    envs = SubprocVecEnv([make] * {workers}, start_method="spawn")
    envs.reset()
    print(time.perf_counter() - begin, 0)
    envs.close()
"""


class Started(NamedTuple):
    """The medians of some runs of a program."""

    seconds: float
    megabytes: float


def rows(peers: Peers) -> Iterator[Row]:
    """Yield the rows: starts of processes, then calls."""
    ours = GYMNASIUM.format(package="import npend_gym", env_id=OURS)
    started(ours)  # compiles, where nothing is kept
    kept = started(ours)
    yield from beside("make, reset, one step; code kept", kept, peers)
    with TemporaryDirectory() as folder:
        cold = started(ours, runs=1, NUMBA_CACHE_DIR=folder)
        cart = GYMNASIUM.format(package="import npend_gym", env_id="npend/CartDoublePole-v1")
        after = started(cart, runs=1, NUMBA_CACHE_DIR=folder)
    for name, took in (("nothing compiled", cold), ("poles on a cart after it", after)):
        yield alone(f"make, reset, one step; {name}", took)
    yield at_once()
    yield from calls()


def started(program: str, runs: int = RUNS, **environment: str) -> Started:
    """Run a program in processes of its own, and return what it measured."""
    found = [[float(word) for word in _run(program, environment).split()[-2:]] for _ in range(runs)]
    return Started(*(statistics.median(column) for column in zip(*found, strict=True)))


def _run(program: str, environment: dict[str, str]) -> str:
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", program], check=True, capture_output=True, text=True,
        env=os.environ | environment,
    )  # fmt: skip
    return done.stdout


def alone(job: str, took: Started) -> Row:
    """Return the row of a start that has no peer."""
    return Row(job, "", 1.0 / took.seconds, math.nan, _note(took))


def beside(job: str, ours: Started, peers: Peers) -> Iterator[Row]:
    """Yield the rows of a start beside those of other environments."""
    programs = {
        "Gymnasium Acrobot-v1": GYMNASIUM.format(package="", env_id="Acrobot-v1"),
        "Gymnasium InvertedDoublePendulum-v5": GYMNASIUM.format(
            package="", env_id="InvertedDoublePendulum-v5"
        ),
        "dm_control acrobot": DM_CONTROL,
    }
    for name, program in programs.items():
        theirs = peers.get(name, partial(started, program))
        if theirs is not None:
            note = f"{_note(ours)}; theirs {_note(theirs)}"
            yield Row(job, name, 1.0 / ours.seconds, 1.0 / theirs.seconds, note)


def _note(took: Started) -> str:
    return f"{took.seconds:.2f} s, {took.megabytes:.0f} MB"


def at_once() -> Row:
    """Return the row of several processes that are ready for their first step: wall time."""
    ours, theirs = (
        _of_file(AT_ONCE.format(package=package, package_of=of, env_id=env_id, workers=WORKERS))
        for package, of, env_id in (
            ("import npend_gym", "npend_gym:", OURS), ("", "", "Acrobot-v1")
        )
    )  # fmt: skip
    note = f"{ours:.2f} s; theirs {theirs:.2f} s"
    return Row(f"{WORKERS} workers of SubprocVecEnv", "Acrobot-v1", 1 / ours, 1 / theirs, note)


def _of_file(program: str) -> float:
    """Return what a program printed that must be a file, for its workers import it."""
    with TemporaryDirectory() as folder:
        path = os.path.join(folder, "program.py")  # noqa: PTH118
        with open(path, "w", encoding="utf-8") as file:  # noqa: PTH123
            file.write(program)
        found = [
            float(subprocess.run([sys.executable, path], check=True, capture_output=True, text=True)
                  .stdout.split()[-2])
            for _ in range(3)
        ]  # fmt: skip
    return statistics.median(found)


def calls() -> Iterator[Row]:
    """Yield the rows of calls with a function of the user's, beside the same call without."""
    chain, times = Chain.uniform(2), np.linspace(0.0, 10.0, 101)
    start = np.array([0.5, 0.3])
    several = np.tile(start, (100, 1)) + np.arange(100)[:, None] * 1e-3
    event = Event("angle", rod=0)

    def push(t: float) -> float:
        return 0.1 * math.sin(t)

    def shake(t: float) -> tuple[float, float]:
        return 0.0, 0.1 * math.sin(t)

    def free(**more: Any) -> Callable[[], object]:
        return lambda: simulate(chain, start, 0.0, times, **more)

    def many(**more: Any) -> Callable[[], object]:
        return lambda: simulate(chain, several, np.zeros_like(several), times, **more)

    def derived(**more: Any) -> Callable[[], object]:
        motion = simulate(chain, start, 0.0, times, **more)
        return motion.sensitivities

    pairs = {
        "simulate with torque=f": (free(), free(torque=push)),
        "simulate with pivot_acceleration=f": (free(), free(pivot_acceleration=shake)),
        "100 motions with torque=f": (many(), many(torque=push)),
        "100 motions with an Event": (many(), many(events=event)),
        "sensitivities of a motion with torque=f": (derived(), derived(torque=push)),
    }
    for name, (without, with_it) in pairs.items():
        found = rates(
            {"": Job(partial(_repeat, with_it)), "without": Job(partial(_repeat, without))}
        )
        more = 1e3 * (1.0 / found[""] - 1.0 / found["without"])
        yield Row(name, "without", found[""], found["without"], f"{more:.2f} ms more a call")


def _repeat(function: Callable[[], object], count: int) -> None:
    for _ in range(count):
        function()
