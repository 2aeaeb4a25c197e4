"""An interrupted step or reset is whole, undone, or refused until the next reset.

What survives an interrupt is compared with an environment that was never interrupted.
"""

import gc
import os
import random
import sys
import time
from collections import Counter
from contextlib import nullcontext
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import random_interrupts
from random_interrupts import GOOD, KINDS, LANES, Alarm, interrupt, same

import npend_gym
from npend_gym._threads import Helpers
from npend_gym.envs import NPendulumVectorEnv, ResetNeeded, SwingUp
from npend_gym.physics import Ensemble

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals")
PACKAGE = str(Path(npend_gym.__file__).parent)
LINES = 60  # of a call, at which it is interrupted; all where it has fewer
INTERRUPTS = 120  # of each kind, half of them by another process


@pytest.fixture(
    scope="module",
    params=[
        # the kernels of motors and sensors take long to compile
        pytest.param(name, marks=pytest.mark.long) if "noise" in name else name
        for name in KINDS
        if "env" in name
    ],
)
def envs(request):
    return KINDS[request.param]()


@pytest.fixture(autouse=True)
def no_garbage_collector():
    """An interrupt in its callbacks or in finalizers of other tests is lost and reported."""
    gc.collect()
    gc.disable()
    yield
    gc.enable()


@pytest.fixture
def alarm():
    clock = Alarm()
    yield clock
    clock.close()


@pytest.mark.parametrize("by_timer", [True, False], ids=["timer", "other process"])
def test_interrupts_at_random_instants_tear_no_environment(envs, alarm, by_timer):
    counted = interrupt(envs, alarm, INTERRUPTS // 2, 0, by_timer=by_timer)
    assert set(counted) <= set(GOOD), counted
    assert counted["refused"] > INTERRUPTS / 20, counted


@pytest.mark.long
@pytest.mark.parametrize(
    ("count", "seed"),
    [
        pytest.param(60, 0, id="other process", marks=pytest.mark.nightly),
        pytest.param(250, 1, id="timer"),
    ],
)
def test_hundreds_of_interrupts_in_processes_that_end_at_once_tear_nothing(
    count, seed, monkeypatch, capsys
):
    words = ["random_interrupts.py", f"--count={count}", f"--seed={seed}"]
    monkeypatch.setattr(sys, "argv", words)
    assert random_interrupts.main() == 0, capsys.readouterr().out


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


@pytest.mark.long
def test_an_interrupt_at_any_line_of_a_call_tears_no_environment(envs):
    for name, call in envs.calls.items():
        envs.begin()
        counter, counted = Tracer(), Counter()
        counter.interrupts(call)
        for line in range(1, counter.lines + 1, 1 + counter.lines // LINES):
            assert same(envs.begin(), envs.first)
            if Tracer(line).interrupts(call):  # with threads the number of lines is not fixed
                counted[envs.outcome(name)] += 1
        assert counted["torn"] == 0, (name, counted)
        assert counted["undone"] > 0, (name, counted)
        assert counted["refused"] > counted.total() / 4, (name, counted)


class Moody(SwingUp):
    """A user's mode that raises an error when it is told to."""

    broken = False

    def reward(self, quantities):
        if self.broken:
            raise ZeroDivisionError
        return quantities.height


@pytest.mark.parametrize("vector", [False, True])
def test_after_an_error_in_a_users_mode_a_reset_is_needed_and_options_persist(vector):
    mode = Moody()
    env = (
        gym.make_vec("NPendulum-v0", 2, mode=mode)
        if vector
        else gym.make("NPendulum-v0", mode=mode)
    )
    env.reset(seed=0, options={"theta": 0.3, "persist": True})
    action = np.zeros(env.action_space.shape)
    mode.broken = True
    with pytest.raises(ZeroDivisionError):
        env.step(action)
    mode.broken = False
    with pytest.raises(ResetNeeded, match=r"was interrupted: call reset\(\) before step\(\)"):
        env.step(action)
    assert np.all(env.reset()[1]["theta"] == 0.3)
    env.step(action)


@pytest.mark.long
def test_after_an_error_noise_is_kept_to_the_same_motors():
    mode = Moody()
    envs = NPendulumVectorEnv(2, n=2, actuated=(0, 1), mode=mode, torque_noise=0.3)
    envs.reset(seed=0)
    assert np.all(envs.step(np.zeros((2, 2)))[-1]["torque"] != 0.0)
    envs.set_noisy_motors(1)
    assert np.all(envs.step(np.zeros((2, 2)))[-1]["torque"][:, 1] == 0.0)
    for mode.broken in (False, True, False):
        envs.reset(seed=0)
        with pytest.raises(ZeroDivisionError) if mode.broken else nullcontext():
            torque = envs.step(np.zeros((2, 2)))[-1]["torque"]
    assert np.all(torque[:, 0] != 0.0)
    assert np.all(torque[:, 1] == 0.0)


def threads_of_this_process():
    return {path.name for path in Path("/proc/self/task").iterdir()}


def test_an_error_in_a_helping_thread_reaches_the_caller():
    def fails(worker, call):  # noqa: ARG001
        if worker:
            raise LookupError(worker)
        time.sleep(0.2)  # until the others are awake

    with pytest.raises(LookupError):
        Helpers(3).run(fails)


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
    chains.set_state(slice(None), theta, 0.5)
    for _ in range(2):
        chains.advance(0.3, 0.02, 40)
        known.append(chains.theta)
    began = time.perf_counter()
    advance()
    duration = time.perf_counter() - began
    draw, refused = random.Random(0), 0
    for tried in range(3000):
        if tried >= 150 and refused > 10:  # a busy machine needs more of them
            break
        if alarm.interrupts(advance, 1e-6 + 1.2 * duration * draw.random()):
            try:
                found = chains.theta
            except RuntimeError:
                refused += 1
                chains = make()
            else:
                assert any(np.array_equal(found, state) for state in known)
    assert refused > 10


@pytest.mark.long
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
