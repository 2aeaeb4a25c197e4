"""Settings as values: they say what flat keywords say, wherever these go."""

import pickle
from dataclasses import fields, replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from npend_gym import Cart, Chain, NPendulumEnv, rl
from npend_gym.envs import CartOnRail, EnvConfig, EnvKeywords, Motors, Randomize, Sensors
from npend_gym.envs.settings import EnvSettings

MOTORS = {"torque_noise": 0.1, "difficulty": "hard", "motor_lag": 0.02, "actuated": (0, 1)}
SENSORS = {"angle_noise": 0.01, "observation": "sincos", "observation_delay": 1.5}
DRAWN = {"masses": (0.9, 1.1), "velocity_noise": {"low": 0.0, "high": 0.1}}
VALUES = {
    "motors": Motors(**MOTORS), "sensors": Sensors(**SENSORS), "randomize": Randomize(**DRAWN),
}  # fmt: skip
FLAT = MOTORS | SENSORS | {"randomize": DRAWN}
ON_CART = {"rail": 2.0, "rail_damping": 0.1, "max_force": 20.0}


def settings_of(config):
    """Return all settings of a config, by name."""
    settings = {each.name: getattr(config, each.name) for each in fields(EnvSettings)}
    return settings | {"mode": type(config.mode), "randomize": config.randomization[:2]}


def same_settings(config, other):
    """Compare two configs; JSON makes lists of tuples."""
    theirs = settings_of(other)
    for name, value in settings_of(config).items():
        np.testing.assert_equal(theirs[name], value, err_msg=name)


def steps_of(env, count=5):
    """Return observations of a few steps."""
    action = np.full(env.action_space.shape, 0.5, np.float32)
    return np.array([env.reset(seed=3)[0], *(env.step(action)[0] for _ in range(count))])


@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
def test_values_give_the_settings_and_the_bits_of_flat_keywords_also_after_json(make):
    flat, nested = make("NPendulum-v0", **FLAT), make("NPendulum-v0", **VALUES)
    again = make(EnvSpec.from_json(nested.spec.to_json()))
    copied = make(pickle.loads(pickle.dumps(nested.spec)))
    expected = steps_of(flat)
    for env in (nested, again, copied):
        same_settings(env.unwrapped.config, flat.unwrapped.config)
        np.testing.assert_array_equal(steps_of(env), expected)


def test_a_config_has_its_settings_as_values_and_takes_them_back():
    config = EnvConfig(**VALUES)
    assert (config.motors.torque_noise, config.sensors.angle_noise) == (0.1, 0.01)
    assert config.motors.max_torque == config.max_torque
    assert config.cart is None
    values = {"motors": config.motors, "sensors": config.sensors}
    same_settings(EnvConfig(**values, randomize=config.randomize), config)
    same_settings(replace(config, dt=0.1), EnvConfig(**FLAT, dt=0.1))
    quiet = replace(config, motors=Motors(), sensors=Sensors(velocity_noise=0.2))
    same_settings(quiet, EnvConfig(velocity_noise=0.2, randomize=DRAWN))
    assert replace(config, torque_noise=0.3).motors == replace(config.motors, torque_noise=0.3)
    assert pickle.loads(pickle.dumps(config.motors)) == config.motors
    assert hash(config.sensors) == hash(replace(config.sensors))


def test_a_cart_as_a_value_stands_on_a_rail_as_with_flat_keywords():
    config = EnvConfig(cart=CartOnRail(**ON_CART))
    same_settings(config, EnvConfig(base="cart", **ON_CART))
    assert config.cart.cart_mass == config.cart_mass > 0.0
    same_settings(replace(EnvConfig(), cart=config.cart, actuated=()), config)
    # what is left out is that of the chain's own cart, and of a cart alone no joint has a motor
    chain = Chain.uniform(2, base=Cart(3.0, 0.4))
    own = EnvConfig(chain=chain, cart=CartOnRail(rail=5.0), motors=Motors(motor_lag=0.01))
    assert (own.cart.cart_mass, own.cart.rail_damping, own.motors.actuated) == (3.0, 0.4, ())
    other = EnvConfig(chain=chain, cart=CartOnRail(rail_damping=0.0), motors=Motors(actuated=(0,)))
    assert (other.rail_damping, other.joints.tolist()) == (0.0, [2, 0])


def test_every_keyword_of_motors_sensors_and_cart_is_a_field_of_one_value():
    held = [each.name for kind in (Motors, Sensors, CartOnRail) for each in fields(kind)]
    assert len(held) == len(set(held))
    assert set(held) <= set(EnvKeywords.__annotations__)
    for kind in (Motors, Sensors, CartOnRail):
        types = {each.name: each.type for each in fields(kind)}
        keywords = {name: EnvKeywords.__annotations__[name].__forward_arg__ for name in types}
        for name, annotation in types.items():
            assert annotation == "Any" or keywords[name].removesuffix(" | None") in annotation
            assert f"    {name} : " in kind.__doc__
    assert "    motors : Motors | Mapping[str, Any] | None" in NPendulumEnv.__doc__
    assert repr(Motors(torque_noise=0.1)) == "Motors(torque_noise=0.1)"
    assert repr(Randomize(masses=(0.9, 1.1))) == "Randomize(masses=(0.9, 1.1))"


@pytest.mark.parametrize(
    ("keywords", "error", "message"),
    [
        (
            {"motors": Motors(), "torque_noise": 0.1},
            ValueError,
            r"torque_noise cannot be given together with motors.*Motors\(torque_noise=0.1",
        ),
        ({"cart": CartOnRail(), "rail": 1.0}, ValueError, "rail cannot be given together with ca"),
        ({"cart": CartOnRail(), "base": "pivot"}, ValueError, 'base must be "cart", or left out'),
        ({"motors": Sensors()}, TypeError, "motors must be an npend_gym.envs.Motors, or the dict"),
        ({"sensors": {"angle_nois": 0.1}}, ValueError, "a key of sensors must be one of obs"),
    ],
)
def test_values_that_do_not_fit_are_refused_by_name(keywords, error, message):
    with pytest.raises(error, match=message):
        EnvConfig(**keywords)


def test_values_are_checked_when_they_are_made():
    with pytest.raises(ValueError, match="torque_noise must be zero or more, got -1"):
        Motors(torque_noise=-1.0)
    with pytest.raises(ValueError, match="observation must be one of angles"):
        Sensors(observation="pixels")
    with pytest.raises(ValueError, match="a name in Randomize must be one of masses"):
        Randomize(mass=(0.9, 1.1))
    with pytest.raises(AttributeError):
        Motors().torque_noise = 0.1


def test_evaluation_takes_settings_as_values():
    given = {"id": "npend/SwingUp-v1", **VALUES}
    flat = rl.setting_of({"id": "npend/SwingUp-v1", **FLAT})
    same_settings(rl.setting_of(given).config, flat.config)
    quiet = rl.setting_of(given).nominal(1.0)[1]
    assert quiet.randomize is None
    assert quiet.torque_noise == 0.1
