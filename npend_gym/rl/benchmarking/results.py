"""What a benchmark found: every episode of one run, as a JSON and a CSV that belong together."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from npend_gym import _checks, _files
from npend_gym._checks import FloatArray
from npend_gym._provenance import machine
from npend_gym.rl.benchmarking.suites import EPISODES, tasks_of
from npend_gym.rl.evaluation.seeds import HELD_OUT, MAX_SEED

FORMAT = "npend benchmark, version 1"
COLUMNS = "score", "return", "settling_time", "motor_work"  # of an episode


@dataclass(frozen=True, eq=False, repr=False)
class BenchmarkRun:
    """The episodes of one run of a training, in the tasks of a suite; see `benchmark`.

    Attributes
    ----------
    name : str
        Of the algorithm.
    suite : str
    run : int
        Seed of the training.
    episodes : dict
        For each task that was played, arrays of shape (episodes,): "score" (1 for success, else 0;
        in "release" the share of the time that is predicted), "return", "settling_time" [s] and
        "motor_work" [J] as `Evaluation` has them. Episode k has the seed ``HELD_OUT + k``.
    record : dict
        For JSON: the versions, the model with its SHA-256, and what the user says of the training.
    """

    name: str
    suite: str
    run: int
    episodes: Mapping[str, Mapping[str, FloatArray]]
    record: Mapping[str, Any]

    def __repr__(self) -> str:
        absent = ", ".join(self.not_run)
        return (
            f"BenchmarkRun({self.name}, {self.suite}, run {self.run}: mean score {self.score:.3f}"
            f"{f'; not run: {absent}' if absent else ''})"
        )

    @property
    def not_run(self) -> list[str]:
        """The tasks of the suite without a model."""
        return [task for task in tasks_of(self.suite) if task not in self.episodes]

    @property
    def scores(self) -> dict[str, float]:
        """The mean score of each task; that of a task that was not run is 0."""
        played = self.episodes
        return {
            task: float(played[task]["score"].mean()) if task in played else 0.0
            for task in tasks_of(self.suite)
        }

    @property
    def score(self) -> float:
        """The mean over all tasks of the suite."""
        return float(np.mean(list(self.scores.values())))

    @property
    def complete(self) -> bool:
        """Whether every task that was played has the episodes of the protocol."""
        return all(each["score"].size == EPISODES for each in self.episodes.values())

    def as_dict(self) -> dict[str, Any]:
        """Return the content of the JSON file."""
        table = _table(self.episodes)
        tasks: dict[str, Any] = {}
        for task, columns in self.episodes.items():
            means = {name: _mean(values) for name, values in columns.items()}
            env = tasks_of(self.suite)[task].env
            tasks[task] = {"env": env, "episodes": columns["score"].size} | means
        return {
            "format": FORMAT,
            "name": self.name,
            "suite": self.suite,
            "run": self.run,
            "score": self.score,
            "tasks": tasks,
            "not_run": self.not_run,
            "complete": self.complete,
            "sha256_of_episodes": hashlib.sha256(table.encode()).hexdigest(),
        } | dict(self.record)

    def write(self, out: Path) -> list[Path]:
        """Write NAME-SUITE-RUN.json and .csv into the folder `out`; return their paths."""
        _files.make_folder(out)
        place = out / f"{self.name}-{self.suite}-{self.run}"
        texts = {
            ".json": json.dumps(self.as_dict(), indent=1, allow_nan=False) + "\n",
            ".csv": _table(self.episodes),
        }
        written = [Path(f"{place}{suffix}") for suffix in texts]
        for path, text in zip(written, texts.values(), strict=True):
            with _files.replacing(path) as file:
                file.write(text)
        return written


def made_record(model: Mapping[str, Any], about: Mapping[str, Any]) -> dict[str, Any]:
    """Return the record of a run: the model, what the user says of it, versions and processor."""
    return {
        "model": dict(model),
        "about": dict(about),
        "made_by": machine(("torch", "onnxruntime")),
    }


def read_benchmarks(paths: Iterable[Path | str]) -> list[BenchmarkRun]:
    """Read the runs in files of `BenchmarkRun.write`, or in all such files of folders.

    Parameters
    ----------
    paths : iterable of path-like
        JSON files, each with its CSV beside it, or folders.

    Returns
    -------
    list of BenchmarkRun

    Raises
    ------
    ValueError
        If a file is damaged; if its numbers do not follow from its episodes; if it has another task
        than the suite of this version.
    OSError
        If a file cannot be opened.

    Examples
    --------
    >>> from npend_gym import rl
    >>> rl.read_benchmarks([])
    []
    """
    found: list[BenchmarkRun] = []
    for path in map(Path, paths):
        files = sorted(path.glob("*.json")) if path.is_dir() else [path]
        if not files:
            raise ValueError(f"{path} must hold files of npend benchmark, got none")
        found += map(_read, files)
    return found


def _read(path: Path) -> BenchmarkRun:
    try:
        said = _files.parse_json(_files.read_text(path))
        if said.get("format") != FORMAT:
            raise ValueError(f"its format must be {FORMAT!r}, got {said.get('format')!r}")
        table = _files.read_text(path.with_suffix(".csv"))
        suite = _checks.choice("suite", said.get("suite"), ("core", "hard", "release"))
        run = BenchmarkRun(
            name=check_name(said.get("name")),
            suite=suite,
            run=_checks.count("run", said.get("run"), low=0, high=MAX_SEED),
            episodes=_parse(table, suite),
            record=_record(said),
        )
        again = json.loads(json.dumps(run.as_dict()))
        wrong = [key for key in again if again[key] != said.get(key)]
    except KeyError as error:
        raise ValueError(f"{path} must be of npend benchmark: it lacks {error}") from error
    except (ValueError, TypeError, csv.Error) as error:
        raise ValueError(f"{path} must be of npend benchmark: {error}") from error
    if wrong:
        raise ValueError(
            f"{path} must say what follows from the episodes beside it, in {path.stem}.csv; "
            f"{', '.join(wrong)} do not: write both with npend benchmark"
        )
    return run


def _record(said: Mapping[str, Any]) -> dict[str, Any]:
    """Return the record of a file, which tables and checks read."""
    record = {key: said[key] for key in ("model", "about", "made_by")}
    model, about, made_by = record["model"], record["about"], record["made_by"]
    if not (isinstance(model, dict) and isinstance(about, dict) and isinstance(made_by, str)):
        raise ValueError("model and about must be objects, names and values, and made_by a text")
    check_about(cast("Mapping[str, Any]", about))
    return record


def check_about(about: Mapping[str, Any]) -> None:
    """Raise an error for what a table cannot show of a training."""
    if "env_steps" in about:
        _checks.count("env_steps", about["env_steps"], low=0)
    by = about.get("by", "")
    if not isinstance(by, str) or not re.fullmatch(r"[^|<>\[\]`\n\r]{0,100}", by):
        raise ValueError(
            "by must be a text of at most 100 characters, without |, <, >, [, ] and `, got "
            f"{_checks.show(by)}"
        )


def check_name(value: Any) -> str:
    """Return a name that may begin the name of a file."""
    text = value if isinstance(value, str) else ""
    if not re.fullmatch(r"[\w.+-]{1,60}", text):
        raise ValueError(
            "name must have 1 to 60 letters, digits, '_', '.', '+' or '-', got "
            f"{_checks.show(value)}"
        )
    return text


def _mean(values: FloatArray) -> float | None:
    """Return the mean of what is there, rounded so that a reader may compare it."""
    known = values[np.isfinite(values)]
    return round(float(known.mean()), 6) if known.size else None


def _table(episodes: Mapping[str, Mapping[str, FloatArray]]) -> str:
    """Return the episodes as CSV: floats as repr, nothing where there is no number."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(("task", "seed", *COLUMNS))
    for task, columns in episodes.items():
        for k, row in enumerate(zip(*(columns[name].tolist() for name in COLUMNS), strict=True)):
            rows.writerow((task, HELD_OUT + k, *("" if math.isnan(x) else repr(x) for x in row)))
    return text.getvalue()


