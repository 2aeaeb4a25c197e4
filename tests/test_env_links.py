"""Environments of chains with links: inertia, centres of mass, dry friction and rotors."""

import json
import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from npend_gym import Chain
from npend_gym.envs import EnvConfig

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


@pytest.mark.parametrize(
    ("name", "chain"),
    [("acrobot", Chain.acrobot()), ("realaigym C.1", Chain.realaigym("C.1"))],
)
def test_presets_are_known_by_name(name, chain):
    assert EnvConfig(chain=name).chain == chain


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


def test_lists_of_numbers_in_arrays_survive_the_spec_as_json_too():
    env = gym.make("NPendulum-v0", n=2, masses=np.array([1.0, 2.0]))
    assert gym.make(EnvSpec.from_json(env.spec.to_json())).unwrapped.config.chain == Chain(
        [1.0, 2.0], 1.0
    )


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"chain": CHAIN, "masses": 1.0}, ValueError, "masses cannot be given together with chain"),
        ({"chain": CHAIN, "gear": 6.0}, ValueError, "gear cannot be given together with chain"),
        ({"chain": CHAIN, "n": 2}, ValueError, "n must be left out .* its number of links, 3; got"),
        ({"chain": "acrobat"}, ValueError, "or one of acrobot, .*; got 'acrobat'"),
        ({"chain": 3}, TypeError, "chain must be a npend_gym.Chain, a dict .*; got 3"),
        ({"chain": {"masses": [1.0]}}, ValueError, "the dict of a chain has no 'lengths'"),
        ({"inertias": -1.0}, ValueError, "inertias must be zero or more"),
        ({"friction": 0.1, "friction_speed": 0.0}, ValueError, "dry friction needs a speed"),
        ({"gear": 0.0}, ValueError, "gear must not be zero"),
        ({"centres": "middle"}, TypeError, "centres must hold real numbers"),
        ({"n": 1, "centres": 0.0, "inertias": 1.0}, ValueError, "centres must give weight to"),
    ],
)
def test_contradictions_and_bad_parameters_are_refused_by_name(given, error, message):
    with pytest.raises(error, match=message):
        EnvConfig(**given)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"inertias": 0.1}, r"options\['inertias'\] must leave .* chain=Chain\(...\)"),
        ({"armature": 0.1, "gear": 6.0}, "to vary armature, make the environment with a chain"),
        ({"centres": 0.5}, "point masses without friction or rotors"),
        ({"friction": 0.1}, "point masses without friction or rotors"),
        ({"gear": 0.0}, r"options\['gear'\] must not be zero"),
        ({"friction_speed": 0.0}, "dry friction needs a speed"),
    ],
)
def test_options_do_not_make_links_of_point_masses(options, message):
    env = gym.make("NPendulum-v0", n=2).unwrapped
    before = env.reset(seed=1)[1]
    with pytest.raises(ValueError, match=message):
        env.reset(options=options)
    assert env.config.chain == Chain.uniform(2)
    after = env.reset(seed=1)[1]  # the refused call has left the environment as it was
    assert before["energy"] == after["energy"]
