import gymnasium as gym
import numpy as np
import pytest
from policy_files import random_policy, save_changed

from npend_gym.rl import Policy

K, LENGTH = 6, 3


def policy_with_memory():
    rng, env = np.random.default_rng(0), {"n": 2, "mode": "swingup", "observation": "sincos"}
    scale = rng.uniform(0.5, 2.0, (LENGTH, K + 1))
    return random_policy([(8, LENGTH * (K + 1)), (1, 8)], env, rng, scale=scale)


def action_for(policy, observations, actions):
    """Return what a policy does after the observations and the actions of one episode."""
    observations = [observations[0]] * (LENGTH - 1) + list(observations)
    actions = [np.zeros(1)] * LENGTH + list(actions)
    frames = [
        np.concatenate([observations[-1 - j], actions[-1 - j]]) / policy.scale[j]
        for j in range(LENGTH)
    ]
    hidden = np.tanh(policy.weights[0] @ np.concatenate(frames) + policy.biases[0])
    return np.clip(policy.weights[1] @ hidden + policy.biases[1], -1.0, 1.0)


def test_a_policy_with_memory_acts_on_its_last_observations_and_actions():
    policy, rng = policy_with_memory(), np.random.default_rng(1)
    policy.reset(4)
    observations = rng.normal(size=(7, 4, K)).astype(np.float32)
    actions = []
    for step, observation in enumerate(observations):
        actions.append(policy(observation))
        for lane in range(4):
            before = [action[lane] for action in actions[:-1]]
            expected = action_for(policy, observations[: step + 1, lane], before)
            np.testing.assert_allclose(actions[-1][lane], expected, atol=1e-5)
    assert policy.has_memory
    assert 0.1 < np.mean(np.abs(actions) < 1.0) < 1.0  # some are clipped, some are not


@pytest.mark.parametrize("autoreset_mode", ["NEXT_STEP", "SAME_STEP"])
def test_an_episode_begins_without_memory_of_the_one_before(autoreset_mode):
    policy, fresh = policy_with_memory(), policy_with_memory()
    envs = gym.make_vec(
        "NPendulum-v0", num_envs=2, max_episode_steps=5, autoreset_mode=autoreset_mode, **policy.env
    )
    observation, info = envs.reset(seed=0)
    starts = 0
    for _ in range(13):
        action = policy(observation, info)
        if (info["time"] == 0.0).all():
            fresh.reset(2)
            starts += 1
        np.testing.assert_array_equal(action, fresh(observation))
        observation, _, _, _, info = envs.step(action)
    assert starts == 3


def test_one_environment_of_many_begins_alone():
    policy, rng = policy_with_memory(), np.random.default_rng(2)
    observations = rng.normal(size=(4, 2, K)).astype(np.float32)
    times = np.array([[0.0, 0.0], [0.05, 0.05], [0.0, 0.1], [0.05, 0.15]])
    actions = [policy(o, {"time": t}) for o, t in zip(observations, times, strict=True)]
    for lane, first in ((0, 2), (1, 0)):
        before = [action[lane] for action in actions[first:-1]]
        expected = action_for(policy, observations[first:, lane], before)
        np.testing.assert_allclose(actions[-1][lane], expected, atol=1e-5)


@pytest.mark.parametrize("with_info", [False, True])
def test_a_policy_with_memory_acts_in_a_single_environment(with_info):
    policy, of_many = policy_with_memory(), policy_with_memory()
    env = gym.make("NPendulum-v0", **policy.env)
    policy.reset()
    of_many.reset(1)
    for seed in (0, 1):
        observation, info = env.reset(seed=seed)
        if not with_info:
            policy.reset()
            of_many.reset(1)
        for _ in range(5):
            action = policy(observation, info if with_info else None)
            batch = {"time": np.array([info["time"]])} if with_info else None
            expected = of_many(observation[None], batch)
            assert action.shape == (1,)
            np.testing.assert_array_equal(action, expected[0])
            observation, _, _, _, info = env.step(action)


def test_a_policy_with_memory_refuses_environments_that_it_does_not_remember():
    policy = policy_with_memory()
    with pytest.raises(ValueError, match=r"call reset\(num_envs\) before .* acts"):
        policy(np.zeros((2, K), np.float32))
    policy.reset(2)
    policy(np.zeros((2, K), np.float32))
    with pytest.raises(ValueError, match=r"shape \(2, 6\).*got \(3, 6\)"):
        policy(np.zeros((3, K), np.float32), {"time": np.array([0.0, 0.0, 0.1])})
    for count, error in ((-1, ValueError), (2.5, TypeError)):
        with pytest.raises(error, match=f"num_envs must be .*, got {count}"):
            policy.reset(count)


def test_without_a_time_the_beginning_of_an_episode_is_left_to_reset():
    bare, without = policy_with_memory(), policy_with_memory()
    for policy in (bare, without):
        policy.reset(2)
    for observation in np.random.default_rng(3).normal(size=(5, 2, K)).astype(np.float32):
        np.testing.assert_array_equal(bare(observation, {}), without(observation))


@pytest.mark.parametrize("shape", [(LENGTH, 1), (0, K + 1), (LENGTH, K + 2), (1, LENGTH, K + 1)])
def test_frames_that_do_not_fit_the_network_are_refused(shape, tmp_path):
    save_changed(policy_with_memory(), tmp_path / "a.safetensors", scale=np.ones(shape, np.float32))
    with pytest.raises(ValueError, match="is no policy"):
        Policy.load(tmp_path / "a.safetensors")


def test_a_policy_without_memory_needs_no_reset():
    memory = policy_with_memory()
    first = memory.weights[0][:, :K]
    policy = Policy(memory.scale[0, :K], [first, memory.weights[1]], memory.biases)
    assert not policy.has_memory
    policy.reset(3)
    assert policy(np.zeros((2, 5, K), np.float32)).shape == (2, 5, 1)
