import os
import platform
from dataclasses import replace
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from policy_files import random_policy, small_policy
from scripts import run_python

from npend_gym import Chain, rl
from npend_gym.envs import EnvConfig, NPendulumEnv
from npend_gym.rl import Policy, evaluate, observation_of, pretrained_names
from npend_gym.rl.policies.model_card import task_of
from npend_gym.rl.training.tasks import env_of_task


@pytest.mark.parametrize(("given", "message"), [
    ({"activation": "gelu"}, "activation must be one of"),
    ({"output": "sigmoid"}, "output must be one of"),
    ({"limit": -1.0}, "limit must be"),
    ({"provenance": {"env": {}}}, r"provenance\['env'\] must be left out"),
    ({"provenance": {"crc32": 5}}, r"provenance\['crc32'\] must be left out"),
    ({"weights": [np.zeros((1, 4))], "biases": [np.zeros(1)]}, r"weights\[0\] .* \(m, 6\) and"),
    ({"weights": [np.zeros((1, 6))]}, "one entry for each layer, got 1 and 3"),
    ({"weights": [], "biases": []}, "weights and biases must have one entry"),
    ({"scale": np.zeros(6)}, "overflow"),
    ({"scale": np.full(6, np.inf)}, "must be finite"),
    ({"offset": np.zeros(5)}, r"offset must have the shape of scale, \(6,\), got \(5,\)"),
    ({"env": {"n": 1, "observation": "sincos"}}, "observes 3 numbers .* policy is for 6 and 1"),
    ({"env": {"n": 2, "actuated": [0, 1], "observation": "sincos"}}, "2 motors"),
    ({"env": "swingup"}, "env must be a dict, got 'swingup'"),
    ({"provenance": None}, "provenance must be a dict, got None"),
    ({"scale": None}, "scale must be an array of numbers, got None"),
    ({"offset": "0"}, "offset must be an array of numbers, got '0'"),
    ({"weights": 3}, "weights must be a list such as"),
    ({"biases": [[0.0], [0.0], [[0.0], [1.0, 2.0]]]}, r"biases\[2\] must be an array of numbers"),
])  # fmt: skip
def test_a_network_that_no_file_could_hold_is_refused_at_once(given, message):
    with pytest.raises((TypeError, ValueError), match=message):
        replace(small_policy(), **given)


@pytest.mark.parametrize("kind", [list, tuple])
def test_lists_and_tuples_stand_for_arrays(kind):
    policy = small_policy()
    numbers = {name: kind(getattr(policy, name)) for name in ("weights", "biases")}
    lists = {name: kind(each.tolist() for each in value) for name, value in numbers.items()}
    assert replace(policy, scale=kind(policy.scale.tolist()), **lists) == policy


def test_nothing_else_changes_the_numbers_of_a_policy():
    scale, policy = np.full(6, 2.0, np.float32), small_policy()
    own = replace(policy, scale=scale)
    scale[:] = 5.0
    assert own == policy
    with pytest.raises(ValueError, match="read-only"):
        own.weights[0][:] = 0.0


def test_actions_do_not_depend_on_how_many_are_asked_for_at_once():
    policy, rng = Policy.pretrained("swingup-6"), np.random.default_rng(0)
    observations = rng.normal(size=(2000, policy.observed)).astype(np.float32)
    together = policy(observations)
    for size in (1, 3, 64):
        parts = [policy(observations[k : k + size]) for k in range(0, 2000, size)]
        np.testing.assert_array_equal(np.concatenate(parts), together)


_DIGESTS = """
import hashlib
import numpy as np
from npend_gym.rl import Policy

policy, rng = Policy.pretrained("swingup-6"), np.random.default_rng(0)
seen = rng.normal(size=(20000, policy.observed)).astype(np.float32)
for values in policy(seen), seen @ policy.weights[0].T:
    print(hashlib.sha256(values.tobytes()).hexdigest())
"""


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="kernels of x86-64")
def test_actions_have_the_same_bits_where_a_processor_sums_in_another_order():
    """OpenBLAS takes the kernels of the processor that is named; products in float32 differ."""
    kinds = "Prescott", "Haswell"
    printed = [
        run_python("-c", _DIGESTS, env=os.environ | {"OPENBLAS_CORETYPE": kind}).split()
        for kind in kinds
    ]
    (actions, others), (products, other_products) = zip(*printed, strict=True)
    assert actions == others
    assert products != other_products


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_scalars_and_arrays_of_numpy_do_not_change_what_a_policy_computes(kind, tmp_path):
    path, obs = tmp_path / "policy.safetensors", np.random.default_rng(1).normal(size=(50, 6))
    policy = replace(small_policy(), limit=kind(0.5))
    policy.save(path)
    expected = replace(small_policy(), limit=0.5)(obs.astype(np.float32))
    for each in (policy, Policy.load(path)):
        assert each(obs).dtype == np.float32
        np.testing.assert_array_equal(each(obs), expected)


