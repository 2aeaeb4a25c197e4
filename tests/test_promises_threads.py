"""Two threads in one environment take turns or are refused; pools of threads survive a fork."""

import multiprocessing
import os
import sys
import threading
from collections import Counter

import gymnasium as gym
import numpy as np
import pytest

from npend_gym.envs import EnvInUse, SwingUp

LANES = 40
STEPS = 1000


def after(steps, lanes):
    """Return an environment after some steps, and the action of all of them."""
    options = {"n": 2, "substeps": 2, "amplitude": 0.1, "mode": "calm"}
    if lanes is None:
        env, action = gym.make("NPendulum-v0", **options).unwrapped, np.full(1, 0.4)
    else:
        env = gym.make_vec("NPendulum-v0", lanes, threads=2, max_episode_steps=None, **options)
        action = np.linspace(-1.0, 1.0, lanes)[:, None]
    env.reset(seed=0)
    for _ in range(steps):
        env.step(action)
    return env, action


@pytest.fixture
def quick_switches():
    """Python changes threads after every few instructions."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


@pytest.mark.usefixtures("quick_switches")
@pytest.mark.parametrize("lanes", [None, LANES])
def test_steps_of_two_python_threads_are_whole_or_refused(lanes):
    env, action = after(1, lanes)
    ready, rounds, outcomes = threading.Barrier(2), [], []

    def step():
        try:
            env.step(action)
        except EnvInUse:
            return "refused"
        return "done"

    def work():
        ready.wait()
        for _ in range(100):  # a busy machine may let one thread take its turn after the other
            rounds.append(STEPS)
            outcomes.extend([step() for _ in range(STEPS)])
            if "refused" in outcomes:
                return

    threads = [threading.Thread(target=work) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    counted = Counter(outcomes)
    other, _ = after(1 + counted["done"], lanes)
    np.testing.assert_array_equal(env.state, other.state)
    assert counted.total() == sum(rounds)
    assert counted["refused"] > 0


class Waiting(SwingUp):
    """A user's mode in which a step waits to be told to go on."""

    def __init__(self):
        self.inside, self.go_on = threading.Event(), threading.Event()
        self.go_on.set()

    def reward(self, quantities):
        self.inside.set()
        self.go_on.wait(20.0)
        return quantities.height


@pytest.mark.parametrize("vector", [False, True])
def test_calls_during_a_step_of_another_thread_are_refused_by_name(vector):
    mode = Waiting()
    if vector:
        env = gym.make_vec("NPendulum-v0", 2, mode=mode)
    else:
        env = gym.make("NPendulum-v0", mode=mode).unwrapped
    env.reset(seed=0)
    action = np.zeros(env.action_space.shape)
    env.step(action)
    state = env.get_state()
    mode.inside.clear()
    mode.go_on.clear()
    stepping = threading.Thread(target=env.step, args=(action,))
    stepping.start()
    assert mode.inside.wait(20.0)
    calls = {
        "step": lambda: env.step(action),
        "reset": env.reset,
        "get_state": env.get_state,
        "set_state": lambda: env.set_state(state),
        "state": lambda: env.state,
    }
    for name, call in calls.items():
        with pytest.raises(EnvInUse, match=rf"^{name}\(\) was called while another thread"):
            call()
    with pytest.raises(gym.error.AlreadyPendingCallError):
        env.reset()
    mode.go_on.set()
    stepping.join()
    env.step(action)
    assert np.all(env.reset(seed=0)[1]["time"] == 0.0)


def in_a_fork(work):
    """Return whether `work` returns True in a forked child within 60 s."""
    child = multiprocessing.get_context("fork").Process(target=lambda: os._exit(not work()))
    child.start()
    child.join(60.0)
    child.kill()
    return child.exitcode == 0


@pytest.mark.skipif(not hasattr(os, "fork"), reason="fork")
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")  # Python's, about threads
def test_an_environment_with_live_threads_works_after_a_fork():
    env, action = after(1, LANES)
    expected = after(3, LANES)[0].state

    def step_twice():
        env.step(action)
        env.step(action)
        return np.array_equal(env.state, expected)

    assert in_a_fork(step_twice)
    assert step_twice()  # here too
