"""`benchmark`: a model, or one for each task, plays the tasks of a suite."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import closing, contextmanager
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.physics import simulate
from npend_gym.rl.benchmarking.results import BenchmarkRun, check_about, check_name, made_record
from npend_gym.rl.benchmarking.suites import EPISODES, BenchmarkTask, tasks_of
from npend_gym.rl.evaluation.episodes import evaluate
from npend_gym.rl.evaluation.seeds import HELD_OUT, MAX_SEED
from npend_gym.rl.evaluation.settings import setting_of

VALID = 0.1  # rad: a prediction is valid up to the first angle that is further from the motion
FINE = 1e-12, 1e-13  # rtol and atol of the motion with which predictions are compared
_MAY_CHOOSE = "observation", "observe_velocities"


def benchmark(
    model: Any,
    suite: str = "core",
    *,
    name: str = "",
    run: int = 0,
    episodes: int = EPISODES,
    about: Mapping[str, Any] | None = None,
    source: Mapping[str, Any] | None = None,
    progress: Callable[[Iterable[str]], Iterable[str]] = iter,
) -> BenchmarkRun:
    """Let models play the episodes of a suite: the same tasks, seeds and lengths for everybody.

    Every task is a public id with its default observation and episode, see `SUITES`. A `Policy`
    may observe less than that, or unscaled numbers, as its file says. The seeds are those of
    `episode_seeds`, "evaluation".

    Parameters
    ----------
    model : mapping, or Controller or Model
        For each task by its name a model as `evaluate` takes it; the others are not run, and score
        0. One function of (observation, info) plays all tasks. In the suite "release" a model is a
        function ``predict(chain, theta, omega, times)``. It takes starts of shape (B, n) and times
        [s] of shape (T,), the first of which is 0, and returns angles [rad], (B, T, n).
    suite : {"core", "hard", "release"}
    name : str
        Of the algorithm, for tables and names of files; the default is that of the model's class.
    run : int
        Seed of the training from which the models are.
    episodes : int
        Of each task. With fewer than 100 the result is not complete.
    about : mapping, optional
        What readers should know of the training: "env_steps" of each task, and "by" whom.
    source : mapping, optional
        From where the models are, with the SHA-256 of their files.
    progress : callable
        May wrap the iteration over the tasks, as tqdm does.

    Returns
    -------
    BenchmarkRun

    Raises
    ------
    ValueError, TypeError
        If an argument breaks its rule, or a model does not fit its task.

    Examples
    --------
    >>> from npend_gym import rl
    >>> policies = {name: rl.Policy.pretrained(name) for name in ("swingup-1", "balance-2")}
    >>> found = rl.benchmark(policies, name="shipped", episodes=2)
    >>> found.scores["balance-2"], found.not_run[:2]
    (1.0, ['swingup-2', 'calm-2'])
    """
    tasks = tasks_of(suite)
    _checks.count("episodes", episodes, high=EPISODES)
    _checks.count("run", run, low=0, high=MAX_SEED)
    check_about(about or {})  # before what takes long
    made = check_name(name or type(model).__name__)
    models: dict[str, Any] = dict.fromkeys(tasks, model)
    if is_mapping := isinstance(model, Mapping):
        models = dict(cast("Mapping[str, Any]", model))
    unknown = [each for each in models if each not in tasks]
    if unknown or not models:
        named = ", ".join(tasks)
        raise ValueError(
            f"model must be for tasks of the suite {suite!r}, which are {named}; got "
            f"{_checks.show(unknown) if models else 'none'}"
        )
    play = _predicted if suite == "release" else _controlled
    found: dict[str, dict[str, FloatArray]] = {}
    for task in progress([each for each in tasks if each in models]):
        with _naming(task, "" if is_mapping else "; give a mapping from tasks to their models"):
            found[task] = play(models[task], tasks[task], episodes)
    return BenchmarkRun(made, suite, run, found, made_record(source or {}, about or {}))


@contextmanager
def _naming(task: str, way_out: str) -> Generator[None]:
    """Let errors of the block name the task."""
    try:
        yield
    except (ValueError, TypeError) as error:
        raise type(error)(f"model must fit the task {task}: {error}{way_out}") from error


def _controlled(model: Any, task: BenchmarkTask, episodes: int) -> dict[str, FloatArray]:
    """Return the episodes of a task that a model acts in."""
    found = evaluate(model, observed_env(model, task), episodes=episodes, seed=HELD_OUT)
    return {
        "score": found.success.astype(np.float64),
        "return": found.returns,
        "settling_time": found.settling_time,
        "motor_work": found.motor_work,
    }


def observed_env(model: Any, task: BenchmarkTask) -> dict[str, Any]:
    """Return the environment of a task, in which a `Policy` observes what its file says."""
    said = getattr(model, "env", None)
    own = cast("Mapping[str, Any]", said if isinstance(said, Mapping) else {})
    return {key: own[key] for key in _MAY_CHOOSE if key in own} | task.env


def _predicted(model: Any, task: BenchmarkTask, episodes: int) -> dict[str, FloatArray]:
    """Return for how long a model predicts each release of a task."""
    if not callable(model):
        raise TypeError(
            f"it must be callable as predict(chain, theta, omega, times), got {_checks.show(model)}"
        )
    setting = setting_of(task.env)
    envs = setting.make(episodes)
    with closing(envs):
        config, steps = setting.config, int(envs.unwrapped.max_episode_steps)
        _, info = envs.reset(seed=HELD_OUT)
        theta, omega = info["theta"].copy(), info["omega"].copy()
    times = config.dt * np.arange(steps + 1)
    motion = simulate(config.chain, theta, omega, times, rtol=FINE[0], atol=FINE[1]).theta
    found = np.asarray(model(config.chain, theta.copy(), omega.copy(), times.copy()))
    if found.shape != motion.shape or found.dtype.kind != "f":
        raise ValueError(
            f"it must return angles of the shape {motion.shape}, got {found.dtype} {found.shape}"
        )
    wrong = ~(np.abs(found - motion).max(axis=2) <= VALID)  # NaN is wrong
    first: NDArray[np.int64] = np.where(wrong.any(axis=1), wrong.argmax(axis=1), steps + 1)
    valid = np.maximum(first - 1, 0) / steps
    nothing = np.zeros(episodes)
    return {
        "score": valid, "return": valid * steps * config.dt,
        "settling_time": np.full(episodes, np.nan), "motor_work": nothing,
    }  # fmt: skip
