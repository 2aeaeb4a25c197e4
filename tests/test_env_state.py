"""`get_state` and `set_state`: an episode continues from any of its instants, to the last bit."""

import copy
import io
import pickle
import re
from itertools import product
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from lanes import actions_for, assert_same, lane, run
from scripts import run_script

from npend_gym import Chain

ROOT = Path(__file__).parent.parent
COUNT = 5
KEYWORDS = {
    "n": 2,
    "mode": "balance",
    "randomize": {"masses": (0.8, 1.2), "max_torque": (0.5, 1.0)},
}


def make(**keywords):
    return gym.make("NPendulum-v0", **(KEYWORDS | keywords)).unwrapped


def make_vec(num_envs=COUNT, **keywords):
    return gym.make_vec("NPendulum-v0", num_envs=num_envs, **(KEYWORDS | keywords))


def through_a_file(state):
    file = io.BytesIO()
    np.save(file, state)
    file.seek(0)
    return np.load(file)


@pytest.mark.long
@settings(max_examples=25, phases=[Phase.generate])
@given(
    before=st.integers(0, 60),
    lanes=st.permutations(range(COUNT)),
    seed=st.integers(0, 2**100),
    copied=st.sampled_from([np.copy, through_a_file, lambda s: pickle.loads(pickle.dumps(s))]),
)
def test_lanes_continue_wherever_their_states_are_put(before, lanes, seed, copied):
    envs = make_vec(max_episode_steps=40)
    actions = actions_for(envs, before + 45)
    run(envs, actions[:before], seed)
    state = copied(envs.get_state(lanes))
    other = make_vec(max_episode_steps=40, threads=2)
    shown = other.set_state(state)
    assert other.get_state().tobytes() == state.tobytes()
    for action in actions[before:]:  # long enough for autoreset, with random chains
        expected, got = envs.step(action), other.step(action[lanes])
        for mine, reference in zip(got[:4], expected[:4], strict=True):
            assert_same(mine, reference[lanes])
        assert_same(got[4], {key: value[lanes] for key, value in expected[4].items()})
    assert other.np_random_seed == tuple(envs.np_random_seed[k] for k in lanes)
    assert_same(other.set_state(state), shown)


def test_some_lanes_are_put_back_and_the_others_are_left_alone():
    envs, twin = make_vec(), make_vec()
    actions = actions_for(envs, 12)
    for each in (envs, twin):
        run(each, actions[:8])
    state = envs.get_state()
    envs.step(actions[8])
    twin.step(actions[8])
    mask = np.array([False, True, False, True, False])
    _, info = envs.set_state(state[[3, 1]], mask)
    assert info["_time"].tolist() == mask.tolist()
    assert envs.get_state([1, 3]).tobytes() == state[[3, 1]].tobytes()
    got, expected = envs.step(actions[9]), twin.step(actions[9])
    for k in (0, 2, 4):
        assert_same([lane(part, k) for part in got], [lane(part, k) for part in expected])


@pytest.mark.parametrize("lanes", [np.zeros(COUNT, np.bool_), np.zeros(0, np.int64)])
def test_the_state_of_no_lanes_has_no_records(lanes):
    envs = make_vec()
    envs.reset(seed=0)
    before, state = envs.get_state(), envs.get_state(lanes)
    assert state.shape == (0,)
    assert state.dtype == before.dtype
    envs.set_state(state, lanes)
    assert envs.get_state().tobytes() == before.tobytes()


def test_a_single_environment_continues_and_so_do_its_next_episodes():
    env = make()
    env.reset(seed=3)
    env.reset()
    actions = actions_for(env, 30)
    for action in actions[:10]:
        env.step(action)
    state = env.get_state()
    assert state.shape == ()
    assert state["rods"]["theta"].shape == (3,)  # of 2 rods, and a base
    assert state["members"]["time"] == pytest.approx(0.2)
    ahead = [env.step(action) for action in actions[10:]], env.reset(), env.reset()
    other = make()
    other.set_state(state)
    assert_same(([other.step(a) for a in actions[10:]], other.reset(), other.reset()), ahead)
    assert other.np_random_seed == env.np_random_seed == 3


def test_state_is_angles_and_velocities_which_may_be_set():
    env, twin = make(randomize=None), make(randomize=None)
    env.reset(seed=0)
    twin.reset(seed=0, options={"theta": [3.0, 3.3], "omega": [0.1, -0.2]})
    env.step(np.ones(1))
    env.state = [3.0, 3.3, 0.1, -0.2]
    assert env.state.tolist() == [3.0, 3.3, 0.1, -0.2]
    action = np.array([0.3], np.float32)
    got, expected = env.step(action), twin.step(action)
    assert_same(got[0], expected[0])
    assert got[1] == expected[1]
    envs = make_vec(2, randomize=None)
    envs.reset(seed=0)
    envs.state = [[3.0, 3.3, 0.1, -0.2], [3.1, 3.0, 0.0, 0.0]]
    assert_same(envs.step(np.full((2, 1), 0.3, np.float32))[0][0], got[0])
    for bad in ([3.0, 3.3], [np.nan, 3.0, 0.0, 0.0], "up", [1e9, 0.0, 0.0, 0.0]):
        before = env.state
        with pytest.raises((TypeError, ValueError), match="state"):
            env.state = bad
        assert_same(env.state, before)


