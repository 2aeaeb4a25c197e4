"""Mode "transition": from any equilibrium to any other, with the goal beside the observation."""

import importlib
import itertools

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from lanes import actions_for, assert_same

from npend_gym import Chain, rl
from npend_gym._streams import Purpose
from npend_gym.compiled.philox import generator
from npend_gym.envs import NPendulumEnv, NPendulumVectorEnv, Transition

GOAL_ENV = {"goal_env": True, "reward_type": "sparse"}


class Nearest(Transition):
    """A task that is judged in Python."""

    def reward(self, quantities):
        """Return how near the worst rod is to its goal."""
        return 1.0 - 0.5 * quantities.goal_distance


def equilibria(theta):
    """Return the nearest multiples of pi, as numbers 0 or 1."""
    assert np.allclose(theta, np.pi * np.rint(theta / np.pi), atol=0.05)
    return np.rint(theta / np.pi).astype(int)


def cosines(angles):
    return np.cos(np.asarray(angles))


# -- starts and goals -----------------------------------------------------------------------


def test_starts_and_goals_are_drawn_as_numpy_draws_them_and_starts_stay_what_they_are():
    envs, hanging = NPendulumVectorEnv(200, n=2, mode="transition"), NPendulumVectorEnv(200, n=2)
    for episode, seed in enumerate((3, None)):
        info, deviation = envs.reset(seed=seed)[1], hanging.reset(seed=seed)[1]
        for lane in range(200):
            rng = generator(3 + lane, 0, Purpose.GOAL, episode)
            start = goal = rng.random(2) >= 0.5
            while np.array_equal(goal, start):
                goal = rng.random(2) >= 0.5
            np.testing.assert_array_equal(info["goal"][lane], np.pi * goal)
            np.testing.assert_array_equal(equilibria(info["theta"][lane]), start)
        start = equilibria(info["theta"])
        expected = np.pi * start + deviation["theta"]
        np.testing.assert_allclose(info["theta"], expected, rtol=0.0, atol=1e-15)
        np.testing.assert_array_equal(info["omega"], deviation["omega"])


def test_options_choose_start_and_goal_and_what_is_not_chosen_is_drawn():
    env = NPendulumEnv(n=3, mode="transition")
    start, goal = np.array([0.0, np.pi, 0.0]), [np.pi, np.pi, 0.0]
    for _ in range(8):
        info = env.reset(options={"start": start, "goal": goal})[1]
        np.testing.assert_array_equal(np.pi * equilibria(info["theta"]), start)
        np.testing.assert_array_equal(info["goal"], goal)
        info = env.reset(options={"start": start + 9e-7})[1]
        np.testing.assert_array_equal(np.pi * equilibria(info["theta"]), start)
        assert not np.array_equal(info["goal"], start)
        info = env.reset(options={"goal": 0.0})[1]
        assert not np.array_equal(equilibria(info["theta"]), [0, 0, 0])
        np.testing.assert_array_equal(info["goal"], [0.0, 0.0, 0.0])
    goals = {tuple(env.reset()[1]["goal"]) for _ in range(40)}
    assert len(goals) > 4  # options hold for one episode
    env.reset(options={"goal": goal, "persist": True})
    drawn = [env.reset()[1] for _ in range(20)]
    assert {tuple(info["goal"]) for info in drawn} == {tuple(goal)}
    assert len({tuple(equilibria(info["theta"])) for info in drawn}) > 3


def test_options_of_lanes_are_their_own():
    envs = NPendulumVectorEnv(4, n=2, mode="transition")
    every = np.pi * np.array(list(itertools.product([0, 1], repeat=2)))
    info = envs.reset(options={"start": every, "goal": every[::-1]})[1]
    np.testing.assert_array_equal(np.pi * equilibria(info["theta"]), every)
    np.testing.assert_array_equal(info["goal"], every[::-1])


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"goal": [0.0, 1.0]}, ValueError, r"options\['goal'\] must be an equilibrium: 0 .*1.0"),
        ({"start": [np.pi, 2e-6]}, ValueError, r"options\['start'\] must be an equilibrium"),
        ({"goal": [0.0, -np.pi]}, ValueError, r"options\['goal'\] must be an equilibrium"),
        ({"goal": [0.0, np.nan]}, ValueError, r"options\['goal'\]"),
        ({"goal": [0.0, 0.0, 0.0]}, ValueError, r"options\['goal'\]"),
        ({"goal": "up"}, TypeError, r"options\['goal'\]"),
        ({"goal": 0.0, "start": 0.0}, ValueError, "must differ .* for both; leave one out"),
    ],
)
def test_what_is_no_goal_is_refused_and_changes_nothing(options, error, message):
    env = NPendulumEnv(mode="transition")
    env.reset(seed=1)
    before = env.get_state().tobytes()
    with pytest.raises(error, match=message):
        env.reset(options=options)
    assert env.get_state().tobytes() == before
    with pytest.raises(ValueError, match=r"options must be among .*got \['goal'\]"):
        NPendulumEnv().reset(options={"goal": 0.0})


