"""Algorithms side by side: interquartile means, intervals, probability of improvement, profiles."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.rl.benchmarking.results import BenchmarkRun
from npend_gym.rl.benchmarking.suites import tasks_of
from npend_gym.rl.evaluation.statistics import (
    bootstrap_interval,
    interquartile_mean,
    performance_profile,
    probability_of_improvement,
)

FEW = 3  # runs, with fewer of which an interval of runs says nothing
PROFILE = 0.0, 0.25, 0.5, 0.75, 0.95  # scores


def compare_benchmarks(
    runs: Iterable[BenchmarkRun], against: str = "", *, tasks: Sequence[str] | None = None
) -> list[dict[str, Any]]:
    """Compare algorithms in one suite, with the statistics of `bootstrap_interval` and its like.

    Parameters
    ----------
    runs : iterable of BenchmarkRun
        Those of one name belong to one algorithm.
    against : str
        The algorithm with which others are compared; the default is the first.
    tasks : sequence of str, optional
        In which tasks of the suite; the default is all.

    Returns
    -------
    list of dict
        For each algorithm its "name", and the numbers of its "runs" and of the "tasks" that it
        played. A task that was not run scores 0. "mean" and "iqm" (interquartile mean) are of the
        scores, with 95 % from "low" to "high". "over" says what was resampled within each task:
        "runs", or "episodes" of fewer than three runs. "improvement" is the probability that a run,
        or else an episode, scores more than one of `against`. It has an interval, too:
        "improvement_low" and "improvement_high". "profile" is the share of runs and tasks that
        score more than each number of `PROFILE`.

    Raises
    ------
    ValueError
        If the runs are of several suites, or two of one seed or one model; if one has fewer
        episodes than another; or if there is no algorithm `against`.

    Examples
    --------
    >>> from npend_gym import rl
    >>> policies = {"swingup-1": rl.Policy.pretrained("swingup-1")}
    >>> runs = [rl.benchmark(policies, name="shipped", episodes=2)]
    >>> rl.compare_benchmarks(runs)[0]["mean"]
    0.125
    """
    groups: dict[str, list[BenchmarkRun]] = {}
    for each in runs:
        groups.setdefault(each.name, []).append(each)
    suites = {each.suite for group in groups.values() for each in group}
    if len(suites) != 1:
        raise ValueError(f"runs must be of one suite, got {', '.join(sorted(suites)) or 'none'}")
    if len(sizes := set[int]().union(*map(_sizes, groups.values()))) > 1:
        raise ValueError(f"runs must have as many episodes in each task, got {sorted(sizes)}")
    for name, group in groups.items():
        if len({each.run for each in group}) < len(group):
            raise ValueError(f"runs of {name} must each have their own seed, got one twice")
        files = [each.record.get("model", {}).get("sha256") for each in group]
        if any(files.count(each) > 1 for each in files if each):
            raise ValueError(
                f"runs of {name} must each have their own models, got the same files twice, by "
                "their SHA-256: leave one of these runs out"
            )
    other = _checks.choice("against", against or next(iter(groups)), tuple(groups))
    known = tuple(tasks_of(*suites))
    names = [_checks.choice("tasks", each, known) for each in (known if tasks is None else tasks)]
    return [_compared(groups[name], groups[other], names) for name in groups]


def _compared(
    own: Sequence[BenchmarkRun], other: Sequence[BenchmarkRun], tasks: Sequence[str]
) -> dict[str, Any]:
    by_task = _scores(own, tasks)
    few = len(own) < FEW
    units = np.concatenate(_episodes(own, tasks), axis=1) if few else by_task
    low, high = bootstrap_interval(units, _of_means if few else interquartile_mean)
    few_of_both = few or len(other) < FEW
    pair = [
        np.concatenate(_episodes(each, tasks)) if few_of_both else _scores(each, tasks)
        for each in (own, other)
    ]
    chance = bootstrap_interval(pair[0], probability_of_improvement, others=pair[1], resamples=500)
    return {
        "name": own[0].name,
        "runs": len(own),
        "tasks": sum(any(task in each.episodes for each in own) for task in tasks),
        "mean": float(by_task.mean()),
        "iqm": interquartile_mean(by_task),
        "low": low,
        "high": high,
        "over": "episodes" if few else "runs",
        "improvement": probability_of_improvement(*pair),
        "improvement_low": chance[0],
        "improvement_high": chance[1],
        "profile": performance_profile(by_task, PROFILE).tolist(),
    }


def _scores(runs: Sequence[BenchmarkRun], tasks: Sequence[str]) -> FloatArray:
    """Return the mean score of every run in every task, (runs, tasks)."""
    return np.array([[each.scores[task] for task in tasks] for each in runs])


def _sizes(runs: Iterable[BenchmarkRun]) -> set[int]:
    """Return the numbers of episodes that tasks have."""
    return {columns["score"].size for each in runs for columns in each.episodes.values()}


def _episodes(runs: Sequence[BenchmarkRun], tasks: Sequence[str]) -> list[FloatArray]:
    """Return the scores of the episodes of each run, (episodes, tasks)."""
    nothing: FloatArray = np.zeros(max(_sizes(runs), default=1))
    by_run: list[list[FloatArray]] = [
        [each.episodes[task]["score"] if task in each.episodes else nothing for task in tasks]
        for each in runs
    ]
    return [np.stack(columns, axis=1) for columns in by_run]


def _of_means(scores: FloatArray) -> float:
    """Return the interquartile mean of the mean scores of all runs and tasks."""
    return interquartile_mean(scores.mean(axis=0, keepdims=True))
