import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AsyncVectorEnv, AutoresetMode
from lanes import (
    actions_for,
    assert_infos_are_those_of_singles,
    assert_lanes_are_singles,
    assert_same,
    lane,
    make_vec,
    run,
)
from test_env_links import CHAIN
from test_hardware import EVERYTHING
from test_randomize import RANDOMIZE

from npend_gym import Chain, pseudo_periods
from npend_gym.envs.modes import MODES


@pytest.mark.parametrize("mode", ["passive", "calm"])
def test_fast_lanes_change_no_bit_of_others_and_are_the_single_env_too(mode):
    count, n = 20, 3
    omega = np.zeros((count, n))
    omega[3], omega[7], omega[18] = 60.0, -25.0, 9.0  # cut into 8, 4 and 2 parts at the start
    theta = np.linspace(-1.5, 1.5, count * n).reshape(count, n)
    keywords = {"n": n, "mode": mode, "damping": 0.003, "drag": 0.01}
    envs, singles = make_vec(count, **keywords), make_vec(count, "sync", **keywords)
    for each in (envs, singles):
        each.reset(seed=0)
    envs.state = np.hstack([theta, omega])
    for single, state in zip(singles.envs, envs.state, strict=True):
        single.unwrapped.state = state
    actions = actions_for(envs, 60)
    shown, expected = ([each.step(action) for action in actions] for each in (envs, singles))
    assert_lanes_are_singles(shown, expected)


KINDS = {mode: {"n": 3, "mode": mode} for mode in MODES}
KINDS["balance"]["spread"] = 0.9  # lanes fail at different steps
DRAWN = {"n": 3, "randomize": RANDOMIZE, "observe_context": True}
KINDS |= {f"{mode}, drawn": DRAWN | {"mode": mode} for mode in ("swingup", "balance", "transition")}
KINDS["goals, drawn"] = KINDS["transition, drawn"] | {"goal_env": True, "reward_type": "sparse"}
KINDS["cart, drawn"] = {
    "base": "cart", "actuated": (1,), "observe_context": True,
    "randomize": {
        "cart_mass": (0.5, 2.0), "max_force": (0.5, 1.0), "masses": (0.9, 1.1),
        "rail_damping": {"low": 0.0, "high": 2.0},
    },
}  # fmt: skip
KINDS["fifty rods"] = {"n": 50}
KINDS["sensors and motors"] = {"n": 2, "mode": "balance", "num_envs": 18} | EVERYTHING
KINDS["links with sensors and motors"] = {
    "chain": "realaigym C.1", "actuated": (0, 1), "num_envs": 17
} | EVERYTHING  # fmt: skip
EACH_KIND = [  # the kernels of motors and sensors take long to compile
    pytest.param(kind, marks=pytest.mark.long) if "motors" in kind else kind for kind in KINDS
]


@pytest.mark.parametrize("kind", EACH_KIND)
@pytest.mark.parametrize("autoreset", list(AutoresetMode))
def test_every_lane_is_the_single_env_of_its_seed_to_the_last_bit(kind, autoreset):
    # where nothing resets a lane, no episode ends
    steps, limit = (80, 25) if autoreset is not AutoresetMode.DISABLED else (10, 100)
    keywords = {"num_envs": 5, "max_episode_steps": limit} | KINDS[kind]
    vector = make_vec(autoreset_mode=autoreset, **keywords)
    singles = make_vec(
        vectorization_mode="sync", vector_kwargs={"autoreset_mode": autoreset}, **keywords
    )
    for space in ("observation_space", "action_space"):
        for owned in (space, f"single_{space}"):
            assert getattr(vector, owned) == getattr(singles, owned)
    assert vector.metadata["autoreset_mode"] is autoreset
    actions = actions_for(vector, steps)
    ours = run(vector, actions)
    assert_lanes_are_singles(ours, run(singles, actions))
    assert all(each[0] in vector.observation_space for each in ours)
    assert len(np.unique(ours[0][1]["theta"], axis=0)) == vector.num_envs  # every seed is another
    if kind == "balance" and steps > limit:
        assert 0 < max(each[2].sum() for each in ours[1:]) < vector.num_envs


