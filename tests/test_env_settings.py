"""Making an environment: its keywords, its tasks, its entry in Gymnasium's registry, its errors."""

import inspect
import pickle
import subprocess
import sys
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from npend_gym import Chain
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


@pytest.mark.parametrize(
    ("mode", "error", "message"),
    [
        ("nowhere:Patient", ValueError, "mode 'nowhere:Patient' cannot be imported"),
        (f"{__name__}:Impatient", ValueError, "cannot be imported: .*Impatient"),
        (f"{__name__}:NAMED", TypeError, "must name a class derived from npend_gym.envs.Mode"),
        (":Patient", ValueError, 'the name of a class, "package.module:Class"'),
        (
            Patient,
            ValueError,
            "mode must be one of passive, swingup, balance, calm, transition, an instance",
        ),
    ],
)
def test_a_task_that_cannot_be_found_is_refused_with_the_reason(mode, error, message):
    with pytest.raises(error, match=message):
        EnvConfig(mode=mode)


def test_a_task_without_failure_or_reward_of_its_own_may_return_plain_values():
    class Constant(Mode):
        def start(self, rng, n, amplitude, spread):  # noqa: ARG002
            return np.zeros(n), np.zeros(n)

        def reward(self, quantities):  # noqa: ARG002
            return 1

    env = gym.make_vec("NPendulum-v0", 3, mode=Constant())
    env.reset(seed=0)
    _, reward, terminated, _, info = env.step(np.zeros((3, 1)))
    assert (reward.dtype, terminated.dtype) == (np.float64, np.bool_)
    assert reward.tolist() == [1.0] * 3
    assert terminated.tolist() == [False] * 3
    assert info["success"].tolist() == [True] * 3


def test_the_registry_lists_the_environments_under_their_own_name():
    groups = gym.pprint_registry(disable_print=True).split("=====")
    listed = {
        name.strip(): ids.split() for name, ids in zip(groups[1::2], groups[2::2], strict=True)
    }
    assert listed["NPendulum"] == ["NPendulum-v0"]


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


def test_importing_the_package_and_its_settings_names_compiles_nothing():
    code = (
        "import sys, npend_gym, npend_gym.envs; dir(npend_gym.envs);"
        "print(sorted({'numba', 'scipy', 'matplotlib', 'torch'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


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
