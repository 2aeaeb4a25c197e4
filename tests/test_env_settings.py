"""Making an environment: its keywords, its tasks, its entry in Gymnasium's registry, its errors."""

import inspect
import pickle
import re
import sys
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from scripts import changed_copy, run_python

from npend_gym import Cart, Chain
from npend_gym.envs import (
    EnvConfig,
    EnvKeywords,
    Mode,
    NPendulumEnv,
    NPendulumVectorEnv,
    ResetNeeded,
    SwingUp,
)
from npend_gym.envs.keywords import CHAIN_KEYWORDS

ENVIRONMENTS = [NPendulumEnv, NPendulumVectorEnv]


class Patient(SwingUp):
    """A task that can be imported from this module."""

    name = "patient"
    hold = 60.0


NAMED = f"{__name__}:Patient"
TRIPLE = Chain.uniform(3)
OBSERVED = "observe_context must be True or False"


@pytest.mark.parametrize("owner", [*ENVIRONMENTS, EnvConfig])
def test_the_signature_shows_every_keyword_with_its_default(owner):
    parameters = inspect.signature(owner).parameters
    for name in EnvKeywords.__annotations__:
        default = parameters[name].default
        assert default is not inspect.Parameter.empty
        if name in CHAIN_KEYWORDS[2:]:
            assert default == inspect.signature(Chain).parameters[name].default
        else:
            EnvConfig(**{name: default})
    assert ("render_mode" in parameters) == (owner is not EnvConfig)
    assert not any(each.kind is each.VAR_KEYWORD for each in parameters.values())


@pytest.mark.parametrize("env", ENVIRONMENTS)
def test_an_unknown_keyword_is_refused_with_the_nearest_one(env):
    with pytest.raises(TypeError) as refused:
        env(amplitud=0.5)
    message = str(refused.value)
    assert f"{env.__name__} got an unexpected keyword argument 'amplitud'" in message
    assert "did you mean 'amplitude'?" in message
    for name in inspect.signature(env).parameters:
        assert name in message
    with pytest.raises(TypeError, match="EnvConfig got an unexpected keyword argument 'chian'"):
        EnvConfig(chian=Chain.acrobot())
    with pytest.raises(TypeError, match="'thread'; did you mean 'threads'"):
        NPendulumVectorEnv(2, thread=2)


def test_the_settings_cannot_be_changed_but_copied_with_a_change():
    config = EnvConfig(n=3, masses=2.0, substeps=4)
    with pytest.raises(AttributeError):
        config.n = 4
    other = replace(config, dt=0.1, substeps=None)
    assert (other.n, other.dt, other.chain) == (3, 0.1, config.chain)
    assert config.min_substeps == 4
    assert other.min_substeps == EnvConfig(n=3, masses=2.0, dt=0.1).min_substeps > 1
    assert "mode" in repr(pickle.loads(pickle.dumps(config)))


@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
def test_a_task_of_ones_own_is_found_by_name_and_survives_json(make):
    env = make("NPendulum-v0", mode=NAMED, n=1)
    again = make(EnvSpec.from_json(env.spec.to_json()))
    for each in (env, again, pickle.loads(pickle.dumps(again))):
        assert type(each.unwrapped.config.mode) is Patient
        assert each.unwrapped.config.hold_steps == 1200