@pytest.mark.parametrize("threads", [2, 3])
@pytest.mark.parametrize(
    "kind",
    [
        {"mode": "passive"},
        {"mode": "swingup"},
        DRAWN,
        pytest.param({"n": 50}, marks=pytest.mark.long),
        pytest.param(EVERYTHING, marks=pytest.mark.long),
    ],
    ids=["passive", "swingup", "drawn", "fifty rods", "sensors and motors"],
)
def test_threads_and_tiles_change_no_bit(kind, threads):
    keywords = {"n": 2, "max_episode_steps": 20} | kind
    alone = make_vec(150, **keywords)  # two tiles and a part
    shared, small = make_vec(150, threads=threads, **keywords), make_vec(3, **keywords)
    actions = actions_for(alone, 50)
    everything = run(alone, actions)
    assert_same(everything, run(shared, actions))
    few = run(small, [action[:3] for action in actions])
    for a, b in zip(everything, few, strict=True):
        assert_same([lane(x, 1) for x in a], [lane(x, 1) for x in b])
    shared.close()


def test_without_autoreset_a_done_lane_must_be_reset_by_mask():
    env = make_vec(3, **DRAWN, max_episode_steps=4, autoreset_mode=AutoresetMode.DISABLED)
    env.reset(seed=0)
    action = np.zeros((3, 1), np.float32)
    for _ in range(4):
        _, _, _, truncated, _ = env.step(action)
    assert truncated.all()
    with pytest.raises(RuntimeError, match="autoreset is disabled and the sub-environments"):
        env.step(action)
    alone = gym.make("NPendulum-v0", **DRAWN)
    alone.reset(seed=1)
    shown = env.reset(options={"reset_mask": truncated})
    assert_same([lane(each, 1) for each in shown], list(alone.reset()))
    assert_same(env.step(action)[0][1], alone.step(action[1])[0])


def test_a_partial_reset_leaves_the_other_lanes_alone():
    env = make_vec(3, n=2, mode="calm")
    env.reset(seed=0)
    for _ in range(10):
        env.step(np.zeros((3, 1), np.float32))
    before = env.step(np.zeros((3, 1), np.float32))
    mask = np.array([False, True, False])
    observation, info = env.reset(seed=[None, 5, None], options={"reset_mask": mask})
    assert_same(observation[[0, 2]], before[0][[0, 2]])
    assert info["_time"].tolist() == [False, True, False]
    fresh, _ = gym.make("NPendulum-v0", n=2, mode="calm").reset(seed=5)
    assert_same(observation[1], fresh)


EACH = np.random.default_rng(0).uniform(0.7, 1.3, (19, 3))  # of 19 lanes and 3 rods
SOME = EACH * (np.arange(19) % 2)[:, None]  # and 0 in every other lane
PASSIVE = {"n": 3, "mode": "passive"}
LINKS = {"inertias": 0.01 * EACH, "masses": EACH, "gravity": 9.0 * EACH[:, 0]}
ROTORS = {"friction": 0.05 * EACH, "gear": 6.0 * EACH, "armature": 1e-3 * EACH}
OPTIONS = {
    "bobs": (PASSIVE, {"lengths": EACH, "gravity": 9.0 * EACH[:, 0], "amplitude": 0.3}),
    "drag": (PASSIVE, {"drag": 0.5 * SOME, "quadratic_drag": SOME}),
    "links": ({"chain": Chain.multiarm(3), "actuated": (0, 2), "dt": 0.02}, LINKS),
    "machine": ({"chain": CHAIN, "actuated": (0, 2), "dt": 0.02}, LINKS | ROTORS),
}


