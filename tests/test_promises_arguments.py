"""Bad arguments are refused at once, by name, before anything large is made."""

import re
import time
import tracemalloc
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from lanes import assert_same

from npend_gym import Cart, Chain, physics, pseudo_periods, simulate, theory
from npend_gym.envs import NPendulumEnv, NPendulumVectorEnv

ENORMOUS = 10**400
ITSELF = []
ITSELF.append(ITSELF)

# What is no such thing, whatever the argument
NO_NUMBERS = (True, "1", b"1", 1j, np.nan, np.inf, -np.inf, ENORMOUS, {}, object(), ITSELF, 1e300)
NO_POSITIVES = (*NO_NUMBERS, 0.0, -1.0, 5e-324)
NO_COUNTS = (*NO_NUMBERS, 0, -1, 1.5, -ENORMOUS, None)
NO_ARRAYS = (*NO_NUMBERS, [1.0, [2.0]], [[[1.0, 2.0]]], [], [1.0, 2.0, 3.0], np.array([None]))
NO_CHOICES = ("", "no such", 1, b"bob", ["bob"], None, 10**9)


PAIR = Chain.uniform(2)
trajectory = partial(simulate, chain=PAIR, theta=0.1, omega=0.0, times=[0.0, 0.1])
on_cart = partial(trajectory, chain=Chain.uniform(2, base=Cart(1.0)))
fixed_step = partial(trajectory, method="rk4", dt=0.01)
cart = partial(Cart, mass=1.0)
springs = partial(Chain, masses=1.0, lengths=[1.0, 1.0], stiffness=1e3)
periods = partial(pseudo_periods, chain=PAIR, theta=0.1)
two_rods = partial(NPendulumEnv, n=2)


def reset(**option):
    env = NPendulumEnv(n=2)
    env.reset(seed=0, options=option)


CASES = [
    (NPendulumEnv, "n", (*NO_COUNTS, 10**9)),
    (NPendulumEnv, "mode", NO_CHOICES),
    (two_rods, "masses", (*NO_ARRAYS, 0.0, [1.0, -1.0], 1e-31)),
    (two_rods, "lengths", (*NO_ARRAYS, 0.0, [1.0, -1.0], 1e-31)),
    (NPendulumEnv, "gravity", (*NO_NUMBERS, -1.0, [9.81], None, 5e-324)),
    (NPendulumEnv, "damping", (*NO_ARRAYS, -1.0, 1e-40)),
    (NPendulumEnv, "drag", (*NO_ARRAYS, -1.0)),
    (NPendulumEnv, "quadratic_drag", (*NO_ARRAYS, -1.0)),
    (NPendulumEnv, "actuated", (0, "0", (), (2,), (-1,), (0, 0), (0.5,), (True,), ((0,),), 10**9)),
    (NPendulumEnv, "max_torque", (*NO_NUMBERS, -1.0, [1.0])),
    (NPendulumEnv, "dt", (*NO_POSITIVES, [0.1])),
    (NPendulumEnv, "substeps", (*NO_COUNTS[:-1], 10**9)),
    (NPendulumEnv, "observation", NO_CHOICES),
    (NPendulumEnv, "amplitude", (*NO_NUMBERS, None, 1e6)),
    (NPendulumEnv, "spread", (*NO_NUMBERS, -0.1, 3.2, 1e6)),
    (NPendulumEnv, "render_mode", NO_CHOICES[:-2]),
    (NPendulumEnv, "render_size", (8, 10**9, True)),
    (NPendulumVectorEnv, "num_envs", (*NO_COUNTS, 10**9)),
    (NPendulumVectorEnv, "threads", (*NO_COUNTS, 10**9)),
    (NPendulumVectorEnv, "max_episode_steps", NO_COUNTS[:-1]),
    (NPendulumVectorEnv, "autoreset_mode", NO_CHOICES),
    (reset, "theta", (*NO_ARRAYS, 1e6, None)),
    (reset, "omega", (*NO_ARRAYS, 1e7, None)),
    (reset, "amplitude", (*NO_NUMBERS, [1.0, 1.0], 1e6)),
    (reset, "masses", (*NO_ARRAYS, 0.0)),
    (reset, "gravity", (*NO_NUMBERS, -1.0, [1.0, 1.0])),
    (trajectory, "chain", (None, 3, "chain", {})),
    (trajectory, "theta", (*NO_ARRAYS, None, 1e6)),
    (trajectory, "omega", (*NO_ARRAYS, None, 1e7)),
    (trajectory, "times", (*NO_ARRAYS[:-2], None, 1.0, [1.0, 0.0], [0.0, 0.0], [[0.0, 1.0]])),
    (trajectory, "torque", NO_ARRAYS),
    (trajectory, "pivot_acceleration", (*NO_ARRAYS, 1.0)),
    (on_cart, "position", (*NO_NUMBERS, None)),
    (on_cart, "velocity", (*NO_NUMBERS, None)),
    (on_cart, "force", (*NO_NUMBERS, None)),
    (cart, "mass", NO_POSITIVES),
    (cart, "damping", (*NO_NUMBERS, -1.0)),
    (springs, "stiffness", (*NO_ARRAYS, 0.0, -1.0)),
    (springs, "axial_damping", (*NO_ARRAYS, -1.0)),
    (springs, "base", (1.0, "cart", Cart)),
    (trajectory, "force", (*NO_NUMBERS, None, 1.0)),
    (trajectory, "method", NO_CHOICES),
    (trajectory, "rtol", (*NO_NUMBERS, None, 0.0, 1e-15)),
    (trajectory, "atol", (*NO_POSITIVES, None)),
    (fixed_step, "dt", (*NO_POSITIVES, None, 1e-20)),
    (periods, "chain", (None, 3)),
    (periods, "theta", (*NO_ARRAYS, None, 1e6, np.zeros((2, 3)), np.zeros((0, 2)))),
    (periods, "omega", (*NO_ARRAYS, None, 1e7, np.zeros((2, 3)), np.zeros((0, 2)))),
    (periods, "definition", NO_CHOICES),
    (periods, "duration", NO_POSITIVES),
    (periods, "rtol", (*NO_NUMBERS, None, 0.0)),
    (periods, "threads", (*NO_COUNTS, 10**9)),
    (Chain.uniform, "n", (*NO_COUNTS, 10**9)),
    (theory.uniform_frequencies, "n", (*NO_COUNTS, 10**9)),
    (theory.large_n_period, "n", NO_COUNTS),
]  # fmt: skip


