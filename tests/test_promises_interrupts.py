"""An interrupted step or reset is whole, undone, or refused until the next reset.

What survives an interrupt is compared with an environment that was never interrupted.
"""

import copy
import gc
import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import npend_gym
from npend_gym._threads import Helpers
from npend_gym.envs import Mode, ResetNeeded
from npend_gym.physics import Ensemble

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals")
PACKAGE = str(Path(npend_gym.__file__).parent)
LANES = 20  # more than one thread takes at once
INTERRUPTS = 260  # of each kind: more than a thousand in all
LINES = 60  # of a call, at which it is interrupted; all where it has fewer


class Situation:
    """An environment, calls that can be interrupted, and what it shows before and after them."""

    def __init__(self, threads=None, autoreset="NEXT_STEP"):
        options = {"n": 2, "substeps": 2}
        if threads is None:
            self.env = gym.make("NPendulum-v0", **options).unwrapped
            self.action, some = np.full(1, 0.4), {}
        else:
            options |= {"max_episode_steps": 2, "autoreset_mode": autoreset}
            self.env = gym.make_vec("NPendulum-v0", LANES, threads=threads, **options)
            self.action = np.linspace(-1.0, 1.0, LANES)[:, None]
            some = {"reset_mask": np.arange(LANES) % 3 == 0}
        others = {"lengths": 0.7, "damping": 0.1, "amplitude": 0.2}
        self.calls = {
            "step": self.step,
            "reset": lambda: self.env.reset(seed=4),
            "reset some": lambda: self.env.reset(options={"masses": 2.0, "theta": 0.3, **some}),
            "reset with other chains": lambda: self.env.reset(options=others),
        }
        self.first = self.begin()
        self.before = self.look()
        self.after = {name: self.looked_at_after(call) for name, call in self.calls.items()}

    def step(self):
        return self.env.step(self.action)

    def begin(self):
        """Begin from the same state; the vector env resets its lanes in the next step."""
        return copy.deepcopy([self.env.reset(seed=3), self.step(), self.step()])

    def look(self):
        """Return what comes next, draws of every generator among it."""
        return copy.deepcopy([self.step(), self.step(), self.step(), self.env.reset()])

    def looked_at_after(self, call):
        self.begin()
        call()
        return self.look()

    def outcome(self, name):
        """Return what has become of a call that was interrupted."""
        try:
            shown = self.look()
        except ResetNeeded:
            return "refused"
        if same(shown, self.before):
            return "undone"
        return "whole" if same(shown, self.after[name]) else "torn"


KINDS = {
    "single": Situation,
    "one thread": lambda: Situation(1),
    "two threads": lambda: Situation(2),
    "two threads, reset in the same step": lambda: Situation(2, "SAME_STEP"),
}


@pytest.fixture(scope="module", params=KINDS.values(), ids=KINDS)
def situation(request):
    return request.param()


def same(a, b):
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

    def __init__(self):
        self.armed = False
        self.handler = signal.signal(signal.SIGALRM, self.ring)

    def ring(self, *_):
        if self.armed:
            self.armed = False
            raise KeyboardInterrupt

    def interrupts(self, work, delay):
        """Run `work` and return whether it was interrupted."""
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


@pytest.fixture(autouse=True)
def no_callbacks_of_the_collector():
    """Hypothesis has one, in which an interrupt would be lost and reported as an error."""
    kept = gc.callbacks[:]
    gc.callbacks.clear()
    yield
    gc.callbacks[:] = kept


@pytest.fixture
def alarm():
    clock = Alarm()
    yield clock
    signal.signal(signal.SIGALRM, clock.handler)


def durations(situation):
    """Return how long each call takes [s]."""
    taken = {}
    for name, call in situation.calls.items():
        situation.begin()
        began = time.perf_counter()
        call()
        taken[name] = time.perf_counter() - began
    return taken


def test_a_thousand_interrupts_at_random_instants_tear_no_environment(situation, alarm):
    draw, counted, taken = random.Random(0), Counter(), durations(situation)
    while counted.total() < INTERRUPTS:
        name = draw.choice(["step", "step", *situation.calls])
        assert same(situation.begin(), situation.first)  # whatever happened before
        if alarm.interrupts(situation.calls[name], 1e-6 + 1.2 * taken[name] * draw.random()):
            counted[situation.outcome(name)] += 1
    assert counted["torn"] == 0, counted
    assert counted["refused"] > INTERRUPTS / 10, counted


class Tracer:
    """Raises KeyboardInterrupt at one of the lines that the package executes, and counts them."""

    def __init__(self, line=0):
        self.line, self.lines = line, 0

    def __call__(self, frame, event, _):
        if not frame.f_code.co_filename.startswith(PACKAGE):
            return None
        if event == "line":
            self.lines += 1
            if self.lines == self.line:
                raise KeyboardInterrupt
        return self

    def interrupts(self, work):
        """Run `work` and return whether it was interrupted."""
        before = sys.gettrace()
        sys.settrace(self)
        try:
            work()
        except KeyboardInterrupt:
            return True
        finally:
            sys.settrace(before)
        return False