@pytest.mark.parametrize(
    "kind",
    [
        # kernels of their own take long to compile
        pytest.param(kind, marks=pytest.mark.long) if kind in ("links", "machine") else kind
        for kind in OPTIONS
    ],
)
def test_options_are_those_of_each_lane_or_numbers_for_all_to_the_last_bit(kind):
    keywords, options = OPTIONS[kind]
    envs = make_vec(19, threads=2, **keywords)
    actions = actions_for(envs, 30)
    plain = run(envs, actions, seed=3)
    shown = [envs.reset(seed=3, options=options)] + [envs.step(action) for action in actions]
    assert np.abs(shown[-1][0] - plain[-1][0]).max() > 0.01
    for k in (0, 7, 18):
        alone = gym.make("NPendulum-v0", **keywords)
        own = {name: value[k] if np.ndim(value) else value for name, value in options.items()}
        expected = [alone.reset(seed=3 + k, options=own)] + [alone.step(a[k]) for a in actions]
        for many, one in zip(shown, expected, strict=True):
            assert_same([lane(part, k) for part in many], list(one))


@pytest.mark.parametrize(
    "chain",
    [Chain.uniform(1), pytest.param(Chain.rods(1.0, 1.0), marks=pytest.mark.long)],
    ids=["bobs", "links"],
)
def test_the_pseudo_period_is_zero_until_a_bob_has_completed_and_its_mask_is_true(chain):
    env = make_vec(2, chain=chain, mode="passive")
    env.reset(seed=0, options={"theta": np.array([[0.5], [0.0]])})
    for _ in range(220):
        info = env.step(np.zeros(2, np.int64))[-1]
    for name in ("pseudo_period", "pseudo_periods", "pseudo_period_com"):
        assert info[f"_{name}"].tolist() == [True, True]
        assert not info[name][1].any()
        expected = pseudo_periods(chain, 0.5, definition="com" if "com" in name else "bob")
        np.testing.assert_allclose(info[name][0], expected.mean(), rtol=0.0, atol=1e-6)
    assert info["_time"].all()


@pytest.mark.parametrize("autoreset", list(AutoresetMode))
def test_masks_are_those_of_gymnasium_in_every_step_of_episodes_that_complete_periods(autoreset):
    keywords = {"num_envs": 3, "n": 2, "mode": "passive", "dt": 0.05, "max_episode_steps": 70}
    kinds = (
        make_vec(autoreset_mode=autoreset, **keywords),
        make_vec(
            vectorization_mode="sync", vector_kwargs={"autoreset_mode": autoreset}, **keywords
        ),
    )
    first = np.array([True, False, True])
    shown = [[envs.reset(seed=0)] for envs in kinds]
    for step in range(300):
        for envs, seen in zip(kinds, shown, strict=True):
            seen.append(envs.step(np.zeros(3, np.int64)))
            if autoreset is AutoresetMode.DISABLED and step % 70 in (30, 69):
                # some lanes, then those that are done
                mask = first if step % 70 == 30 else seen[-1][2] | seen[-1][3]
                seen.append(envs.reset(options={"reset_mask": mask}) if mask.any() else ())
    assert shown[0][60][-1]["pseudo_period"].any()  # some bob has completed
    for mine, theirs in zip(*shown, strict=True):
        assert (mine[-1].keys() if mine else ()) == (theirs[-1].keys() if theirs else ())
        for info, expected in [(mine[-1], theirs[-1])] if mine else []:
            masks = {key: value for key, value in expected.items() if key.startswith("_")}
            assert_same({key: info[key] for key in masks}, masks)
            if "final_info" in expected:
                assert_infos_are_those_of_singles(info["final_info"], expected["final_info"])


def test_one_diverged_lane_disturbs_no_other():
    env, calm = make_vec(2, n=1, dt=0.05), make_vec(2, n=1, dt=0.05)
    env.reset(seed=0, options={"omega": np.array([[0.1], [0.999e6]]), "gravity": 9.81})
    calm.reset(seed=0, options={"omega": 0.1, "gravity": 9.81})
    action = np.zeros((2, 1), np.float32)
    outputs = [(env.step(action), calm.step(action)) for _ in range(10)]
    assert any(step[-1]["diverged"][1] for step, _ in outputs)
    for step, reference in outputs:
        assert np.isfinite(step[0]).all()
        assert_same(step[0][0], reference[0][0])