def test_keywords_of_numpy_are_kept_as_plain_values(tmp_path):
    path, policy = tmp_path / "policy.safetensors", small_policy()
    replace(policy, env=policy.env | {"dt": np.float64(0.05), "n": np.int64(2)}).save(path)
    assert Policy.load(path).env["n"] == 2


TRAINED = {"steps": 10, "seconds": 2.0, "return": 3.0}
ABOUT = {"trained_by": "a test", "training": TRAINED}


@pytest.mark.parametrize("depth", [1, 3])
def test_an_ensemble_acts_with_the_mean_of_its_policies(depth, tmp_path):
    rng = np.random.default_rng(3)
    sizes = [(4, 6), (4, 4), (2, 4)] if depth == 3 else [(2, 6)]
    env = {"n": 2, "mode": "calm", "observation": "sincos", "actuated": [0, 1]}
    scale = np.full(6, 2.0)
    seeds = [
        random_policy(sizes, env, rng, 0.15, scale=scale, provenance=ABOUT | {"seed": seed})
        for seed in range(3)
    ]
    rl.ensemble(seeds).save(tmp_path / "mean.safetensors")
    loaded = Policy.load(tmp_path / "mean.safetensors")
    obs = rng.normal(size=(50, 6)).astype(np.float32)
    expected = np.mean([policy(obs) for policy in seeds], axis=0)
    assert np.abs(expected).max() < 0.9  # so that no action was clipped
    np.testing.assert_allclose(loaded(obs), expected, atol=1e-6)
    about = loaded.provenance
    assert [member["seed"] for member in about["members"]] == [0, 1, 2]
    assert about["trained_by"] == "a test"
    assert about["training"] == {"steps": 30, "seconds": 6.0}


def test_an_ensemble_in_an_ensemble_counts_as_its_members():
    rng = np.random.default_rng(4)
    env, sizes = {"n": 2, "mode": "calm", "observation": "sincos"}, [(4, 6), (1, 4)]
    one, two, three = (
        random_policy(sizes, env, rng, 0.3, provenance=ABOUT | {"seed": seed}) for seed in range(3)
    )
    nested = rl.ensemble([rl.ensemble([one, two], weights=[2, 1]), three], weights=[2, 1])
    flat = rl.ensemble([one, two, three], weights=[4, 2, 3])
    obs = rng.normal(size=(50, 6)).astype(np.float32)
    np.testing.assert_allclose(nested(obs), flat(obs), atol=1e-6)
    for about in (nested.provenance, flat.provenance):
        assert [member["seed"] for member in about["members"]] == [0, 1, 2]
        assert about["arguments"]["weights"] == pytest.approx([4 / 9, 2 / 9, 3 / 9])
        assert about["training"] == {"steps": 30, "seconds": 6.0}


def test_an_ensemble_clips_the_mean_and_not_each_output():
    constant = [
        small_policy(weights=[np.zeros((1, 6))], biases=[np.array([value])])
        for value in (3.0, -2.0)
    ]
    np.testing.assert_allclose(rl.ensemble(constant)(np.zeros(6, np.float32)), [0.5])
    weighted = rl.ensemble(constant, weights=[1, 3])
    np.testing.assert_allclose(weighted(np.zeros(6, np.float32)), [-0.75])
    assert "training" not in weighted.provenance  # of which nothing is known
    for weights, rule in (
        ([1, 1, 1], "an array of shape"),
        ([1, 0], "greater than zero"),
        (2.0, r"an array of shape \(2,\), .* shape \(\)"),
    ):
        with pytest.raises(ValueError, match=f"weights must be .*{rule}"):
            rl.ensemble(constant, weights=weights)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("env", {"env": {"n": 2, "mode": "swingup", "observation": "sincos"}}),
        ("scale", {"scale": np.ones(6, np.float32)}),
        ("offset", {"offset": np.ones(6, np.float32)}),
        ("output", {"output": "tanh"}),
        ("number of layers", {"weights": [np.zeros((1, 6))], "biases": [np.zeros(1)]}),
    ],
)
def test_an_ensemble_of_policies_that_differ_is_refused(name, changes):
    with pytest.raises(ValueError, match=rf"must have the same {name}, got .*policies\[1\]: train"):
        rl.ensemble([small_policy(), small_policy(**changes)])


