"""Imitation of plans: who acts when, and what the student learns from."""

import numpy as np
import pytest

from npend_gym.rl import evaluate
from npend_gym.rl.controllers.planning import Tracking, planned_swing_up
from npend_gym.rl.evaluation.settings import setting_of

pytestmark = pytest.mark.long  # plans take seconds

torch = pytest.importorskip("torch")

from npend_gym.rl.training import imitation  # noqa: E402
from npend_gym.rl.training.dataset import Dataset  # noqa: E402


@pytest.fixture(scope="module")
def dagger():
    settings = imitation.settings_of("swingup-1", seconds=3.0, num_envs=64, hidden=8)
    torch.manual_seed(0)
    envs = setting_of(settings.env).make(64, max_episode_steps=None)
    expert = planned_swing_up(envs.unwrapped.config, 3.0, tries=2)
    return imitation.DAgger(settings, envs, expert)


def tracking(rows):
    actions = np.linspace(-2.0, 2.0, rows)[:, None]
    return Tracking(actions, np.zeros((rows, 4)), np.zeros(rows), np.full((rows, 1), 4.0))


def test_the_expert_takes_over_from_a_student_that_knows_nothing_but_not_everywhere(dagger):
    assert dagger.play(0) == {}
    score = dagger.play(1)
    assert score["success"] == 0.0  # where the student is alone
    assert 0.1 < score["taken_over"] < 1.0


def test_the_expert_does_not_take_over_from_a_student_that_does_as_it_would(dagger, monkeypatch):
    def as_expert(info):
        told = expert_tracking(info)
        monkeypatch.setattr(dagger, "act", lambda _: told.actions)
        return told

    expert_tracking = dagger.expert.tracking
    with monkeypatch.context() as patch:
        patch.setattr(imitation.PlannedTransition, "tracking", lambda _, info: as_expert(info))
        score = dagger.play(2)
    assert score["success"] == 1.0
    assert score["taken_over"] < 0.2  # starts that are farther away than others


def test_a_fit_comes_nearer_to_the_actions_of_the_expert(dagger):
    dagger.fit(20)
    before = dagger.fit.distance
    dagger.fit(200)
    assert dagger.fit.distance < 0.7 * before


def test_a_full_dataset_takes_new_states_in_place_of_old_ones():
    dataset, rng = Dataset(10, inputs=3, joints=1), np.random.default_rng(0)
    shown = np.arange(24.0, dtype=np.float32).reshape(8, 3)
    chosen = np.array([True, False] * 4)
    for size in (4, 8, 8, 8):
        dataset.add(shown, tracking(8), chosen, rng)
        assert dataset.size == size
    for row in range(dataset.size):
        k = int(dataset.observations[row, 0]) // 3
        assert chosen[k]
        assert dataset.actions[row, 0] == pytest.approx(
            np.clip(tracking(8).actions[k, 0], -1.5, 1.5)
        )
        assert dataset.weights[row, 0] == 2.0


@pytest.mark.parametrize(
    "env",
    [{"mode": "balance", "n": 2}, {"mode": "calm", "n": 2}, {"mode": "balance", "base": "cart"}],
    ids=lambda env: " ".join(map(str, env.values())),
)
def test_a_student_learns_from_a_regulator_where_no_plan_is_needed(env):
    env = env | {"observation": "sincos"}
    settings = imitation.Settings(env=env, rounds=3, num_envs=64, seconds=4.0, standing=100)
    policy, curve = imitation.train(settings)
    assert curve[-1]["success"] == 1.0
    assert evaluate(policy, env, episodes=20).success_rate == 1.0
