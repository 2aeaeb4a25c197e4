"""Tasks whose chains MuJoCo moves, compared with the package's own dynamics."""

import copy
import json
import math
import sys

import gymnasium as gym
import numpy as np
import pytest

from npend_gym import Cart, Chain, NPendulumVectorEnv, rl
from npend_gym.cli import main
from npend_gym.envs import ResetNeeded, SwingUp
from npend_gym.export import in_mujoco

pytest.importorskip("mujoco", reason="MuJoCo is not installed")

LINKS = Chain(
    [1.0, 0.7], [0.8, 0.5], damping=0.02, centres=[0.5, 0.2], inertias=[0.02, 0.01], armature=0.01
)
ENVS = {
    "one rod": {"n": 1},
    "two rods": {"n": 2, "actuated": (1, 0)},
    "standing": {"n": 3, "mode": "balance"},
    "links": {"chain": LINKS, "torque_levels": 3},
    "a cart": {"chain": Chain.from_dict(LINKS.as_dict() | {"base": Cart(1.0, 0.2)})},
    "dm_control": {"chain": "dm_control cartpole 2", "rail": 30.0, "max_force": 10.0},
    "goals": {"n": 2, "mode": "transition", "reward_type": "sparse", "goal_env": True},
    "no motor": {"n": 2, "mode": "passive"},
    "a motor without torque": {"n": 2, "max_torque": 0.0},
    "judged by Python": {"n": 2, "mode": type("Mine", (SwingUp,), {})()},
}


def pair(num_envs, **keywords):
    """Return environments of our dynamics and of MuJoCo's, reset with the same seed."""
    envs = NPendulumVectorEnv(num_envs, **keywords), in_mujoco(keywords, num_envs)
    for each in envs:
        each.reset(seed=5)
        each.action_space.seed(0)
    return envs


@pytest.mark.parametrize(
    ("name", "substeps", "within"),
    [
        *(
            pytest.param(name, 100, 1e-8, marks=[pytest.mark.long] * (name in ("links", "a cart")))
            for name in ENVS
        ),
        ("two rods", None, 2e-5),
    ],
)
def test_motions_agree_over_the_first_second_and_are_judged_alike(name, substeps, within):
    own, other = pair(3, substeps=substeps, **ENVS[name])  # by default, ours err by 1e-6 themselves
    np.testing.assert_array_equal(other.unwrapped.state, own.state)
    for _ in range(math.ceil(1.0 / own.config.dt)):
        action = own.action_space.sample()
        (*expected, about), (*found, shown) = own.step(action), other.step(action)
        assert type(found[0]) is type(expected[0])
        for mine, of_mujoco in zip(expected[1:], found[1:], strict=True):
            np.testing.assert_allclose(of_mujoco, mine, rtol=0.0, atol=within)
        for key in ("theta", "omega", "time", "tip_height", "success", "torque", "cart_position"):
            if key in about:
                np.testing.assert_allclose(shown[key], about[key], rtol=0.0, atol=within)
    away = abs(own.state - other.unwrapped.state).max()
    print(f"{name}: {away:.1e}")
    assert away < within
    assert np.any(own.state != other.unwrapped.state)


def test_episodes_end_and_begin_as_in_our_dynamics():
    own, other = pair(3, n=2, mode="balance", max_episode_steps=50)
    ends = 0
    for _ in range(120):
        _, _, *mine, about = own.step(np.ones((3, 1)))
        _, _, *found, shown = other.step(np.ones((3, 1)))
        np.testing.assert_array_equal(found, mine)
        np.testing.assert_array_equal(shown["time"], about["time"])
        ends += np.count_nonzero(mine)
    assert ends >= 6


def test_no_lane_depends_on_another_and_a_state_goes_on():
    # MuJoCo's friction is found by iteration
    chain = Chain(1.0, [1.0, 1.0], friction=0.1, centres=0.5, inertias=0.1, base=Cart(1.0))
    many, one = in_mujoco({"chain": chain}, 3).unwrapped, in_mujoco({"chain": chain}).unwrapped
    many.reset(seed=0), one.reset(seed=2)
    action = np.array([[0.3], [-0.2], [0.9]])
    for _ in range(20):
        many.step(action), one.step(action[2:])
    np.testing.assert_array_equal(many.state[2:], one.state)
    kept, copied = many.get_state(), copy.deepcopy(many)
    expected = many.step(action)[0]
    np.testing.assert_array_equal(copied.step(action)[0], expected)
    many.set_state(kept)
    np.testing.assert_array_equal(many.step(action)[0], expected)


@pytest.mark.long
@pytest.mark.parametrize("options", [{"friction": 0.2}, {"armature": 0.02}, {"masses": 2.0}])
def test_a_state_of_another_chain_than_that_of_the_model_is_refused(options):
    chain = Chain(1.0, [1.0, 1.0], friction=0.1, armature=0.01, centres=0.5, inertias=0.1)
    own, engine = NPendulumVectorEnv(2, chain=chain), in_mujoco({"chain": chain}, 2).unwrapped
    engine.reset(seed=0), own.reset(seed=0)
    engine.set_state(own.get_state())
    own.reset(seed=0, options=options)
    with pytest.raises(ValueError, match="state must be one of the chain as made"):
        engine.set_state(own.get_state())


def test_a_motion_beyond_all_bounds_ends_the_episode():
    envs = in_mujoco({"n": 1, "max_torque": 1e9, "dt": 1.0}, 2).unwrapped
    envs.reset(seed=0)
    before = envs.state
    _, _, _, truncated, info = envs.step([[1.0], [0.0]])
    assert truncated.tolist() == info["diverged"].tolist() == [True, False]
    np.testing.assert_array_equal(envs.state[0], before[0])
    assert info["time"].tolist() == [0.0, 1.0]
    assert not envs.step([[0.0], [0.0]])[-1]["diverged"].any()