def test_an_ensemble_of_no_policy_is_refused():
    with pytest.raises(ValueError, match="policies must be one or more, got none"):
        rl.ensemble([])
    for given in ([small_policy(), 3], small_policy(), 3):
        with pytest.raises(TypeError, match="policies must be several `Policy`, got"):
            rl.ensemble(given)
    pair = [small_policy(), small_policy()]
    assert rl.ensemble(iter(pair)) == rl.ensemble(pair)


def test_a_function_becomes_no_policy():
    with pytest.raises(TypeError, match="model must be one of Stable-Baselines3, got <ufunc"):
        Policy.from_sb3(np.tanh, {"n": 1})


def test_a_policy_may_observe_one_number_of_each_rod(tmp_path):
    env = {"n": 3, "observation": "angles", "observe_velocities": False}
    policy = Policy(
        np.ones(3, np.float32), [np.ones((1, 3), np.float32)], [np.zeros(1, np.float32)], env
    )
    policy.save(tmp_path / "angles.safetensors")
    assert Policy.load(tmp_path / "angles.safetensors").env == env


def test_a_policy_may_say_how_long_its_episodes_are(tmp_path):
    policy = replace(small_policy(), env=small_policy().env | {"max_episode_steps": 7})
    policy.save(tmp_path / "short.safetensors")
    loaded = Policy.load(tmp_path / "short.safetensors")
    assert loaded.config.n == EnvConfig(**loaded.env).n == small_policy().config.n
    assert task_of(loaded.env) == "npend/Calm-v1"
    assert loaded.env == policy.env
    with pytest.raises(TypeError, match="max_episode_steps must be an integer, got 'abc'"):
        EnvConfig(**loaded.env | {"max_episode_steps": "abc"})
    with pytest.raises(TypeError, match=r"gym\.make\(\.\.\., max_episode_steps"):
        NPendulumEnv(**loaded.env)
    envs = gym.make_vec("npend/SwingUp-v1", num_envs=1, **loaded.env)
    assert envs.unwrapped.max_episode_steps == 7
    with pytest.raises(ValueError, match="max_episode_steps must be"):
        replace(policy, env=policy.env | {"max_episode_steps": 0})


def test_policies_are_equal_where_their_numbers_and_their_environments_are(tmp_path):
    policy = small_policy()
    policy.save(str(tmp_path / "a.safetensors"))
    loaded = Policy.load(str(tmp_path / "a.safetensors"))
    assert policy == loaded == replace(policy, provenance={})
    assert hash(policy) == hash(loaded)
    assert loaded in [small_policy(), replace(policy, env={})]
    chain = Chain.uniform(2)
    others = [
        replace(policy, scale=np.full(6, 3.0, np.float32)),
        replace(policy, biases=[bias + 1.0 for bias in policy.biases]),
        replace(policy, env=policy.env | {"mode": "balance"}),
        replace(policy, env={"chain": chain, "observation": "sincos"}),
    ]
    assert all(policy != other for other in others)
    assert policy not in others
    assert policy != "swingup-1"
    copied = {"chain": Chain.from_dict(chain.as_dict()), "observation": "sincos"}
    assert others[-1] == replace(policy, env=copied)
    first, same, different = (
        replace(policy, env=policy.env | {"masses": np.array([1.0, mass])})
        for mass in (2.0, 2.0, 3.0)
    )
    assert first == same != different


def test_the_error_for_an_unknown_pretrained_policy_lists_the_known_ones():
    for name in ("swingup-99", "../policies"):
        with pytest.raises(ValueError, match="pretrained must be one of"):
            Policy.pretrained(name)
    assert "swingup-99" not in pretrained_names()


LONG = "pendubot", "smooth", "performance", "hardware", "robust", "calm-50"


@pytest.mark.parametrize(
    "name",
    [
        # kernels of links take long to compile, and many steps of many rods long to take
        pytest.param(
            name,
            marks=[pytest.mark.long] * (name.endswith(LONG) or "transition-3" in name)
            + [pytest.mark.nightly] * (name == "calm-50"),
        )
        for name in pretrained_names()
    ],
)
def test_a_pretrained_policy_succeeds_as_often_as_recorded(name):
    policy = Policy.pretrained(name)
    recorded = policy.provenance["evaluation"]
    evaluation = evaluate(policy, policy.env, episodes=recorded["episodes"])
    # tanh is the system's own
    assert evaluation.success_rate == pytest.approx(recorded["success"], abs=0.02)
    assert evaluation.success_rate > 0.9


