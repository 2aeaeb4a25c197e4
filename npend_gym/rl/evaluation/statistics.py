"""How sure a comparison of algorithms is that rests on a few runs of each.

The definitions are those of R. Agarwal, M. Schwarzer, P. S. Castro, A. Courville, M. G. Bellemare,
"Deep Reinforcement Learning at the Edge of the Statistical Precipice", NeurIPS 2021, which the
library rliable computes too. Scores stand in arrays of shape (runs, tasks), and are comparable
between tasks: success rates, say.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from npend_gym import _checks
from npend_gym._checks import FloatArray

_MAX_RESAMPLES = 1_000_000


def interquartile_mean(scores: ArrayLike) -> float:
    """Return the mean of the middle half of all scores, of all tasks together.

    It is less moved by a single run than the mean, and less blind to the others than the median.

    Parameters
    ----------
    scores : array_like, shape (runs, tasks)

    Raises
    ------
    ValueError
        If the scores are not finite, or of another shape.

    Examples
    --------
    >>> from npend_gym import rl
    >>> rl.interquartile_mean([[0.0], [0.9], [1.0], [1.0]])
    0.95
    """
    from scipy.stats import trim_mean  # takes long to import

    return float(trim_mean(_scores(scores), 0.25, axis=None))


def bootstrap_interval(
    scores: ArrayLike,
    statistic: Callable[..., float] = interquartile_mean,
    *,
    others: ArrayLike | None = None,
    confidence: float = 0.95,
    resamples: int = 2000,
    seed: int = 0,
) -> tuple[float, float]:
    """Return a confidence interval of a statistic by stratified bootstrap.

    Runs are resampled, with replacement, within each task; the interval has the percentiles of the
    statistic of what was drawn.

    Parameters
    ----------
    scores : array_like, shape (runs, tasks)
    statistic : callable
        Of an array of scores, returns a number; with `others`, of two.
    others : array_like, shape (other runs, tasks), optional
        Scores of another algorithm, which are resampled too.
    confidence : float
        Between 0 and 1.
    resamples : int
    seed : int
        Of the draws.

    Returns
    -------
    low, high : float

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule.

    Examples
    --------
    >>> from npend_gym import rl
    >>> low, high = rl.bootstrap_interval([[0.7], [0.8], [0.9], [1.0]])
    >>> bool(0.7 <= low < high <= 1.0)
    True
    """
    given = [_scores(scores)] + ([] if others is None else [_scores(others)])
    share = _checks.positive_number("confidence", confidence)
    if share >= 1.0:
        raise ValueError(f"confidence must be between 0 and 1, got {_checks.show(confidence)}")
    count = _checks.count("resamples", resamples, high=_MAX_RESAMPLES)
    rng = np.random.default_rng(_checks.count("seed", seed, low=0))
    found: list[float] = []
    for _ in range(count):
        drawn = [
            np.take_along_axis(each, rng.integers(len(each), size=each.shape), axis=0)
            for each in given
        ]
        value = float(statistic(*drawn))
        found.append(_checks.number("what statistic returns", value))
    low, high = np.quantile(found, [0.5 - 0.5 * share, 0.5 + 0.5 * share])
    return float(low), float(high)


def probability_of_improvement(scores: ArrayLike, others: ArrayLike) -> float:
    """Return how likely a run scores more than a run of another algorithm, as a mean over tasks.

    A tie counts as a half.

    Parameters
    ----------
    scores : array_like, shape (runs, tasks)
    others : array_like, shape (other runs, tasks)

    Raises
    ------
    ValueError
        If the scores are not finite, or of other tasks.

    Examples
    --------
    >>> from npend_gym import rl
    >>> rl.probability_of_improvement([[0.8], [1.0]], [[0.7], [0.8]])
    0.875
    """
    own, theirs = _scores(scores), _scores(others)
    if own.shape[1] != theirs.shape[1]:
        raise ValueError(
            f"others must have the {own.shape[1]} tasks of scores, got {theirs.shape[1]}"
        )
    difference = own[:, None] - theirs[None]
    return float((0.5 * (1.0 + np.sign(difference))).mean())


def performance_profile(scores: ArrayLike, thresholds: ArrayLike) -> FloatArray:
    """Return which share of all runs scores more than each threshold.

    Parameters
    ----------
    scores : array_like, shape (runs, tasks)
    thresholds : array_like, shape (k,)

    Returns
    -------
    ndarray, shape (k,)
        One algorithm is better than another where its profile is higher at every threshold.

    Raises
    ------
    ValueError
        If scores or thresholds are not finite, or of another shape.

    Examples
    --------
    >>> from npend_gym import rl
    >>> rl.performance_profile([[0.2], [0.6], [0.9], [1.0]], [0.5, 0.95]).tolist()
    [0.75, 0.25]
    """
    limits = _checks.array("thresholds", thresholds)
    if limits.ndim != 1:
        raise ValueError(f"thresholds must have the shape (k,), got {limits.shape}")
    return (_scores(scores).ravel() > limits[:, None]).mean(axis=1)


def _scores(scores: ArrayLike) -> FloatArray:
    given = _checks.array("scores", scores)
    if given.ndim != 2 or given.size == 0:
        raise ValueError(f"scores must have the shape (runs, tasks), got {given.shape}")
    return given
