"""Environments with any combination of their keywords keep what all of them promise."""

import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from lanes import actions_for, assert_lanes_are_singles, assert_same, lane, run

from npend_gym import Chain
from npend_gym.envs import EnvKeywords
from npend_gym.envs.keywords import CHAIN_KEYWORDS
from npend_gym.envs.modes import MODES
from npend_gym.envs.values import VALUES

LANES, STEPS = 3, 10
QUICKLY = (Phase.generate,)  # a failing case is not made smaller: environments take too long
FINAL = {"final_obs", "_final_obs", "final_info", "_final_info"}


def per_rod(low, high):
    """Return a strategy, for n rods, of a number for all or one for each."""
    number = st.floats(low, high)
    return lambda n: number | st.lists(number, min_size=n, max_size=n)


def or_zero(numbers):
    """Return a strategy of 0.0 too."""
    return lambda n: st.just(0.0) | numbers(n)


def one_of(*values):
    """Return the strategy of some values, whatever n is."""
    return lambda _n: st.sampled_from(values)


def chain_of_uneven_links(n):
    return Chain(
        np.linspace(1.0, 0.4, n), np.linspace(0.6, 0.9, n), centres=0.3, inertias=0.02,
        friction=0.01, friction_speed=0.1, armature=1e-3, gear=[np.inf, 6.0, -6.0][:n],
    )  # fmt: skip


def joints(n):
    return st.lists(st.integers(0, n - 1), min_size=1, max_size=n, unique=True)


def factors(n):
    return st.just((0.8, 1.2)) | st.just(([0.5] * n, [2.0, 1.0, 1.5][:n]))


# What may be drawn at every start: factors of what is not zero, else values
DRAWN = {
    "masses": factors,
    "lengths": factors,
    "gravity": one_of({"low": 3.0, "high": 10.0}),
    "damping": one_of({"low": 0.0, "high": 0.2}),
    "max_torque": one_of({"low": 0.5, "high": 4.0}),
    "velocity_noise": one_of({"low": 0.0, "high": 0.2}),
    "observation_delay": one_of({"low": 0.0, "high": 2.0}),
}
DRAWN_OF_CARTS = {
    "cart_mass": one_of((0.5, 1.5), {"low": 0.4, "high": 3.0}),
    "rail_damping": one_of({"low": 0.0, "high": 1.0}),
    "max_force": one_of({"low": 0.5, "high": 4.0}),
}
# Of every keyword but n: the strategy of its values for n rods
KEYWORDS = {
    "mode": one_of(*MODES, "lanes:Own"),
    "chain": lambda n: st.sampled_from([None, Chain([1.0, 0.5, 2.0][:n], 0.7, drag=0.0).as_dict()]),
    "masses": per_rod(0.3, 3.0),
    "lengths": per_rod(0.3, 2.0),
    "gravity": one_of(0.0, 1.62, 9.81, 20.0),
    "damping": or_zero(per_rod(1e-3, 1.0)),
    "actuated": joints,
    "max_torque": one_of(None, 0.0, 3.0),
    "difficulty": one_of(None, "easy", "hard", 0.3),
    "torque_levels": one_of(None, 2, 3),
    "dt": one_of(None, 0.01, 0.07),
    "substeps": one_of(None, 1, 7),
    "observation": one_of("angles", "sincos", "scaled"),
    "reward_type": one_of("dense", "sparse"),
    "goal_env": one_of(False, True),
    "measure_periods": one_of(None, False, True),
    "amplitude": one_of(0.0, -0.4, 2.5),
    "max_tilt": one_of(None, 0.4, 1.5),
    "spread": one_of(None, 0.0, 0.3),
    "randomize": lambda n: st.fixed_dictionaries({}, optional={k: s(n) for k, s in DRAWN.items()}),
    "observe_context": one_of(False, True),
    "observe_velocities": one_of(False, True),
    "render_size": one_of(48, 84),
    "render_plain": one_of(False, True),
}
# Those of sensors and motors that are not ideal
HARDWARE = {
    "angle_noise": one_of(0.0, 0.01, 6.0),
    "velocity_noise": one_of(0.0, 0.1, 1e6),
    "angle_resolution": one_of(0.0, 2.0 * np.pi / 1024, 1.0),
    "velocity_resolution": one_of(0.0, 0.05),
    "observation_delay": one_of(0, 1, 0.4, 2.75),
    "action_delay": one_of(0, 1, 0.4, 2.75),
    "motor_lag": one_of(0.0, 1e-4, 0.05),
    "torque_noise": one_of(0.0, 0.5),
    "torque_ripple": one_of(0.0, 0.5),
    "ripple_cycles": one_of(1, 12),
    "push_rate": one_of(0.0, 5.0),
    "push_force": one_of(0.0, 10.0),
}
NEEDS_MOTOR = {
    "difficulty", "torque_levels", "action_delay", "motor_lag", "torque_noise", "torque_ripple"
}  # fmt: skip
OF_CARTS = {
    "base": one_of("pivot", "cart"),
    "cart_mass": one_of(None, 0.5, 4.0),
    "rail": one_of(None, 0.05, 5.0),
    "rail_damping": one_of(0.0, 0.7),
    "max_force": one_of(None, 0.0, 8.0),
    "randomize": lambda n: st.fixed_dictionaries(
        {}, optional={k: s(n) for k, s in (DRAWN | DRAWN_OF_CARTS).items()}
    ),
}
# Those that make links of bobs, or give them drag
OF_LINKS = {
    "chain": lambda n: st.just(chain_of_uneven_links(n)),
    "centres": per_rod(0.1, 0.3),
    "inertias": or_zero(per_rod(1e-3, 0.1)),
    "friction": per_rod(1e-3, 0.1),
    "friction_speed": per_rod(0.05, 0.2),
    "armature": or_zero(per_rod(1e-4, 1e-2)),
    "gear": lambda n: st.lists(st.sampled_from([None, -6.0, 4.0]), min_size=n, max_size=n),
    "drag": or_zero(per_rod(1e-3, 0.1)),
    "quadratic_drag": or_zero(per_rod(1e-3, 0.1)),
}