@pytest.mark.parametrize("mode", ["NEXT_STEP", "DISABLED"])
def test_the_state_of_lanes_that_are_done_is_set_after_their_reset(mode):
    envs = make_vec(2, randomize=None, autoreset_mode=mode, max_episode_steps=2)
    envs.reset(seed=0)
    envs.step(np.zeros((2, 1)))
    envs.reset(options={"reset_mask": np.array([True, False])})
    done = envs.step(np.zeros((2, 1)))[3]
    before, state = envs.state, np.full((2, 4), 0.1)
    with pytest.raises(ValueError, match=r"got done sub-environments \[1\]: reset them first"):
        envs.state = state
    assert_same(envs.state, before)
    envs.reset(options={"reset_mask": done})
    envs.state = state
    assert envs.step(np.zeros((2, 1)))[4]["time"].tolist() == [envs.unwrapped.config.dt] * 2


def of_version(version):
    def change(state):
        state = state.copy()
        state["version"] = version
        return state

    return change


def later(state):
    state["members"]["time"][3] += 1.0
    return state


def from_other(**keywords):
    def make_other(state):
        other = make_vec(len(state), **keywords)
        other.reset(seed=0)
        return other.get_state()

    return make_other


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (of_version(1), ValueError, "state must have version 4, that of this package, got"),
        (of_version(5), ValueError, "state must have version 4, that of this package, got"),
        (from_other(n=3), ValueError, "state must come from .* the same number of rods"),
        (from_other(masses=2.0), ValueError, "state must come from .* the same chain"),
        (from_other(mode="calm"), ValueError, "state must come from .* mode"),
        (from_other(dt=0.01), ValueError, "state must come from .* dt"),
        (from_other(substeps=3), ValueError, "state must come from .* substeps"),
        (from_other(max_torque=1.0), ValueError, "state must come from .* max_torque"),
        (from_other(randomize=None), ValueError, "state must come from .* randomize"),
        (
            from_other(chain=Chain.uniform(2, friction=0.1), randomize=None),
            ValueError,
            "kind of chain",
        ),
        (lambda state: state[:3], ValueError, "state must hold 5 sub-environments, got 3"),
        (lambda state: state["rods"], ValueError, "state must come from"),
        (lambda state: state.tolist(), TypeError, r"state must come from get_state\(\)"),
        (lambda _: None, TypeError, r"state must come from get_state\(\), got None"),
        (later, ValueError, r"got changed records \[3\]: set env.state, or"),
    ],
)
def test_what_is_no_state_of_this_environment_is_refused_and_nothing_has_changed(
    change, error, message
):
    envs = make_vec()
    envs.reset(seed=1)
    before = envs.get_state()
    with pytest.raises(error, match=message):
        envs.set_state(change(before.copy()))
    assert envs.get_state().tobytes() == before.tobytes()


KINDS = {
    "links on a cart": {
        "base": "cart",
        "inertias": 0.1,
        "friction": 0.1,
        "armature": 0.01,
        "randomize": {"masses": (0.8, 1.2), "max_force": (0.5, 1.0)},
    },
    "motors and sensors": {"action_delay": 1.5, "motor_lag": 0.1, "observation_delay": 2.5},
    "goals": {"mode": "transition"},
}


def leaves(dtype, path=()):
    """Yield the path of every field of numbers."""
    for name in dtype.names:
        inner = dtype[name]
        yield from leaves(inner, (*path, name)) if inner.names else [(*path, name)]


@pytest.mark.parametrize("vector", [False, True], ids=["single", "vector"])
@pytest.mark.parametrize(
    "kind", [{}, *(pytest.param(k, marks=pytest.mark.long, id=n) for n, k in KINDS.items())]
)
def test_a_state_with_a_changed_bit_is_refused_whatever_it_is_of_and_changes_nothing(kind, vector):
    env, twin = ((make_vec if vector else make)(**kind) for _ in range(2))
    actions = actions_for(env, 12)
    for each in (env, twin):
        run(each, actions[:8])
    state, refused = env.get_state(), set()
    for path, bit in product(leaves(state.dtype), (0, 63)):
        forged = state.copy()
        field = forged
        for name in path:
            field = field[name]
        if field.size == 0:
            continue
        number = np.array(field.flat[0])
        field.flat[0] = (number.view("u8") ^ np.uint64(1 << bit)).view(number.dtype)
        assert forged.tobytes() != state.tobytes()
        with pytest.raises(ValueError, match=r"state must"):
            env.set_state(forged)
        refused.add(path)
    assert len(refused) > 50
    for bad in (state.astype(state.dtype.newbyteorder()), state[["version", "done"]], [state]):
        with pytest.raises((TypeError, ValueError), match=r"state must"):
            env.set_state(bad)
    for action in actions[8:]:
        assert_same(env.step(action), twin.step(action))
    env.set_state(state)
    assert env.get_state().tobytes() == state.tobytes()


