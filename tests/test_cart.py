"""Environments on a cart: against Gymnasium's equations, by energy and by symmetry."""

import gymnasium as gym
import numpy as np
import pytest
from lanes import Own, actions_for, assert_same
from scipy.integrate import solve_ivp

from npend_gym import Cart, Chain
from npend_gym.envs import EnvConfig, NPendulumEnv, NPendulumVectorEnv

# -- the motion -----------------------------------------------------------------------------


def cartpole_rates(_, state, force):
    """Return the rates of (x, x', theta, theta'), theta clockwise from upright, as Gymnasium's."""
    _, speed, theta, omega = state
    gravity, cart, pole, half = 9.8, 1.0, 0.1, 0.5
    total, moment = cart + pole, pole * half
    s, c = np.sin(theta), np.cos(theta)
    temp = (force + moment * omega**2 * s) / total
    alpha = (gravity * s - c * temp) / (half * (4.0 / 3.0 - pole * c**2 / total))
    return [speed, temp - moment * alpha * c / total, omega, alpha]


def test_the_cart_pole_moves_by_gymnasiums_equations():
    env = gym.make("npend/CartPole-v1", mode="swingup", dt=0.02, rail=50.0).unwrapped
    options = {"theta": np.pi - 0.3, "omega": 0.4, "cart_position": -0.2, "cart_velocity": 0.5}
    env.reset(options=options)
    state = np.array([-0.2, 0.5, 0.3, -0.4])
    rng, lowest = np.random.default_rng(0), 1.0
    for action in rng.uniform(-1.0, 1.0, (150, 1)):
        info = env.step(action)[-1]
        force = 10.0 * action[0]
        path = solve_ivp(
            cartpole_rates, (0.0, 0.02), state, method="DOP853", rtol=1e-12, atol=1e-13,
            args=(force,),
        )  # fmt: skip
        state = path.y[:, -1]
        shown = [info["cart_position"], info["cart_velocity"], np.pi - info["theta"][0]]
        np.testing.assert_allclose(shown, state[:3], rtol=0, atol=2e-6)
        assert -info["omega"][0] == pytest.approx(state[3], abs=1e-5)
        lowest = min(lowest, info["tip_height"])
    assert lowest < -0.9  # it has swung through


@pytest.mark.parametrize("keywords", [
    {}, {"damping": 0.2, "rail_damping": 1.0}, {"cart_mass": 0.2, "actuated": (0, 1)},
])  # fmt: skip
def test_the_energy_is_that_at_the_start_and_the_work_that_was_done(keywords):
    env = NPendulumEnv(base="cart", n=2, rail=200.0, **keywords)
    env.reset(seed=1, options={"theta": [2.0, 1.0], "cart_velocity": 1.0})
    errors = [abs(env.step(a)[-1]["energy_error"]) for a in actions_for(env, 200)]
    assert max(errors) < 1e-5


def test_the_energy_has_the_cart_and_all_that_moves_with_it():
    chain, cart_mass = Chain([1.0, 0.5], [0.7, 0.4], inertias=0.1, centres=0.3), 2.0
    env = NPendulumEnv(chain=chain, base="cart", cart_mass=cart_mass)
    theta, omega, speed = np.array([0.4, 1.9]), np.array([1.0, -2.0]), 0.7
    info = env.reset(options={"theta": theta, "omega": omega, "cart_velocity": speed})[1]
    velocity = np.cumsum(chain.lengths * omega * np.exp(1j * theta))
    at = speed + np.concatenate([[0.0], velocity[:-1]])
    at = at + chain.centres * omega * np.exp(1j * theta)
    kinetic = chain.masses @ np.abs(at) ** 2 + chain.inertias @ omega**2 + cart_mass * speed**2
    potential = chain.gravity * chain.lift @ (1.0 - np.cos(theta))
    assert info["energy"] == pytest.approx(0.5 * kinetic + potential, rel=1e-12)


