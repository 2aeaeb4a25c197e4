"""Chains drawn at every start: what is drawn, that it is what moves, and what is refused."""

import gymnasium as gym
import numpy as np
import pytest
from lanes import actions_for, assert_same, make_vec
from oracle import numpys_philox

from npend_gym import Chain, simulate
from npend_gym._streams import Purpose
from npend_gym.envs import EnvConfig
from npend_gym.envs.starts import Draw
from npend_gym.physics.substeps import default_substeps
from npend_gym.rl import evaluate

FACTORS = (0.8, 1.2)
# Of every kind: factors, values, one for each rod, one for the chain, one for the motor
RANDOMIZE = {
    "masses": FACTORS,
    "lengths": ([0.5, 0.9, 1.0], [0.7, 1.0, 1.3]),
    "gravity": {"low": 3.0, "high": 20.0},
    "damping": {"low": 0.0, "high": [0.1, 0.0, 0.2]},
    "max_torque": (0.5, 1.0),
}
NAMES = (
    *(f"{name}[{rod}]" for name in ("masses", "lengths") for rod in range(3)),
    "gravity", "damping[0]", "damping[1]", "damping[2]", "max_torque",
)  # fmt: skip
TORQUE = EnvConfig(n=3).max_torque
LOW = np.array([0.8] * 3 + [0.5, 0.9, 1.0, 3.0, 0.0, 0.0, 0.0, 0.5 * TORQUE])
HIGH = np.array([1.2] * 3 + [0.7, 1.0, 1.3, 20.0, 0.1, 0.0, 0.2, TORQUE])
# Links with all that they may have, none alike
LINKS = Chain(
    [1.0, 0.5, 0.8], [0.5, 0.4, 0.3], 9.8, [0.01, 0.02, 0.01], [0.02, 0.01, 0.01], 0.01,
    centres=[0.2, 0.4, -0.1], inertias=[0.02, 0.01, 0.01], friction=[0.1, 0.01, 0.02],
    friction_speed=[0.05, 0.05, 0.1], armature=[0.003, 0.002, 0.001], gear=[4.0, 6.0, -6.0],
)  # fmt: skip


def chain_of(env, context):
    """Return the chain that is made of the numbers of a context, by their names."""
    config = env.unwrapped.config
    parameters = config.chain.repeated(1)._asdict().items()
    chain = {name: row[0] if name == "gravity" else row[0].tolist() for name, row in parameters}
    at_the_end = chain["centres"] == chain["lengths"]
    if at_the_end and "centres[0]" not in config.context_names:
        chain["centres"] = chain["lengths"]  # bobs stay at the ends of their rods
    for entry, value in zip(config.context_names, context.tolist(), strict=True):
        name, _, rod = entry.partition("[")
        if name == "gravity":
            chain[name] = value
        elif name != "max_torque":
            chain[name][int(rod[:-1])] = value
    return Chain(**chain)


# -- what is drawn ----------------------------------------------------------------------------


def test_draws_are_those_of_numpys_philox_by_seed_and_episode():
    count, seed = 5, 2**64 + 12
    envs = make_vec(count, n=3, randomize=RANDOMIZE, max_episode_steps=2)
    assert envs.unwrapped.config.context_names == NAMES
    contexts = [envs.reset(seed=seed)[1]["context"]]
    contexts += [envs.step(np.zeros((count, 1)))[-1]["context"] for _ in range(6)]
    contexts.append(envs.reset()[1]["context"])
    assert_same(contexts[0], contexts[2])  # the same chain until the next episode
    for episode, context in enumerate((contexts[0], contexts[3], contexts[6], contexts[7])):
        for k, drawn in enumerate(context):
            stream = numpys_philox(seed + k, purpose=Purpose.CHAIN, episode=episode)
            u = np.random.Generator(stream).random(len(NAMES))
            assert drawn.tolist() == (LOW + (HIGH - LOW) * u).tolist()


