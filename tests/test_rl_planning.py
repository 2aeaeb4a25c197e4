"""Planned swing-ups: the plan is a motion of the chain, and following it stands the chain up."""

import gymnasium as gym
import numpy as np
import pytest

import npend_gym  # noqa: F401 - registers the environments
from npend_gym import simulate
from npend_gym.rl.evaluation import evaluate
from npend_gym.rl.planning import LIMIT, planned_swing_up


def config_of(**keywords):
    return gym.make("NPendulum-v0", **keywords).unwrapped.config


@pytest.fixture(scope="module")
def triple():
    return planned_swing_up(config_of(n=3, mode="swingup"), seconds=5.0, tries=3)


def check_motion(config, plan):
    """Check steps of the plan by the adaptive method, which is not the environment's."""
    states, actions = plan
    for k in range(0, len(actions), 7):
        motion = simulate(
            config.chain, *np.split(states[k], 2), [0.0, config.dt],
            torque=float(actions[k, 0]) * config.max_torque,
        )  # fmt: skip
        reached = np.concatenate([motion.theta[1], motion.omega[1]])
        np.testing.assert_allclose(reached, states[k + 1], atol=1e-5)


def test_a_plan_is_a_motion_of_the_chain_from_hanging_to_upright(triple):
    config, (states, actions) = config_of(n=3, mode="swingup"), triple.plan
    assert np.abs(actions).max() <= LIMIT
    np.testing.assert_array_equal(states[0], 0.0)
    np.testing.assert_allclose(np.cos(states[-1, :3]), -1.0)
    np.testing.assert_array_equal(states[-1, 3:], 0.0)
    check_motion(config, triple.plan)


def test_a_plan_for_a_chain_in_air_has_the_drag_in_it():
    config = config_of(n=1, mode="swingup", drag=0.05, quadratic_drag=0.05)
    check_motion(config, planned_swing_up(config, seconds=4.0, tries=2).plan)


def test_three_rods_swung_up_by_the_base_alone_stand_in_held_out_episodes(triple):
    keywords = {"n": 3, "mode": "swingup", "max_episode_steps": 300}
    assert evaluate(triple, keywords, episodes=50).rate > 0.9


def test_without_its_feedback_the_plan_fails(triple):
    def replay(observation, info):
        k = np.rint(info["time"] / triple.dt).astype(int)
        inside = k < len(triple.plan.actions)
        planned = triple.plan.actions[np.minimum(k, len(triple.plan.actions) - 1)]
        return np.where(inside[:, None], planned, triple.stand(observation, info))

    keywords = {"n": 3, "mode": "swingup", "max_episode_steps": 300}
    assert evaluate(replay, keywords, episodes=20).rate < 0.1


def test_the_chain_is_calmed_first_where_that_is_asked_for():
    config = config_of(n=1, mode="swingup")
    agent = planned_swing_up(config, seconds=3.0, settle=4.0, tries=1)
    info = {"theta": np.full((3, 1), 0.1), "omega": np.zeros((3, 1))}
    before = agent(None, info | {"time": np.array([0.0, 1.0, 3.9])})
    np.testing.assert_array_equal(before, agent.hang(None, info))
    hanging = {"theta": np.zeros((1, 1)), "omega": np.zeros((1, 1))}
    begun = agent(None, hanging | {"time": np.full(1, 4.0)})
    np.testing.assert_allclose(begun[0], agent.plan.actions[0])


def test_where_the_torque_cannot_swing_the_chain_up_it_says_so():
    config = config_of(n=1, mode="swingup", max_torque=0.05)
    with pytest.raises(RuntimeError, match="no path of 1 s was found in 1 tries"):
        planned_swing_up(config, seconds=1.0, tries=1)