def test_a_diverged_lane_continues():
    envs = make_vec(3, randomize=None, max_torque=1e25, substeps=1, autoreset_mode="DISABLED")
    envs.reset(seed=0)
    diverged = envs.step(np.array([[1.0], [0.0], [0.0]]))[4]["diverged"]
    assert diverged.tolist() == [True, False, False]
    state = envs.get_state()
    envs.set_state(state)
    assert envs.get_state().tobytes() == state.tobytes()


def test_a_copied_environment_takes_and_gives_states_as_its_original_does():
    env = make(motor_lag=0.3)
    env.reset(seed=0)
    env.step(np.array([0.7]))
    copied, again = copy.deepcopy(env), pickle.loads(pickle.dumps(env))
    early, fresh = env.get_state(), make(motor_lag=0.3)
    fresh.set_state(early)
    expected = fresh.step(np.array([0.4]))
    for each in (env, copied, again):
        each.step(np.array([-0.2]))
        late = each.get_state()
        assert late.tobytes() == env.get_state().tobytes()
        each.set_state(early)
        assert each.get_state().tobytes() == early.tobytes()
        assert_same(each.step(np.array([0.4])), expected)
        each.set_state(late)


@pytest.mark.parametrize("lanes", [[5], [-1], [0.5], [0, 0], [True, False], "all"])
def test_lanes_that_are_none_are_refused(lanes):
    envs = make_vec()
    envs.reset(seed=1)
    before = envs.get_state()
    with pytest.raises((TypeError, ValueError), match="which must"):
        envs.get_state(lanes)
    with pytest.raises((TypeError, ValueError), match="which must"):
        envs.set_state(before[: len(lanes)], lanes)
    assert envs.get_state().tobytes() == before.tobytes()


def test_before_the_first_reset_there_is_no_state_to_get():
    state = make_vec()
    for env in (make(), state):
        with pytest.raises(gym.error.ResetNeeded, match="get_state"):
            env.get_state()
        with pytest.raises(gym.error.ResetNeeded, match="state"):
            _ = env.state
    full = make_vec()
    full.reset(seed=0)
    with pytest.raises(gym.error.ResetNeeded, match="set_state of some sub-environments"):
        state.set_state(full.get_state([0]), [0])


def test_a_planner_that_knows_only_the_states_swings_the_pendulum_up(tmp_path):
    out = run_script(ROOT / "examples" / "plan_by_search.py", cwd=tmp_path)
    after, held = map(float, re.search(r"upright after (\S+) s, and for the (\S+) s", out).groups())
    assert 1.0 < after < 8.0
    assert held > 5.0


@pytest.mark.parametrize("mode", ["passive", "calm", "swingup"])
def test_energy_counts_from_a_state_that_was_set(mode):
    whole, moved = (make(n=1, mode=mode, randomize=None) for _ in range(2))
    for env in (whole, moved):
        env.reset(seed=0, options={"theta": [0.5], "omega": [0.0]})
    moved.step(moved.action_space.sample())
    moved.state = [0.5, 0.0]
    idle = 0 * moved.action_space.sample()
    (*_, reward, _, _, expected), (*_, found, _, _, info) = (e.step(idle) for e in (whole, moved))
    assert found == reward
    assert abs(info["energy_error"]) < 1e-7
    assert info["energy"] == expected["energy"]
    moved.state = [0.0, 0.0]
    assert abs(moved.step(idle)[-1]["energy_error"]) < 1e-7


def test_an_environment_tells_the_chain_of_its_episode():
    env = make(randomize={"lengths": (0.5, 1.5), "cart_mass": (0.5, 1.5)}, base="cart")
    drawn = []
    for seed in (0, 1):
        env.reset(seed=seed)
        drawn.append(env.chain)
        kept = env.get_state()
        assert env.chain.base.mass == pytest.approx(1.0 / kept["base"][0, 0], rel=1e-12)
    assert drawn[0] != drawn[1]
    env.reset(seed=0, options={"lengths": [0.3, 0.4]})
    assert env.chain.lengths.tolist() == [0.3, 0.4]
