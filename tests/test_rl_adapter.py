"""SB3VecEnv against Stable-Baselines3's own vector environments."""

from importlib.util import find_spec

import gymnasium as gym
import numpy as np
import pytest

from npend_gym import rl

# Stable-Baselines3 imports PyTorch: seconds that not every worker of the tests must spend
pytestmark = pytest.mark.skipif(
    find_spec("stable_baselines3") is None, reason="stable_baselines3 is not installed"
)
COUNT = 3


def native(**keywords):
    return gym.make_vec("NPendulum-v0", num_envs=COUNT, autoreset_mode="SAME_STEP", **keywords)


def dummy(**keywords):
    from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

    return VecMonitor(DummyVecEnv([lambda: gym.make("NPendulum-v0", **keywords)] * COUNT))


@pytest.mark.parametrize("mode", ["swingup", "balance"])
def test_it_returns_what_dummyvecenv_with_vecmonitor_returns(mode):
    keywords = {"n": 2, "mode": mode, "max_episode_steps": 60}
    ours, theirs = rl.SB3VecEnv(native(**keywords), info_keys=("time",)), dummy(**keywords)
    for env in (ours, theirs):
        env.seed(5)
    np.testing.assert_array_equal(ours.reset(), theirs.reset())
    assert ours.reset_infos[1]["energy"] == theirs.venv.reset_infos[1]["energy"]
    rng, ends = np.random.default_rng(0), {"truncated": 0, "failed": 0}
    for _ in range(150):
        actions = rng.uniform(-1.0, 1.0, (COUNT, 1)).astype(np.float32)
        mine, reference = ours.step(actions), theirs.step(actions)
        for a, b in zip(mine[:3], reference[:3], strict=True):
            np.testing.assert_array_equal(a, b)
            assert a.dtype == b.dtype
        for a, b, done in zip(mine[3], reference[3], mine[2], strict=True):
            if not done:
                assert a.keys() == {"time"}
                continue
            assert a.keys() >= b.keys() - {"pseudo_period", "pseudo_periods", "pseudo_period_com"}
            np.testing.assert_array_equal(a["terminal_observation"], b["terminal_observation"])
            assert a["TimeLimit.truncated"] is b["TimeLimit.truncated"]
            assert a["success"] is b["success"]
            assert a["time"] == b["time"]
            assert a["episode"]["l"] == b["episode"]["l"]
            assert a["episode"]["r"] == pytest.approx(b["episode"]["r"], rel=1e-5)
            ends["truncated" if a["TimeLimit.truncated"] else "failed"] += 1
    assert ends["failed" if mode == "balance" else "truncated"] >= COUNT


def test_other_autoreset_modes_are_refused():
    with pytest.raises(ValueError, match="autoreset_mode SAME_STEP"):
        rl.SB3VecEnv(gym.make_vec("NPendulum-v0", num_envs=2))


def test_options_reach_the_lanes_in_the_next_reset_only():
    env = rl.SB3VecEnv(native(n=2))
    theta = [np.full(2, 0.1 * k) for k in range(COUNT)]
    env.set_options([{"theta": angles, "omega": np.zeros(2)} for angles in theta])
    np.testing.assert_allclose(env.reset(), [[0.1 * k] * 2 + [0.0] * 2 for k in range(COUNT)])
    assert np.abs(env.reset()).max() < 0.06
    env.set_options([{"theta": theta[0]}, {}, {}])
    with pytest.raises(ValueError, match=r"options\['theta'\] must be given for every"):
        env.reset()


def test_all_lanes_of_a_native_env_share_its_attributes_and_methods():
    from stable_baselines3.common.monitor import Monitor

    env = rl.SB3VecEnv(native(n=2, render_mode=None))
    assert env.get_attr("num_envs", indices=[0, 2]) == [COUNT, COUNT]
    assert env.get_attr("config")[0].chain.n == 2
    assert env.render_mode is None
    assert not env.has_attr("no_such_thing")
    env.set_attr("note", 7)
    assert env.get_attr("note") == [7] * COUNT
    assert env.env_method("__len__") if env.has_attr("__len__") else True
    with pytest.raises(ValueError, match="indices must be all environments"):
        env.set_attr("note", 8, indices=0)
    assert env.env_is_wrapped(Monitor) == [True] * COUNT
    assert env.env_is_wrapped(gym.wrappers.TimeLimit, indices=0) == [False]


def test_each_env_of_gymnasiums_vector_env_has_its_own_attributes_and_methods():
    env = rl.SB3VecEnv(
        gym.make_vec(
            "CartPole-v1",
            num_envs=COUNT,
            vectorization_mode="sync",
            vector_kwargs={"autoreset_mode": gym.vector.AutoresetMode.SAME_STEP},
        )
    )
    assert env.get_attr("gravity") == [9.8] * COUNT
    env.set_attr("gravity", 3.0, indices=1)
    assert env.get_attr("gravity") == [9.8, 3.0, 9.8]
    assert len(env.env_method("reset", seed=0)) == COUNT
    env.seed(0)
    env.reset()
    ended = 0
    for _ in range(60):
        _, rewards, dones, infos = env.step(np.ones(COUNT, int))
        assert rewards.dtype == np.float32
        for done, info in zip(dones, infos, strict=True):
            assert done == ("terminal_observation" in info)
            ended += done
            if done:
                assert info["episode"]["r"] == info["episode"]["l"]  # CartPole pays 1 a step
    assert ended >= COUNT


def test_ppo_learns_on_it_and_is_evaluated():
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.evaluation import evaluate_policy

    torch.set_num_threads(1)
    env = rl.SB3VecEnv(native(n=1, mode="balance", observation="sincos", max_episode_steps=50))
    model = PPO("MlpPolicy", env, n_steps=32, batch_size=48, n_epochs=1, seed=0)
    before = model.policy.get_distribution(torch.zeros(1, 3)).mode().item()
    model.learn(300)
    assert model.policy.get_distribution(torch.zeros(1, 3)).mode().item() != before
    assert len(model.ep_info_buffer) > 0
    mean, _ = evaluate_policy(model, env, n_eval_episodes=4)
    assert 0.0 < mean <= 50.0


def test_pictures_of_all_lanes_are_put_side_by_side():
    pytest.importorskip("pygame")
    env = rl.SB3VecEnv(native(n=2, render_mode="rgb_array"))
    env.reset()
    assert env.render().shape[2] == 3
