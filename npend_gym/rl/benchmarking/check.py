"""Results that somebody sends are checked: the models play again, and every episode must agree."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from npend_gym import _checks
from npend_gym.rl.benchmarking.play import benchmark
from npend_gym.rl.benchmarking.results import BenchmarkRun
from npend_gym.rl.evaluation.seeds import HELD_OUT

_ROUNDING = 1e-6  # by which processors may differ: relative, of numbers below 1 absolute


@dataclass(frozen=True)
class Replay:
    """What became of a check, see `check_benchmark`.

    Attributes
    ----------
    differing : dict
        By task the seeds of the episodes that differ.
    same_bits : bool
        Whether every number is the same to the last bit.
    complaints : list of str
        Why the result cannot be accepted; none where it can.
    """

    differing: Mapping[str, list[int]]
    same_bits: bool
    complaints: list[str]

    @property
    def accepted(self) -> bool:
        """Whether there is no complaint."""
        return not self.complaints


def check_benchmark(
    found: BenchmarkRun,
    model: Any,
    *,
    sha256: Mapping[str, Any] | None = None,
    tolerance: float = 0.0,
    progress: Callable[[Iterable[str]], Iterable[str]] = iter,
) -> Replay:
    """Play the episodes of a result again, and compare scores and returns.

    Parameters
    ----------
    found : BenchmarkRun
        As `read_benchmarks` returns it.
    model
        As for `benchmark`.
    sha256 : mapping, optional
        Of the files of these models, which must be those of the result.
    tolerance : float
        Share of the episodes of a task that may differ, below 1: other networks than a `Policy`
        round otherwise on another processor, and an episode may then end otherwise.
    progress : callable
        As for `benchmark`.

    Returns
    -------
    Replay

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, or a model does not fit its task.

    Examples
    --------
    >>> from npend_gym import rl
    >>> policies = {"swingup-1": rl.Policy.pretrained("swingup-1")}
    >>> found = rl.benchmark(policies, name="shipped", episodes=2)
    >>> rl.check_benchmark(found, policies).accepted
    True
    """
    share = _checks.nonnegative_number("tolerance", tolerance)
    if share >= 1.0:
        raise ValueError(f"tolerance must be below 1, a share of the episodes, got {share:g}")
    said, complaints = found.record["model"].get("sha256"), list[str]()
    if said != (dict(sha256) if sha256 else None):
        complaints.append("the files of the models are others than in the result, by their SHA-256")
    given: dict[str, Any] = dict.fromkeys(found.episodes, model)
    if isinstance(model, Mapping):
        given = dict(cast("Mapping[str, Any]", model))
    own = {task: given[task] for task in found.episodes if task in given}
    if absent := [task for task in found.episodes if task not in own]:
        complaints.append(f"there is no model for {', '.join(absent)}")
    counts = {columns["score"].size for columns in found.episodes.values()}
    if not own or len(counts) != 1:
        return Replay({}, False, [*complaints, "its tasks must have as many episodes, one or more"])
    again = benchmark(own, found.suite, name=found.name, episodes=counts.pop(), progress=progress)
    differing, same = dict[str, list[int]](), True
    for task, columns in again.episodes.items():
        kept = found.episodes[task]
        same &= all(np.array_equal(kept[c], columns[c], equal_nan=True) for c in columns)
        wrong = np.zeros(kept["score"].size, np.bool_)
        for name, values in columns.items():
            near = np.isclose(kept[name], values, rtol=_ROUNDING, atol=_ROUNDING, equal_nan=True)
            wrong |= ~near
        if wrong.any():
            differing[task] = (np.flatnonzero(wrong) + HELD_OUT).tolist()
        if wrong.mean() > share:
            complaints.append(
                f"{wrong.sum()} of {wrong.size} episodes of {task} differ, the first with the seed "
                f"{differing[task][0]}"
            )
    return Replay(differing, bool(same), complaints)
