"""Environments of chains with links: inertia, centres of mass, dry friction and rotors."""

import json
import pickle
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from lanes import Own

from npend_gym import Cart, Chain, simulate
from npend_gym.envs import EnvConfig
from npend_gym.physics.energy import centre_of_mass, kinetic_energy, positions, total_energy

pytestmark = pytest.mark.long  # kernels of their own take long to compile

# Every parameter is that of a link, and no two links are alike
CHAIN = Chain(
    [1.0, 0.5, 0.8], [0.5, 0.4, 0.3], 9.8, [0.01, 0.02, 0.0], [0.02, 0.0, 0.01], 0.01,
    centres=[0.2, 0.4, -0.1], inertias=[0.02, 0.0, 0.01], friction=[0.1, 0.0, 0.02],
    friction_speed=[0.05, 0.05, 0.1], armature=[0.003, 0.002, 0.0], gear=[np.inf, 6.0, -6.0],
)  # fmt: skip
MAKERS = [gym.make, gym.make_vec]


@pytest.mark.parametrize(
    "given",
    [
        {"chain": CHAIN},
        {"chain": CHAIN.as_dict()},
        {"chain": json.loads(json.dumps(CHAIN.as_dict())), "n": 3},
        {"n": 3} | {name: getattr(CHAIN, name) for name in CHAIN.repeated(1)._fields},
    ],
)
def test_a_chain_its_parameters_and_the_keywords_make_the_same_environment(given):
    config = EnvConfig(**given)
    assert config.chain == CHAIN
    assert config.n == 3
    assert config.max_torque == pytest.approx(0.25 * CHAIN.gravity * 2.0 * np.abs(CHAIN.lift).sum())


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize("chain", [CHAIN, CHAIN.as_dict(), "acrobot"])
def test_a_chain_survives_the_spec_as_json_and_pickles(make, chain):
    env = make("NPendulum-v0", chain=chain, amplitude=0.5)
    kept = json.loads(env.spec.to_json())["kwargs"]["chain"]
    assert kept == (chain if isinstance(chain, str) else CHAIN.as_dict())
    again = make(EnvSpec.from_json(env.spec.to_json()))
    for one in (again, pickle.loads(pickle.dumps(env))):
        assert one.unwrapped.config.chain == env.unwrapped.config.chain
        assert one.spec == env.spec


@pytest.mark.parametrize("kind", [str, Path])
def test_a_file_describes_the_chain_and_is_not_needed_again(kind, tmp_path):
    file = tmp_path / "fit.json"
    file.write_text(json.dumps(CHAIN.as_dict()))
    env = gym.make("NPendulum-v0", chain=kind(file), dt=0.02)
    assert env.unwrapped.config.chain == CHAIN
    spec = env.spec.to_json()
    file.unlink()
    assert gym.make(EnvSpec.from_json(spec)).unwrapped.config.chain == CHAIN


def test_a_file_that_describes_no_chain_is_refused_by_its_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = Path("fit.json")
    with pytest.raises(ValueError, match=r"a JSON file .*; got .*fit.json.*, and there is no such"):
        EnvConfig(chain=str(file))
    file.write_text("[1]")
    with pytest.raises(ValueError, match=r"fit.json cannot be read: it must be an object"):
        EnvConfig(chain=str(file))


POINT_MASSES = {"lengths": 1.0, "centres": 1.0, "inertias": 0.0}  # in place of links


@pytest.mark.parametrize(
    ("chain", "options", "message"),
    [
        (
            Chain.uniform(2),
            {"inertias": 0.1},
            r"options\['inertias'\] must not turn point masses into links",
        ),
        (Chain.uniform(2), {"gear": 6.0, "armature": 0.1}, r"options\['armature'\] .* chain=Chain"),
        (Chain.uniform(2), {"gear": 0.0}, r"options\['gear'\] must not be zero"),
        (Chain.uniform(2), {"friction_speed": 0.0}, "dry friction needs a speed"),
        (
            Chain.acrobot(),
            {"masses": 2.0, "drag": 0.1},
            r"options\['drag'\] must not .* add friction to them, or rotors or drag to links",
        ),
        (Chain.acrobot(), POINT_MASSES | {"drag": 0.1}, r"options\['drag'\] must not"),
        (Chain.acrobot(), POINT_MASSES, None),
        (Chain.rods([1.0, 1.0], [1.0, 1.0], drag=0.2), POINT_MASSES | {"drag": 0.1}, None),
        (Chain.rods([1.0, 1.0], [1.0, 1.0], base=Cart(1.0)), POINT_MASSES, None),
        (
            Chain.rods([1.0, 1.0], [1.0, 1.0], base=Cart(1.0)),
            POINT_MASSES | {"drag": 0.1},
            r"options\['drag'\] must not",
        ),
        (Chain.uniform(3), {"damping": 100.0}, r"options\['damping'\] .* or with substeps=1280"),
        (Chain.uniform(3), {"damping": 1e12}, r"options\['damping'\] .* and shorten dt"),
        (Chain.uniform(3, base=Cart(0.01)), {"damping": 1.0}, r"options\['damping'\] must leave"),
        (Chain.uniform(3), {"lengths": [0.9, 0.8, 1.0]}, None),
        (Chain.acrobot(), {"centres": 0.0, "lengths": 1.0, "masses": 1.0}, None),
    ],
)
def test_options_do_not_give_a_chain_more_than_the_environment_was_made_with(
    chain, options, message
):
    env = gym.make("NPendulum-v0", chain=chain).unwrapped
    before = env.reset(seed=1)[1]
    if message is None:
        env.reset(options=options)
    else:
        with pytest.raises(ValueError, match=message):
            env.reset(options=options)
    after = env.reset(seed=1)[1]  # without options: the chain of the config again
    assert before["energy"] == after["energy"]


START = {"theta": [0.4, -0.3, 1.1], "omega": [0.5, -1.0, 2.0]}


def test_quantities_are_those_of_the_links():
    env = gym.make("NPendulum-v0", chain=CHAIN, mode=Own()).unwrapped
    env.reset(options=START)
    quantities = env._episodes.outputs.quantities()
    theta, omega = (np.array(values) for values in START.values())
    now, down, up = (centre_of_mass(CHAIN, at)[1] for at in (theta, 0.0 * theta, np.full(3, np.pi)))
    unit = CHAIN.lifting_energy
    tip = positions(CHAIN, theta)[-1, 1] / CHAIN.total_length
    assert quantities.height == pytest.approx((now - down) / (up - down), rel=1e-12)
    assert quantities.tip == pytest.approx(tip, rel=1e-12)
    assert quantities.energy == pytest.approx(total_energy(CHAIN, theta, omega) / unit, rel=1e-12)
    kinetic = kinetic_energy(CHAIN, theta, omega) / unit
    assert quantities.kinetic_energy == pytest.approx(kinetic, rel=1e-12)


def test_options_change_the_chain_for_one_episode():
    env = gym.make("NPendulum-v0", chain=CHAIN, dt=0.02, substeps=50).unwrapped
    torque = [0.2 * env.config.max_torque, 0.0, 0.0]
    changed = {"friction": 0.02, "armature": 0.01, "gear": [None, -4.0, np.inf], "centres": 0.1}
    for change in (changed, {}):
        env.reset(options=START | change)
        info = [env.step(np.array([0.2]))[4] for _ in range(10)][-1]
        chain = Chain.from_dict(CHAIN.as_dict() | change)
        exact = simulate(chain, *START.values(), [0.0, 0.2], torque=torque)
        np.testing.assert_allclose(info["theta"], exact.theta[-1], rtol=0, atol=1e-7)
