"""SB3VecEnv against Stable-Baselines3's own vector environments."""

import itertools
from functools import cache, partial
from importlib.util import find_spec
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest

from npend_gym import NPendulumEnv, NPendulumVectorEnv, rl

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


def constant(action):
    """A controller that always does the same."""
    return lambda shown, _: np.full((len(shown), 1), action)


def wavy(shown, _):
    """A controller that what it is shown matters to."""
    return np.sin(4.0 * shown.sum(axis=-1, keepdims=True))


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


def test_pictures_of_all_lanes_are_put_side_by_side():
    pytest.importorskip("pygame")
    env = rl.SB3VecEnv(native(n=2, render_mode="rgb_array"))
    env.reset()
    assert env.render().shape[2] == 3


SWING = {"n": 1, "mode": "swingup", "observation": "sincos", "max_episode_steps": 40}
ALGORITHMS = {
    "PPO": {"n_steps": 32, "batch_size": 48, "n_epochs": 1},
    "SAC": {"learning_starts": 20, "batch_size": 16},
    "TQC": {"learning_starts": 20, "batch_size": 16},
    "RecurrentPPO": {"n_steps": 32, "batch_size": 48, "n_epochs": 1},
}
OFF_POLICY = ("SAC", "TQC")


@cache
def trained(algorithm, *, normalize=False, stack=1):
    """Return a model after some steps, which acts strongly, so that what it is shown matters."""
    torch = pytest.importorskip("torch")
    from stable_baselines3.common.vec_env import VecFrameStack, VecNormalize

    torch.set_num_threads(1)
    contributed = algorithm in ("RecurrentPPO", "TQC")
    package = "sb3_contrib" if contributed else "stable_baselines3"
    env = rl.SB3VecEnv(native(**SWING))
    env = VecFrameStack(env, stack) if stack > 1 else env
    env = VecNormalize(env, norm_reward=False) if normalize else env
    name = "MlpLstmPolicy" if algorithm == "RecurrentPPO" else "MlpPolicy"
    model = getattr(pytest.importorskip(package), algorithm)(
        name, env, seed=0, device="cpu", **ALGORITHMS[algorithm]
    )
    model.learn(120)
    last = model.actor.mu if algorithm in OFF_POLICY else model.policy.action_net
    last.weight.data *= 1.0 if algorithm in OFF_POLICY else 100.0
    return model