def test_what_is_mirrored_moves_mirrored():
    envs = NPendulumVectorEnv(2, base="cart", n=3, observation="sincos", actuated=(1,))
    theta, sides = np.array([0.3, -1.0, 2.0]), np.array([[1.0], [-1.0]])
    envs.reset(options={
        "theta": sides * theta, "omega": 0.0, "cart_position": 0.5 * sides[:, 0],
        "cart_velocity": 0.0,
    })  # fmt: skip
    rng = np.random.default_rng(3)
    for action in rng.uniform(-1.0, 1.0, (60, 2)):
        observation, reward, *_, info = envs.step(sides * action)
        np.testing.assert_allclose(info["cart_position"] @ [1.0, 1.0], 0.0, atol=1e-12)
        np.testing.assert_allclose(info["theta"][0], -info["theta"][1], atol=1e-9)
        assert reward[0] == pytest.approx(reward[1], abs=1e-9)
        mirror = np.repeat([-1.0, 1.0, -1.0, -1.0], [3, 3, 3, 2])
        np.testing.assert_allclose(observation[0], mirror * observation[1], atol=1e-5)


# -- what is shown --------------------------------------------------------------------------


def test_the_cart_is_observed_and_told_and_a_release_starts_in_the_middle():
    env = NPendulumEnv(base="cart", n=2, observation="sincos", rail=3.0, gravity=5.0)
    env.reset(seed=7)
    for action in actions_for(env, 30):
        observation, *_, info = env.step(action)
        x, v = info["cart_position"] / 3.0, info["cart_velocity"] / np.sqrt(5.0 * 3.0)
        np.testing.assert_allclose(observation[6:], [x, v], rtol=1e-6)
        np.testing.assert_array_equal(
            env.state,
            [*info["theta"], *info["omega"], info["cart_position"], info["cart_velocity"]],
        )
    released = NPendulumEnv(base="cart", mode="calm").reset(seed=1)[1]
    assert released["cart_position"] == released["cart_velocity"] == 0.0
    goals = NPendulumEnv(base="cart", mode="transition", observation="scaled")
    observation, info = goals.reset(seed=1)
    np.testing.assert_array_equal(observation[8:], np.cos(info["goal"]))
    assert observation[6] == np.float32(info["cart_position"] / 4.0)


@pytest.mark.parametrize(
    "mode",
    [
        *("swingup", "balance", "calm", "transition", Own()),
        pytest.param("passive", marks=[pytest.mark.long, pytest.mark.nightly]),
    ],
)
def test_beyond_its_rail_the_cart_fails_and_within_it_lowers_the_reward(mode):
    keywords = {"mode": mode, "n": 2, "cart_mass": 30.0, "rail": 2.0, "dt": 0.05}
    envs = NPendulumVectorEnv(2, base="cart", **keywords, autoreset_mode="DISABLED")
    start = {"theta": np.pi - 0.01, "omega": 0.0, "cart_velocity": [1.5, 0.0]}
    start |= {"goal": np.pi} if mode == "transition" else {}
    envs.reset(seed=0, options=start)
    still = 0 * envs.action_space.sample()
    for _ in range(60):
        _, reward, terminated, _, info = envs.step(still)
        x = info["cart_position"][0]
        assert bool(terminated[0]) == (x > 2.0)
        if terminated[0]:
            assert not info["success"][0]
            assert reward[0] == 0.0
            break
        # Galileo: the chain moves alike on a cart in uniform motion
        if mode not in ("calm", "balance", "passive"):
            factor = 1.0 - 0.5 * (x / 2.0) ** 2
            height = reward[1] / (1.0 - 0.5 * (info["cart_position"][1] / 2.0) ** 2)
            assert reward[0] <= factor * height * (1.0 + 1e-9)
            assert reward[0] > 0.4 * factor * height
    assert terminated[0]


# -- lanes, states, ranges ------------------------------------------------------------------


def test_a_drawn_cart_is_the_cart_that_moves():
    keywords = {"base": "cart", "mode": "swingup", "substeps": 8}
    drawn = NPendulumEnv(randomize={"cart_mass": (0.3, 3.0), "max_force": (0.5, 1.5)}, **keywords)
    start = drawn.reset(seed=11)[1]
    mass, force = start["context"]
    made = NPendulumEnv(cart_mass=mass, max_force=force, rail=4.0, **keywords)
    made.reset(seed=11)
    for action in actions_for(made, 30):
        ours, theirs = drawn.step(action), made.step(action)
        assert ours[1] == theirs[1]
        assert ours[-1]["cart_position"] == theirs[-1]["cart_position"]


