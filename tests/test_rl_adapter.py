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


SWING = {"n": 1, "mode": "swingup", "observation": "sincos", "max_episode_steps": 40}
ALGORITHMS = {
    "PPO": {"n_steps": 32, "batch_size": 48, "n_epochs": 1},
    "SAC": {"learning_starts": 20, "batch_size": 16},
    "RecurrentPPO": {"n_steps": 32, "batch_size": 48, "n_epochs": 1},
}


def trained(algorithm, *, normalize=False):
    """Return a model after some steps, which acts strongly, so that what it is shown matters."""
    torch = pytest.importorskip("torch")
    from stable_baselines3.common.vec_env import VecNormalize

    torch.set_num_threads(1)
    package = "sb3_contrib" if algorithm == "RecurrentPPO" else "stable_baselines3"
    env = rl.SB3VecEnv(native(**SWING))
    env = VecNormalize(env, norm_reward=False) if normalize else env
    name = "MlpLstmPolicy" if algorithm == "RecurrentPPO" else "MlpPolicy"
    model = getattr(pytest.importorskip(package), algorithm)(
        name, env, seed=0, device="cpu", **ALGORITHMS[algorithm]
    )
    model.learn(120)
    last = model.actor.mu if algorithm == "SAC" else model.policy.action_net
    last.weight.data *= 1.0 if algorithm == "SAC" else 100.0
    return model


def scored_by_stable_baselines3(model, episodes, seed):
    """Return the returns that evaluate_policy of Stable-Baselines3 finds."""
    from stable_baselines3.common.evaluation import evaluate_policy
    from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecNormalize

    make = [lambda: gym.make("NPendulum-v0", **SWING)] * episodes
    env, known = VecMonitor(DummyVecEnv(make)), model.get_vec_normalize_env()
    env.seed(seed)
    if known is not None:
        env = VecNormalize(env, training=False, norm_reward=False)
        env.obs_rms = known.obs_rms
    return evaluate_policy(model, env, n_eval_episodes=episodes, return_episode_rewards=True)[0]


@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize("normalize", [False, True])
def test_evaluate_finds_the_returns_that_evaluate_policy_of_stable_baselines3_finds(
    algorithm, normalize
):
    model = trained(algorithm, normalize=normalize)
    ours = rl.evaluate(model, SWING, episodes=4, seed=7)
    theirs = scored_by_stable_baselines3(model, 4, 7)
    np.testing.assert_allclose(ours.returns, theirs, rtol=1e-4)
    again = rl.evaluate(model, SWING, episodes=4, seed=7)  # nothing is remembered
    np.testing.assert_array_equal(again.returns, ours.returns)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_model_without_the_statistics_that_it_was_trained_with_is_refused(algorithm, tmp_path):
    from stable_baselines3.common.vec_env import VecNormalize

    model = trained(algorithm, normalize=True)
    model.save(tmp_path / "model.zip")
    loaded = type(model).load(tmp_path / "model.zip", device="cpu")
    with pytest.raises(ValueError, match=r"VecNormalize\.load"):
        rl.evaluate(loaded, SWING, episodes=2)
    fresh = VecNormalize(rl.SB3VecEnv(native(**SWING)))
    loaded = type(model).load(tmp_path / "model.zip", env=fresh, device="cpu")
    with pytest.raises(ValueError, match=r"VecNormalize\.load"):
        rl.evaluate(loaded, SWING, episodes=2)
    whole = type(model).load(tmp_path / "model.zip", env=model.get_env(), device="cpu")
    found, expected = (rl.evaluate(each, SWING, episodes=2).returns for each in (whole, model))
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_model_that_saw_plain_observations_is_evaluated_without_its_environment(
    algorithm, tmp_path
):
    model = trained(algorithm)
    model.save(tmp_path / "model.zip")
    loaded = type(model).load(tmp_path / "model.zip", device="cpu")
    found, expected = (rl.evaluate(each, SWING, episodes=2).returns for each in (loaded, model))
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("vector", [False, True])
def test_a_model_of_an_environment_whose_wrapper_changes_observations_is_refused(vector):
    from stable_baselines3 import PPO

    wrapper = gym.wrappers.NormalizeObservation
    env = wrapper(gym.make("NPendulum-v0", **SWING))
    if vector:
        same_step = {"autoreset_mode": gym.vector.AutoresetMode.SAME_STEP}
        made = {"vectorization_mode": "sync", "wrappers": (wrapper,), "vector_kwargs": same_step}
        env = rl.SB3VecEnv(gym.make_vec("NPendulum-v0", 2, **made, **SWING))
    model = PPO("MlpPolicy", env, n_steps=32, batch_size=32)
    with pytest.raises(ValueError, match="NormalizeObservation"):
        rl.evaluate(model, SWING, episodes=2)


def test_every_judge_takes_a_model_as_it_takes_a_function():
    model = trained("PPO", normalize=True)
    statistics = model.get_vec_normalize_env()

    def acts(observation, _):
        return model.predict(statistics.normalize_obs(observation), deterministic=True)[0]

    judges = {
        rl.performance: {"episodes": 2, "seconds": 1.0},
        rl.recovery: {"episodes": 2, "seconds": 1.0},
        rl.robustness: {"values": 2, "repetitions": 1, "seconds": 0.2},
    }
    for judge, arguments in judges.items():
        found, expected = (judge(each, SWING, **arguments) for each in (model, acts))
        assert found.as_row() == expected.as_row()


def test_what_can_neither_act_nor_predict_is_refused_by_every_judge():
    for judge in (rl.evaluate, rl.performance, rl.recovery, rl.robustness):
        with pytest.raises(TypeError, match="controller must be callable as"):
            judge("swingup-2", SWING)