@pytest.mark.parametrize(
    ("call", "name", "values"),
    CASES,
    ids=[f"{getattr(call, 'func', call).__name__}-{name}" for call, name, _ in CASES],
)
def test_a_bad_value_is_refused_by_name_at_once_and_without_memory(call, name, values):
    tracemalloc.start()
    try:
        for value in values:
            began = time.process_time()
            with pytest.raises(
                (ValueError, TypeError), match=rf"\b{name}\b.* must|must.*\b{name}\b"
            ):
                call(**{name: value})
            assert time.process_time() - began < 5.0
        assert tracemalloc.get_traced_memory()[1] < 100e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: NPendulumEnv(n=1_000_001), "n must be between 1 and 1000000, got 1000001"),
        (lambda: NPendulumVectorEnv(10**7, n=10**5), "num_envs"),
        (lambda: trajectory(chain=Chain.uniform(10**6), times=np.arange(1e5)), "times"),
        (lambda: theory.normal_modes(Chain.uniform(10**6)), "n"),
        (lambda: theory.amplitude_correction(0.1, 10**9), "terms"),
    ],
)
def test_what_would_take_all_memory_or_for_ever_is_refused(make, name):
    began = time.process_time()
    with pytest.raises(ValueError, match=rf"\b{name}\b"):
        make()
    assert time.process_time() - began < 5.0


@pytest.mark.parametrize("option", ["gravity", "masses", "lengths"])
def test_the_extremes_that_are_allowed_make_an_env_that_steps(option):
    smallest, largest = 1e-30, 1e30
    for value in (smallest, largest):
        env = NPendulumEnv(n=3, mode="calm", substeps=1, **{option: value})
        env.reset(seed=0)
        observation, reward, _, _, info = env.step(np.ones(1))
        assert np.isfinite(observation).all()
        assert np.isfinite(reward)
        assert all(np.all(np.isfinite(part)) for part in info.values())


