"""What is recorded to be shown."""

import gymnasium as gym
import numpy as np
import pytest

from npend_gym import Chain, pseudo_periods, simulate, theory
from npend_gym.experiments import ReleaseExperiment, Run, measure
from npend_gym.recording import record_episode, record_release, record_simulation


def recorded(interval=0.02, **fields):
    plan = ReleaseExperiment(**({"n_values": [3], "trials": 1} | fields))
    return record_release(plan, measure(plan, *plan.runs()[0]), interval)


def test_a_release_is_recorded_until_its_last_bob_has_completed():
    recording = recorded()
    expected = pseudo_periods(Chain.uniform(3), recording.motion.theta[0])
    np.testing.assert_array_equal(recording.periods, expected)
    assert expected.max() < recording.motion.times[-1] < 1.1 * expected.max()


@pytest.mark.parametrize(("interval", "last"), [(0.5, 1.5), (0.4, 1.2), (7.0, 7.0)])
def test_a_recording_ends_at_its_end_or_at_the_next_instant(interval, last):
    times = recorded(interval=interval, duration=1.2).motion.times
    assert times[0] == 0.0
    assert times[-1] == pytest.approx(last, abs=1e-12)


def test_the_recorded_motion_is_the_simulated_one():
    motion = recorded(duration=3.0).motion
    again = simulate(Chain.uniform(3), motion.theta[0], 0.0, [0.0, 1.0, 3.0])
    np.testing.assert_allclose(motion.theta[[0, 50, 150]], again.theta, atol=1e-9)


@pytest.mark.parametrize("reading", ["bob", "link", "height"])
def test_the_signal_vanishes_where_a_pseudo_period_completes(reading):
    recording = recorded(interval=0.005, reading=reading, amplitude=0.5)
    signals, times = recording.signals(), recording.motion.times
    for bob in np.flatnonzero(np.isfinite(recording.periods)):
        after = np.searchsorted(times, recording.periods[bob])
        before, then = signals[after - 1 : after + 1, bob] / np.abs(signals[:, bob]).max()
        # a height may only touch that of the start
        assert before * then <= 0.0 or (reading == "height" and abs(before) < 1e-3)


def test_turning_points_lie_where_the_bobs_are_at_that_instant():
    recording = recorded()
    chain, start = recording.motion.chain, recording.motion.theta[0]
    for bob, period in enumerate(recording.periods):
        place = simulate(chain, start, 0.0, [0.0, period]).positions()[-1, bob]
        np.testing.assert_allclose(recording.turning_points()[bob], place, atol=1e-3)


def test_bobs_that_have_not_completed_have_no_turning_point():
    recording = recorded(n_values=[20], duration=5.0)
    done = np.isfinite(recording.periods)
    assert 0 < done.sum() < 20
    np.testing.assert_array_equal(np.isnan(recording.turning_points()[:, 0]), ~done)


def test_the_provenance_makes_the_same_recording_again():
    recording = recorded(masses=[1.0, 2.0, 0.5], seed=4, duration=1.0)
    arguments = dict(recording.provenance["arguments"])
    trial, start = arguments.pop("trial"), arguments.pop("start")
    plan = ReleaseExperiment(**arguments)
    assert plan.runs() == [(3, trial, start)]
    again = record_release(plan, measure(plan, 3, trial, start), 0.02)
    np.testing.assert_array_equal(again.motion.theta, recording.motion.theta)


def test_an_episode_is_recorded_step_by_step():
    def agent(observation, info):
        assert observation.shape == (1, 4)
        assert info["theta"].shape == (1, 2)
        return np.array([[np.sin(3.0 * info["time"][0])]])

    keywords = {"n": 2, "mode": "swingup"}
    recording = record_episode(agent, keywords, seed=5, seconds=2.0, name="sine")
    env = gym.make("NPendulum-v0", **keywords)
    env.reset(seed=5)
    for k in range(40):
        _, _, _, _, info = env.step(np.array([np.sin(3.0 * 0.05 * k)], np.float32))
    np.testing.assert_allclose(recording.motion.times, 0.05 * np.arange(41), atol=1e-12)
    np.testing.assert_allclose(recording.motion.theta[-1], info["theta"], atol=1e-9)
    np.testing.assert_allclose(recording.torque[:40], np.sin(0.15 * np.arange(40)), atol=1e-6)
    assert recording.caption == "swingup by sine, n = 2"


def test_an_episode_with_a_goal_is_recorded():
    def agent(observation, _):
        assert observation["desired_goal"].shape == (1, 2)
        return np.array([[0.5]])

    keywords = {"n": 1, "mode": "transition", "goal_env": True, "reward_type": "sparse"}
    assert record_episode(agent, keywords, seconds=0.5).torque.tolist() == [0.5] * 11