@pytest.mark.parametrize("copier", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize(
    "make",
    [
        lambda: gym.make("NPendulum-v0", **DRAWN),
        lambda: make_vec(3, n=2, threads=2, max_episode_steps=15),
    ],
    ids=["single", "vector"],
)
def test_a_copy_made_within_an_episode_continues_bit_for_bit(make, copier):
    env = make()
    actions = actions_for(env, 40)
    run(env, actions[:20])
    both = env, copier(env)
    assert_same(*([*(each.step(a) for a in actions[20:]), each.reset()] for each in both))


@pytest.mark.parametrize("context", ["fork", pytest.param("spawn", marks=pytest.mark.long)])
def test_gymnasiums_worker_processes_can_run_it(context):
    def make_one():
        return gym.make("npend_gym:NPendulum-v0", n=2)

    env = AsyncVectorEnv([make_one] * 2, context=context)
    actions = actions_for(env, 5)
    reference = make_vec(2, n=2)
    for a, b in zip(run(env, actions), run(reference, actions), strict=True):
        assert_same(a[0], b[0])
    env.close()


@pytest.mark.parametrize("mode", AutoresetMode)
def test_the_spec_of_a_vector_environment_survives_json_with_every_autoreset_mode(mode):
    envs = gym.make_vec("npend/Balance-v1", num_envs=3, n=1, autoreset_mode=mode)
    again = gym.make_vec(EnvSpec.from_json(envs.spec.to_json()))
    assert again.metadata["autoreset_mode"] is mode
    assert again.num_envs == 3
    assert_same(again.reset(seed=1), envs.reset(seed=1))


@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("name", ["NormalizeObservation", "RescaleObservation", "ClipAction"])
def test_gymnasiums_vector_wrappers_refuse_autoreset_modes_as_the_page_says(name, mode):
    refused = {"NormalizeObservation": "SAME_STEP, DISABLED", "RescaleObservation": "SAME_STEP"}
    bounds = {"RescaleObservation": (np.float32(-1.0), np.float32(1.0))}.get(name, ())
    envs = make_vec(2, n=1, observation="scaled", max_episode_steps=1, autoreset_mode=mode)

    def play():
        wrapped = getattr(gym.wrappers.vector, name)(envs, *bounds)
        wrapped.reset(seed=0)
        wrapped.step(np.zeros((2, 1), np.float32))

    if mode.name in refused.get(name, ""):
        with pytest.raises((AssertionError, ValueError)):
            play()
    else:
        play()


def test_call_renders_as_gymnasiums_own_vector_environments_do():
    pytest.importorskip("pygame", reason="pygame is not installed")
    keywords = {"n": 2, "render_mode": "rgb_array", "render_size": 60}
    envs = [
        gym.make_vec("npend/SwingUp-v1", num_envs=2, vectorization_mode=mode, **keywords)
        for mode in ("vector_entry_point", "sync")
    ]
    for each in envs:
        each.reset(seed=4)
    assert_same(*(each.call("render") for each in envs))
    with pytest.raises(ValueError, match=r"name must be \"render\", got 'reset'.*get_state"):
        envs[0].call("reset")


def test_any_sequence_of_seeds_has_one_for_each_lane():
    env = make_vec(3, n=2)
    expected = env.reset(seed=[4, 5, 6])[0]
    assert_same(env.reset(seed=range(4, 7))[0], expected)
    with pytest.raises(
        ValueError, match="seed must have an entry for each of the 3 sub-environments, got 4"
    ):
        env.reset(seed=range(4))
    for text in ("456", b"456"):
        with pytest.raises(TypeError, match="seed must be an integer"):
            env.reset(seed=text)