@st.composite
def combinations(draw):
    """Draw keywords that go together."""
    n = draw(st.integers(1, 3))
    links = draw(st.booleans())
    on_cart = draw(st.booleans())
    optional = KEYWORDS | (OF_LINKS if links else {}) | (OF_CARTS if on_cart else {}) | HARDWARE
    keywords = draw(st.fixed_dictionaries({}, optional={k: s(n) for k, s in optional.items()}))
    if keywords.get("chain") is not None:
        keywords = {k: v for k, v in keywords.items() if k not in CHAIN_KEYWORDS}
    if keywords.get("base") != "cart":
        keywords = {k: v for k, v in keywords.items() if k not in OF_CARTS or k == "randomize"}
        if "randomize" in keywords:
            drawn = keywords["randomize"].items()
            keywords["randomize"] = {k: v for k, v in drawn if k not in DRAWN_OF_CARTS}
    elif not keywords.get("actuated"):
        keywords = {k: v for k, v in keywords.items() if k not in ("torque_noise", "torque_ripple")}
    if {keywords.get(name) for name in ("max_torque", "max_force")} != {None}:
        keywords.pop("difficulty", None)
    if keywords.get("mode") == "passive":
        keywords = {k: v for k, v in keywords.items() if k not in NEEDS_MOTOR}
    if keywords.get("mode") != "transition":
        keywords.pop("goal_env", None)
    if keywords.get("goal_env"):
        keywords["reward_type"] = "sparse"
    pushes = [keywords.get(name, 0.0) for name in ("push_rate", "push_force")]
    if np.count_nonzero(pushes) == 1:
        keywords |= {"push_rate": 0.0, "push_force": 0.0}
    return {"n": n} | keywords


def keeps_energy(chain):
    """Return whether energy is left to compare errors with, and no link is turned too quickly."""
    return chain.is_ideal and (chain.gravity > 0.0 or not np.any(chain.damping))


def check_states(vector, common, actions, autoreset):
    """Let other environments, never reset, continue from the state of `vector`."""
    state = pickle.loads(pickle.dumps(vector.get_state()))
    over = state["done"].astype(bool)
    other = gym.make_vec("NPendulum-v0", num_envs=LANES, autoreset_mode=autoreset, **common)
    shown = other.set_state(state)
    ahead = [vector.step(action) for action in actions]
    assert_same([other.step(action) for action in actions], ahead)
    assert_same(other.set_state(state), shown)
    for k in np.flatnonzero(~over):
        alone = gym.make("NPendulum-v0", **common).unwrapped
        assert_same(alone.set_state(state[k]), (lane(shown[0], k), lane(shown[1], k)))
        observation, reward, terminated, _, info = alone.step(actions[0][k])
        mine = ahead[0]
        if autoreset is AutoresetMode.SAME_STEP and (mine[2][k] or mine[3][k]):
            observation, info = alone.reset()
        assert_same((observation, reward, terminated), tuple(lane(part, k) for part in mine[:3]))
        assert_same(info, {key: lane(mine[-1], k)[key] for key in info})


def check(keywords, autoreset, steps, seed):
    """Make environments, single and vector, and look at all that they show."""
    common = {"max_episode_steps": steps} | keywords
    vector = gym.make_vec("NPendulum-v0", num_envs=LANES, autoreset_mode=autoreset, **common)
    singles = gym.make_vec(
        "NPendulum-v0", num_envs=LANES, vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": autoreset}, **common,
    )  # fmt: skip
    actions = actions_for(vector, STEPS, seed)
    shown = run(vector, actions, seed)
    assert_lanes_are_singles(shown, run(singles, actions, seed))
    for observation, *outcome, info in shown:
        assert vector.observation_space.contains(observation)
        told = {key: value for key, value in info.items() if key not in FINAL}
        assert told.keys() == shown[0][1].keys()
        for key, value in (told | info.get("final_info", {})).items():
            assert value.dtype.kind != "f" or np.isfinite(value).all(), key
        if outcome:
            assert np.all((outcome[0] >= 0.0) & (outcome[0] <= 1.0))
        if not {"substeps", "randomize"} & set(keywords) and keeps_energy(vector.config.chain):
            assert np.all(np.abs(info["energy_error"]) < 0.05)

    check_states(vector, common, actions[:4], autoreset)

    env = gym.make("NPendulum-v0", **common)
    twin = gym.make(EnvSpec.from_json(env.spec.to_json()))
    assert twin.spec.to_json() == env.spec.to_json()
    assert_same(env.reset(seed=seed), twin.reset(seed=seed))
    action = actions_for(env, 1, seed)[0]
    assert_same(env.step(action), twin.step(action))


AUTORESET = st.sampled_from([AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])


def test_every_keyword_has_a_strategy():
    every = set(EnvKeywords.__annotations__) - VALUES.keys()
    assert {"n", *KEYWORDS, *OF_CARTS, *OF_LINKS, *HARDWARE} == every


@pytest.mark.long
@settings(max_examples=50, phases=QUICKLY)
@given(combinations(), AUTORESET, st.integers(2, 6), st.integers(0, 2**70))
def test_any_combination_of_keywords_keeps_every_promise(keywords, autoreset, steps, seed):
    check(keywords, autoreset, steps, seed)