# Keywords that are wrong, and what the error says of them
REFUSED = [
    # tasks
    ({"mode": "nowhere:Patient"}, "mode 'nowhere:Patient' cannot be imported"),
    ({"mode": f"{__name__}:Impatient"}, "cannot be imported: .*Impatient"),
    ({"mode": ":Patient"}, 'the name of a class, "package.module:Class"'),
    ({"mode": Patient}, "passive, swingup, balance, calm, transition, an instance"),
    ({"goal_env": True}, "goal_env must be False in mode 'swingup'"),
    (
        {"goal_env": True, "mode": "transition"},
        "type must be \"sparse\" with goal_env=True.*'dense'",
    ),
    ({"reward_type": "rare"}, "reward_type must be one of dense, sparse; got"),
    ({"observation": "pixels"}, "observation must be one of angles, sincos, scaled; got"),
    # chains
    ({"chain": TRIPLE, "masses": 1.0}, "masses cannot be given together with chain"),
    ({"chain": TRIPLE, "n": 2}, "n must be left out .* its number of links, 3; got"),
    ({"chain": "acrobat"}, "or one of acrobot, .*; got 'acrobat'"),
    ({"chain": {"masses": [1.0]}}, "the dict of a chain has no 'lengths'"),
    ({"chain": Chain.uniform(2, stiffness=1e4)}, "chain must have rigid rods in an environment"),
    ({"n": 1, "centres": 0.0, "inertias": 1.0}, "centres must put the chain's"),
    # carts
    (
        {"chain": Chain.uniform(2, base=Cart(1.0)), "base": "pivot"},
        'base must be "cart", or left out, for a chain that has a cart',
    ),
    ({"base": "rail"}, "base must be one of pivot, cart"),
    ({"cart_mass": 1.0}, 'cart_mass belongs to a cart: give base="cart" with it'),
    ({"rail": 2.0}, "rail belongs to a cart.*got 2.0"),
    ({"base": "cart", "cart_mass": 0.0}, "cart_mass must be greater than zero"),
    ({"base": "cart", "rail": -1.0}, "rail must be greater than zero"),
    ({"base": "cart", "rail_damping": -1.0}, "rail_damping must be"),
    ({"base": "cart", "max_force": np.nan}, "max_force must be finite"),
    (
        {"base": "cart", "max_force": 1.0, "difficulty": "easy"},
        "difficulty cannot be given together with max_force",
    ),
    ({"base": "cart", "torque_noise": 0.1}, "torque_noise must be left out where"),
    ({"base": "cart", "actuated": (2,)}, "actuated must be between 0 and 1"),
    ({"cart_mass": np.ones(2)}, "cart_mass belongs to a cart"),
    ({"base": "cart", "randomize": {"max_torque": (0.5, 2.0)}}, "leave out 'max_torque' where no"),
    ({"randomize": {"cart_mass": (0.5, 2.0)}}, "randomize must have keys among"),
    ({"base": "cart", "randomize": {"cart_mass": {"low": 0.0, "high": 1.0}}}, "cart_mass"),
    # motors
    ({"actuated": (0, 0)}, "actuated must name at least one joint, and each once"),
    ({"difficulty": "harder"}, "difficulty must be one of easy, medium, hard, or"),
    ({"difficulty": -0.2}, "difficulty must be greater than zero, got -0.2"),
    ({"difficulty": np.nan}, "difficulty must be finite, got nan"),
    (
        {"difficulty": "hard", "max_torque": 2.0},
        "difficulty cannot be given together with max_torque.*difficulty='hard' and max",
    ),
    (
        {"difficulty": "easy", "mode": "passive"},
        "difficulty must be left out in mode 'passive', which has no motor; got 'easy'",
    ),
    ({"torque_levels": 1}, "torque_levels must be between 2 and 65536, got 1"),
    (
        {"torque_levels": 300, "actuated": (0, 1)},
        r"torque_levels to the power of the actuated joints.*at most 65536; got 300 \*\* 2",
    ),
    (
        {"torque_levels": 3, "mode": "passive"},
        "torque_levels must be left out in mode 'passive', which has no motor; got 3",
    ),
    # sensors and motors that are not ideal
    ({"angle_noise": -0.1}, "angle_noise must be zero or more, got -0.1"),
    ({"velocity_noise": np.nan}, "velocity_noise must be finite, got nan"),
    ({"angle_noise": 7.0}, "angle_noise must be at most 6.28319 rad, beyond which .* got 7"),
    ({"angle_resolution": 4.0}, "angle_resolution must be at most 3.14159 rad"),
    ({"observation_delay": 100.5}, "observation_delay must be at most 100 steps; make dt lar"),
    ({"action_delay": 101}, "action_delay must be at most 100 steps; make dt larger"),
    ({"motor_lag": np.inf}, "motor_lag must be finite, got inf"),
    ({"push_rate": 30.0, "push_force": 1.0}, "push_rate must be at most 20 1/s, one a step"),
    ({"push_rate": 1.0}, "push_rate and push_force must be given together"),
    ({"push_force": 1.0}, "push_rate and push_force must be given together"),
    ({"ripple_cycles": 0}, "ripple_cycles must be between 1 and 1000, got 0"),
    ({"mode": "passive", "motor_lag": 0.1}, "motor_lag must be left out in mode 'passive'"),
]


