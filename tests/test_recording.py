"""What is recorded to be shown."""

import gymnasium as gym
import numpy as np
import pytest

from npend_gym import Chain, pseudo_periods, simulate, theory
from npend_gym.experiments import ReleaseExperiment, Run, measure
from npend_gym.recording import (
    record_episode,
    record_motion,
    record_release,
    record_simulation,
)


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


@pytest.mark.parametrize("definition", ["bob", "link", "height"])
def test_the_signal_vanishes_where_a_pseudo_period_completes(definition):
    recording = recorded(interval=0.005, definition=definition, amplitude=0.5)
    signals, times = recording.signals(), recording.motion.times
    for bob in np.flatnonzero(np.isfinite(recording.periods)):
        after = np.searchsorted(times, recording.periods[bob])
        before, then = signals[after - 1 : after + 1, bob] / np.abs(signals[:, bob]).max()
        # a height may only touch that of the start
        assert before * then <= 0.0 or (definition == "height" and abs(before) < 1e-3)


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


@pytest.mark.parametrize(
    "more", [{}, {"base": "cart"}, {"randomize": {"lengths": (0.5, 1.5)}}],
    ids=["pivot", "cart", "drawn chain"],
)  # fmt: skip
def test_an_episode_is_recorded_step_by_step(more):
    def agent(observation, info):
        assert observation.shape == (1, 6 if "base" in more else 4)
        assert info["theta"].shape == (1, 2)
        return np.array([[np.sin(3.0 * info["time"][0])]])

    keywords = {"n": 2, "mode": "swingup"} | more
    recording = record_episode(agent, keywords, seed=5, seconds=2.0, name="sine")
    env = gym.make("NPendulum-v0", **keywords)
    infos = [env.reset(seed=5)[1]]
    torque = np.sin(0.15 * np.arange(40))
    infos += [env.step(np.array([each], np.float32))[-1] for each in torque]
    motion = recording.motion
    np.testing.assert_allclose(motion.times, 0.05 * np.arange(41), atol=1e-12)
    np.testing.assert_allclose(motion.theta, [info["theta"] for info in infos], atol=1e-9)
    np.testing.assert_allclose(motion.energy(), [info["energy"] for info in infos], rtol=1e-9)
    np.testing.assert_allclose(recording.torque[:40], torque, atol=1e-6)
    places = np.array([info.get("cart_position", 0.0) for info in infos])
    tips = recording.positions()[:, -1]
    np.testing.assert_allclose(tips[:, 1], [info["tip_height"] for info in infos], atol=1e-9)
    np.testing.assert_allclose(tips[:, 0] - motion.positions()[:, -1, 0], places, atol=1e-15)
    assert recording.caption == "swingup by sine, n = 2"
    if "base" in more:
        assert np.ptp(places) > 0.05
        np.testing.assert_array_equal(recording.cart(), places)
        assert (recording.joint, recording.rail) == (2, env.unwrapped.config.rail)


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
        pytest.param(
            {"action_delay": 1, "base": "cart"},
            [0.5],
            [0.0, 0.5, 0.5, 0.5],
            marks=pytest.mark.long,
        ),
        ({"randomize": {"max_torque": (0.5, 0.6)}}, [0.5], [0.5, 0.5, 0.5, 0.5]),
    ],
)
def test_the_torque_that_the_motor_exerts_is_recorded(keywords, action, expected):
    keywords = {"n": 1, "mode": "swingup"} | keywords
    recording = record_episode(lambda *_: np.array([action]), keywords, seconds=0.15)
    np.testing.assert_allclose(recording.torque, expected, atol=1e-12)


def test_an_action_that_is_no_integer_is_none_of_an_episode_that_is_recorded():
    with pytest.raises(TypeError, match="action must hold integers"):
        record_episode(lambda *_: np.array([0.9]), {"n": 1, "torque_levels": 3}, seconds=0.1)


def test_an_episode_that_fails_ends_the_recording():
    def idle(_observation, _info):
        return np.zeros((1, 1))

    recording = record_episode(idle, {"n": 1, "mode": "balance"}, seconds=60.0)
    assert 0.5 < recording.motion.times[-1] < 10.0
    tip = recording.motion.positions()[:, -1, 1]
    assert tip[-1] < 0.5 <= tip[:-1].min()


def test_pseudo_periods_are_asked_for_of_releases_alone():
    chain = Chain.uniform(2)
    assert record_simulation(chain, 0.7, 0.0, 1.0, 0.1)[0].timed
    assert not record_simulation(chain, 0.7, 1.0, 1.0, 0.1)[0].timed
    assert not record_motion(simulate(chain, 0.7, 0.0, [0.0, 1.0])).timed
    for mode, timed in (("passive", True), ("swingup", False)):
        wait = np.zeros(1, int) if timed else np.zeros((1, 1))
        swung = record_episode(lambda *_, wait=wait: wait, {"mode": mode, "n": 1}, seconds=6.0)
        assert swung.timed == timed


def test_passive_episodes_measure_what_the_release_measures():
    def wait(_observation, _info):
        return np.zeros(1, int)

    keywords = {"n": 3, "mode": "passive", "spread": 0.0}
    recording = record_episode(wait, keywords, seconds=5.0)
    expected = pseudo_periods(Chain.uniform(3), np.pi / 4)
    np.testing.assert_allclose(recording.periods, expected, atol=1e-5)


def simulated(theta=0.5, omega=0.0, **more):
    return record_simulation(Chain.uniform(1), theta, omega, 1.0, 0.1, **more)


@pytest.mark.parametrize(
    ("record", "change", "message"),
    [
        (recorded, {"interval": 0.0}, "interval must be greater than zero"),
        (recorded, {"interval": 1e-9}, "a recording must hold at most"),
        (simulated, {"theta": np.ones((2, 1))}, "theta must"),
        (simulated, {"omega": [1.0, 2.0]}, "omega must"),
        (simulated, {"definition": "foo", "omega": 1.0}, "definition must be one of"),
    ],
)
def test_what_cannot_be_recorded_is_refused(record, change, message):
    with pytest.raises(ValueError, match=message):
        record(**change)


def test_a_recording_needs_an_interval():
    with pytest.raises(ValueError, match="intervals must be one or more"):
        record_simulation(Chain.uniform(1), 0.5, 0.0, 1.0)


def test_a_pseudo_period_is_nan_where_the_recording_ends_before_it():
    rough, fine = record_simulation(Chain.uniform(1), 0.5, 0.0, 2.1, 1.5, 0.1)
    assert rough.motion.times[-1] == 1.5
    np.testing.assert_array_equal(rough.periods, [np.nan])
    assert fine.periods == pytest.approx(theory.pendulum_period(0.5, 1.0))


def test_a_release_that_completes_nothing_is_recorded_for_the_papers_window():
    plan = ReleaseExperiment(n_values=[2], trials=1, gravity=0.0)
    recording = record_release(plan, Run(2, 1, 0.7, np.full(2, np.nan)), 0.5)
    assert recording.motion.times[-1] == 10.0
