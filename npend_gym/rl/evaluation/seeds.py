"""Which episodes are for training, which for choosing and which for evaluating: by their seeds.

A policy is evaluated fairly in episodes that its training has not seen, and that nobody has used to
choose it. So the seeds of episodes come from `episode_seeds`, whose three ranges never overlap.
"""

from __future__ import annotations

from npend_gym import _checks

VALIDATION = 900_000  # the first seed of the episodes in which one of several policies is chosen
HELD_OUT = 1_000_000  # the first seed of evaluations; training and choosing take other seeds
_BEYOND = 2**31  # the first seed that is for training again
MAX_SEED = _BEYOND - 1  # of a training run: as much as all libraries take, with its environments
USES = ("training", "validation", "evaluation")


def episode_seeds(use: str, count: int, *, run: int = 0, spacing: int = 1) -> range:
    """Return the seeds of episodes for one use, which are none of another use.

    Parameters
    ----------
    use : str
        "training", "validation" (to choose one of several policies) or "evaluation".
    count : int
        Number of seeds.
    run : int
        For training: the seed of the run, which the user gives.
    spacing : int
        For training: how far apart the seeds of one run and of the next begin.

    Returns
    -------
    range
        For training from ``spacing * run`` on, where that ends below `VALIDATION` and before the
        next run begins; else from 2^31 on. For the other uses from `VALIDATION` or `HELD_OUT` on.

    Raises
    ------
    ValueError, TypeError
        If there are not as many seeds for this use, or an argument breaks its rule.

    Examples
    --------
    >>> from npend_gym.rl import episode_seeds
    >>> episode_seeds("training", 32, run=2, spacing=1000)
    range(2000, 2032)
    >>> episode_seeds("evaluation", 100)
    range(1000000, 1000100)
    """
    _checks.choice("use", use, USES)
    run = _checks.count("run", run, low=0, high=MAX_SEED)
    spacing = _checks.count("spacing", spacing)
    if use != "training":
        first, end = (VALIDATION, HELD_OUT) if use == "validation" else (HELD_OUT, _BEYOND)
        return range(first, first + _checks.count("count", count, high=end - first))
    count = _checks.count("count", count)
    first = spacing * run
    if count > spacing or first + count > VALIDATION:
        first = _BEYOND + max(spacing, count) * run
    return range(first, first + count)


def training_seed(seed: int) -> int:
    """Return the seed of a training run, or say which seeds it may have."""
    return _checks.count("seed", seed, low=0, high=MAX_SEED)