OF_A_WRONG_TYPE = [
    ({"mode": f"{__name__}:NAMED"}, "must name a class derived from npend_gym.envs.Mode"),
    ({"goal_env": 1, "mode": "transition"}, "goal_env must be"),
    ({"observe_context": 1}, OBSERVED),
    ({"observe_context": "yes"}, OBSERVED),
    ({"observe_context": None}, OBSERVED),
    ({"chain": 3}, "chain must be an npend_gym.Chain, a dict .*; got 3"),
    ({"chain": "acrobot", "n": 2.0}, "n must be an integer, got 2.0"),
    ({"chain": Chain.uniform(1), "n": True}, "n must be an integer, got True"),
    ({"chain": "acrobot", "n": np.array([2, 2])}, "n must be an integer, got array"),
    ({"difficulty": ["easy"]}, r"difficulty must be a real number, got \['easy'\]"),
    ({"torque_levels": 2.0}, "torque_levels must be an integer, got 2.0"),
]


@pytest.mark.parametrize(
    ("keywords", "message", "error"),
    [(*case, ValueError) for case in REFUSED] + [(*case, TypeError) for case in OF_A_WRONG_TYPE],
)
def test_keywords_that_are_wrong_are_refused_by_name_with_the_reason(keywords, message, error):
    with pytest.raises(error, match=message):
        EnvConfig(**keywords)


@pytest.mark.parametrize("name", ["start", "reward", "failed", "achieved"])
def test_a_method_on_an_instance_of_a_built_in_mode_is_refused(name):
    mode = SwingUp()
    setattr(mode, name, lambda *_: 7.0)
    with pytest.raises(ValueError, match=f"got {name} on an instance of SwingUp.*derive a class"):
        EnvConfig(mode=mode)


def test_a_start_on_an_instance_of_a_mode_of_ones_own_is_used():
    mode = Patient()
    mode.start = lambda _, n, *__: (np.ones(n), np.zeros(n))
    env = gym.make("NPendulum-v0", mode=mode, n=2)
    assert env.reset(seed=0)[1]["theta"].tolist() == [1.0, 1.0]


@pytest.mark.parametrize(
    ("start", "message"),
    [
        (([np.nan, 0.0], 0.0), "the angles of mode.start must be finite"),
        ((2e5, 0.0), "the angles of mode.start must lie within"),
        ((0.0, 2e6), "the velocities of mode.start must lie within"),
        ((np.zeros(3), 0.0), r"the angles of mode.start must be .*\(2,\), got shape \(3,\)"),
        (np.zeros(2), r"start of mode 'patient' must .*two arrays of shape \(2,\).*got array"),
        (([0.0, 0.0], 0.0, 0.0), r"start of mode .*; got \(\[0.0, 0.0\], 0.0, 0.0\)"),
        (None, "start of mode 'patient' .*; got None"),
    ],
)
def test_a_start_of_a_mode_that_is_no_state_is_refused_by_its_name(start, message):
    mode = Patient()
    mode.start = lambda *_: start
    env = gym.make("NPendulum-v0", mode=mode, n=2)
    with pytest.raises(ValueError, match=message):
        env.reset(seed=0)


