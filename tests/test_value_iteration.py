"""Value iteration for the acrobot of dm_control: its futures, its networks, its record."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from engines import dm_control_model

from npend_gym import Chain, simulate
from npend_gym.rl import Policy

pytest.importorskip("torch")
import value_iteration as script

SMALL = script.Settings(updates=4, batch=8, lanes=8, memory=64, hidden=8)
STATES = np.array([[1.0, 2.0, 3.0, -4.0], [3.1, 3.3, -0.2, 0.4], [0.0, 0.0, 0.0, 0.0]])
TORQUE = script.ENV["max_torque"]
EXAMPLES = Path(script.__file__).parent


def test_rewards_are_those_of_dm_control():
    rewards = pytest.importorskip("dm_control.utils.rewards")
    theta = np.random.default_rng(0).uniform(-10.0, 10.0, (50, 2))
    theta[:10] = np.pi + theta[:10] / 50.0  # near the target
    tip = np.sin(theta).sum(axis=1), 2.0 + np.cos(theta).sum(axis=1)
    expected = rewards.tolerance(np.hypot(*tip), bounds=(0.0, 0.2), margin=1.0)
    np.testing.assert_allclose(script.reward(theta, np.ones(2)), expected, rtol=1e-12)
    assert (expected == 1.0).any()
    assert (expected < 0.01).any()


def test_an_action_moves_the_acrobot_as_dm_control_does():
    mujoco, model = pytest.importorskip("mujoco"), dm_control_model()
    futures, actions = script.Futures(script.Settings()), np.array([0.7, -1.0, 0.3])
    ends, _ = futures.step(STATES, actions)
    for state, action, end in zip(STATES, actions, ends, strict=True):
        data = mujoco.MjData(model)
        data.qpos = np.diff(np.pi - state[:2], prepend=0.0)
        data.qvel = np.diff(-state[2:], prepend=0.0)
        data.ctrl = -action  # as `judge` gives it
        for _ in range(10):
            mujoco.mj_step(model, data)
        found = np.hstack([np.pi - data.qpos.cumsum(), -data.qvel.cumsum()])
        np.testing.assert_allclose(end, found, rtol=0, atol=2e-4)  # steps of 0.02 s and 0.01 s


def test_looking_ahead_adds_the_discounted_value_at_the_end_to_the_rewards():
    futures = script.Futures(script.Settings())
    found = futures.look_ahead(STATES, lambda ends: ends[:, 0] / 10.0)
    chain, times = Chain.dm_control("acrobot"), np.linspace(0.0, 0.1, 6)
    discount = np.exp(-0.1 / 4.0)
    for state, sums in zip(STATES, found, strict=True):
        for action, total in zip(script.LEVELS, sums, strict=True):
            path = simulate(chain, state[:2], state[2:], times, torque=[0.0, TORQUE * action])
            mean = script.reward(path.theta[1:], chain.lengths).mean()
            expected = (1.0 - discount) * mean + discount * path.theta[-1, 0] / 10.0
            assert total == pytest.approx(expected, abs=1e-4)


def test_sums_are_interpolated_between_the_actions_that_were_tried():
    sums, actions = np.random.default_rng(0).normal(size=(7, 5)), np.linspace(-1.0, 1.0, 7)
    actions[2] = -0.3  # one that was tried
    found = script.interpolated(script.torch.from_numpy(actions).float(), sums)
    expected = [np.interp(a, script.LEVELS, each) for a, each in zip(actions, sums, strict=True)]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)


def test_the_policy_is_the_mean_of_the_networks_over_the_last_updates():
    policy, curve = script.train(SMALL)
    learner = script.Learner(SMALL)
    for update in range(4):
        learner.update(1.0 - update / 4)
    actions = policy.act(STATES[:, :2], STATES[:, 2:])[:, 0]
    np.testing.assert_allclose(actions, learner.act(STATES), atol=1e-6)
    returns = script.returns_of(learner.act, learner.futures, 100, 0)
    assert curve[-1]["return"] == round(float(returns.mean()), 1)
    assert policy.provenance["trained_by"] == script.SCRIPT


@pytest.mark.parametrize("name", ["acrobot", "learned_model"])
def test_a_policy_that_comes_with_the_examples_returns_what_its_record_says(name):
    policy = Policy.load(EXAMPLES / f"{name}.safetensors")
    futures = script.Futures(script.Settings())
    acts = lambda states: policy.act(states[:, :2], states[:, 2:])[:, 0]  # noqa: E731
    known = policy.provenance["training"]["return"]
    assert script.returns_of(acts, futures, 100, 0).mean() == pytest.approx(known, abs=20.0)
    assert script.returns_of(acts, futures, 200, 9).mean() > 640.0  # other starts


def test_the_command_writes_a_policy_that_acts(tmp_path, monkeypatch, capsys):
    out = tmp_path / "new" / "acrobot.safetensors"
    train, small = script.train, replace(SMALL, updates=2)
    given = lambda chosen, _, kind: train(replace(small, seed=chosen.seed), kind=kind)  # noqa: E731
    monkeypatch.setattr(script, "train", given)
    monkeypatch.setattr("sys.argv", ["value_iteration.py", "--updates", "2", "--out", str(out)])
    script.main()
    assert Policy.load(out).act([3.0, 3.1], [0.0, 0.0]).shape == (1,)
    assert "'updates': 2" in capsys.readouterr().out
    assert out.with_suffix(".csv").read_text().count("\n") == 2
