"""Reference controllers and evaluation against linear theory and closed forms."""

import gymnasium as gym
import numpy as np
import pytest
from scipy.stats import binomtest

import npend_gym  # noqa: F401 - registers the environments
from npend_gym import simulate
from npend_gym.rl import controllers
from npend_gym.rl.evaluation import evaluate, wilson_interval


def config_of(**keywords):
    return gym.make("NPendulum-v0", **keywords).unwrapped.config


def idle(observation, info):
    del info
    return np.zeros((len(observation), 1))


@pytest.mark.parametrize("angle", [0.0, np.pi])
def test_the_sampled_linear_map_is_what_the_chain_does_in_one_step(angle):
    config = config_of(n=3, mode="balance", damping=0.3)
    a, b = controllers.sampled(config, angle)
    rng = np.random.default_rng(0)
    small = 1e-5 * rng.normal(size=6)
    push = 1e-6
    motion = simulate(
        config.chain, angle + small[:3], small[3:], [0.0, config.dt],
        torque=push * config.max_torque,
    )  # fmt: skip
    after = np.concatenate([motion.theta[1] - angle, motion.omega[1]])
    np.testing.assert_allclose(after, a @ small + b[:, 0] * push, atol=1e-9)
    assert np.abs(b).max() * push > 1e-7


@pytest.mark.parametrize("n", [1, 2, 3])
def test_lqr_balances_every_held_out_start(n):
    keywords = {"n": n, "mode": "balance"}
    agent = controllers.lqr(config_of(**keywords))
    assert evaluate(agent, keywords, episodes=20).rate == 1.0
    assert evaluate(idle, keywords, episodes=20).rate == 0.0


def test_the_regulators_cost_is_the_cost_of_the_linear_system():
    config = config_of(n=2, mode="balance")
    gain, cost = controllers.riccati(config, np.pi, effort=2.0)
    a, b = controllers.sampled(config, np.pi)
    x = np.array([0.1, -0.2, 0.3, 0.1])
    expected, total = x @ cost @ x, 0.0
    for _ in range(3000):
        u = -gain @ x
        total += x[:2] @ x[:2] + x[2:] @ x[2:] / 9.81 + 2.0 * u @ u
        x = a @ x + b @ u
    assert total == pytest.approx(expected, rel=1e-9)


def test_swing_up_of_one_rod_always_stands_and_of_two_mostly():
    for n, least in ((1, 1.0), (2, 0.5)):
        keywords = {"n": n, "mode": "swingup"}
        agent = controllers.swing_up(config_of(**keywords))
        seen = evaluate(agent, keywords, episodes=40)
        assert seen.rate >= least
        assert seen.since[seen.success].max() <= 50.0


@pytest.mark.parametrize("n", [1, 2, 5])
def test_damping_calms_and_a_brake_of_other_strength_calms_slower(n):
    keywords = {"n": n, "mode": "calm", "amplitude": 0.05, "spread": 0.0}  # nearly linear
    config = config_of(**keywords)
    best = controllers.damper(config)
    assert evaluate(best, keywords, episodes=1).rate == 1.0
    left = {}
    for factor in (0.5, 1.0, 2.0):
        agent = controllers.StateFeedback(0.0, factor * best.gain)
        a, b = controllers.sampled(config, 0.0)
        left[factor] = np.abs(np.linalg.eigvals(a - b @ agent.gain)).max()
    assert left[1.0] < min(left[0.5], left[2.0])


def test_evaluation_measures_the_work_of_the_motor():
    # from rest, without gravity, a constant torque: energy = work, all of it positive
    keywords = {"n": 1, "mode": "swingup", "gravity": 0.0, "max_episode_steps": 40}
    config = config_of(n=1, gravity=0.0)
    seen = evaluate(lambda o, _: np.full((len(o), 1), 0.5), keywords, episodes=2)
    torque = 0.5 * config.max_torque
    omega = 0.05  # at most, at the start
    angle = 0.5 * torque * 2.0**2
    np.testing.assert_allclose(seen.spent, torque * angle, atol=torque * omega * 2.0)
    assert seen.as_row()["success"] == 0.0
    assert np.isnan(seen.since).all()


def test_evaluation_ends_every_episode_once():
    keywords = {"n": 1, "mode": "balance", "max_episode_steps": 300}
    seen = evaluate(idle, keywords, episodes=30)
    env = gym.make("NPendulum-v0", **keywords)
    for k in range(30):
        env.reset(seed=1_000_000 + k)
        total, over = 0.0, False
        while not over:
            _, reward, terminated, truncated, info = env.step(np.zeros(1))
            total, over = total + reward, terminated or truncated
        assert seen.returns[k] == pytest.approx(total, rel=1e-12)
        assert seen.success[k] == info["success"]


@pytest.mark.parametrize(("successes", "trials"), [(0, 100), (97, 100), (100, 100), (3, 7)])
def test_wilsons_interval_is_scipys(successes, trials):
    expected = binomtest(successes, trials).proportion_ci(method="wilson")
    assert wilson_interval(successes, trials) == pytest.approx(tuple(expected), abs=1e-12)


@pytest.mark.parametrize(("successes", "trials"), [(-1, 5), (6, 5), (0, 0)])
def test_impossible_counts_are_refused(successes, trials):
    with pytest.raises(ValueError, match=r"(successes|trials) must be"):
        wilson_interval(successes, trials)
