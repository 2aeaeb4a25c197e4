"""The acrobot of dm_control as an environment of this package, beside dm_control's own code."""

import json

import dm_acrobot
import gymnasium as gym
import numpy as np
import pytest

from npend_gym.envs import SwingUp

ENV_ID = "npend/DMAcrobot-v1"
# From an observation of ours to theirs, whose angles count from upright, clockwise
THEIRS = np.array([
    [1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0], [0, 0, -1, 0, 0, 0], [0, 0, 0, -1, 0, 0],
    [0, 0, 0, 0, -1, 0], [0, 0, 0, 0, 1, -1],
])  # fmt: skip


def load(seed=0):
    """Return dm_control's environment; dm_control 1.0.50 has none with MuJoCo 4."""
    pytest.importorskip("dm_control")
    try:
        return dm_acrobot.load(seed=seed)
    except (AttributeError, RuntimeError, TypeError, ValueError) as error:  # of another MuJoCo
        pytest.skip(f"dm_control loads no task: {error!r}")


def check(steps):
    """Take the steps here too, and compare all that follows."""
    qpos, qvel = np.array(steps["qpos"]), np.array(steps["qvel"])
    options = {"theta": np.pi - qpos.cumsum(axis=1), "omega": -qvel.cumsum(axis=1)}
    for name in ("dense", "sparse"):
        envs = gym.make_vec(ENV_ID, num_envs=len(qpos), reward_type=name)
        envs.reset(seed=0, options=options)
        observation, reward, terminated, _, info = envs.step(-np.array(steps["action"]))
        np.testing.assert_allclose(reward, steps[name], rtol=0, atol=1e-12)
        assert not terminated.any()
        expected = np.hstack([steps["orientations"], steps["velocity"]])
        np.testing.assert_allclose(observation @ THEIRS.T, expected, rtol=0, atol=4e-6)
        exact = np.hstack([np.sin(info["theta"]), np.cos(info["theta"]), info["omega"]])
        np.testing.assert_allclose(exact @ THEIRS.T, expected, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(info["success"], np.array(steps["sparse"]) == 1.0)


def test_steps_rewards_and_observations_are_those_that_dm_control_has_computed():
    steps = json.loads(dm_acrobot.FILE.read_text(encoding="utf-8"))
    assert steps["dm_control"] == "1.0.50"
    assert 0 < sum(steps["sparse"]) < len(steps["sparse"])
    check(steps)


@pytest.mark.long
def test_a_thousand_episodes_of_dm_control_have_the_same_steps_here():
    load()
    check(dm_acrobot.steps_of(1000))


def test_motions_are_those_of_dm_control_until_rounding_has_grown():
    load()
    for seed in range(3):
        start, actions, states = dm_acrobot.motion_of(seed)
        env = gym.make(ENV_ID)
        env.reset(seed=0, options={"theta": np.pi - start.cumsum(), "omega": 0.0})
        for action, state in zip(actions[:200], states[:200], strict=True):
            *_, info = env.step(-action)
            np.testing.assert_allclose(np.pi - state.cumsum(), info["theta"], rtol=0, atol=1e-8)


def test_episodes_start_at_rest_with_both_joints_at_any_angle():
    envs = gym.make_vec(ENV_ID, num_envs=4000)
    _, info = envs.reset(seed=0)
    assert not info["omega"].any()
    elbow = np.mod(np.diff(info["theta"], axis=1)[:, 0], 2.0 * np.pi)
    shoulder = np.mod(info["theta"][:, 0], 2.0 * np.pi)
    for angle in (elbow, shoulder):  # each octant has an eighth of them, 500 +- 21
        assert (abs(np.histogram(angle, 8, (0.0, 2.0 * np.pi))[0] - 500) < 100).all()
    assert abs(np.corrcoef(np.cos(elbow), np.cos(shoulder))[0, 1]) < 0.06


def test_an_episode_has_a_thousand_steps_of_ten_milliseconds():
    env = gym.make(ENV_ID)
    _, info = env.reset(seed=0)
    truncated, steps = False, 0
    while not truncated:
        *_, terminated, truncated, info = env.step(np.ones(1))
        steps += 1
        assert not terminated
    assert (steps, info["time"]) == (1000, pytest.approx(10.0))


@pytest.mark.long
def test_tensors_have_the_same_rewards_and_their_gradient():
    torch = pytest.importorskip("torch")
    from npend_gym.torch import DifferentiableVectorEnv

    spec, plain = gym.spec(ENV_ID).kwargs, gym.make_vec(ENV_ID, num_envs=5)
    env = DifferentiableVectorEnv(5, **spec)
    for each in (env, plain):
        each.reset(seed=3)
    action = torch.full((5, 1), 0.4, dtype=torch.float64, requires_grad=True)
    reward = env.step(action)[1]
    np.testing.assert_allclose(reward.detach(), plain.step(action.detach().numpy())[1], atol=1e-14)
    reward.sum().backward()
    moved, total = 1e-4, []
    for sign in (1.0, -1.0):
        plain.reset(seed=3)
        total.append(plain.step(np.full((5, 1), 0.4 + sign * moved))[1])
    slopes = (total[0] - total[1]) / (2.0 * moved)
    np.testing.assert_allclose(action.grad[:, 0], slopes, rtol=1e-4, atol=1e-9)


class Judged(SwingUp):
    """Rewards the quantities that the tasks of other packages need."""

    rail_weight = 0.0

    def reward(self, quantities):
        return quantities.tip_distance + 10.0 * quantities.cart_velocity


@pytest.mark.parametrize("base", ["pivot", "cart"])
@pytest.mark.parametrize("kind", ["points", pytest.param("links", marks=pytest.mark.long)])
def test_the_distance_of_the_tip_and_the_velocity_of_a_cart_are_those_of_any_chain(base, kind):
    lengths = np.array([1.0, 0.4, 0.7])
    links = {"inertias": 0.1, "centres": 0.5 * lengths, "armature": 0.01} if kind == "links" else {}
    keywords = {"lengths": lengths, "randomize": {"lengths": [0.8, 1.2]}, "base": base, **links}
    envs = gym.make_vec("NPendulum-v0", num_envs=20, mode=Judged(), spread=2.0, **keywords)
    _, info = envs.reset(seed=0)
    drawn = info["context"]
    for _ in range(3):
        _, reward, *_, info = envs.step(envs.action_space.sample())
        tip = np.exp(1j * info["theta"])
        away = abs((drawn * tip).sum(axis=1) + drawn.sum(axis=1)) / drawn.sum(axis=1)
        velocity = info["cart_velocity"] if base == "cart" else 0.0
        np.testing.assert_allclose(reward, away + 10.0 * velocity, rtol=1e-12)
