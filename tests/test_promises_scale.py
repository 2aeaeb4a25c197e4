"""From one rod to a hundred thousand: memory and time grow in proportion."""

import pickle
import time
from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest

import npend_gym  # noqa: F401 - registers the environments
from npend_gym import Chain, simulate, theory

DECADES = (1000, 10_000, 100_000)


@pytest.mark.parametrize("n", [1, 2, 3, 64, *DECADES])
def test_chains_of_any_length_are_made_reset_and_stepped(n):
    env = gym.make("NPendulum-v0", n=n, substeps=2, dt=1e-3, max_torque=1.0)
    observation, _ = env.reset(seed=0)
    assert observation.shape == (2 * n,)
    for _ in range(3):
        observation, reward, terminated, truncated, info = env.step(np.ones(1, np.float32))
    assert env.observation_space.contains(observation)
    assert np.isfinite(reward)
    assert not terminated
    assert not truncated
    assert abs(info["energy_error"]) < 1e-6


def test_the_memory_of_an_environment_is_linear_in_n():
    sizes = [
        len(pickle.dumps(gym.make("NPendulum-v0", n=n, substeps=1).unwrapped)) for n in DECADES
    ]
    for small, large in pairwise(sizes):
        assert 5.0 < large / small < 20.0
    assert sizes[-1] < 1000 * DECADES[-1]  # bytes


def test_the_time_of_a_step_and_of_the_making_is_linear_in_n():
    spent = {}
    for n in DECADES:
        began = time.process_time()
        env = gym.make("NPendulum-v0", n=n, substeps=5, dt=1e-3, max_torque=1.0).unwrapped
        env.reset(seed=0)
        made = time.process_time() - began
        calls, action, best = 100_000 // n, np.ones(1), np.inf
        for _ in range(5):
            began = time.process_time()
            for _ in range(calls):
                env.step(action)
            best = min(best, (time.process_time() - began) / calls)
        spent[n] = made, best
    for small, large in pairwise(DECADES):
        assert spent[large][1] < 20.0 * spent[small][1]
    # a thousand rods take some tens of ms whatever they do
    assert spent[100_000][0] < 20.0 * spent[10_000][0] + 0.5


def test_the_fundamental_period_of_a_long_chain_is_its_law():
    chain = Chain.uniform(100_000)
    assert theory.fundamental_period(chain) == pytest.approx(
        theory.large_n_period(100_000), rel=1e-6
    )
    path = simulate(chain, 0.3, 0.0, [0.0, 0.01])
    assert np.ptp(path.energy()) < 1e-10 * path.energy()[0]