LINES = [
    (f"release --{option} {value}", option)
    for option, values in {
        "n": ("nan", "1.5", "-1", "0", "1000000001", "9" * 401, "1,,2", "[1,2]", "1;2"),
        "trials": ("nan", "0.5", "-3", "1000000001", "9" * 401),
        "amplitude": ("inf", "1e300", "pi", "0", "3.2"),
        "spread": ("nan", "-1e-3", "1e300"),
        "seed": ("-5", "1e3", "9" * 401),
        "duration": ("nan", "-1", "inf", "1e300"),
        "masses": ("nan", "1,2,x", "-1", "1e-300", "1," * 3),
        "lengths": ("0", "1,2", "1e300"),
        "gravity": ("nan", "-9.81", "1e300"),
        "damping": ("-1", "nan", "1,2,3"),
        "definition": ("rod", ""),
    }.items()
    for value in values
] + [("chaos all", "all"), ("verify --jsn", "jsn")]


@pytest.mark.parametrize(("line", "name"), LINES, ids=[line[:32] for line, _ in LINES])
def test_the_command_line_refuses_in_one_line(line, name, refusal):
    assert re.search(rf"\b{name}\b", refusal(*line.split(" ")))


NO_SEEDS = (-1, "x", 1.5, True, np.True_, [[1]], [1, 2], np.array(3), np.nan, {}, b"1")
NO_OPTIONS = (
    3, "x", [1], np.ones(2), {"nope": 1}, {"theta": np.nan}, {"theta": "up"}, {"masses": -1.0},
    {"omega": 1e9}, {"persist": 2}, {1: 2}, {"reset_mask": 1}, {"gravity": None}, {"start": 0.5},
    {"reset_mask": [True] * 3}, {"reset_mask": np.ones(2, bool)}, {"reset_mask": np.zeros(3, bool)},
    {"theta": [0.1] * 4}, {"reset_mask": np.ma.array([True] * 3, mask=[True, False, False])},
)  # fmt: skip
# Of two motors
NO_ACTIONS = (
    np.array([np.nan, 0.0]), np.array([np.inf, 0.0]), np.array([0.0, -np.inf]), np.zeros(1),
    np.zeros((2, 1)), np.zeros(3), np.array([1j, 0.0]), np.array(["0", "0"]), "00", None, 0.0,
    [[0.0], 1.0], {}, object(), np.array([None, 0.0]), np.zeros((0,)),
    [10**400, 0], np.array(["1e400", "0"], np.longdouble),
    np.array(["2020", "2021"], "datetime64[D]"),
)  # fmt: skip
NO_ACTIONS_OF_ONE = (np.array([np.nan]), np.array([np.inf]), np.array([-np.inf]), np.zeros(2))
NO_STATES = (None, 3, "state", np.nan, [1.0], np.zeros(3), np.zeros(1, [("version", "<u8")]))


def refused_calls(env):
    """Calls that must raise an error that names this, whatever has happened to `env` before."""
    yield from (("seed", partial(env.reset, seed=seed)) for seed in NO_SEEDS)
    yield from (("options", partial(env.reset, seed=8, options=some)) for some in NO_OPTIONS)
    yield "seed", partial(env.reset, seed=-1, options={"theta": 0.1})
    if isinstance(env, NPendulumVectorEnv):  # whose lanes are the first axis
        yield "options", partial(env.reset, seed=8, options={"theta": [0.1, 0.2]})
    yield from (("state", partial(env.set_state, state)) for state in NO_STATES)


def refused_after_reset(env):
    """Further ones, which are refused for another reason before the first reset."""
    no_actions = NO_ACTIONS_OF_ONE if env.action_space.shape[-1:] == (1,) else NO_ACTIONS
    yield from (("action", partial(env.step, bad)) for bad in no_actions)
    masked = np.ma.array(0 * env.action_space.sample(), mask=True)
    yield "action", partial(env.step, masked)
    if isinstance(env, NPendulumVectorEnv):  # beside good actions of other lanes
        good = 0 * env.action_space.sample()[1:]
        yield from (("action", partial(env.step, [bad, *good])) for bad in no_actions)
    yield from (("state", partial(setattr, env, "state", bad)) for bad in NO_STATES[:-1])