def test_the_state_can_be_set_and_options_that_persist_stay():
    env = NPendulumEnv(base="cart")
    env.reset(seed=3, options={"cart_position": 0.1, "persist": True})
    for action in actions_for(env, 5):
        observation, *_, info = env.step(action)
    state = env.get_state()
    env.reset(seed=0)
    assert_same(env.set_state(state), (observation, info))
    assert env.reset()[1]["cart_position"] == 0.1
    env.state = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    np.testing.assert_allclose(env.state, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6], rtol=0)
    other = NPendulumEnv(base="cart", cart_mass=5.0)
    other.reset(seed=0)
    with pytest.raises(ValueError, match="state must come from an environment with the same"):
        other.set_state(state)


@pytest.mark.long
@pytest.mark.nightly
def test_delays_hold_for_the_cart_too():
    keywords = {"base": "cart", "n": 1, "observation": "sincos"}
    plain, late = (
        NPendulumEnv(**keywords),
        NPendulumEnv(observation_delay=2, action_delay=1, **keywords),
    )
    shown, seen = [plain.reset(seed=4)], [late.reset(seed=4)]
    actions = [np.zeros(1, np.float32), *actions_for(plain, 12)]
    for now, later in zip(actions[1:], actions, strict=False):
        shown.append(plain.step(later))
        seen.append(late.step(now))
        assert shown[-1][-1]["cart_position"] == seen[-1][-1]["cart_position"]
        past = shown[max(len(shown) - 3, 0)][0]
        np.testing.assert_array_equal(seen[-1][0], past)
    assert np.ptp([each[0][3] for each in shown]) > 0.01


# -- keywords -------------------------------------------------------------------------------


def test_the_defaults_are_those_of_the_documentation():
    chain = Chain([1.0, 0.5], [0.4, 0.6])
    config = EnvConfig(chain=chain, base="cart", mode="calm")
    assert (config.cart_mass, config.rail, config.rail_damping) == (1.5, 2.0, 0.0)
    assert config.max_force == pytest.approx(0.2 * 9.81 * 3.0, rel=1e-14)
    assert config.actuated == ()
    weightless = EnvConfig(base="cart", mode="calm", gravity=0.0)  # has the force of the Earth's
    assert weightless.max_force == EnvConfig(base="cart", mode="calm").max_force
    assert EnvConfig(base="cart", difficulty="hard", cart_mass=3.0).max_force == pytest.approx(
        0.1 * 9.81 * 5.0
    )
    assert NPendulumEnv(base="cart").action_space.shape == (1,)
    assert NPendulumEnv(base="cart", actuated=(1, 0)).action_space.shape == (3,)
    assert NPendulumEnv(base="cart", mode="passive").action_space.n == 1
    assert NPendulumEnv(base="cart", torque_levels=3).action_space.n == 3


def test_a_chain_that_brings_its_cart_stands_on_it():
    own = Chain([1.0, 0.5], [0.4, 0.6], base=Cart(3.0, 0.2))
    config = EnvConfig(chain=own)
    assert (config.base, config.cart_mass, config.rail_damping) == ("cart", 3.0, 0.2)
    assert config.chain == own
    given = EnvConfig(chain=own.hung(), base="cart", cart_mass=3.0, rail_damping=0.2)
    assert given.chain == own
    assert EnvConfig(chain=own.hung()).chain == own.hung()
    assert EnvConfig(chain="dm_control cartpole 3").cart_mass == 1.0
    changed = gym.make("npend/CartDoublePole-v1", cart_mass=2.0).unwrapped.config
    assert (changed.cart_mass, changed.rail_damping) == (2.0, 5e-4)
    assert changed.chain.base == Cart(2.0, 5e-4)


def test_wrong_options_are_refused_and_change_nothing():
    env = NPendulumEnv(base="cart", rail=2.0)
    env.reset(seed=0)
    before = env.get_state().tobytes()
    with pytest.raises(ValueError, match=r"options\['cart_position'\] must lie within"):
        env.reset(options={"cart_position": 2.1})
    with pytest.raises(ValueError, match=r"options\['cart_velocity'\]"):
        env.reset(options={"cart_velocity": np.inf})
    assert env.get_state().tobytes() == before
    with pytest.raises(ValueError, match=r"options must be among .*got \['cart_position'\]"):
        NPendulumEnv().reset(options={"cart_position": 0.0})