# -- reward and success ---------------------------------------------------------------------


def test_with_the_goal_upright_it_is_the_swing_up():
    keywords = {"num_envs": 5, "n": 3, "masses": [1.0, 0.3, 2.0], "observation": "sincos"}
    ours, theirs = NPendulumVectorEnv(mode="transition", **keywords), NPendulumVectorEnv(**keywords)
    shown = ours.reset(seed=2, options={"start": 0.0, "goal": np.pi})[0]
    np.testing.assert_array_equal(shown[:, :9], theirs.reset(seed=2)[0])
    np.testing.assert_array_equal(shown[:, 9:], -np.ones((5, 3)))
    for action in actions_for(ours, 50):
        mine, reference = ours.step(action), theirs.step(action)
        np.testing.assert_array_equal(mine[0][:, :9], reference[0])
        np.testing.assert_allclose(mine[1], reference[1], rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(
    "chain",
    [
        Chain([1.0, 0.3], [0.5, 2.0]),
        pytest.param(Chain([1.0, 1.0], 1.0, centres=[-0.9, 0.4]), marks=pytest.mark.long),
    ],
)
def test_the_reward_is_that_of_the_documentation(chain):
    env = NPendulumEnv(chain=chain, mode="transition")
    goal = np.array([0.0, np.pi])
    weight = np.abs(chain.lift) / np.abs(chain.lift).sum()
    env.reset(seed=4, options={"goal": goal})
    for action in actions_for(env, 30):
        _, reward, terminated, _, info = env.step(action)
        theta, omega = info["theta"], info["omega"]
        closeness = 1.0 - 0.5 * weight @ np.abs(cosines(theta) - cosines(goal))
        velocity = np.cumsum(chain.lengths * omega * np.exp(1j * theta))
        at = np.concatenate([[0.0], velocity[:-1]]) + chain.centres * omega * np.exp(1j * theta)
        kinetic = 0.5 * chain.masses @ np.abs(at) ** 2 / chain.lifting_energy
        expected = closeness**2 * (1.0 + 1.0 / (1.0 + 4.0 * kinetic)) / 2.0
        expected *= 1.0 - float(action[0]) ** 2 / 10.0
        assert reward == pytest.approx(expected, rel=1e-10)
        assert not terminated


def test_success_means_every_rod_at_its_goal_and_slow_for_five_seconds():
    lengths = [1.0, 1.0, 0.02]  # one that hardly counts in the closeness
    keywords = {"mode": "transition", "n": 3, "lengths": lengths}
    env = NPendulumEnv(**keywords, damping=[2.0, 2.0, 0.02], max_torque=0.0)
    env.reset(seed=0, options={"start": [0.0, 0.0, np.pi], "goal": 0.0})
    shown = [env.step(np.zeros(1, np.float32)) for _ in range(300)]
    success = np.array([each[-1]["success"] for each in shown])
    away = np.array([np.abs(cosines(each[-1]["theta"]) - 1.0).max() for each in shown])
    reached = np.flatnonzero(away >= 0.1)[-1] + 1  # first instant from which on it is near
    assert 0 < reached < 150
    assert np.flatnonzero(success)[0] >= reached + 100  # 5 s of 0.05 s
    assert np.flatnonzero(success)[0] < reached + 110
    assert success[-1]
    env.reset(seed=0, options={"start": 0.0, "goal": [0.0, 0.0, np.pi]})
    shown = [env.step(np.zeros(1, np.float32)) for _ in range(150)]
    assert shown[-1][1] > 0.95  # the reward: two of three rods are where they are to be
    assert not any(each[-1]["success"] for each in shown)


def test_a_task_derived_from_it_is_judged_by_the_same_quantities():
    own, built_in = NPendulumVectorEnv(3, mode=Nearest()), NPendulumVectorEnv(3, mode="transition")
    assert_same(own.reset(seed=1), built_in.reset(seed=1))
    for action in actions_for(own, 5):
        mine, reference = own.step(action), built_in.step(action)
        info = mine[-1]
        away = np.abs(cosines(info["theta"]) - cosines(info["goal"])).max(axis=1)
        np.testing.assert_allclose(mine[1], 1.0 - 0.5 * away, rtol=1e-12)
        assert_same(info, reference[-1])


# -- goals in a Dict ------------------------------------------------------------------------


def test_the_dict_of_goals_passes_gymnasiums_check_and_has_what_was_achieved():
    env = gym.make("npend/Transition-v1", n=3, **GOAL_ENV).unwrapped
    check_env(env, skip_render_check=True)
    observation, info = env.reset(seed=6)
    assert observation["observation"].shape == (9,)
    for action in actions_for(env, 20):
        observation, reward, _, _, info = env.step(action)
        achieved, desired = observation["achieved_goal"], observation["desired_goal"]
        np.testing.assert_allclose(achieved[:3], cosines(info["theta"]), atol=1e-14)
        np.testing.assert_array_equal(desired, [*cosines(info["goal"]), 0.0])
        assert reward == env.compute_reward(achieved, desired, info)
        assert env.compute_reward(achieved, achieved, info) == 1.0
    for goals in ((achieved[:3], desired), (achieved, desired[:1]), (achieved, 0.0)):
        with pytest.raises(ValueError, match=r"_goal must have n \+ 1 = 4 numbers"):
            env.compute_reward(*goals, info)
    assert not hasattr(NPendulumEnv(mode="transition"), "compute_reward")


def test_the_reward_of_goals_is_that_of_the_steps_and_of_success():
    envs = NPendulumVectorEnv(4, mode="transition", damping=3.0, n=2, **GOAL_ENV)
    every = np.pi * np.array([[0, 1], [1, 0], [1, 1], [0, 1]])
    envs.reset(seed=1, options={"start": every, "goal": [[0, 0]] * 3 + [[np.pi, 0]]})
    sums = np.zeros(4)
    for _ in range(300):
        observation, reward, *_, info = envs.step(np.zeros((4, 1), np.float32))
        achieved, desired = observation["achieved_goal"], observation["desired_goal"]
        np.testing.assert_array_equal(reward, envs.compute_reward(achieved, desired, {}))
        sums += reward
    assert np.all(sums[:3] > 100)
    assert sums[3] == 0
    np.testing.assert_array_equal(info["success"], [True, True, True, False])
    # the rule: each cosine within 0.1, the kinetic energy within 0.01
    goal = np.array([1.0, -1.0, 0.0])
    away = [[-0.099, 0.099, 0.0099], [-0.101, 0.0, 0.0], [0.0, 0.101, 0.0], [0.0, 0.0, 0.011]]
    rewards = envs.compute_reward(np.add(goal, away), [goal] * 4, [{}] * 4)
    np.testing.assert_array_equal(rewards, [1.0, 0.0, 0.0, 0.0])


class Near(Transition):
    """A task whose goal needs what no goal has."""

    def achieved(self, quantities):
        return quantities.closeness > 0.9


class Coarse(Transition):
    """A task that reaches its goal sooner."""

    def achieved(self, quantities):
        return (quantities.goal_distance < 0.5) & (quantities.kinetic_energy < 1.0)


def test_a_task_whose_goal_is_more_than_a_goal_has_is_refused_with_goal_env():
    with pytest.raises(ValueError, match=r"achieved of mode 'transition' must use .*got closeness"):
        NPendulumEnv(mode=Near(), **GOAL_ENV)
    env = NPendulumEnv(n=2, mode=Coarse(), **GOAL_ENV)
    env.reset(seed=0, options={"start": [0.0, 0.0], "goal": [0.0, np.pi]})
    for theta in (2.2, 1.8):
        env.state = [0.0, theta, 0.0, 0.0]
        observation, reward, *_, info = env.step(np.zeros(1))
        achieved, desired = observation["achieved_goal"], observation["desired_goal"]
        assert reward == env.compute_reward(achieved, desired, info) == float(theta == 2.2)


@pytest.mark.filterwarnings("ignore")  # Stable-Baselines3 warns of CUDA
def test_stable_baselines3_learns_from_hindsight_in_several_lanes():
    sb3 = pytest.importorskip("stable_baselines3")
    keywords = {"n": 1, "max_episode_steps": 20} | GOAL_ENV
    env = gym.make("npend/Transition-v1", **keywords)
    importlib.import_module("stable_baselines3.common.env_checker").check_env(env.unwrapped)
    envs = gym.make_vec("npend/Transition-v1", 4, autoreset_mode="SAME_STEP", **keywords)
    model = sb3.SAC(
        "MultiInputPolicy", rl.SB3VecEnv(envs), replay_buffer_class=sb3.HerReplayBuffer,
        learning_starts=100, batch_size=64, policy_kwargs={"net_arch": [16]}, seed=0,
        replay_buffer_kwargs={"n_sampled_goal": 4, "goal_selection_strategy": "future"},
    )  # fmt: skip
    model.learn(160)
    batch = model.replay_buffer.sample(256)
    rewards = batch.rewards.numpy().ravel()
    desired = batch.observations["desired_goal"].numpy()
    assert 0.0 < rewards.mean() < 1.0  # goals taken from hindsight have been reached
    assert np.any(np.abs(desired[:, 0]) < 0.99)