@pytest.mark.parametrize("mode", ["swingup", "balance", "calm"])
def test_starts_are_those_of_the_same_seed_without_randomisation(mode):
    drawn, plain = (make_vec(4, n=3, mode=mode, **k) for k in ({"randomize": RANDOMIZE}, {}))
    assert_same(drawn.reset(seed=5)[1]["theta"], plain.reset(seed=5)[1]["theta"])


def test_the_context_is_observed_from_minus_one_to_one():
    env = gym.make("NPendulum-v0", n=3, randomize=RANDOMIZE, observe_context=True)
    plain = gym.make("NPendulum-v0", n=3, randomize=RANDOMIZE)
    for seed in range(20):
        observation, info = env.reset(seed=seed)
        assert env.observation_space.contains(observation)
        assert_same(observation[:-11], plain.reset(seed=seed)[0])
        shown, middle = observation[-11:], 0.5 * (LOW + HIGH)
        expected = middle + shown * (HIGH - middle)
        np.testing.assert_allclose(info["context"], expected, rtol=1e-6)
    assert shown[8] == 0.0  # a range without width
    after = env.step(np.ones(1, np.float32))[0]
    assert_same(after[-11:], shown)


@pytest.mark.parametrize("randomize", [None, {}])
def test_nothing_drawn_is_nothing_observed(randomize):
    env = gym.make("NPendulum-v0", n=2, randomize=randomize, observe_context=True)
    observation, info = env.reset(seed=0)
    assert_same(observation, gym.make("NPendulum-v0", n=2).reset(seed=0)[0])
    assert "context" not in info


# -- what is drawn is what moves --------------------------------------------------------------


def test_a_small_swing_has_the_period_of_the_length_and_gravity_drawn():
    envs = make_vec(
        64, n=1, mode="passive", amplitude=0.01, spread=0.0, max_episode_steps=None,
        randomize={"lengths": (0.5, 2.0), "gravity": (0.3, 2.0), "masses": (0.1, 10.0)},
    )  # fmt: skip
    info = envs.reset(seed=0)[1]
    length, gravity, _ = info["context"].T
    expected = 2.0 * np.pi * np.sqrt(length / gravity) * (1.0 + 0.01**2 / 16.0)
    while (info["bobs_completed"] < 1).any():
        info = envs.step(np.zeros(64, int))[-1]
        assert info["time"][0] < 6.0
    np.testing.assert_allclose(info["pseudo_period"], expected, rtol=1e-7)
    np.testing.assert_allclose(info["ideal_period"], 2.0 * np.pi * np.sqrt(length / gravity))


def test_the_motor_turns_the_rod_by_the_torque_drawn_and_damping_brakes_it():
    envs = make_vec(
        32, n=1, gravity=0.0,
        randomize={"masses": FACTORS, "lengths": FACTORS, "max_torque": (0.1, 2.0)},
    )  # fmt: skip
    mass, length, limit = envs.reset(seed=0, options={"theta": 0.0, "omega": 0.0})[1]["context"].T
    action = np.linspace(-1.0, 1.0, 32)
    for _ in range(10):
        info = envs.step(action[:, None])[-1]
    np.testing.assert_allclose(
        info["omega"][:, 0], 0.5 * action * limit / (mass * length**2), rtol=1e-12
    )
    envs = make_vec(32, n=1, gravity=0.0, randomize={"damping": {"low": 0.1, "high": 1.0}})
    damping = envs.reset(seed=0, options={"omega": 2.0})[1]["context"][:, 0]
    for _ in range(10):
        info = envs.step(np.zeros((32, 1)))[-1]
    np.testing.assert_allclose(info["omega"][:, 0], 2.0 * np.exp(-0.5 * damping), rtol=1e-6)


DRAWN = {
    "bobs": ({"n": 3}, {name: RANDOMIZE[name] for name in RANDOMIZE if name != "max_torque"}),
    "links": ({"chain": LINKS}, dict.fromkeys(LINKS.repeated(1)._fields, FACTORS)),
    "bobs that become links": (
        {"n": 2, "chain": None},
        {
            "centres": (0.3, 0.8),
            "inertias": {"low": 0.01, "high": 0.2},
            "armature": {"low": 0.0, "high": 0.1},
            "gear": {"low": [2.0, -9.0], "high": [5.0, -3.0]},
            "friction": {"low": 0.0, "high": 0.2},
        },
    ),
}