class Judged(SwingUp):
    """A task that returns what it is made with; "achieved" is that of `Mode`."""

    achieved = Mode.achieved

    def __init__(self, method="", value=None):
        if method:
            setattr(self, method, value if callable(value) else lambda _: value)


NAN = np.nan
THREE = r", or an array of them of shape \(3,\), got"


@pytest.mark.parametrize("reward_type", ["dense", "sparse"])
@pytest.mark.parametrize("method", ["failed", "achieved"])
@pytest.mark.parametrize(
    ("value", "error", "got"),
    [
        (NAN, TypeError, "nan"),
        (0.5, TypeError, "0.5"),
        ("no", TypeError, "'no'"),
        (None, TypeError, "None"),
        (np.zeros(3), TypeError, r"\[0.0, 0.0, 0.0\]"),
        ([True, [False]], TypeError, r"\[True, \[False\]\]"),
        (np.zeros((3, 1), bool), ValueError, r"\[\[False\], \[False\], \[False\]\]"),
    ],
)
def test_a_failure_or_success_of_a_mode_that_is_no_truth_is_refused(
    reward_type, method, value, error, got
):
    mode = Judged(method, value)
    envs = gym.make_vec("NPendulum-v0", 3, n=2, mode=mode, reward_type=reward_type)
    with pytest.raises(
        error, match=f"{method} of mode 'swingup' must be True or False{THREE} {got}"
    ):
        envs.reset(seed=0)


@pytest.mark.parametrize(
    ("value", "error", "message"),
    [
        (NAN, ValueError, "finite, got nan in sub-environment 0"),
        (
            lambda q: q.tip / np.array([1.0, 0.0, 1.0]),
            ValueError,
            "finite, got -inf in sub-environment 1",
        ),
        (1j, TypeError, f"a finite number{THREE} 1j"),
        ("1", TypeError, f"a finite number{THREE} '1'"),
        (None, TypeError, f"a finite number{THREE} None"),
        (np.zeros(2), ValueError, rf"a finite number{THREE} \[0.0, 0.0\]"),
        (lambda q: q.theta, ValueError, rf"a finite number{THREE} \[\["),
    ],
)
def test_a_reward_of_a_mode_that_is_no_finite_number_is_refused(value, error, message):
    envs = gym.make_vec("NPendulum-v0", 3, n=2, mode=Judged("reward", value))
    envs.reset(seed=0)
    with (
        np.errstate(divide="ignore"),
        pytest.raises(error, match=f"reward of mode 'swingup' must be {message}"),
    ):
        envs.step(np.zeros((3, 1)))


@pytest.mark.parametrize(("method", "value"), [("failed", 0.5), ("reward", "1"), ("reward", NAN)])
def test_a_single_environment_refuses_what_a_mode_may_not_return(method, value):
    env = gym.make("NPendulum-v0", n=2, mode=Judged(method, value)).unwrapped
    with pytest.raises((TypeError, ValueError), match=f"{method} of mode 'swingup' must be"):
        env.reset(seed=0), env.step(np.zeros(1))


@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
def test_comparisons_of_a_mode_may_be_multiplied_and_a_reward_may_be_a_truth(make):
    env = make("NPendulum-v0", n=2, mode=Judged("failed", lambda q: (q.tip < 0.0) * (q.tip > -9.0)))
    env.reset(seed=0)
    assert np.all(env.step(np.zeros(env.action_space.shape))[2])
    env = make("NPendulum-v0", n=2, mode=Judged("reward", lambda q: q.tip < 0.0))
    env.reset(seed=0)
    assert np.all(env.step(np.zeros(env.action_space.shape))[1] == 1.0)