def test_an_interrupted_step_is_followed_by_new_episodes_in_mujoco(monkeypatch):
    own, other = pair(2, n=2)
    with monkeypatch.context() as patch:

        def interrupt(*_):
            raise KeyboardInterrupt

        patch.setattr(type(other.unwrapped._episodes), "_moved", interrupt)
        with pytest.raises(KeyboardInterrupt):
            other.step(np.zeros((2, 1)))
    with pytest.raises(ResetNeeded):
        other.step(np.zeros((2, 1)))
    own.reset(seed=1), other.reset(seed=1)
    own.step(np.ones((2, 1))), other.step(np.ones((2, 1)))
    assert 0.0 < abs(own.state - other.unwrapped.state).max() < 1e-6


def test_without_mujoco_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ImportError, match=r"^motions in MuJoCo need mujoco: .*\[mujoco\]"):
        in_mujoco({"n": 1})


def test_other_dynamics_would_be_noticed():
    """Rewards and success are those of MuJoCo's motion: one under an upward gravity is seen."""
    policy = rl.Policy.pretrained("balance-2")
    envs = in_mujoco(policy.env, 4)
    envs.unwrapped._episodes._model.opt.gravity[2] = 9.81
    envs.reset(seed=0)
    rewards = [envs.step(np.zeros((4, 1)))[1] for _ in range(100)]
    assert np.all(np.array(rewards) > 0.9)  # what stands is stable there


@pytest.mark.long
@pytest.mark.parametrize(
    "name",
    [
        "balance-2",
        pytest.param("swingup-1", marks=pytest.mark.nightly),
        pytest.param("swingup-2", marks=pytest.mark.nightly),
        pytest.param("swingup-3", marks=pytest.mark.nightly),
    ],
)
def test_a_policy_succeeds_as_often_in_mujoco(name):
    policy = rl.Policy.pretrained(name)
    own = rl.evaluate(policy, policy.env, episodes=30)
    found = rl.evaluate(policy, in_mujoco(policy.env), episodes=30)
    assert found.success_rate >= own.success_rate - 0.02 > 0.9
    np.testing.assert_allclose(found.returns, own.returns, rtol=1e-3)


def test_the_task_may_be_named_by_its_id_and_scores_are_measured_there_too():
    envs = in_mujoco("npend/Balance-v1", 2)
    assert envs.unwrapped.config.mode.name == "balance"
    assert envs.unwrapped.config.observation == "scaled"
    setting = rl.evaluation.settings.setting_of(envs)
    assert type(setting.make(1, actuated=(0, 1)).unwrapped) is type(envs.unwrapped)


def test_episodes_of_an_id_are_as_long_in_mujoco(monkeypatch):
    monkeypatch.setattr(gym.envs.registration, "registry", dict(gym.registry))
    kind = "npend_gym.envs:NPendulumVectorEnv"
    gym.register("my/Short-v0", vector_entry_point=kind, max_episode_steps=3, kwargs={"n": 1})
    envs = in_mujoco({"id": "my/Short-v0", "mode": "swingup"})
    envs.reset(seed=0)
    truncated = [bool(envs.step(np.zeros((1, 1), np.float32))[3][0]) for _ in range(3)]
    assert truncated == [False, False, True]


def test_what_mujoco_does_not_play_is_refused_by_its_name():
    for name, value in {
        "angle_noise": 0.1, "observation_delay": 1.0, "action_delay": 1.0, "motor_lag": 0.1,
        "torque_ripple": 0.1, "randomize": {"masses": (0.9, 1.1)}, "drag": 0.1,
    }.items():  # fmt: skip
        with pytest.raises(ValueError, match=f"^{name} must be left out"):
            in_mujoco({"n": 2, name: value})
    with pytest.raises(ValueError, match=r"^push_(rate|force) must be left out"):
        in_mujoco({"n": 2, "push_rate": 0.1, "push_force": 1.0})
    envs = in_mujoco({"n": 2})
    with pytest.raises(ValueError, match=r"^options\['masses'\] must be left out"):
        envs.reset(options={"masses": 2.0})
    own = NPendulumVectorEnv(1, n=2)
    for options in ({"masses": 2.0}, {"gravity": 1.0}):
        own.reset(options=options)
        with pytest.raises(ValueError, match=r"^state must be one of the chain as made"):
            envs.unwrapped.set_state(own.get_state())
    own.reset(options={"theta": 1.0, "omega": 0.0})
    envs.unwrapped.set_state(own.get_state())
    assert envs.unwrapped.state.tolist() == [[1.0, 1.0, 0.0, 0.0]]
    with pytest.raises(TypeError, match=r"^state must come from get_state"):
        envs.unwrapped.set_state(own.state)
    stacked = gym.wrappers.vector.RescaleObservation(
        NPendulumVectorEnv(2, n=1), np.float32(-1.0), np.float32(1.0)
    )
    with pytest.raises(ValueError, match=r"^env must be without wrappers, got RescaleObservation"):
        in_mujoco(stacked)


@pytest.mark.long
def test_the_command_evaluates_in_mujoco(capsys, refusal):
    options = ["evaluate", "balance-2", "--episodes", "2", "--engine", "mujoco"]
    assert main([*options, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    policy = rl.Policy.pretrained("balance-2")
    expected = rl.evaluate(policy, in_mujoco(policy.env), episodes=2)
    assert found["evaluation"] == expected.as_row()
    assert "mujoco" in json.dumps(found["provenance"])
    assert "--robust must be left out with --engine mujoco" in refusal(*options, "--robust")
    assert "motor_lag must be left out" in refusal(*options, "--env", "motor_lag=0.1")