def scored_by_stable_baselines3(model, episodes, seed):
    """Return the returns that evaluate_policy of Stable-Baselines3 finds."""
    from stable_baselines3.common.evaluation import evaluate_policy
    from stable_baselines3.common.vec_env import (
        DummyVecEnv,
        VecFrameStack,
        VecMonitor,
        VecNormalize,
    )

    make = [lambda: gym.make("NPendulum-v0", **SWING)] * episodes
    env, known = VecMonitor(DummyVecEnv(make)), model.get_vec_normalize_env()
    env.seed(seed)
    if model.observation_space.shape != env.observation_space.shape:
        env = VecFrameStack(env, model.observation_space.shape[0] // env.observation_space.shape[0])
    if known is not None:
        env = VecNormalize(env, training=False, norm_reward=False)
        env.obs_rms = known.obs_rms
    return evaluate_policy(model, env, n_eval_episodes=episodes, return_episode_rewards=True)[0]


@pytest.mark.long
@pytest.mark.parametrize("algorithm", ALGORITHMS)
@pytest.mark.parametrize(("normalize", "stack"), [(False, 1), (True, 1), (True, 3)])
def test_evaluate_finds_the_returns_that_evaluate_policy_of_stable_baselines3_finds(
    algorithm, normalize, stack
):
    model = trained(algorithm, normalize=normalize, stack=stack)
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
    if algorithm == "PPO":
        with pytest.raises(ValueError, match=r"VecNormalize\.load"):
            rl.Policy.from_sb3(loaded, SWING)
        with pytest.raises(ValueError, match="env must be given"):
            rl.Policy.from_sb3(loaded)
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


def test_a_model_is_not_judged_on_observations_of_another_kind_than_in_its_training():
    with pytest.raises(ValueError, match=r"must be as in the model's training.* got 'scaled'"):
        rl.evaluate(trained("PPO"), SWING | {"observation": "scaled"}, episodes=2)


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


JUDGES = {
    "performance": {"episodes": 2, "seconds": 1.0},
    "recovery": {"episodes": 2, "seconds": 1.0},
    "robustness": {"values": 2, "repetitions": 1, "seconds": 0.2},
}
each_judge = pytest.mark.parametrize(
    "judge",
    [
        # the kernels of motors and sensors take long to compile
        pytest.param(name, marks=pytest.mark.long) if name == "robustness" else name
        for name in JUDGES
    ],
)


@each_judge
def test_every_judge_takes_a_model_as_it_takes_a_function(judge):
    model = trained("PPO", normalize=True)
    statistics = model.get_vec_normalize_env()

    def acts(observation, _):
        return model.predict(statistics.normalize_obs(observation), deterministic=True)[0]

    rows = [getattr(rl, judge)(each, SWING, **JUDGES[judge]).as_row() for each in (model, acts)]
    assert rows[0] == rows[1]


@each_judge
def test_every_judge_takes_a_wrapped_environment(judge):
    env, _ = wrapped_by_stable_baselines3()
    row = getattr(rl, judge)(wavy, env, **JUDGES[judge]).as_row()
    assert row["score"] <= 1.0
    assert judge != "robustness" or set(row) == {"score", *rl.CRITERIA}


def wrapped_by_stable_baselines3():
    """Return an environment that was stepped, in wrappers, and the one that has statistics."""
    from stable_baselines3.common.vec_env import VecFrameStack, VecNormalize

    normalized = VecNormalize(rl.SB3VecEnv(native(**SWING)))
    env = VecFrameStack(normalized, 2)
    env.reset()
    for _ in range(30):
        env.step(np.ones((COUNT, 1)))
    normalized.training = False
    return env, normalized


def test_a_wrapped_environment_of_stable_baselines3_is_judged_in_as_it_is_stepped():
    env, normalized = wrapped_by_stable_baselines3()
    before = normalized.obs_rms.mean.copy(), env.stacked_obs.stacked_obs.copy()
    found = rl.evaluate(wavy, env, episodes=COUNT, seed=3).returns
    normalized.training = True
    np.testing.assert_array_equal(rl.evaluate(wavy, env, episodes=COUNT, seed=3).returns, found)
    np.testing.assert_array_equal(normalized.obs_rms.mean, before[0])
    np.testing.assert_array_equal(env.stacked_obs.stacked_obs, before[1])
    normalized.training = False
    env.seed(3)
    shown = env.reset()
    for _ in range(SWING["max_episode_steps"]):
        shown, _, _, infos = env.step(wavy(shown, {}))
    returns = [info["episode"]["r"] for info in infos]
    np.testing.assert_allclose(found, returns, rtol=1e-6)
    bare = rl.evaluate(wavy, SWING, episodes=COUNT, seed=3).returns
    assert bare.tolist() != found.tolist()


@pytest.mark.parametrize("lanes", [2, 5])
def test_a_wrapped_vector_environment_of_gymnasium_is_judged_in_as_it_is_stepped(lanes):
    wrappers = gym.wrappers.vector
    env = gym.make_vec("NPendulum-v0", num_envs=lanes, **SWING)
    env = wrappers.NormalizeObservation(wrappers.RescaleAction(env, *np.float32([-2.0, 2.0])))
    env = wrappers.FlattenObservation(wrappers.RecordEpisodeStatistics(env))
    env = wrappers.TransformObservation(env, lambda shown: shown - 0.1)

    def act(shown, _):
        return 2.0 * wavy(shown, _)

    env.reset(seed=0)
    for _ in range(20):
        env.step(np.ones((lanes, 1), np.float32))
    statistics = env.env.env.env
    mean = statistics.obs_rms.mean.copy()
    found = rl.evaluate(act, env, episodes=4, seed=7)
    np.testing.assert_array_equal(statistics.obs_rms.mean, mean)
    statistics.update_running_mean = False
    for k in range(0, 4, lanes):
        shown, _ = env.reset(seed=7 + k)
        returns = np.zeros(lanes)
        for _ in range(SWING["max_episode_steps"]):
            shown, reward, *_ = env.step(act(shown, {}).astype(np.float32))
            returns += reward
        own = found.returns[k : k + lanes]
        np.testing.assert_allclose(own, returns[: own.size], rtol=1e-5)


@pytest.fixture
def register():
    """`gymnasium.register` for a while: afterwards its ids are unknown again."""
    known = set(gym.registry)
    yield gym.register
    for name in set(gym.registry) - known:
        del gym.registry[name]


def test_every_name_of_an_environment_gives_the_same_episodes(register):
    from stable_baselines3.common.env_util import make_vec_env

    named = {"id": "npend/SwingUp-v1", "n": 1, "max_episode_steps": 30}
    keywords = {key: value for key, value in named.items() if key != "id"}
    register(
        "Short-v0",
        "npend_gym:NPendulumEnv",
        vector_entry_point="npend_gym:NPendulumVectorEnv",
        max_episode_steps=30,
        kwargs=gym.spec(named["id"]).kwargs | {"n": 1},
    )
    envs = [
        "Short-v0",
        gym.spec("Short-v0"),
        gym.make_vec(named["id"], num_envs=2, **keywords),
        gym.make_vec(named["id"], num_envs=2, **keywords).spec,
        gym.make_vec("Short-v0", num_envs=2, vectorization_mode="sync"),
        gym.make("Short-v0"),
        make_vec_env("Short-v0", n_envs=2),
        rl.SB3VecEnv(gym.make_vec(named["id"], 3, autoreset_mode="SAME_STEP", **keywords)),
        NPendulumVectorEnv(2, mode="swingup", n=1, observation="scaled", max_episode_steps=30),
    ]

    expected = rl.evaluate(wavy, named, episodes=3).returns
    for env in envs:
        np.testing.assert_array_equal(rl.evaluate(wavy, env, episodes=3).returns, expected)


class Doubled(gym.vector.VectorWrapper):
    """A wrapper of a user that shows other observations."""

    def __init__(self, env):
        super().__init__(env)
        self.observation_space = gym.spaces.Box(-9.0, 9.0, (COUNT, 6))


class Still(gym.vector.VectorWrapper):
    """A wrapper of a user that takes no action."""

    def step(self, actions):
        return self.env.step(0.0 * actions)


class Started(gym.vector.VectorWrapper):
    """A wrapper of a user that chooses where episodes start."""

    def reset(self, *, seed=None, options=None):
        return self.env.reset(seed=seed, options=(options or {}) | {"omega": 0.0})


class Doubling(gym.vector.VectorRewardWrapper):
    """A wrapper of a user that changes rewards only."""

    def rewards(self, reward):
        return 2.0 * reward


class Reversed(NPendulumEnv):
    """An environment of a user, whose motor is wired the wrong way."""

    def step(self, action):
        return super().step(-np.asarray(action))


class ManyReversed(NPendulumVectorEnv):
    """Many of them."""

    def step(self, actions):
        return super().step(-np.asarray(actions))


def test_a_subclass_with_a_step_of_its_own_is_judged_by_an_id_that_makes_it(register):
    policy = rl.Policy.pretrained("balance-1")
    for env in (Reversed(**policy.env), ManyReversed(2, **policy.env)):
        with pytest.raises(ValueError, match="Reversed, whose step is its own: register an id"):
            rl.evaluate(policy, env, episodes=2)
    more = {"kwargs": policy.env, "max_episode_steps": 200}
    register("Reversed-v0", Reversed, **more)
    register("ManyReversed-v0", Reversed, vector_entry_point=ManyReversed, **more)
    with pytest.raises(ValueError, match="got 'Reversed-v0': register it with vector_entry_p"):
        rl.evaluate(policy, "Reversed-v0", episodes=2)
    assert rl.evaluate(policy, "ManyReversed-v0", episodes=2).returns.mean() < 150.0
    plain = policy.env | {"max_episode_steps": 200}
    assert rl.evaluate(policy, plain, episodes=2).returns.mean() > 190.0


@pytest.mark.parametrize(
    "name", ["Doubled", "Still", "Started", "step_async", "step_wait", "reset"]
)
def test_a_wrapper_of_a_users_own_around_a_vector_environment_is_refused(name):
    from stable_baselines3.common.vec_env import VecCheckNan, VecNormalize

    wrap, env = globals().get(name), native(**SWING)
    if wrap is None:  # of Stable-Baselines3, with this method changed
        wrap, env = type(name, (VecCheckNan,), {name: None}), VecNormalize(rl.SB3VecEnv(env))
    with pytest.raises(ValueError, match=f"wrapper {name} changes observations or actions"):
        rl.evaluate(constant(0.0), wrap(env), episodes=2)


def test_wrappers_of_vector_environments_that_change_no_step_are_ignored_by_evaluate():
    from stable_baselines3.common.vec_env import VecCheckNan

    vector, env = gym.wrappers.vector, Doubling(native(**SWING))
    env = vector.RecordEpisodeStatistics(vector.NormalizeReward(vector.ClipReward(env, 0.0, 1.0)))
    expected, *found = (
        rl.evaluate(constant(1.0), each, episodes=2).returns
        for each in (SWING, VecCheckNan(rl.SB3VecEnv(env)), dummy(**SWING))
    )
    np.testing.assert_array_equal(found, [expected] * 2)


def test_a_model_is_not_judged_behind_a_normalisation_that_has_seen_no_observation():
    env = gym.wrappers.vector.NormalizeObservation(gym.make_vec("NPendulum-v0", 2, **SWING))
    with pytest.raises(ValueError, match="the obs_rms of the training"):
        rl.evaluate(trained("PPO"), env, episodes=2)
    env.reset(seed=0)
    assert rl.evaluate(trained("PPO"), env, episodes=2).returns.size == 2


def test_an_environment_lasts_as_long_as_its_shortest_time_limit():
    own = {name: value for name, value in SWING.items() if name != "max_episode_steps"}
    bare = gym.make("NPendulum-v0", **own).unwrapped
    bare.spec = None
    limited = gym.wrappers.TimeLimit(gym.wrappers.TimeLimit(bare, 9), 5)
    found, expected = (
        rl.evaluate(constant(1.0), env, episodes=2).returns
        for env in (limited, own | {"max_episode_steps": 5})
    )
    np.testing.assert_array_equal(found, expected)
    with pytest.raises(ValueError, match=r"got None: give .* gymnasium\.wrappers\.TimeLimit"):
        rl.evaluate(constant(1.0), bare, episodes=2)
    with pytest.raises(ValueError, match="max_episode_steps must be a number"):
        rl.evaluate(constant(1.0), native(n=1, max_episode_steps=None), episodes=2)


class Logged(gym.Wrapper):
    """A wrapper of a user that changes no step."""

    def render(self):
        return "a log"


WRAPPERS = {
    "RescaleAction": partial(
        gym.wrappers.RescaleAction, min_action=np.float32(-2.0), max_action=np.float32(2.0)
    ),
    "MaxAndSkipObservation": gym.wrappers.MaxAndSkipObservation,
    "FrameStackObservation": partial(gym.wrappers.FrameStackObservation, stack_size=2),
    "TimeAwareObservation": gym.wrappers.TimeAwareObservation,
}


@pytest.mark.parametrize(
    "made", ["single", "sync", "async", pytest.param("sb3", marks=pytest.mark.long)]
)
@pytest.mark.parametrize("name", WRAPPERS)
def test_a_wrapper_of_single_environments_is_refused_however_they_are_made(name, made):
    wrap = WRAPPERS[name]
    if made == "single":
        env = wrap(gym.make("NPendulum-v0", **SWING))
    elif made == "sb3":
        from stable_baselines3.common.env_util import make_vec_env
        from stable_baselines3.common.vec_env import SubprocVecEnv

        made_by = {"wrapper_class": wrap, "vec_env_cls": SubprocVecEnv}
        env = make_vec_env("npend_gym:NPendulum-v0", 1, env_kwargs=SWING, **made_by)
    else:
        env = gym.make_vec("NPendulum-v0", 2, vectorization_mode=made, wrappers=[wrap], **SWING)
    with pytest.raises(ValueError, match=f"wrapper {name} changes observations or actions"):
        rl.evaluate(constant(0.0), env, episodes=2)
    env.close()


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_wrappers_that_change_no_step_are_ignored_by_evaluate(mode, tmp_path):
    from stable_baselines3.common.monitor import Monitor

    wrappers = [
        gym.wrappers.RecordEpisodeStatistics,
        partial(gym.wrappers.ClipReward, min_reward=0.0, max_reward=0.5),
        partial(Monitor, filename=str(tmp_path / "monitor")),
        *([Logged] if mode == "sync" else []),
    ]
    env = gym.make_vec("NPendulum-v0", 2, vectorization_mode=mode, wrappers=wrappers, **SWING)
    found, expected = (
        rl.evaluate(constant(1.0), each, episodes=2).returns for each in (env, SWING)
    )
    np.testing.assert_array_equal(found, expected)
    env.close()


def test_frames_of_observations_with_a_goal_are_stacked_as_stable_baselines3_stacks_them():
    from stable_baselines3.common.vec_env import VecFrameStack

    keywords = {"id": "npend/Transition-v1", "n": 1, "goal_env": True, "reward_type": "sparse"}
    venv = gym.make_vec(num_envs=2, autoreset_mode="SAME_STEP", max_episode_steps=5, **keywords)
    env, seen = VecFrameStack(rl.SB3VecEnv(venv), 3), []

    def act(shown, _):
        seen.append({key: value.copy() for key, value in shown.items()})
        return np.ones((2, 1), np.float32)

    rl.evaluate(act, env, episodes=2, seed=3)
    env.seed(3)
    shown = env.reset()
    for each in seen[:5]:
        for key, value in shown.items():
            np.testing.assert_array_equal(each[key], value)
        shown = env.step(np.ones((2, 1), np.float32))[0]
    assert seen[0]["achieved_goal"].shape == (2, 6)


def random_observations(model, count=200):
    """Return observations, some of them far beyond what the model has seen."""
    rng, size = np.random.default_rng(0), model.observation_space.shape
    return (rng.normal(size=(count, *size)) * rng.choice([0.3, 1.0, 30.0], (count, 1))).astype("f4")


@pytest.mark.parametrize("normalize", [False, True])
@pytest.mark.parametrize("algorithm", ["PPO", "SAC", "TQC"])
def test_a_policy_made_of_a_model_acts_as_the_model_does(algorithm, normalize, tmp_path):
    model = trained(algorithm, normalize=normalize)
    seen = random_observations(model)
    shown = model.get_vec_normalize_env().normalize_obs(seen) if normalize else seen
    expected = model.predict(shown, deterministic=True)[0]
    policy = rl.Policy.from_sb3(model)
    np.testing.assert_allclose(policy(seen), expected, rtol=1e-5, atol=2e-6)
    assert 0.01 < np.abs(expected).mean() < 0.999
    assert policy.env == {"n": 1, "mode": "swingup", "observation": "sincos"}
    assert policy.provenance["arguments"]["algorithm"] == algorithm
    policy.save(tmp_path / "a.safetensors")
    assert rl.Policy.load(tmp_path / "a.safetensors") == policy
    found, own = (rl.evaluate(each, SWING, episodes=3).returns for each in (policy, model))
    np.testing.assert_allclose(found, own, rtol=1e-3)


def test_the_normalisation_between_the_layers_of_crossq_is_part_of_its_policy():
    contrib, torch = pytest.importorskip("sb3_contrib"), pytest.importorskip("torch")
    model = contrib.CrossQ("MlpPolicy", gym.make("npend/SwingUp-v1", n=1), device="cpu", seed=1)
    noise = torch.manual_seed(2)
    with torch.no_grad():
        for name, values in model.policy.actor.state_dict().items():
            if values.is_floating_point():  # the variances stay positive
                values.mul_(0.5 + torch.rand(values.shape, generator=noise))
                if "ra_mean" in name or name.endswith("bias"):
                    values.add_(0.2 * torch.randn(values.shape, generator=noise))
    policy, seen = rl.Policy.from_sb3(model), random_observations(model)
    expected = model.predict(seen, deterministic=True)[0]
    np.testing.assert_allclose(policy(seen), expected, rtol=1e-4, atol=1e-5)
    assert 0.01 < np.abs(expected).mean() < 0.999


@pytest.mark.parametrize("algorithm", ["A2C", "TD3"])
def test_other_networks_of_layers_become_policies_too(algorithm):
    sb3 = pytest.importorskip("stable_baselines3")
    env = gym.make("npend/Balance-v1", n=2, max_torque=7.0)
    arguments = {"net_arch": [24, 16]}
    model = getattr(sb3, algorithm)("MlpPolicy", env, policy_kwargs=arguments, device="cpu", seed=1)
    policy, seen = rl.Policy.from_sb3(model), random_observations(model)
    expected = model.predict(seen, deterministic=True)[0]
    np.testing.assert_allclose(policy(seen), expected, rtol=1e-5, atol=2e-6)
    assert policy.env == {"n": 2, "mode": "balance", "observation": "scaled", "max_torque": 7.0}


@pytest.mark.parametrize(
    ("kind", "arguments"),
    [
        ("MlpPolicy", {}),
        ("MlpPolicy", {"net_arch": [24], "with_bias": False, "squash_output": False}),
        ("LinearPolicy", {}),
        ("LinearPolicy", {"with_bias": True, "squash_output": True}),
    ],
)
def test_policies_of_ars_with_and_without_biases_become_policies_too(kind, arguments):
    contrib, torch = pytest.importorskip("sb3_contrib"), pytest.importorskip("torch")
    env = gym.make("npend/SwingUp-v1", n=1)
    model = contrib.ARS(kind, env, policy_kwargs=arguments, device="cpu", seed=1)
    with torch.no_grad():  # linear ones begin with zeros
        for weights in model.policy.parameters():
            weights.add_(0.3 * torch.randn(weights.shape, generator=torch.manual_seed(2)))
    policy, seen = rl.Policy.from_sb3(model), random_observations(model)
    expected = model.predict(seen, deterministic=True)[0]
    np.testing.assert_allclose(policy(seen), expected, rtol=1e-5, atol=2e-6)
    assert 0.01 < np.abs(expected).mean() < 0.999


@pytest.mark.parametrize("algorithm", ["SAC", "TQC", "CrossQ", "TD3", "PPO"])
def test_models_of_sbx_become_policies_too(algorithm):
    sbx = pytest.importorskip("sbx")
    env = gym.make("npend/SwingUp-v1", n=1)
    # the first ones act at random, so that statistics of the layers differ from the first ones
    more = {"n_steps": 64} if algorithm == "PPO" else {"learning_starts": 100, "train_freq": 8}
    kwargs = {"net_arch": [24, 16]}
    model = getattr(sbx, algorithm)("MlpPolicy", env, policy_kwargs=kwargs, seed=1, **more)
    model.learn(400)
    policy, seen = rl.Policy.from_sb3(model), random_observations(model)
    expected = model.predict(seen, deterministic=True)[0]
    np.testing.assert_allclose(policy(seen), expected, rtol=1e-4, atol=1e-5)
    assert 0.01 < np.abs(expected).mean() < 0.999
    assert policy.provenance["arguments"]["algorithm"] == algorithm


def jax_actor(rng, sizes, **features):
    """Return what a model of SBX keeps of an actor, with random numbers, and the function of it."""

    def relu(x):
        return np.maximum(x, 0.0)

    params, stats = {}, {}
    for k, (before, after) in enumerate(itertools.pairwise(sizes)):
        params[f"Dense_{k}"] = {"kernel": rng.normal(size=(before, after)) / before**0.5,
                                "bias": rng.normal(size=after)}  # fmt: skip
        params[f"BatchRenorm_{k}"] = {"scale": rng.uniform(0.5, 2.0, before),
                                      "bias": rng.normal(size=before)}  # fmt: skip
        stats[f"BatchRenorm_{k}"] = {"mean": rng.normal(size=before),
                                     "var": rng.uniform(0.1, 2.0, before)}  # fmt: skip
    params[f"Dense_{len(sizes) - 1}"] = params[f"Dense_{len(sizes) - 2}"]  # of the deviation

    def act(x):
        for k in range(len(sizes) - 1):
            seen, shown = stats[f"BatchRenorm_{k}"], params[f"BatchRenorm_{k}"]
            x = (x - seen["mean"]) / np.sqrt(seen["var"] + 1e-3) * shown["scale"] + shown["bias"]
            x = x @ params[f"Dense_{k}"]["kernel"] + params[f"Dense_{k}"]["bias"]
            x = relu(x) if k < len(sizes) - 2 else np.tanh(x)
        return x

    state = SimpleNamespace(params=params, batch_stats=stats)
    actor = SimpleNamespace(activation_fn=relu, net_arch=[*sizes[1:-1]], **features)
    return SimpleNamespace(actor=actor, actor_state=state, squash_output=True), act


def as_sbx(policy):
    """Return a model with a policy of SBX, and all else as Stable-Baselines3 has it."""
    model = sb3().SAC("MlpPolicy", gym.make("npend/SwingUp-v1", n=1), device="cpu", seed=0)
    model.policy = policy
    return model


def test_the_normalisation_of_crossq_in_jax_is_part_of_its_policy():
    actor, act = jax_actor(np.random.default_rng(0), (3, 24, 16, 1), use_batch_norm=True)
    model = as_sbx(actor)
    seen = random_observations(model)
    np.testing.assert_allclose(rl.Policy.from_sb3(model)(seen), act(seen), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("what", ["SimbaResidualBlock", "elu"])
def test_another_network_of_sbx_is_refused_with_the_way_out(what):
    actor, _ = jax_actor(np.random.default_rng(0), (3, 24, 1))
    if what == "elu":
        actor.actor.activation_fn.__name__ = what
    else:
        actor.actor_state.params[f"{what}_0"] = {}
    with pytest.raises(ValueError, match=f"got SAC with {what}: evaluate and robustness"):
        rl.Policy.from_sb3(as_sbx(actor))


def test_a_normalisation_that_no_layer_follows_is_refused():
    contrib, torch = pytest.importorskip("sb3_contrib"), pytest.importorskip("torch")
    model = contrib.CrossQ("MlpPolicy", gym.make("npend/SwingUp-v1", n=1), device="cpu", seed=1)
    norm, linear, relu, *others = model.policy.actor.latent_pi
    inner = type(norm)(linear.out_features)
    model.policy.actor.latent_pi = torch.nn.Sequential(norm, linear, inner, relu, *others)
    with pytest.raises(ValueError, match=r"Linear, BatchRenorm1d, ReLU.*take the model itself"):
        rl.Policy.from_sb3(model)


def test_a_model_that_is_no_network_of_layers_is_refused_with_the_way_out():
    from sb3_contrib import ARS
    from stable_baselines3 import DQN, PPO
    from torch import nn

    env = gym.make("npend/SwingUp-v1", n=1)
    discrete = gym.make("npend/SwingUp-v1", n=1, torque_levels=3)
    smooth = PPO("MlpPolicy", env, policy_kwargs={"activation_fn": nn.ELU}, device="cpu")
    refused = {
        "RecurrentPPO with an LSTM": trained("RecurrentPPO"),
        "PPO with Linear, ELU": smooth,
        "DQN with discrete actions": DQN("MlpPolicy", discrete, device="cpu"),
        "ARS with discrete actions": ARS("MlpPolicy", discrete, device="cpu"),
        "VecNormalize alone, got VecFrameStack": trained("PPO", stack=2),
    }
    for text, model in refused.items():
        with pytest.raises(ValueError, match=f"{text}.*evaluate and robustness take the model"):
            rl.Policy.from_sb3(model)


def sb3():
    import stable_baselines3

    return stable_baselines3


@pytest.mark.parametrize("normalize", [False, True])
@pytest.mark.parametrize("judge", [rl.evaluate, rl.performance, rl.robustness, rl.recovery])
def test_a_model_of_another_size_is_refused_by_the_name_of_what_differs(judge, normalize):
    model = trained("PPO", normalize=normalize)
    with pytest.raises(ValueError, match=r"env must show observations of the shape \(3,\).*\(6,\)"):
        judge(model, SWING | {"n": 2})
    with pytest.raises(ValueError, match=r"torque_levels must be as .* got 3, .*Discrete\(3\)"):
        judge(model, SWING | {"torque_levels": 3})
    pair = sb3().PPO("MlpPolicy", gym.make("NPendulum-v0", **SWING | {"n": 2, "actuated": (0, 1)}))
    with pytest.raises(ValueError, match=r"actuated must have as many .* training, 2, got \[0\]"):
        judge(pair, SWING | {"n": 2})


def test_a_model_is_refused_behind_wrappers_of_another_size():
    venv = sb3().common.vec_env.VecNormalize(rl.SB3VecEnv(native(**SWING | {"n": 2})))
    with pytest.raises(ValueError, match=r"env must show observations of the shape \(3,\)"):
        rl.evaluate(trained("PPO"), venv)


def test_a_model_of_more_torque_levels_is_refused_where_its_actions_mean_others():
    model = sb3().PPO("MlpPolicy", gym.make("NPendulum-v0", **SWING, torque_levels=5))
    with pytest.raises(ValueError, match=r"torque_levels must be .*Discrete\(5\), got 3"):
        rl.evaluate(model, SWING | {"torque_levels": 3})


@pytest.mark.parametrize(
    ("venv", "way"),
    [
        ("npend/SwingUp-v1", r"make_vec\('npend/SwingUp-v1', num_envs=32, autoreset_mode="),
        (lambda: gym.make("npend/Balance-v1"), r"make_vec\('npend/Balance-v1'"),
        ({"n": 2}, "make_vec"),
        (
            lambda: rl.SB3VecEnv(native()),
            "as it",
        ),
    ],
)
def test_what_is_no_vector_environment_is_refused_with_the_way_to_one(venv, way):
    with pytest.raises(TypeError, match=rf"venv must be a vector environment .*{way}"):
        rl.SB3VecEnv(venv() if callable(venv) else venv)


def test_a_model_becomes_a_policy_of_its_own_environment_alone():
    from stable_baselines3 import PPO

    venv = gym.make_vec("npend/SwingUp-v1", num_envs=2, n=1, autoreset_mode="SAME_STEP")
    model = PPO("MlpPolicy", rl.SB3VecEnv(venv), n_steps=8, batch_size=16)
    assert rl.Policy.from_sb3(model).config.observation == "scaled"
    with pytest.raises(ValueError, match="observation must be as in the model's training"):
        rl.Policy.from_sb3(model, {"n": 1, "observation": "sincos"})
    with pytest.raises(ValueError, match=r"env must show observations of the shape \(3,\)"):
        rl.Policy.from_sb3(model, {"n": 2, "observation": "sincos"})
    model.action_space = gym.spaces.Box(-3.0, 3.0, (1,))
    with pytest.raises(ValueError, match=r"actions from array\(\[-3.\]"):
        rl.Policy.from_sb3(model)


def test_a_model_becomes_a_policy_behind_the_wrappers_of_the_environment_that_is_given():
    from stable_baselines3.common.vec_env import VecFrameStack, VecNormalize

    model = trained("PPO", normalize=True)
    env = VecNormalize(rl.SB3VecEnv(native(**SWING)))
    with pytest.raises(ValueError, match="must have the statistics of its observations"):
        rl.Policy.from_sb3(model, env)
    env.obs_rms.mean, env.obs_rms.var, env.obs_rms.count = np.ones(3), np.full(3, 4.0), 9.0
    seen = random_observations(model)
    expected = model.predict(env.normalize_obs(seen), deterministic=True)[0]
    found = rl.Policy.from_sb3(model, env)(seen)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=2e-6)
    with pytest.raises(ValueError, match="VecNormalize alone, got VecFrameStack"):
        rl.Policy.from_sb3(model, VecFrameStack(env, 2))


def test_options_of_all_lanes_may_be_one_number():
    venv = rl.SB3VecEnv(native(n=2, mode="swingup"))
    venv.set_options({"masses": 2.0})
    venv.reset()
    assert venv.venv.unwrapped.get_state()["rods"]["mass"][:, :2].tolist() == [[2.0, 2.0]] * COUNT
    venv.set_options([{"amplitude": 0.1 * (k + 1)} for k in range(COUNT)])
    venv.reset()


@pytest.mark.parametrize("n", [2, COUNT])
def test_one_number_of_a_lane_stands_for_all_its_rods(n):
    venv = rl.SB3VecEnv(native(n=n, mode="swingup"))
    angles = [0.1, np.full(n, 0.2), 0.3]
    venv.set_options([{"theta": x, "omega": k, "gravity": 9 + k} for k, x in enumerate(angles)])
    venv.reset()
    expected = [[0.1 * (k + 1)] * n + [k] * n for k in range(COUNT)]
    np.testing.assert_allclose(venv.venv.unwrapped.state, expected)
