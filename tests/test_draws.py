"""Draws of starts are numpy's: of releases, of campaigns and of every environment."""

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from oracle import numpys_philox

from npend_gym.envs import EnvConfig
from npend_gym.experiments import CampaignPlan, ReleaseExperiment, starts
from npend_gym.experiments.studies.release_tables import measure_task


def numpys(seed, episode=0):
    """Return the draw by which an episode of an environment that is seeded so starts."""
    return np.random.Generator(numpys_philox(seed, episode=episode)).random()


@given(st.integers(0, 2**63 - 1), st.integers(0, 10**12))
@example(0, 0)
@example(2**64 - 2, 0)
@example(2**63 - 1, 10**12)
def test_the_draws_are_those_of_numpy_generators_of_successive_seeds(seed, first):
    expected = [numpys(seed + first + k) for k in range(3)]
    np.testing.assert_array_equal(starts(seed, first, 3, 0.0, 1.0), expected)


def test_a_hundred_thousand_draws_are_those_of_numpy():
    found = starts(5, 0, 100_000, 0.7, 0.017)
    for k in (0, 1, 65_535, 65_536, 99_999):
        assert found[k] == 0.7 + 0.017 * numpys(5 + k)


@pytest.mark.parametrize("n", [1, 3])
def test_release_campaign_and_environments_start_every_trial_alike(n):
    seed, trials = 40, 4
    expected = [0.6 + 0.02 * numpys(seed + t) for t in range(trials)]
    env = gym.make("NPendulum-v0", n=n, mode="passive", amplitude=0.6, spread=0.02)
    single = [env.reset(seed=seed + t)[1]["theta"][0] for t in range(trials)]
    lanes = gym.make_vec(
        "NPendulum-v0", num_envs=trials, n=n, mode="passive", amplitude=0.6, spread=0.02
    )
    vector = lanes.reset(seed=seed)[1]["theta"][:, 0].tolist()
    release = ReleaseExperiment(n_values=[n], trials=trials, amplitude=0.6, spread=0.02, seed=seed)
    plan = CampaignPlan(n=n, trials=trials, amplitude=0.6, spread=0.02, seed=seed)
    (task,) = plan.tasks()
    assert single == vector == [start for _, _, start in release.runs()] == expected
    assert measure_task(plan, task)[0].tolist() == expected


NEAR = {"swingup": 0.0, "balance": np.pi}


@pytest.mark.parametrize("mode", [*NEAR, "transition"])
@pytest.mark.parametrize("spread", [None, 0.001, 0.7])
def test_every_environment_starts_within_the_spread_of_an_equilibrium(mode, spread):
    keywords = {"n": 2, "mode": mode, "base": "cart", "spread": spread}
    envs = gym.make_vec("NPendulum-v0", num_envs=3, **keywords)
    vector = envs.reset(seed=11)[1]
    width = EnvConfig(mode=mode).spread if spread is None else spread
    for k in range(3):
        single = gym.make("NPendulum-v0", **keywords).reset(seed=11 + k)[1]
        state = [*single["theta"], *single["omega"]]
        state += [single["cart_position"], single["cart_velocity"]]
        drawn = np.random.Generator(numpys_philox(11 + k)).uniform(-width, width, 6)
        if mode == "transition":  # from which every rod hangs or stands
            start = np.round((state[:2] - drawn[:2]) / np.pi) * np.pi
        else:
            start = np.full(2, NEAR[mode])
        drawn[:2] += start
        np.testing.assert_array_equal(state, drawn)
        for name in ("theta", "omega", "cart_position", "cart_velocity"):
            np.testing.assert_array_equal(vector[name][k], single[name])


def test_later_episodes_start_from_streams_of_their_own():
    env = gym.make("NPendulum-v0", n=1, mode="passive", amplitude=0.0, spread=1.0)
    starts_drawn = [env.reset(seed=seed)[1]["theta"][0] for seed in (7, None, None)]
    assert starts_drawn == [numpys(7, episode) for episode in range(3)]