@pytest.mark.long
@pytest.mark.parametrize("task", ["swingup-1", "calm-2"])
def test_a_robust_policy_holds_over_the_whole_range_of_training(task):
    policy, nominal = Policy.pretrained(f"{task}-robust"), Policy.pretrained(task)
    drawn = env_of_task(f"{task}-robust")["randomize"]
    for name in ("masses", "lengths", "gravity", "max_torque"):
        assert drawn[name] == [0.8, 1.2]
    assert not EnvConfig(**policy.env).observe_context  # it is not told which chain it has
    slow = {"masses": (1.2, 1.2), "lengths": (1.2, 1.2), "max_torque": (0.8, 0.8)}
    heavy = {"gravity": (1.5, 1.5)}
    for randomize in (drawn, slow, heavy):
        keywords = policy.env | {"randomize": randomize}
        assert evaluate(policy, keywords, episodes=20).success_rate >= 0.95
    falls = evaluate(nominal, nominal.env | {"randomize": heavy}, episodes=20).success_rate
    assert falls == (0.0 if task == "swingup-1" else 1.0)  # calming forgives much


TASKS = {
    "angles": {"n": 3, "mode": "calm"},
    "sincos": {"n": 2, "mode": "swingup", "observation": "sincos"},
    "scaled": {"n": 2, "mode": "swingup", "observation": "scaled", "lengths": [1.0, 0.5]},
    "cart": {"n": 1, "mode": "balance", "base": "cart", "rail": 2.4, "observation": "scaled"},
    "goal": {"n": 2, "mode": "transition", "observation": "sincos"},
    "still": {"n": 2, "mode": "swingup", "observe_velocities": False},
    "still cart": {"n": 1, "mode": "balance", "base": "cart", "observe_velocities": False},
}


@pytest.mark.parametrize("task", TASKS)
def test_measured_angles_and_velocities_become_what_the_environment_observes(task):
    envs = gym.make_vec("NPendulum-v0", num_envs=50, **TASKS[task])
    config, rng = envs.unwrapped.config, np.random.default_rng(0)
    theta = rng.uniform(-9.0, 9.0, (50, config.n))
    omega = rng.uniform(-12.0, 12.0, (50, config.n))
    options = {"theta": theta, "omega": omega}
    if "cart" in task:
        options |= {
            "cart_position": rng.uniform(-2.0, 2.0, 50),
            "cart_velocity": rng.normal(size=50),
        }
    observed, info = envs.reset(seed=0, options=options)
    others = {key: options[key] for key in options if key not in ("theta", "omega")}
    others |= {"goal": info["goal"]} if task == "goal" else {}
    found = observation_of(config, theta, omega, **others)
    assert found.dtype == observed.dtype
    np.testing.assert_allclose(found, observed, rtol=3e-7, atol=3e-7)
    joints = (np.diff(each, prepend=0.0) for each in (theta, omega))
    encoders = observation_of(config, *joints, relative=True, **others)
    np.testing.assert_allclose(encoders, observed, rtol=1e-5, atol=1e-5)
    one = observation_of(config, theta[3], omega[3], **{k: v[3] for k, v in others.items()})
    np.testing.assert_array_equal(one, found[3])


def test_small_and_many_times_turned_angles_are_observed_to_the_last_bit():
    rng = np.random.default_rng(0)
    small, turned = rng.normal(0.0, 1e-9, (500, 2)), 2.0 * np.pi * rng.integers(-900, 900, (500, 2))
    theta = np.concatenate([small, turned + 1e-7, rng.uniform(-9.0, 9.0, (500, 2))])
    envs = gym.make_vec("NPendulum-v0", num_envs=len(theta), n=2, observation="angles")
    observed, _ = envs.reset(seed=0, options={"theta": theta, "omega": 0.0})
    found = observation_of(envs.unwrapped.config, theta, np.zeros_like(theta))
    np.testing.assert_array_equal(found, observed)