def _parse(table: str, suite: str) -> dict[str, dict[str, FloatArray]]:
    rows = list(csv.reader(io.StringIO(table)))
    if not rows or tuple(rows[0]) != ("task", "seed", *COLUMNS):
        raise ValueError(f"its CSV must have the columns task, seed, {', '.join(COLUMNS)}")
    parts: dict[str, list[Sequence[float]]] = {}
    for task, seed, *row in (each if len(each) == 6 else ["", "", *each] for each in rows[1:]):
        own = parts.setdefault(task, [])
        if task not in tasks_of(suite) or seed != str(HELD_OUT + len(own)):
            raise ValueError(
                f"its CSV must have the episodes of each task of {suite!r} in order, with seeds "
                f"from {HELD_OUT}, got {_checks.show([task, seed])}"
            )
        own.append([float(x) if x else float("nan") for x in row])
    found: dict[str, dict[str, FloatArray]] = {}
    for task, own in parts.items():
        numbers = np.array(own).T
        if len(own) > EPISODES:
            raise ValueError(
                f"its CSV must have at most {EPISODES} episodes of a task, got {len(own)} of {task}"
            )
        if not np.isfinite(numbers[[0, 1, 3]]).all() or ((numbers[0] < 0) | (numbers[0] > 1)).any():
            raise ValueError(f"its CSV must have finite numbers, and scores from 0 to 1, in {task}")
        found[task] = dict(zip(COLUMNS, numbers, strict=True))
    return found