def test_an_interrupt_at_any_line_of_a_call_tears_no_environment(situation):
    for name, call in situation.calls.items():
        situation.begin()
        counter, counted = Tracer(), Counter()
        counter.interrupts(call)
        for line in range(1, counter.lines + 1, 1 + counter.lines // LINES):
            assert same(situation.begin(), situation.first)
            if Tracer(line).interrupts(call):  # with threads the number of lines is not fixed
                counted[situation.outcome(name)] += 1
        assert counted["torn"] == 0, (name, counted)
        assert counted["undone"] > 0, (name, counted)
        assert counted["refused"] > counted.total() / 4, (name, counted)


class Moody(Mode):
    """A user's mode that raises an error when it is told to."""

    broken = False

    def start(self, rng, n, amplitude, spread):  # noqa: ARG002
        return rng.random(n), np.zeros(n)

    def reward(self, quantities):
        if self.broken:
            raise ZeroDivisionError
        return quantities.height


@pytest.mark.parametrize("vector", [False, True])
def test_after_an_error_in_a_users_mode_a_reset_is_needed(vector):
    mode = Moody()
    env = (
        gym.make_vec("NPendulum-v0", 2, mode=mode)
        if vector
        else gym.make("NPendulum-v0", mode=mode)
    )
    env.reset(seed=0)
    action = np.zeros(env.action_space.shape)
    mode.broken = True
    with pytest.raises(ZeroDivisionError):
        env.step(action)
    mode.broken = False
    with pytest.raises(ResetNeeded, match=r"was interrupted: call reset\(\) before step\(\)"):
        env.step(action)
    env.reset(seed=0)
    env.step(action)


def test_a_process_ends_at_once_after_two_hundred_interrupts_of_two_threads():
    code = f"""
import random, sys, time
sys.path.insert(0, {str(Path(__file__).parent)!r})
import test_promises_interrupts as here
alarm, situation, draw, count = here.Alarm(), here.Situation(2), random.Random(1), 0
while count < 200:
    situation.env.reset(seed=0)
    count += alarm.interrupts(situation.look, 1e-6 + 1e-3 * draw.random())
print(time.time())
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    assert time.time() - float(done.stdout) < 3.0
    assert done.stderr == ""


def threads_of_this_process():
    return {path.name for path in Path("/proc/self/task").iterdir()}


def test_helpers_share_the_work_and_pass_errors_on():
    helpers, done = Helpers(3), []
    for _ in range(50):
        items = iter(range(40))
        helpers.run(lambda worker, call: done.extend(items))  # noqa: ARG005, B023
    assert sorted(done) == sorted(list(range(40)) * 50)

    def fails(worker, call):  # noqa: ARG001
        if worker:
            raise LookupError(worker)
        time.sleep(0.2)  # until the others are awake

    with pytest.raises(LookupError):
        helpers.run(fails)


@pytest.mark.parametrize("threads", [1, 2])
def test_an_interrupted_ensemble_is_complete_or_unchanged_or_refuses(alarm, threads):
    def make():
        return Ensemble(npend_gym.Chain.uniform(2), LANES, threads=threads)

    def advance():
        chains.set_state(slice(None), theta, 0.5)
        chains.advance(0.3, 0.02, 40)
        chains.advance(0.3, 0.02, 40)

    theta = np.linspace(0.1, 1.0, 2 * LANES).reshape(LANES, 2)
    chains, known = make(), [np.zeros((LANES, 2)), theta]
    for steps in (1, 2):
        chains.set_state(slice(None), theta, 0.5)
        for _ in range(steps):
            chains.advance(0.3, 0.02, 40)
        known.append(chains.theta)
    began = time.perf_counter()
    advance()
    duration = time.perf_counter() - began
    draw, refused = random.Random(0), 0
    for _ in range(150):
        if alarm.interrupts(advance, 1e-6 + 1.2 * duration * draw.random()):
            try:
                found = chains.theta
            except RuntimeError:
                refused += 1
                chains = make()
            else:
                assert any(np.array_equal(found, state) for state in known)
    assert refused > 10


def test_pseudo_periods_in_two_threads_can_be_interrupted_at_any_instant(alarm):
    def measure():
        return npend_gym.pseudo_periods(chain, np.full((64, 2), 0.7), threads=2)

    chain = npend_gym.Chain.uniform(2)
    expected, draw, count = measure(), random.Random(0), 0
    began = time.perf_counter()
    measure()
    duration = time.perf_counter() - began
    while count < 100:
        count += alarm.interrupts(measure, 1e-6 + 1.2 * duration * draw.random())
    np.testing.assert_array_equal(measure(), expected)


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="Linux")
@pytest.mark.parametrize("closed", [True, False])
def test_the_threads_of_an_environment_end_with_it(closed):
    before = threads_of_this_process()
    env = gym.make_vec("NPendulum-v0", LANES, threads=2)
    env.reset(seed=0)
    env.step(np.zeros((LANES, 1)))
    begun = threads_of_this_process() - before
    assert len(begun) == 1
    if closed:
        env.close()
    del env
    gc.collect()
    began = time.perf_counter()
    while begun & threads_of_this_process():
        assert time.perf_counter() - began < 10.0, "a thread was left behind"
        time.sleep(0.05)