@pytest.mark.parametrize("many", [False, True])
def test_a_policy_refuses_scaled_observations_of_an_environment_without_info_too(many):
    policy = Policy.pretrained("swingup-2")
    make = partial(gym.make_vec, num_envs=3) if many else gym.make
    env, own = make("npend/SwingUp-v1"), make("npend/SwingUp-v1", **policy.env)
    for show in (partial(env.reset, seed=0), partial(env.step, env.action_space.sample())):
        observation = show()[0]
        for shown in (observation, observation[-1:] if many else observation[None]):
            with pytest.raises(ValueError, match=r"must be 'sincos' of 2 rods, .* got 'scaled'"):
                policy(shown)
    own.reset(seed=0)
    observation, *_, info = own.step(own.action_space.sample())
    np.testing.assert_array_equal(policy(observation), policy(observation, info))


def test_a_policy_acts_on_measured_angles_as_on_what_its_environment_shows():
    policy = Policy.pretrained("swingup-2")
    envs = gym.make_vec("NPendulum-v0", num_envs=5, **policy.env)
    observation, info = envs.reset(seed=1)
    actions = policy.act(info["theta"], info["omega"])
    np.testing.assert_allclose(actions, policy(observation), atol=1e-5)
    one = policy.act(info["theta"][2].tolist(), info["omega"][2].tolist())
    np.testing.assert_allclose(one, actions[2], atol=1e-6)


TRANSITION, ONE, AT_REST = {"n": 2, "mode": "transition"}, {"n": 1}, ([0.0] * 2, [0.0] * 2)
TOLD = {"n": 2, "randomize": {"masses": (0.9, 1.1)}, "observe_context": True}
ON_CART = Policy.pretrained("swingup-1-cart").env


@pytest.mark.parametrize(("env", "state", "more", "message"), [
    (TRANSITION, ([0.0] * 3, [0.0] * 3), {}, r"theta must have .* \(2,\) or \(B, 2\), got \(3,\)"),
    (TRANSITION, ([0.0] * 2, [[0.0] * 2]), {}, "omega must have the shape of theta"),
    (TRANSITION, AT_REST, {}, "goal must be given in mode 'transition'"),
    (TRANSITION, AT_REST, {"goal": [[0.0] * 2] * 3}, r"goal must have the shape \(2,\) .*\(3, 2\)"),
    (TRANSITION, (np.zeros((4, 2)),) * 2, {"goal": [[0.0] * 2] * 3}, r"goal must .* or \(4, 2\)"),
    (TOLD, AT_REST, {}, "observe_context must be False"),
    (ON_CART, ([0.1], [0.0]), {"cart_position": np.nan}, "cart_position"),
    (ONE, ([0.1], [0.0]), {"cart_position": 1.0}, "must be 0 for a chain without a cart"),
    (ONE, ([0.1], [0.0]), {"goal": [0.0]}, "goal must be left out in mode 'swingup'"),
    (
        TRANSITION | {"goal_env": True, "reward_type": "sparse"}, AT_REST, {"goal": [0.0, 0.0]},
        "goal must be left out with goal_env=True",
    ),
])  # fmt: skip
def test_what_no_environment_can_observe_is_refused(env, state, more, message):
    with pytest.raises(ValueError, match=message):
        observation_of(EnvConfig(**env), *state, **more)


def test_an_observation_of_another_environment_is_refused_with_the_way_out():
    policy = Policy.pretrained("swingup-2")
    with pytest.raises(ValueError, match=r"must have 6 entries, got \(9,\): make the environment"):
        policy(np.zeros(9, np.float32))
    assert repr(policy).startswith("Policy(6-64-64-1, env={'n': 2")


@pytest.mark.parametrize("name", ["swingup-2", "calm-2", "swingup-2-robust"])
def test_a_policy_raises_where_the_observation_of_an_id_is_not_its_own(name):
    policy = Policy.pretrained(name)
    keywords = {k: v for k, v in policy.env.items() if k not in ("observation", "randomize")}
    envs = gym.make_vec("npend/SwingUp-v1", num_envs=3, **keywords)
    observation, info = envs.reset(seed=0, options={"omega": np.zeros((3, 2))})
    policy(observation, info)  # a chain at rest shows nothing yet
    observation, _, _, _, info = envs.step(np.ones((3, 1), np.float32))
    with pytest.raises(ValueError, match=r"must be 'sincos' of 2 rods.*got 'scaled'.*policy\.env"):
        policy(observation, info)


def test_a_policy_raises_where_the_observation_is_of_another_number_of_rods():
    policy, env = Policy.pretrained("swingup-2"), gym.make("NPendulum-v0", n=3)
    with pytest.raises(ValueError, match=r"must be 'sincos' of 2 rods.*got that of 3 rods"):
        policy(*env.reset(seed=0))