@pytest.mark.long
@pytest.mark.parametrize("kind", DRAWN)
def test_every_number_drawn_is_the_moving_chains(kind):
    keywords, randomize = DRAWN[kind]
    envs = make_vec(6, mode="passive", amplitude=1.0, randomize=randomize, **keywords)
    info = envs.reset(seed=1)[1]
    chains = [chain_of(envs, context) for context in info["context"]]
    theta, energy = info["theta"], info["energy"]
    for _ in range(50):
        info = envs.step(np.zeros(6, int))[-1]
    for k, chain in enumerate(chains):
        motion = simulate(chain, theta[k], 0.0, [0.0, 0.5], rtol=1e-10, atol=1e-12)
        hanging = simulate(chain, 0.0, 0.0, [0.0]).energy()[0]
        np.testing.assert_allclose(info["theta"][k], motion.theta[1], atol=1e-5)
        assert energy[k] == pytest.approx(motion.energy()[0] - hanging, rel=1e-9)
    if "lengths" in randomize:
        assert np.ptp([chain.total_length for chain in chains]) > 0.01


# -- options ----------------------------------------------------------------------------------


@pytest.mark.parametrize("autoreset", ["NEXT_STEP", "SAME_STEP"])
@pytest.mark.parametrize("persist", [False, True])
def test_options_override_draws_and_persist_until_a_reset_with_options(autoreset, persist):
    envs = make_vec(3, n=3, randomize=RANDOMIZE, max_episode_steps=2, autoreset_mode=autoreset)
    plain = make_vec(3, n=3, randomize=RANDOMIZE, max_episode_steps=2, autoreset_mode=autoreset)
    masses = np.array([[2.0, 3.0, 4.0], [1.0, 1.0, 1.0], [0.5, 0.1, 0.2]])
    options = {"masses": masses, "theta": 0.3, "persist": persist}
    infos = [(envs.reset(seed=1, options=options)[1], plain.reset(seed=1)[1])]
    still = np.zeros((3, 1))
    infos += [(envs.step(still)[-1], plain.step(still)[-1]) for _ in range(4)]
    infos.append((envs.reset()[1], plain.reset()[1]))
    for t, (info, drawn) in enumerate(infos):
        assert_same(info["context"][:, 3:], drawn["context"][:, 3:])  # the others are drawn
        changed = persist or t < (3 if autoreset == "NEXT_STEP" else 2)
        assert_same(info["context"][:, :3], masses if changed else drawn["context"][:, :3])
        if info["time"][0] == 0.0:
            assert (info["theta"] == 0.3).all() == changed
    again = envs.reset(options={"theta": 0.1})[1], plain.reset()[1]
    assert_same(again[0]["context"], again[1]["context"])
    again = envs.reset()[1], plain.reset()[1]
    assert_same(again[0]["theta"], again[1]["theta"])


def test_options_that_persist_hold_in_the_lanes_that_say_so():
    envs = make_vec(3, n=1, max_episode_steps=1, autoreset_mode="SAME_STEP")
    persist = np.array([True, False, True])
    envs.reset(seed=0, options={"theta": np.array([[1.0], [2.0], [3.0]]), "persist": persist})
    assert (envs.step(np.zeros((3, 1)))[-1]["theta"][:, 0] == [1.0, 2.0, 3.0]).tolist() == [
        True, False, True,
    ]  # fmt: skip
    mask = np.array([True, False, False])
    envs.reset(options={"reset_mask": mask, "omega": 0.0})  # forgets what lane 0 had
    theta = envs.step(np.zeros((3, 1)))[-1]["theta"][:, 0]
    assert np.abs(theta[:2]).max() < 0.05
    assert theta[2] == 3.0


# -- substeps ---------------------------------------------------------------------------------

