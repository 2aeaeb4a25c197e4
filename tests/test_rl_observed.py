"""What controllers know of the state where sensors are not ideal: what these show."""

from functools import partial

import gymnasium as gym
import numpy as np
import pytest

import npend_gym  # noqa: F401 - registers the environments
from npend_gym.envs import EnvConfig
from npend_gym.rl import evaluate, lqr, performance, recovery
from npend_gym.rl.controllers.references import reference_controller

ERRORS = {
    "angle_noise": 0.2,
    "velocity_noise": 0.3,
    "observation_delay": 3,
    "angle_resolution": 0.1,
}
SWING = {"mode": "swingup", "n": 1, "max_episode_steps": 30}
JUDGES = {
    "evaluate": partial(evaluate, episodes=3),
    "performance": partial(performance, episodes=3, seconds=1.0),
    "recovery": partial(recovery, episodes=3, seconds=1.0, resets=0),
}


class Recorder:
    """Pushes in one direction, and keeps what it is given."""

    def __init__(self):
        self.given = []

    def __call__(self, observation, info):
        self.given.append((observation, info))
        return np.full((len(info["time"]), 1), 0.5)


@pytest.mark.parametrize("judge", JUDGES)
def test_controllers_are_given_the_state_that_sensors_show(judge):
    recorder, keywords = Recorder(), SWING | {"observation": "sincos"} | ERRORS
    JUDGES[judge](recorder, keywords)
    assert len(recorder.given) > 10
    theta = np.array([info["theta"][:, 0] for _, info in recorder.given])
    omega = np.array([info["omega"][:, 0] for _, info in recorder.given])
    seen = np.array([observation for observation, _ in recorder.given], np.float64)
    np.testing.assert_allclose(np.sin(theta), seen[:, :, 0], atol=1e-6)
    np.testing.assert_allclose(np.cos(theta), seen[:, :, 1], atol=1e-6)
    np.testing.assert_array_equal(omega, seen[:, :, 2])
    np.testing.assert_allclose(theta / 0.1, np.rint(theta / 0.1), atol=1e-4)  # rounded
    for _, info in recorder.given:
        np.testing.assert_allclose(info["tip_height"], -np.cos(info["theta"][:, 0]), atol=1e-12)
        kinetic, potential = 0.5 * info["omega"] ** 2, 9.81 * (1.0 - np.cos(info["theta"]))
        np.testing.assert_allclose(info["energy"], (kinetic + potential)[:, 0], atol=1e-9)


def test_where_sensors_are_ideal_controllers_know_the_exact_state_and_all_of_the_info():
    recorder = Recorder()
    evaluate(recorder, SWING, episodes=1, seed=3)
    env = gym.make("NPendulum-v0", **SWING)
    _, expected = env.reset(seed=3)
    for _, info in recorder.given:
        assert expected.keys() <= info.keys()
        assert info["theta"][0] == expected["theta"]
        expected = env.step(np.full(1, 0.5))[-1]


def test_in_environments_of_goals_the_observed_state_is_that_of_the_array():
    recorder = Recorder()
    task = {"mode": "transition", "n": 1, "goal_env": True, "reward_type": "sparse"}
    evaluate(recorder, task | {"max_episode_steps": 5, "angle_noise": 0.3}, episodes=3)
    for observation, info in recorder.given:
        shown = observation["observation"][:, 0]
        np.testing.assert_allclose(np.sin(info["theta"][:, 0]), np.sin(shown), atol=1e-6)
        assert info["goal"].shape == (3, 1)


def test_feedback_fails_where_its_sensors_show_too_little():
    task = {"mode": "balance", "n": 1}
    controller = lqr(EnvConfig(**task))
    task["max_episode_steps"] = 300
    assert evaluate(controller, task, episodes=3).success.all()
    blind = task | {"angle_resolution": 1.0, "angle_noise": 1.0, "observation_delay": 20}
    assert not evaluate(controller, blind, episodes=3).success.any()


@pytest.mark.long
def test_a_plan_fails_where_its_sensors_show_too_little():
    task = {"mode": "swingup", "n": 2, "observation": "sincos"}
    plan = reference_controller("plan", task)
    blind = task | {"angle_resolution": 1.0, "angle_noise": 1.0, "observation_delay": 20}
    assert evaluate(plan, task, episodes=10).success.all()
    assert not evaluate(plan, blind, episodes=10).success.any()


def test_what_no_sensor_shows_is_refused_with_a_way_out():
    noisy, hidden = SWING | {"angle_noise": 0.1}, SWING | {"observe_velocities": False}
    torque = lambda _, info: info["torque"]  # noqa: E731
    with pytest.raises(ValueError, match=r"model must read only what sensors show.*'torque'"):
        evaluate(torque, noisy, episodes=1)
    with pytest.raises(ValueError, match=r"observe_velocities must be True .*'omega'"):
        evaluate(lqr(EnvConfig(mode="swingup", n=1)), hidden, episodes=1)
    with pytest.raises(KeyError, match="nothing"):
        evaluate(lambda _, info: info["nothing"], noisy, episodes=1)