def test_a_lane_that_diverges_is_truncated_even_if_its_reward_is_not_finite():
    mode = Judged("reward", lambda q: np.where(q.mean_squared_action > 0.0, NAN, 1.0))
    envs = gym.make_vec("NPendulum-v0", 2, n=2, mode=mode, max_torque=1e25, substeps=1)
    envs.reset(seed=0)
    _, reward, _, truncated, info = envs.step(np.array([[0.0], [1.0]]))
    assert truncated.tolist() == info["diverged"].tolist() == [False, True]
    assert reward[0] == 1.0


@pytest.mark.parametrize(("method", "missing"), [("start", "reward"), ("reward", "start")])
def test_a_mode_without_a_start_or_a_reward_is_refused_by_name(method, missing):
    mode = type("Half", (Mode,), {method: lambda *_: (0.0, 0.0)})()
    env = gym.make("NPendulum-v0", mode=mode).unwrapped
    with pytest.raises(NotImplementedError, match=f"mode 'custom' must define {missing}"):
        env.reset(seed=0), env.step(np.zeros(1))


@pytest.mark.parametrize(
    ("name", "value", "error", "rule"),
    [
        ("dt", 0.0, ValueError, "greater than zero, got 0.0"),
        ("dt", -0.02, ValueError, "greater than zero, got -0.02"),
        ("dt", NAN, ValueError, "finite, got nan"),
        ("dt", "0.02", TypeError, "a real number, got '0.02'"),
        ("hold", -1.0, ValueError, "zero or more, got -1.0"),
        ("hold", np.inf, ValueError, "finite, got inf"),
        ("hold", "1", TypeError, "a real number, got '1'"),
        ("torque_share", -0.5, ValueError, "zero or more, got -0.5"),
        ("torque_share", NAN, ValueError, "finite, got nan"),
        ("torque_share", None, TypeError, "a real number, got None"),
    ],
)
def test_the_numbers_of_a_mode_keep_the_rules_of_keywords(name, value, error, rule):
    mode = type("Own", (Patient,), {name: value})()
    with pytest.raises(error, match=f"^{name} of mode 'patient' must be {rule}"):
        EnvConfig(mode=mode)


def test_a_mode_says_how_wide_its_starts_are_unless_the_keyword_does():
    class Wide(SwingUp):
        spread = 0.4

    class Old(SwingUp):
        nearness = 0.4

    assert EnvConfig(mode=Wide()).spread == 0.4
    assert EnvConfig(mode=Wide(), spread=0.1).spread == 0.1
    with pytest.raises(TypeError, match="nearness of mode 'swingup' must be named spread"):
        EnvConfig(mode=Old())
    short = {"base": "cart", "rail": 0.5}
    for wide in ({"spread": 0.5}, {"randomize": {"spread": {"low": 0.0, "high": 0.5}}}):
        with pytest.raises(ValueError, match=r"spread must be less than 0.5, with which carts"):
            NPendulumEnv(mode="swingup", n=1, **short, **wide)
    with pytest.raises(ValueError, match=r"spread must be less than 0.5, .*longer rail"):
        NPendulumEnv(mode="swingup", n=1, **short).reset(options={"spread": 0.6})
    with pytest.raises(ValueError, match=r"spread must be at most pi in mode 'balance'.*got 4"):
        EnvConfig(mode="balance", spread=4.0)


@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
def test_rendering_without_a_render_mode_warns_and_returns_none(make):
    env = make("NPendulum-v0").unwrapped
    with pytest.warns(UserWarning, match='gym.make\\("NPendulum-v0", render_mode="rgb_array"\\)'):
        assert env.render() is None
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="does nothing without a render mode"):
        assert env.render() is None


@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
@pytest.mark.parametrize("caught", [gym.error.ResetNeeded, RuntimeError, ResetNeeded])
def test_before_the_first_reset_steps_and_pictures_are_refused(make, caught):
    pytest.importorskip("pygame")
    env = make("NPendulum-v0", render_mode="rgb_array").unwrapped
    with pytest.raises(caught, match=r"call reset\(\) before step\(\)"):
        env.step(np.zeros(env.action_space.shape))
    with pytest.raises(caught, match=r"call reset\(\) before render\(\)"):
        env.render()


