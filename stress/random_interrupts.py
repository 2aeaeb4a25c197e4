"""Whether anything is torn, stuck or left behind by interrupts at random instants.

    python stress/random_interrupts.py --count 10000

Why: the exception of a signal, such as that of Ctrl-C, can be raised after any bytecode. Each kind
of work below runs in a process of its own, where a timer, or another process at moments of its own,
interrupts calls. What such a call leaves is compared with an environment that was never
interrupted: the call was whole, or undone, or the environment refuses to continue until it is
reset; functions must return the same bits the next time. Anything else is counted as torn, an error
other than KeyboardInterrupt as an error, a process that does not end within seconds as a hang.
POSIX only.
"""

from __future__ import annotations

import argparse
import copy
import faulthandler
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np

from npend_gym import Chain, pseudo_periods, simulate
from npend_gym.envs import ResetNeeded
from npend_gym.experiments import ReleaseExperiment, run_release

LANES = 20  # more than one thread takes at once
PER_PROCESS = 250  # interrupts
GOOD = ("whole", "undone", "refused")
_HANG, _EXIT = 120.0, 30.0  # s, of a call and of the end of a process, on a busy machine


class Envs:
    """An environment, calls that can be interrupted, and what it shows before and after them."""

    def __init__(self, threads: int | None = None, **keywords: Any) -> None:
        options: dict[str, Any] = {"n": 2, "substeps": 2, **keywords}
        some: dict[str, Any] = {}
        self.env: Any
        if threads is None:
            self.env = gym.make("npend_gym:NPendulum-v0", **options).unwrapped
            self.action = np.full(1, 0.4)
        else:
            options |= {"max_episode_steps": 2, "threads": threads}
            self.env = gym.make_vec("npend_gym:NPendulum-v0", LANES, **options)
            self.action = np.linspace(-1.0, 1.0, LANES)[:, None]
            some["reset_mask"] = np.arange(LANES) % 3 == 0
        others = {"lengths": 0.7, "damping": 0.1, "amplitude": 0.2}
        self.calls: dict[str, Callable[[], Any]] = {
            "step": self.step,
            "reset": lambda: self.env.reset(seed=4),
            "reset some": lambda: self.env.reset(options={"masses": 2.0, "theta": 0.3, **some}),
            "reset with other chains": lambda: self.env.reset(options=others),
        }
        self.first = self.begin()
        self.before = self.look()
        self.after = {name: self.looked_at_after(call) for name, call in self.calls.items()}

    def step(self) -> Any:
        """Take a step with the same action as always."""
        return self.env.step(self.action)

    def begin(self) -> Any:
        """Begin from the same state; the vector env resets its lanes in the next step."""
        return copy.deepcopy([self.env.reset(seed=3), self.step(), self.step()])

    def look(self) -> Any:
        """Return what comes next, draws of every generator among it."""
        return copy.deepcopy([self.step(), self.step(), self.step(), self.env.reset()])

    def looked_at_after(self, call: Callable[[], Any]) -> Any:
        """Return what comes after a call that was not interrupted."""
        self.begin()
        call()
        return self.look()

    def outcome(self, name: str) -> str:
        """Return what has become of a call that was interrupted."""
        try:
            shown = self.look()
        except ResetNeeded:
            return "refused"
        if same(shown, self.before):
            return "undone"
        return "whole" if same(shown, self.after[name]) else "torn"


class Function:
    """A function without a memory: after an interrupt it must return what it always returns."""

    def __init__(self, work: Callable[[], Any]) -> None:
        self.calls = {"call": work}
        self.first = self.begin()
        self.expected = work()

    def begin(self) -> None:
        """Do nothing: there is no state."""

    def outcome(self, name: str) -> str:
        """Return what has become of the function."""
        return "undone" if same(self.calls[name](), self.expected) else "torn"


def _simulated(members: int | None) -> Callable[[], Any]:
    theta = 1.0 if members is None else np.linspace(0.1, 2.0, 3 * members).reshape(members, 3)
    threads = 1 if members is None else 2
    times = np.linspace(0.0, 2.0, 21)

    def work() -> Any:
        motion = simulate(Chain.uniform(3), theta, 0.0, times, threads=threads)
        return [motion.theta, motion.omega, motion.counts]

    return work


def _released() -> list[Any]:
    runs = run_release(ReleaseExperiment(n_values=(2, 3), trials=2))
    return [run.periods for run in runs]


NOISY = {"angle_noise": 0.01, "observation_delay": 1.5, "motor_lag": 0.1, "push_rate": 1.0}
NOISY |= {"push_force": 1.0}
KINDS: dict[str, Callable[[], Any]] = {
    "single env": Envs,
    "vector env, one thread": lambda: Envs(1),
    "vector env, two threads": lambda: Envs(2),
    "vector env, two threads, reset in the same step": lambda: Envs(2, autoreset_mode="SAME_STEP"),
    "vector env, two threads, noise, delay, pushes": lambda: Envs(2, **NOISY),
    "simulate, one motion": lambda: Function(_simulated(None)),
    "simulate, 64 motions, two threads": lambda: Function(_simulated(64)),
    "pseudo_periods, one release": lambda: Function(lambda: pseudo_periods(Chain.uniform(3), 0.7)),
    "pseudo_periods, 64 releases, two threads": lambda: Function(
        lambda: pseudo_periods(Chain.uniform(2), np.full((64, 2), 0.7), threads=2)
    ),
    "run_release": lambda: Function(_released),
}


