import numpy as np
import pytest
from scipy.stats import mannwhitneyu

from npend_gym.rl import (
    bootstrap_interval,
    interquartile_mean,
    performance_profile,
    probability_of_improvement,
)


def test_the_interquartile_mean_leaves_out_the_best_and_the_worst_quarter():
    scores = np.array([[0.0, 1.0, 2.0, 3.0], [4.0, 5.0, 6.0, 1e9]])
    assert interquartile_mean(scores) == np.mean([2.0, 3.0, 4.0, 5.0])
    assert interquartile_mean(scores.T) == interquartile_mean(scores)


def test_the_interval_of_a_mean_is_that_of_the_central_limit_theorem():
    scores = np.random.default_rng(0).normal(3.0, 2.0, (400, 2))
    low, high = bootstrap_interval(scores, np.mean, resamples=4000)
    error = np.sqrt(scores.var(axis=0).sum() / 400.0) / 2.0  # of the mean of two tasks' means
    assert low == pytest.approx(scores.mean() - 1.96 * error, abs=0.08 * error)
    assert high == pytest.approx(scores.mean() + 1.96 * error, abs=0.08 * error)


@pytest.mark.long
def test_intervals_hold_the_truth_as_often_as_they_say():
    rng, held = np.random.default_rng(1), 0
    for k in range(200):
        scores = rng.uniform(0.0, 1.0, (30, 3))  # whose middle half has the mean 1/2
        low, high = bootstrap_interval(scores, np.mean, confidence=0.8, resamples=200, seed=k)
        held += low <= 0.5 <= high
    assert held / 200 == pytest.approx(0.8, abs=0.1)


def test_runs_are_drawn_within_their_task():
    scores = np.repeat([[0.0, 10.0]], 5, axis=0)  # runs of a task are alike
    assert bootstrap_interval(scores, np.mean) == (5.0, 5.0)


@pytest.mark.long
def test_the_same_seed_draws_the_same_interval_and_another_one_another():
    scores = np.random.default_rng(0).uniform(size=(5, 4))
    assert bootstrap_interval(scores, seed=1) == bootstrap_interval(scores, seed=1)
    assert bootstrap_interval(scores, seed=1) != bootstrap_interval(scores, seed=2)


def test_the_profile_is_the_share_of_runs_above_each_threshold():
    scores = [[0.0, 0.5], [0.5, 1.0]]
    found = performance_profile(scores, [-1.0, 0.0, 0.4, 0.5, 1.0])
    np.testing.assert_array_equal(found, [1.0, 0.75, 0.75, 0.25, 0.0])


@pytest.mark.parametrize("scores", [[1.0, 2.0], [[]], np.zeros((2, 2, 2)), [[np.nan]], 3.0])
def test_scores_of_another_shape_or_not_finite_are_refused_by_name(scores):
    for function in (interquartile_mean, bootstrap_interval):
        with pytest.raises(ValueError, match="scores must"):
            function(scores)
    with pytest.raises(ValueError, match="scores must"):
        performance_profile(scores, [0.5])


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"confidence": 1.0}, "confidence must be between 0 and 1"),
        ({"confidence": -1.0}, "confidence must be"),
        ({"resamples": 0}, "resamples must be"),
        ({"seed": -1}, "seed must be"),
    ],
)
def test_arguments_of_the_interval_are_refused_by_name(keywords, message):
    with pytest.raises(ValueError, match=message):
        bootstrap_interval([[1.0, 2.0]], **keywords)


def test_the_probability_of_improvement_is_the_mean_of_mann_whitneys_u_over_the_tasks():
    rng = np.random.default_rng(2)
    scores, others = rng.integers(0, 5, (9, 3)) / 4.0, rng.integers(0, 5, (6, 3)) / 4.0  # with ties
    tests = [mannwhitneyu(own, their) for own, their in zip(scores.T, others.T, strict=True)]
    expected = np.mean([each.statistic / 54.0 for each in tests])
    found = probability_of_improvement(scores, others)
    assert found == pytest.approx(expected, rel=1e-12)
    assert probability_of_improvement(others, scores) == pytest.approx(1.0 - found, rel=1e-12)
    low, high = bootstrap_interval(scores, probability_of_improvement, others=others, resamples=200)
    assert low < found < high
    with pytest.raises(ValueError, match="others must have the 3 tasks of scores, got 2"):
        probability_of_improvement(scores, others[:, :2])


@pytest.mark.parametrize("thresholds", [0.5, [[0.5], [0.9]]])
def test_thresholds_of_another_shape_are_refused(thresholds):
    with pytest.raises(ValueError, match=r"thresholds must have the shape \(k,\), got"):
        performance_profile([[1.0], [2.0]], thresholds)


def test_a_statistic_that_is_no_number_is_refused():
    with pytest.raises(ValueError, match="what statistic returns must be finite, got nan"):
        bootstrap_interval([[1.0], [2.0]], lambda scores: np.nan * scores.sum())


def test_rliable_finds_the_same():
    metrics = pytest.importorskip("rliable.metrics")
    scores = np.random.default_rng(0).uniform(size=(7, 5))
    expected = metrics.aggregate_iqm(scores)
    assert interquartile_mean(scores) == pytest.approx(expected, rel=1e-12)