WIDE = (0.2, 5.0)
RANGES = {
    "bobs": ({}, {"masses": WIDE, "lengths": WIDE, "gravity": (0.5, 2.0)}),
    "damping": ({}, {"masses": WIDE, "lengths": WIDE, "damping": {"low": 0.0, "high": 1.0}}),
    "friction": (
        {"friction": 0.1},
        {"masses": WIDE, "friction": (0.0, 20.0), "friction_speed": {"low": 0.05, "high": 1.0}},
    ),
    "centres": (
        {"inertias": 0.1},
        {"inertias": {"low": 1e-4, "high": 2.0}, "masses": WIDE,
         "centres": {"low": 0.01, "high": 1.0}},
    ),
    "drag": (
        {"inertias": 0.1, "drag": 2.0},
        {"inertias": {"low": 1e-3, "high": 0.1}, "centres": {"low": 0.01, "high": 0.2},
         "lengths": {"low": 0.2, "high": 1.0}},
    ),
    "rotors": (
        {"armature": 0.1, "inertias": 0.1, "masses": 0.1},
        {"armature": (0.01, 20.0), "damping": {"low": 0.0, "high": 2.0}},
    ),
}  # fmt: skip


@pytest.mark.parametrize("n", [1, 2, 3, 5])
@pytest.mark.parametrize("kind", RANGES)
def test_substeps_resolve_every_chain_of_the_range(n, kind):
    keywords, randomize = RANGES[kind]
    env = gym.make("NPendulum-v0", n=n, randomize=randomize, **keywords)
    config, rng = env.unwrapped.config, np.random.default_rng(n)
    low, high = config.randomization.draws[:, [Draw.LOW, Draw.HIGH]].T
    for _ in range(60):
        ends = np.where(rng.random(low.size) < 0.5, low, high)  # corners are the fastest
        assert default_substeps(chain_of(env, ends), config.dt) <= 1.05 * config.min_substeps


def test_the_energy_of_the_fastest_chains_is_kept():
    envs = make_vec(
        512, n=3, mode="passive", amplitude=1.0, dt=0.05,
        randomize={"masses": WIDE, "lengths": WIDE, "gravity": WIDE},
    )  # fmt: skip
    envs.reset(seed=0)
    for _ in range(40):
        info = envs.step(np.zeros(512, int))[-1]
    assert np.abs(info["energy_error"]).max() < 1e-5