@pytest.mark.parametrize("vector", [False, True], ids=["single", "vector"])
@pytest.mark.parametrize(
    "mode",
    [
        *("swingup", "balance", "calm", "transition"),
        pytest.param("passive", marks=pytest.mark.long),
    ],
)
def test_a_refused_call_makes_no_legal_one_fail_and_changes_no_bit(mode, vector):
    motors = {"actuated": (0, 1)} if mode in ("balance", "transition") else {}
    options = {"n": 2, "mode": mode} | motors
    env, twin = (
        NPendulumVectorEnv(3, **options) if vector else NPendulumEnv(**options) for _ in range(2)
    )
    for name, call in refused_calls(env):
        with pytest.raises((TypeError, ValueError), match=rf"\b{name}\b"):
            call()
        with pytest.raises(gym.error.ResetNeeded):
            env.step(env.action_space.sample())
    np.testing.assert_array_equal(env.reset(seed=3)[0], twin.reset(seed=3)[0])
    env.action_space.seed(1)
    for name, call in (*refused_calls(env), *refused_after_reset(env)):
        with pytest.raises((TypeError, ValueError), match=rf"\b{name}\b"):
            call()
        action = env.action_space.sample()
        assert_same(env.step(action)[:4], twin.step(action)[:4])
    assert env.get_state().tobytes() == twin.get_state().tobytes()
    for each in (env, twin):
        each.close()
        each.close()
    np.testing.assert_array_equal(env.reset()[0], twin.reset()[0])
    assert env.step(env.action_space.sample())[0].shape == env.observation_space.shape


@pytest.mark.parametrize("make", [NPendulumEnv, lambda: NPendulumVectorEnv(2)])
def test_a_seed_is_any_integer_of_numpy_too(make):
    expected = make().reset(seed=3)[0]
    for seed in (np.int64(3), np.uint8(3)):
        env = make()
        np.testing.assert_array_equal(env.reset(seed=seed)[0], expected)
        assert np.ravel(env.np_random_seed)[0] == 3


DEGREES = {
    "simulate": lambda: simulate(PAIR, [120, -10], 0.0, [0.0, 0.01]),
    "many motions": lambda: simulate(PAIR, [[0.1, 0.2], [22.5, 0.0]], 0.0, [0.0, 0.01]),
    "moving": lambda: pseudo_periods(PAIR, 45.0, [0.1, 0.0], duration=0.1),
    "ensemble": lambda: physics.Ensemble(PAIR, 2).set_state(0, [30.0, 60.0]),
    "equations": lambda: physics.accelerations(PAIR, [90.0, 45.0], 0.0),
    "amplitude": lambda: gym.make("NPendulum-v0", mode="calm", amplitude=60),
    "reset": lambda: two_rods().reset(options={"theta": [180, 180]}),
    "reset, amplitude": lambda: two_rods(mode="calm").reset(options={"amplitude": 60}),
    "reset, lanes": lambda: gym.make_vec("NPendulum-v0", 2).reset(
        options={"theta": [[0.1, 0.2], [180, 0]]}
    ),
}


@pytest.mark.parametrize("case", DEGREES)
def test_angles_that_look_like_degrees_bring_one_warning_at_the_line_of_the_call(case):
    with pytest.warns(UserWarning, match=r"turns: are these degrees\? They must be rad") as seen:
        DEGREES[case]()
    assert len(seen) == 1
    if not case.startswith(("amplitude", "reset, lanes")):  # Gymnasium calls us there
        assert seen[0].filename == __file__


def test_large_angles_of_a_motion_bring_no_warning():  # warnings are errors here
    whirled = simulate(PAIR, [0.1, 0.2], [80.0, 0.0], [0.0, 5.0])
    assert np.abs(whirled.theta).max() > 100.0
    simulate(PAIR, whirled.theta[-1], whirled.omega[-1], [0.0, 0.01])
    two_rods().reset(options={"theta": whirled.theta[-1], "omega": 0.0})
    simulate(PAIR, [6.0, -3.0], 0.0, [0.0, 0.01])
    simulate(PAIR, [20.0 * np.pi, 0.0], 0.0, [0.0, 0.01])
    simulate(PAIR, 1e4, 0.0, [0.0, 0.01])
