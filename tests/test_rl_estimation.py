"""Controllers that are given angles alone: what the Kalman filter tells them, and what they do."""

import gymnasium as gym
import numpy as np
import pytest

from npend_gym import Cart, Chain
from npend_gym.rl import FromAngles, evaluate, lqr, planned_swing_up, reference_controller
from npend_gym.rl.evaluation.settings import setting_of
from npend_gym.rl.training.tasks import env_of_task

LINKS = Chain([1.0, 0.6], [0.8, 0.5], centres=0.3, inertias=0.02, friction=[0.0, 0.05])
MECHANISMS = {
    "bobs": {"n": 3},
    "links": {"chain": LINKS},
    "a cart": {"chain": Chain([0.2, 0.3], [0.5, 0.4], base=Cart(1.0, damping=0.1)), "base": "cart"},
}


class Reader:
    """Random actions, and the states that were read in `info`."""

    def __init__(self, joints):
        self._rng, self._joints = np.random.default_rng(0), joints
        self.read = []

    def __call__(self, _, info):
        self.read.append(np.concatenate([info[key].ravel() for key in ("theta", "omega")]))
        if "cart_velocity" in info:
            self.read[-1] = np.append(self.read[-1], info["cart_velocity"])
        return self._rng.uniform(-1.0, 1.0, (len(info["theta"]), self._joints))


@pytest.mark.parametrize(
    "mechanism", ["bobs", pytest.param("links", marks=pytest.mark.long), "a cart"]
)
def test_velocities_are_those_of_the_mechanism_as_soon_as_angles_tell_them(mechanism):
    keywords = {"mode": "swingup", "observe_velocities": False} | MECHANISMS[mechanism]
    envs = gym.make_vec("npend_gym:NPendulum-v0", num_envs=4, **keywords)
    config = envs.unwrapped.config
    reader = Reader(config.joints.size)
    act = FromAngles(reader, config)
    act.reset(4)
    observation, info = envs.reset(seed=0)
    for step in range(30):
        hidden = {key: info[key] for key in ("theta", "cart_position", "time") if key in info}
        action = act(observation, hidden)
        if step >= 8:
            true = np.concatenate([info["theta"].ravel(), info["omega"].ravel()])
            if config.has_cart:
                true = np.append(true, info["cart_velocity"])
            np.testing.assert_allclose(reader.read[-1], true, rtol=1e-3, atol=1e-3)
        observation, *_, info = envs.step(action)
    envs.close()


def test_noisy_angles_give_velocities_much_closer_than_their_differences_are():
    keywords = {"n": 2, "mode": "swingup", "observe_velocities": False, "angle_noise": 0.01}
    envs = gym.make_vec("npend_gym:NPendulum-v0", num_envs=8, **keywords)
    config, reader = envs.unwrapped.config, Reader(1)
    act, rng = FromAngles(reader, config), np.random.default_rng(1)
    _, info = envs.reset(seed=0)
    wrong, last, rough = [], None, []
    for step in range(60):
        seen = info["theta"] + rng.normal(0.0, 0.01, info["theta"].shape)
        action = act(None, {"theta": seen, "time": info["time"]})
        if step >= 10:
            estimate = reader.read[-1][seen.size :].reshape(seen.shape)
            wrong.append(estimate - info["omega"])
            rough.append((seen - last) / config.dt - info["omega"])
        last = seen
        info = envs.step(action)[-1]
    envs.close()
    assert np.std(wrong) < 0.3 * np.std(rough)


def test_a_new_episode_begins_at_rest_and_others_go_on():
    config = setting_of({"n": 1, "mode": "balance"}).config
    reader = Reader(1)
    act = FromAngles(reader, config)
    theta = np.array([[3.0], [3.0]])
    act(None, {"theta": theta, "time": np.array([0.0, 0.0])})
    act(None, {"theta": theta + 0.05, "time": np.array([config.dt, config.dt])})
    assert (reader.read[-1][2:] > 0.3).all()
    times = np.array([0.0, 2.0 * config.dt])  # the first was reset
    act(None, {"theta": np.array([[3.1], [3.1]]), "time": times})
    assert reader.read[-1][2] == 0.0
    assert reader.read[-1][3] > 0.3
    act.reset(1)
    act(None, {"theta": np.array([[3.1]]), "time": np.array([2.0 * config.dt])})
    assert reader.read[-1][1] == 0.0


def test_lqr_balances_on_angles_alone_also_with_few_torques_and_in_a_single_environment():
    task = {"n": 2, "mode": "balance", "observe_velocities": False}
    config = setting_of(task).config
    assert evaluate(FromAngles(lqr(config), config), task, episodes=10).success_rate == 1.0
    with pytest.raises(ValueError, match="got False: FromAngles"):
        evaluate(lqr(config), task, episodes=1)
    few = {"n": 1, "mode": "balance", "observe_velocities": False, "torque_levels": 9}
    config = setting_of(few).config
    assert evaluate(FromAngles(lqr(config), config), few, episodes=4).success_rate == 1.0
    env = gym.make("npend_gym:NPendulum-v0", **task)
    config = env.unwrapped.config
    act = FromAngles(lqr(config), config)
    observation, info = env.reset(seed=0)
    for _ in range(100):
        action = act(observation, {key: info[key] for key in ("theta", "time")})
        assert action.shape == (1,)
        observation, *_, info = env.step(np.clip(action, -1.0, 1.0))
    assert np.abs(info["theta"] - np.pi).max() < 0.01
    env.close()


def test_a_plan_swings_up_two_rods_on_angles_alone():
    task = {"n": 2, "mode": "swingup", "observe_velocities": False}
    config = setting_of(task).config
    plan = planned_swing_up(config, 3.0, tries=1, guess="mpc")
    assert evaluate(FromAngles(plan, config), task, episodes=10).success_rate == 1.0


@pytest.mark.nightly
@pytest.mark.long
def test_a_plan_swings_up_five_poles_on_a_cart_on_angles_alone():
    task = env_of_task("swingup-5-cart") | {"observe_velocities": False}
    act = FromAngles(reference_controller("plan", task), setting_of(task).config)
    assert evaluate(act, task, episodes=20).success_rate == 1.0


@pytest.mark.nightly
@pytest.mark.long
@pytest.mark.parametrize(
    ("n", "limits", "seconds", "seed"),
    [(6, {}, 18.0, 2), (7, {"max_force": 30.0, "rail": 4.0}, 14.0, 0)],
)
def test_a_plan_swings_up_six_and_seven_poles_also_on_angles_alone(n, limits, seconds, seed):
    task = env_of_task(f"swingup-{n}-cart") | {"dt": 0.025} | limits
    plan = planned_swing_up(setting_of(task).config, seconds, tries=1, guess="mpc", seed=seed)
    assert evaluate(plan, task, episodes=20).success_rate == 1.0
    blind = task | {"observe_velocities": False}
    act = FromAngles(plan, setting_of(blind).config)
    assert evaluate(act, blind, episodes=20).success_rate == 1.0


def test_what_cannot_be_estimated_is_refused_by_name():
    config = setting_of({"n": 1, "mode": "balance"}).config
    with pytest.raises(TypeError, match="controller must be callable"):
        FromAngles(None, config)
    with pytest.raises(TypeError, match="config must be the settings of an environment"):
        FromAngles(lqr(config), {"n": 1})
    with pytest.raises(ValueError, match="angle_std must be greater than zero, got 0"):
        FromAngles(lqr(config), config, angle_std=0.0)
    with pytest.raises(ValueError, match="action_std must be"):
        FromAngles(lqr(config), config, action_std=-1.0)