# -- what is refused --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("randomize", "error", "message"),
    [
        ({"masses": (1.2, 0.8)}, ValueError, r"\['masses'\] must have its low end below its high"),
        ({"masses": ([0.8, 1.2], 1.0)}, ValueError, r"\['masses'\] must have its low end below"),
        ({"damping": {"low": 0.1, "high": 0.0}}, ValueError, r"\['damping'\] must have its low"),
        ({"lengths": (-0.1, 1.0)}, ValueError, r"\['lengths'\] must be zero or more, got"),
        ({"damping": {"low": -1.0, "high": 1.0}}, ValueError, r"\['damping'\] must be zero or mo"),
        ({"max_torque": (-1.0, 1.0)}, ValueError, r"\['max_torque'\] must be zero or more"),
        ({"masses": (np.nan, 1.0)}, ValueError, r"\['masses'\] must be finite, got nan"),
        ({"gravity": (1.0, np.inf)}, ValueError, r"\['gravity'\] must be finite, got inf"),
        ({"masses": (0.0, 1.0)}, ValueError, r"\['masses'\] must be greater than zero"),
        ({"lengths": (0.0, 0.0)}, ValueError, r"\['lengths'\] must be greater than zero"),
        ({"lengths": (1e-40, 1.0)}, ValueError, r"\['lengths'\] must be zero or at least 1e-30"),
        ({"mass": (0.9, 1.1)}, ValueError, "randomize must have keys among masses, .*got 'mass'"),
        ({3: (0.9, 1.1)}, ValueError, "randomize must have keys among masses, .*got 3"),
        ({"masses": 0.9}, ValueError, r"\['masses'\] must be a pair \(low, high\) of factors"),
        ({"masses": (0.9, 1.0, 1.1)}, ValueError, r"\['masses'\] must be a pair \(low, high\)"),
        ({"masses": "ab"}, ValueError, r"\['masses'\] must be a pair \(low, high\)"),
        ({"masses": ([1.0] * 3, [2.0] * 3)}, ValueError, r"\['masses'\] must be one number or an"),
        ({"gravity": ([1.0] * 2, 2.0)}, ValueError, r"\['gravity'\] must be one number or an arr"),
        ({"masses": {"low": 1.0}}, ValueError, r"\['masses'\] must have the keys \"low\" and"),
        ({"masses": {"low": 1, "high": 2, "by": 1}}, ValueError, r"\['masses'\] must have the ke"),
        ({"masses": (True, 2.0)}, TypeError, r"\['masses'\] must hold real numbers, got True"),
        ({"damping": (0.5, 2.0)}, ValueError, r"\['damping'\] are factors of \[0.0, 0.0\], which"),
        ({"gear": (0.5, 2.0)}, ValueError, r"\['gear'\] are factors of \[inf, inf\], which"),
        ({"gear": {"low": 1.0, "high": np.inf}}, ValueError, r"\['gear'\] must be finite, got"),
        ({"gear": {"low": 0.0, "high": 1.0}}, ValueError, r"\['gear'\] must not be zero"),
        ({"gear": {"low": -1.0, "high": 1.0}}, ValueError, r"\['gear'\] must have ends of one s"),
        ({"friction_speed": (0.0, 1.0)}, ValueError, r"\['friction_speed'\] must be greater than"),
        ({"centres": {"low": -0.1, "high": 0.9}}, ValueError, r"\['centres'\] must keep the cen"),
        ({"centres": {"low": -2.0, "high": -0.1}}, ValueError, "centres must put the chain's cent"),
        (  # standing where all are light, or all heavy, but not where the second is light
            {
                "masses": {"low": 0.1, "high": 10.0},
                "inertias": {"low": 0.1, "high": 0.2},
                "centres": {"low": [-0.5, 0.4], "high": 0.5},
            },
            ValueError,
            "centres must put the chain's cent",
        ),
        (
            {"ripple_cycles": {"low": 1, "high": 9}},
            ValueError,
            "keys among .* 'ripple_cycles'",
        ),
        ([("masses", (0.9, 1.1))], TypeError, r"randomize must be a dict such as {\"masses\": "),
    ],
)
@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
def test_a_range_that_is_none_is_refused_by_name(make, randomize, error, message):
    with pytest.raises(error, match=message):
        make("NPendulum-v0", n=2, randomize=randomize)


@pytest.mark.parametrize(
    "options",
    [{"masses": -1.0}, {"persist": "yes"}, {"persist": [True, False]}, {"max_torque": -3.0}],
)
def test_a_reset_that_is_refused_changes_nothing(options):
    envs, twins = (make_vec(3, n=3, randomize=RANDOMIZE, max_episode_steps=4) for _ in range(2))
    for both in (envs, twins):
        both.reset(seed=0, options={"gravity": 5.0, "persist": True})
    with pytest.raises((ValueError, TypeError), match="options"):
        envs.reset(options=options)
    actions = actions_for(envs, 10)
    for action in actions:
        assert_same(envs.step(action), twins.step(action))


def test_options_that_let_a_chain_be_drawn_higher_hanging_are_refused():
    chain = Chain([1.0, 1.0], [1.0, 1.0], centres=[-0.1, 0.5], inertias=0.1)
    env = gym.make("NPendulum-v0", chain=chain, randomize={"masses": (0.5, 2.0)})
    with pytest.raises(ValueError, match="centres must put the chain's centre of mass higher"):
        env.reset(options={"centres": [-0.6, 0.5]})  # of the chain as made a good one


# -- evaluations ------------------------------------------------------------------------------


def test_the_motors_work_is_that_of_the_torque_drawn():
    drawn = {"randomize": {"max_torque": {"low": 3.0, "high": 3.0}}}
    works = [
        evaluate(lambda observation, _: np.ones((len(observation), 1)), keywords, episodes=3)
        for keywords in ({"n": 1, "max_torque": 3.0}, {"n": 1} | drawn)
    ]
    assert_same(works[0].motor_work, works[1].motor_work)
    assert works[0].motor_work.min() > 1.0