@pytest.mark.parametrize(
    ("keywords", "action", "expected"),
    [
        ({"torque_levels": 3}, 0, [-1.0, -1.0, -1.0, -1.0]),
        ({"action_delay": 2}, [2.0], [0.0, 0.0, 1.0, 1.0]),
        ({"action_delay": 1, "base": "cart"}, [0.5], [0.0, 0.5, 0.5, 0.5]),
        ({"randomize": {"max_torque": (0.5, 0.6)}}, [0.5], [0.5, 0.5, 0.5, 0.5]),
    ],
)
def test_the_torque_that_the_motor_exerts_is_recorded(keywords, action, expected):
    keywords = {"n": 1, "mode": "swingup"} | keywords
    recording = record_episode(lambda *_: np.array([action]), keywords, seconds=0.15)
    np.testing.assert_allclose(recording.torque, expected, atol=1e-12)


def test_an_episode_that_fails_ends_the_recording():
    def idle(_observation, _info):
        return np.zeros((1, 1))

    recording = record_episode(idle, {"n": 1, "mode": "balance"}, seconds=60.0)
    assert 0.5 < recording.motion.times[-1] < 10.0
    tip = recording.motion.positions()[:, -1, 1]
    assert tip[-1] < 0.5 <= tip[:-1].min()


def test_passive_episodes_measure_what_the_release_measures():
    def wait(_observation, _info):
        return np.zeros(1, int)

    keywords = {"n": 3, "mode": "passive", "spread": 0.0}
    recording = record_episode(wait, keywords, seconds=5.0)
    expected = pseudo_periods(Chain.uniform(3), np.pi / 4)
    np.testing.assert_allclose(recording.periods, expected, atol=1e-5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"interval": 0.0}, "interval must be greater than zero"),
        ({"interval": 1e-9}, "a recording must hold at most"),
    ],
)
def test_what_cannot_be_recorded_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        recorded(**change)


def test_a_pseudo_period_is_nan_where_the_recording_ends_before_it():
    rough, fine = record_simulation(Chain.uniform(1), 0.5, 0.0, 2.1, 1.5, 0.1)
    assert rough.motion.times[-1] == 1.5
    np.testing.assert_array_equal(rough.periods, [np.nan])
    assert fine.periods == pytest.approx(theory.pendulum_period(0.5, 1.0))


@pytest.mark.parametrize(("change", "error"), [
    ({"theta": np.ones((2, 1))}, "theta must"),
    ({"omega": [1.0, 2.0]}, "omega must"),
    ({"reading": "foo", "omega": 1.0}, "reading must be one of"),
])  # fmt: skip
def test_a_simulation_that_cannot_be_recorded_is_refused(change, error):
    theta, omega, reading = ({"theta": 0.5, "omega": 0.0, "reading": "bob"} | change).values()
    with pytest.raises(ValueError, match=error):
        record_simulation(Chain.uniform(1), theta, omega, 1.0, 0.1, reading=reading)


def test_a_release_that_completes_nothing_is_recorded_for_the_papers_window():
    plan = ReleaseExperiment(n_values=[2], trials=1, gravity=0.0)
    recording = record_release(plan, Run(2, 1, 0.7, np.full(2, np.nan)), 0.5)
    assert recording.motion.times[-1] == 10.0


def test_an_episode_on_a_cart_has_the_way_of_the_cart_and_the_force_on_it():
    def push(_observation, info):
        return np.array([[0.4]]) * np.cos(2.0 * info["time"][0])

    keywords = {"n": 2, "mode": "swingup", "base": "cart"}
    recording = record_episode(push, keywords, seed=3, seconds=2.0)
    env = gym.make("NPendulum-v0", **keywords)
    _, info = env.reset(seed=3)
    places = [info["cart_position"]]
    for k in range(40):
        action = np.array([0.4 * np.cos(2.0 * 0.05 * k)], np.float32)
        info = env.step(action)[-1]
        places.append(info["cart_position"])
    assert np.ptp(places) > 0.05
    np.testing.assert_array_equal(recording.cart(), places)
    tips = recording.positions()[:, -1] - recording.motion.positions()[:, -1]
    np.testing.assert_allclose(tips, np.column_stack([places, np.zeros(41)]), atol=1e-15)
    assert (recording.joint, recording.rail) == (2, env.unwrapped.config.rail)
    np.testing.assert_allclose(recording.motion.energy()[-1], info["energy"], rtol=1e-12)
    np.testing.assert_allclose(recording.torque[:3], 0.4 * np.cos([0.0, 0.1, 0.2]), atol=1e-6)


def test_an_episode_is_recorded_with_the_chain_that_was_drawn_for_it():
    keywords = {"n": 2, "mode": "swingup", "randomize": {"lengths": (0.5, 1.5)}}
    recording = record_episode(lambda *_: np.zeros((1, 1)), keywords, seed=3, seconds=1.0)
    env = gym.make("NPendulum-v0", **keywords)
    _, info = env.reset(seed=3)
    assert recording.motion.energy()[0] == pytest.approx(info["energy"], rel=1e-9)
    assert recording.positions()[0, -1, 1] == pytest.approx(info["tip_height"], rel=1e-9)