@pytest.mark.long
def test_a_policy_acts_on_its_own_observations_with_noise_another_chain_and_a_cart():
    for name, others in (
        ("swingup-2", {"velocity_noise": 0.1, "observation_delay": 1}),
        ("swingup-2", {"lengths": [0.9, 1.1]}),
        ("swingup-2-cart", {}),
    ):
        policy = Policy.pretrained(name)
        env = gym.make("npend/SwingUp-v1", **policy.env | others)
        observation, info = env.reset(seed=0)
        for _ in range(3):
            observation, _, _, _, info = env.step(policy(observation, info))


JUDGES = [rl.evaluate, rl.performance, rl.recovery, rl.robustness]


@pytest.mark.parametrize("judge", JUDGES)
def test_every_judge_refuses_a_seed_that_is_none_and_environments_of_others(judge):
    policy = Policy.pretrained("swingup-1")
    for seed, error in ((None, TypeError), (0.5, TypeError), (-1, ValueError)):
        with pytest.raises(error, match=f"seed must be .*, got {seed}"):
            judge(policy, policy.env, seed=seed)
    ids = "CartPole-v1", gym.spec("CartPole-v1"), "Pendulum-v1"
    for env in (*ids, {"id": "CartPole-v1", "n": 1}):
        with pytest.raises(TypeError, match=r"env must be an id .* got '(CartPole|Pendulum)-v1'"):
            judge(policy, env)
    for env in (None, 3, gym.make_vec("CartPole-v1", num_envs=2)):
        with pytest.raises(TypeError, match=r'env must be an id such as "npend/SwingUp-v1"'):
            judge(policy, env)


@pytest.mark.parametrize("judge", JUDGES)
@pytest.mark.parametrize("model", ["swingup-2", lambda observation: observation, np.float64(1.0)])
def test_every_judge_refuses_a_model_that_takes_no_observation_and_info(judge, model):
    with pytest.raises(TypeError, match=r"model must be callable as model\(observation, info\)"):
        judge(model, {"n": 1})


def test_a_policy_takes_the_discrete_actions_nearest_to_its_torques():
    env = {"n": 2, "actuated": (0, 1), "observation": "sincos"}
    policy = random_policy([(4, 6), (2, 4)], env)
    levels = (-1.0, -0.5, 0.0, 0.5, 1.0)
    table = np.array([(i, j) for i in levels for j in levels])

    def nearest(observation, info):
        away = policy(observation, info).clip(-1.0, 1.0)[:, None] - table
        return (away**2).sum(axis=-1).argmin(axis=-1)

    env = env | {"torque_levels": 5, "max_episode_steps": 40}
    found, expected = (evaluate(each, env, episodes=3).returns for each in (policy, nearest))
    np.testing.assert_array_equal(found, expected)


ACROBOT = Policy.pretrained("swingup-2-acrobot").env


@pytest.mark.parametrize("judge", JUDGES)
@pytest.mark.parametrize(
    ("name", "env", "message"),
    [
        (
            "swingup-2", {"id": "npend/SwingUp-v1", "n": 2},
            r"must be 'sincos'.*got 'scaled'.*policy\.env \|",
        ),
        (
            "swingup-2-acrobot", ACROBOT | {"actuated": (0,)},
            r"actuated must be \(1,\), .* got \(0,\): .* policy\.env",
        ),
        (
            "swingup-2-acrobot", ACROBOT | {"actuated": (0, 1)},
            r"actuated must be \(1,\), .* got \(0, 1\): .* policy\.env",
        ),
    ],
    ids=["observation", "another motor", "two motors"],
)  # fmt: skip
def test_no_judge_takes_a_policy_to_an_environment_unlike_its_own(judge, name, env, message):
    with pytest.raises(ValueError, match=message):
        judge(Policy.pretrained(name), env)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda _: observation_of("npend/SwingUp-v1", 0.0, 0.0), "config must be the settings of"),
        (lambda _: evaluate("swingup-1", {"n": 1}), "got 'swingup-1': Policy.pretrained or"),
        (
            lambda policy: rl.write_repository("a", policy, "me/a"),
            "must be a Policy, got 'a'",
        ),
    ],
)
def test_what_is_given_for_a_policy_or_its_settings_is_named(call, message):
    if "Policy, got" in message:
        pytest.importorskip("huggingface_hub")
    with pytest.raises(TypeError, match=message):
        call(Policy.pretrained("swingup-1"))