@pytest.mark.parametrize("caught", [gym.error.DependencyNotInstalled, ImportError])
@pytest.mark.parametrize("env", ENVIRONMENTS)
def test_without_pygame_an_environment_with_pictures_names_the_extra(env, caught, monkeypatch):
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(caught, match=r'pip install "npend-gym\[render\]"'):
        env(render_mode="rgb_array")


def test_the_number_of_rods_is_that_of_the_masses_where_it_is_not_given():
    assert EnvConfig(masses=[1.0, 2.0, 3.0]).n == 3
    assert EnvConfig(lengths=np.array([1.0])).n == 1
    assert EnvConfig(masses=2.0).n == EnvConfig().n == 2
    with pytest.raises(ValueError, match=r"masses must be one number or an array of shape \(2,\)"):
        EnvConfig(n=2, masses=[1.0, 2.0, 3.0])


@pytest.mark.parametrize(("name", "hint"), [
    ("num_links", "did you mean 'n'"), ("frame_skip", "did you mean 'substeps'"),
    ("seed", r"a seed is given to reset\(seed=...\)"),
])  # fmt: skip
def test_the_words_of_other_packages_are_answered_with_ours(name, hint):
    with pytest.raises(TypeError, match=hint):
        NPendulumEnv(**{name: 3})


# -- what CONTRIBUTING says of a keyword, a key of the info and a task ----------------------

ROOT = Path(__file__).parent.parent
WALKED = r"""
import inspect
import numpy as np
import pytest
from npend_gym import NPendulumEnv, NPendulumVectorEnv
from npend_gym.envs import EnvConfig, Info, Sensors
from npend_gym.physics import mass_matrix

def both(lanes=LANES, **keywords):
    env, envs = NPendulumEnv(n=2, **keywords), NPendulumVectorEnv(lanes, n=2, **keywords)
    shown, vector = env.reset(seed=3), envs.reset(seed=3)
    for action in ([0.5], [-1.0]):
        stepped = env.step(np.array(action))
        many = envs.step(np.tile(action, (lanes, 1)))
        assert np.array_equal(many[0][0], stepped[0]) and many[1][0] == stepped[1]
        assert np.array_equal(many[4]["theta"][0], stepped[4]["theta"])
    assert shown[0] in env.observation_space and vector[0] in envs.observation_space
    return env, stepped, many

def tensors_like_arrays(lanes, **keywords):
    torch = pytest.importorskip("torch")
    from npend_gym.torch import DifferentiableVectorEnv

    envs, ours = (
        kind(lanes, n=2, **keywords) for kind in (NPendulumVectorEnv, DifferentiableVectorEnv)
    )
    assert np.allclose(ours.reset(seed=3)[0], envs.reset(seed=3)[0], atol=1e-6)
    theta, omega = (x.clone().requires_grad_() for x in ours.state)
    ours.state = theta, omega
    actions = np.full((lanes, 1), 0.5)
    shown, *_, info = ours.step(torch.from_numpy(actions))
    assert np.allclose(shown.detach(), envs.step(actions)[0], atol=1e-6)
    assert not np.allclose(shown[:, :2].detach(), info["theta"].detach(), atol=0.05)
    gradients = [torch.autograd.grad(x.sum(), (theta, omega), retain_graph=True)
                 for x in (shown[:, :2], info["theta"])]
    assert all(torch.equal(*pair) and pair[0].any() for pair in zip(*gradients))

# the keyword
env, (observation, *_, info), _ = both(angle_offset=0.25)
assert np.allclose(observation[:2], info["theta"] + 0.25, atol=1e-6)
assert np.allclose(observation[2:], info["omega"], atol=1e-6)
assert EnvConfig(n=2).angle_offset == 0.0
assert EnvConfig(n=2, sensors=Sensors(angle_offset=0.25)).angle_offset == 0.25
assert inspect.signature(NPendulumVectorEnv).parameters["angle_offset"].default == 0.0
assert "angle_offset : float\n        By how much the sensors show" in NPendulumEnv.__doc__
assert env.get_state()["members"]["angle_offset"] == 0.25
env, (*_, info), many = both(randomize={"angle_offset": {"low": 0.1, "high": 0.2}})
assert 0.1 < info["context"][0] == many[4]["context"][0, 0] < 0.2
for wrong in (-1.0, float("nan")):
    with pytest.raises(ValueError, match="angle_offset must be"):
        EnvConfig(angle_offset=wrong)
drawn = {"angle_offset": {"low": 0.1, "high": 0.2}}
for keywords in ({"angle_offset": 0.25}, {"randomize": drawn}) if LANES > 1 else ():
    tensors_like_arrays(LANES, **keywords)

# the key of the info
env, (*_, info), many = both()
expected = 0.5 * info["omega"] @ mass_matrix(env.config.chain, info["theta"]) @ info["omega"]
assert abs(info["kinetic_energy"] - expected) < 1e-9 and expected > 1e-3
assert many[4]["kinetic_energy"][0] == info["kinetic_energy"]
assert many[4]["_kinetic_energy"].all()
assert "Kinetic part of the energy [J]" in Info.__doc__

# the task
env, (_, reward, *_, info), many = both(mode="level")
tip = info["tip_height"] / 2.0
assert reward == 1.0 / (1.0 + 100.0 * tip * tip)
assert env._episodes._judge > 0
assert "Hold the tip level with the pivot." in NPendulumEnv.__doc__
assert both(mode="level", reward_type="sparse")[1][1] == float(abs(tip) < 0.1)
"""


