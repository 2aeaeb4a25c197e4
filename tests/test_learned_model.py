"""The learned model of the acrobot: what is recorded, what is fitted, what it foresees."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch")
import learned_model as script
import torch

pytestmark = pytest.mark.long  # derivatives of its links take long to compile
SMALL = script.Settings(
    updates=6, batch=8, lanes=8, memory=64, hidden=8, episodes=4, rounds=2, fits=2,
    model_hidden=8, model_batch=16,
)  # fmt: skip
STATES = np.array([[1.0, 2.0, 3.0, -4.0], [3.1, 3.3, -0.2, 0.4], [0.0, 0.0, 0.0, 0.0]])
ACTIONS = np.array([0.7, -1.0, 0.3])


def recorded():
    """Return a learner, and what it records of an action in three states."""
    learner = script.Learner(SMALL)
    ends = learner.record(STATES, ACTIONS)
    return learner, ends, [torch.stack(each).numpy() for each in learner.recorded]


def test_an_action_is_recorded_as_the_exact_simulation_moves():
    _, ends, (given, changes, _) = recorded()
    expected, _ = script.exact.Futures(SMALL).step(STATES, ACTIONS)
    np.testing.assert_allclose(ends, expected, rtol=0, atol=2e-4)  # steps of 0.02 s and 0.01 s
    assert given.shape == (6, 3, 5)  # from 0, 0.01, ... 0.05 s
    np.testing.assert_allclose(given[0], np.column_stack([STATES, ACTIONS]), atol=1e-6)
    np.testing.assert_allclose(given[5, :, :4] + changes[5], ends, atol=1e-5)
    np.testing.assert_allclose(given[0, :, :4] + changes[0], given[5, :, :4], atol=1e-5)


@pytest.mark.parametrize("entry", range(5))
def test_derivatives_of_recorded_steps_are_differences_of_their_ends(entry):
    _, _, (_, _, derivatives) = recorded()
    ends, step = [], 1e-6
    for sign in (-1.0, 1.0):
        moved = np.column_stack([STATES, ACTIONS])
        moved[:, entry] += sign * step
        ends.append(script.Learner(SMALL).record(moved[:, :4], moved[:, 4]))
    through = np.concatenate([derivatives[[0, 5]], np.zeros((2, 3, 1, 5))], axis=2) + np.eye(5)
    found = (through[1] @ through[0])[:, :4, entry]  # of the whole action
    expected = (ends[1] - ends[0]) / (2.0 * step)
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-5)


def test_angles_between_the_ends_of_a_step_are_those_of_the_cubic_through_both():
    span, times = script.SPAN * script.TICK, np.array([0.0, 0.4, 1.0])
    place = np.polynomial.Polynomial([0.3, -2.0, 5.0, 70.0])
    theta, omega = place(times * span), place.deriv()(times * span)
    start, _, end = (np.array([[t, -t, w, -w]]) for t, w in zip(theta, omega, strict=True))
    found = script.between(start, end, 0.4)
    np.testing.assert_allclose(found, [[theta[1], -theta[1]]], rtol=0, atol=1e-14)


def test_a_fitted_model_foresees_states_and_rewards_that_it_has_not_seen(monkeypatch):
    monkeypatch.setattr(script.exact, "EPISODE", 2.0)
    settings = replace(
        SMALL, episodes=50, model_hidden=32, model_batch=128, model_learning_rate=0.01
    )
    torch.manual_seed(0)
    learner, rng = script.Learner(settings), np.random.default_rng(7)
    states = script.exact.starts(rng, 100) + rng.normal(size=(100, 4)) * [0.0, 0.0, 1.0, 1.0]
    actions = rng.uniform(-1.0, 1.0, 100)
    ends, rewards = script.exact.Futures(settings).step(states, actions)
    errors = []
    for updates in (1, 400):
        learner.play(at_random=True)
        learner.fit(updates, 1.0)
        found, foreseen = learner.futures.step(states, actions)
        errors.append([np.abs(found - ends).mean(), np.abs(foreseen - rewards).mean()])
    before, after = np.array(errors)
    assert (after < 0.3 * before).all()


def test_a_run_plays_its_rounds_where_they_are_due_and_counts_no_more_steps(monkeypatch):
    monkeypatch.setattr(script.exact, "EPISODE", 1.0)
    policy, curve = script.train(SMALL)
    learner = script.Learner(SMALL)
    for update in range(6):
        learner.update(1.0 - update / 6)
    assert learner.due == {0, 4}
    windows = 2 * 10 * 6  # rounds at 0 and 4 updates, actions in an episode, windows in each
    assert [len(each) for each in learner.recorded] == [windows] * 3
    assert policy.act(STATES[:, :2], STATES[:, 2:])[:, 0] == pytest.approx(
        learner.act(STATES), abs=1e-6
    )
    assert (curve[-1]["updates"], policy.provenance["trained_by"]) == (6, script.Learner.script)