def same(a: Any, b: Any) -> bool:
    """Return whether nested results are equal to the last bit."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, (tuple, list)):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, np.ndarray) and a.dtype == object:
        return same(list(a), list(b))
    return np.array_equal(a, b)


class Alarm:
    """Raises KeyboardInterrupt from a signal's handler while some work is done."""

    def __init__(self) -> None:
        self.armed = False
        self.before = {
            number: signal.signal(number, self.ring) for number in (signal.SIGALRM, signal.SIGINT)
        }

    def ring(self, *_: Any) -> None:
        """Handle the signal."""
        if self.armed:
            self.armed = False
            raise KeyboardInterrupt

    def interrupts(self, work: Callable[[], Any], delay: float = 0.0) -> bool:
        """Run `work` and return whether it was interrupted, by the timer where there is a delay."""
        try:
            self.armed = True
            signal.setitimer(signal.ITIMER_REAL, delay)
            work()
            self.armed = False
        except KeyboardInterrupt:
            return True
        finally:
            self.armed = False
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        return False

    def close(self) -> None:
        """Put the handlers back."""
        for number, handler in self.before.items():
            signal.signal(number, handler)


_SENDER = """
import os, random, signal, sys, time
parent, gap, seed = int(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3])
draw = random.Random(seed)
while os.getppid() == parent:
    time.sleep(draw.expovariate(1.0 / gap))
    os.kill(parent, signal.SIGINT)
"""


def durations(kind: Any) -> dict[str, float]:
    """Return how long each call takes [s]."""
    taken: dict[str, float] = {}
    for name, call in kind.calls.items():
        kind.begin()
        began = time.perf_counter()
        call()
        taken[name] = time.perf_counter() - began
    return taken


def interrupt(kind: Any, alarm: Alarm, count: int, seed: int, *, by_timer: bool) -> Counter[str]:
    """Return what has become of `count` interrupted calls of a kind of work.

    They are interrupted by a timer, or else by signals that come whenever another process sends
    them.
    """
    draw, counted, taken = random.Random(seed), Counter[str](), durations(kind)
    names = [next(iter(kind.calls)), *kind.calls]  # every other one is the first, the step
    sender = None
    if not by_timer:
        gap = max(5e-4, 0.7 * max(taken.values()))
        words = [str(word) for word in (os.getpid(), gap, seed)]
        sender = subprocess.Popen([sys.executable, "-c", _SENDER, *words])
    try:
        while counted.total() < count:
            name = draw.choice(names)
            if not same(kind.begin(), kind.first):  # whatever happened before
                counted["torn"] += 1
            delay = 1e-6 + 1.2 * taken[name] * draw.random() if by_timer else 0.0
            faulthandler.dump_traceback_later(_HANG, exit=True)
            if alarm.interrupts(kind.calls[name], delay):
                counted[kind.outcome(name)] += 1
            faulthandler.cancel_dump_traceback_later()
    finally:
        if sender is not None:
            sender.kill()
            sender.wait()
    return counted


def _one_process(name: str, count: int, seed: int) -> Counter[str]:
    """Interrupt one kind of work in a process of its own; count what became of it."""
    command = [sys.executable, __file__, "--kind", name, "--count", str(count), "--seed", str(seed)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    ended = time.time()
    if done.returncode or done.stderr:
        print(f"{name}, seed {seed}: exit code {done.returncode}\n{done.stderr}", flush=True)
        return Counter({"hang" if "Timeout" in done.stderr else "error": 1})
    found = json.loads(done.stdout)
    return Counter(found["counted"]) + Counter(hang=int(ended - found["at"] > _EXIT))


def main() -> int:
    """Interrupt every kind of work in turn; return 1 where anything was torn."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=10_000, help="interrupts in all (10000)")
    parser.add_argument("--kind", choices=KINDS, help="only this one, in this process")
    parser.add_argument("--seed", type=int, default=0, help="of the instants (0)")
    options = parser.parse_args()
    if options.kind is not None:
        kind, alarm = KINDS[options.kind](), Alarm()
        counted = interrupt(kind, alarm, options.count, options.seed, by_timer=options.seed % 2 > 0)
        print(json.dumps({"counted": counted, "at": time.time()}))
        return 0
    total = Counter[str]()
    for place, name in enumerate(KINDS):
        left = (place + 1) * options.count // len(KINDS) - place * options.count // len(KINDS)
        counted, seed = Counter[str](), options.seed
        while left > 0:
            counted += _one_process(name, min(left, PER_PROCESS), seed)
            left, seed = left - PER_PROCESS, seed + 1
        print(f"{name}: {dict(counted)}", flush=True)
        total += counted
    bad = total.total() - sum(total[name] for name in GOOD)
    print(f"{total.total()} interrupts, {bad} bad: {dict(total)}")
    return int(bad > 0)


if __name__ == "__main__":
    raise SystemExit(main())