UNREAD = """
import pytest
from npend_gym import NPendulumVectorEnv
from npend_gym.torch import DifferentiableVectorEnv

NPendulumVectorEnv(1, angle_offset=0.1)
DifferentiableVectorEnv(1, angle_offset=0.0)
drawn = {"angle_offset": {"low": 0.0, "high": 0.1}}
for keywords in ({"angle_offset": 0.1}, {"randomize": drawn}):
    with pytest.raises(ValueError, match="angle_offset must be left out .* of tensors"):
        DifferentiableVectorEnv(1, **keywords)
"""


def as_change(diff):
    """A block of CONTRIBUTING as a file and what is replaced there."""
    name, *lines = diff.strip("\n").split("\n")
    old, new = ("\n".join(x[1:] for x in lines if x[0] in kinds) + "\n" for kinds in (" -", " +"))
    return name, [(old, new)]


def run_changed(script, folder, *, compiled, leave_out=()):
    """Run a script with a copy of the package that has the changes of CONTRIBUTING."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```diff\n(.*?)```", text, re.DOTALL)
    assert len(blocks) == 6
    used = [block for block in blocks if not block.strip().startswith(leave_out)]
    environment = changed_copy(folder, map(as_change, used))
    environment["NUMBA_DISABLE_JIT"] = "0" if compiled else "1"
    run_python("-c", script, env=environment, cwd=folder)


@pytest.mark.long
@pytest.mark.parametrize("compiled", [False, True], ids=["Python", "compiled"])
def test_the_changes_that_contributing_describes_give_what_it_says(tmp_path, compiled):
    script = WALKED.replace("LANES", "20" if compiled else "1")  # packs need a compiler
    run_changed(script, tmp_path, compiled=compiled)


@pytest.mark.long
def test_an_environment_of_tensors_refuses_a_setting_that_no_law_reads(tmp_path):
    pytest.importorskip("torch")
    left_out = "npend_gym/envs/sensors.py"
    run_changed(UNREAD, tmp_path, compiled=False, leave_out=left_out)
