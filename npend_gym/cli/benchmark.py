"""Play the tasks of a suite, write every episode, compare algorithms, check results of others.

MODEL is "pretrained", "reference" or "random", or a folder with a file for each task, such as
swingup-2.zip or swingup-2.onnx. Several seeds of a training have such a folder each, named 0, 1 and
so on. MODEL can be a function for all tasks, too: file.py:name. See docs/howto/benchmark.md.

Examples
--------
  npend benchmark pretrained --suite core
  npend benchmark models --suite core --algorithm PPO --trust --name ppo --env-steps 1000000
  npend benchmark swingup-2.onnx --out results --compare benchmarks/leaderboard
  npend benchmark mine.py:act --suite hard --name mine -o results
  npend benchmark --compare benchmarks/leaderboard --suite core --tasks swingup-1,swingup-2
  npend benchmark --check benchmarks/leaderboard/pretrained-core-0.json
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from npend_gym.cli.common import (
    FAILED,
    OK,
    finishing,
    prepare_results,
    progress,
    refuse_unused,
    warn,
)


def run(
    model: str | None = None,
    *,
    suite: Literal["core", "hard", "release"] | None = None,
    name: str | None = None,
    algorithm: str | None = None,
    trust: bool = False,
    env_steps: int | None = None,
    by: str | None = None,
    episodes: int | None = None,
    tasks: Sequence[str] | None = None,
    compare: Path | None = None,
    check: Path | None = None,
    tolerance: float | None = None,
    as_json: bool = False,
    out: Path | None = None,
) -> int:
    """Play, compare or check; return the exit code.

    Parameters
    ----------
    model : model, optional
        Where the models are: a name of the package, a folder, a file, or a function.
    suite : name, optional
        Which tasks are played (default core).
    name : name, optional
        Of the algorithm, for tables and names of files (default the name of MODEL).
    algorithm : name, optional
        Class of Stable-Baselines3 or sb3-contrib that reads .zip files, such as PPO.
    trust : bool
        Allow .zip, .pkl and .pt2 files, whose pickles can run any code.
    env_steps : int, optional
        Environment steps of the training of each task, for readers.
    by : str, optional
        Who trained it, for readers.
    episodes : int, optional
        Of each task (default 100); with fewer the result is not complete.
    tasks : task, optional
        Only these tasks of the suite.
    compare : folder, optional
        A folder, or a JSON file, of results that are put beside these.
    check : file, optional
        A JSON file of results, whose episodes are played again and compared.
    tolerance : float, optional
        Share of the episodes that may differ with --check (default 0).
    as_json : bool
        Print everything as JSON.
    out : folder, optional
        Write a JSON and a CSV for each run there.
    """
    from npend_gym import _checks
    from npend_gym.rl.benchmarking.comparison import compare_benchmarks
    from npend_gym.rl.benchmarking.play import benchmark
    from npend_gym.rl.benchmarking.readers import read_models
    from npend_gym.rl.benchmarking.results import read_benchmarks
    from npend_gym.rl.benchmarking.suites import EPISODES, SUITES

    played: dict[str, Any] = {
        "--name": name, "--env-steps": env_steps, "--by": by, "--episodes": episodes, "--out": out,
    }  # fmt: skip
    read = {"--algorithm": algorithm, "--trust": trust}
    if check is not None:
        chosen = {"--suite": suite, "--compare": compare, "--tasks": tasks, "--json": as_json}
        refuse_unused(played | chosen, "with --check")
        if model is None:
            refuse_unused(read, "without a model")
        return _checked(check, model, algorithm, trust=trust, tolerance=tolerance or 0.0)
    refuse_unused({"--tolerance": tolerance}, "without --check")
    if model is None:
        refuse_unused(played | read, "without a model")
        if compare is None:
            raise ValueError("give a model, --compare or --check")
    suite, episodes = suite or "core", EPISODES if episodes is None else episodes
    for each in tasks or ():
        _checks.choice("tasks", each, tuple(SUITES[suite]))
    if out is not None and model is not None:
        prepare_results(out, "npend benchmark")
    known = [] if compare is None else read_benchmarks([compare])
    others = [each for each in known if each.suite == suite]
    if compare is not None and not others:
        found = sorted({each.suite for each in known})
        raise ValueError(f"{compare} must have results of the suite {suite}, got {found}")
    if others and model is not None and episodes != EPISODES:
        raise ValueError(f"episodes must be {EPISODES} with --compare, got {episodes}")
    runs: list[Any] = []
    wanted = SUITES[suite] if tasks is None else tasks
    if model is not None:
        about: dict[str, Any] = {"env_steps": env_steps, "by": by}
        shown, plans = progress("tasks"), progress("plans")
        named = name or Path(model.partition(":")[0]).resolve().stem
        found_models = read_models(model, suite, algorithm=algorithm, trust=trust, progress=plans)
        if taken := [
            each.run for each in others if each.name == named and each.run in found_models
        ]:
            raise ValueError(
                f"name must be another than those in {compare}, which has the run {taken[0]} of "
                f"{named}: give --name"
            )
        for seed, found in found_models.items():
            models = {each: found.models[each] for each in found.models if each in wanted}
            runs.append(
                benchmark(
                    models,
                    suite,
                    name=named,
                    run=seed,
                    episodes=episodes,
                    about={key: each for key, each in about.items() if each is not None},
                    source=found.source,
                    progress=shown,
                )
            )
    with finishing():  # written first: a comparison can be repeated
        written = [] if out is None else [path for each in runs for path in each.write(out)]
    rows = compare_benchmarks([*runs, *others], tasks=tasks) if others else []
    with finishing():
        if as_json:
            said = {"runs": [each.as_dict() for each in runs], "compared": rows}
            print(json.dumps(said, indent=2, allow_nan=False))
        else:
            _print(runs, rows)
            print(*(f"written: {path}" for path in written), sep="\n")
    return OK


def _print(runs: Sequence[Any], rows: Sequence[dict[str, Any]]) -> None:
    from npend_gym.rl.benchmarking.comparison import PROFILE

    for each in runs:
        print(f"{each.name}, run {each.run}: {each.suite}, mean score {each.score:.3f}")
        for task, score in each.scores.items():
            mean = each.episodes[task]["return"].mean() if task in each.episodes else None
            shown = "not run" if mean is None else f"score {score:.3f}   return {mean:.2f}"
            print(f"  {task:18}{shown}")
        if each.not_run:
            warn(f"npend benchmark: not run, and counted as 0: {', '.join(each.not_run)}")
    if rows:
        print(f"\n{'algorithm':20}runs tasks  mean   IQM   95 % interval        better than first")
    for row in rows:
        interval = f"{row['low']:.3f} to {row['high']:.3f} ({row['over']})"
        better = f"{row['improvement']:.2f}"
        better += f" ({row['improvement_low']:.2f} to {row['improvement_high']:.2f})"
        print(
            f"{row['name']:20}{row['runs']:4}{row['tasks']:6}{row['mean']:6.3f}{row['iqm']:6.3f}"
            f"   {interval:27}{better}"
        )
    if rows:
        print("\nshare of runs and tasks with a score above " + ", ".join(map(str, PROFILE)))
    for row in rows:
        print(f"{row['name']:20}" + "".join(f"{share:7.2f}" for share in row["profile"]))


def _checked(
    path: Path, model: str | None, algorithm: str | None, *, trust: bool, tolerance: float
) -> int:
    """Play the episodes of a file again; nothing that the file names is imported or read."""
    from npend_gym.cli.common import printable
    from npend_gym.rl.benchmarking.check import check_benchmark
    from npend_gym.rl.benchmarking.readers import NAMED, read_models
    from npend_gym.rl.benchmarking.results import read_benchmarks
    from npend_gym.rl.benchmarking.suites import EPISODES

    if path.is_dir():
        raise ValueError(f"check must be a JSON file of one run, got the folder {path}")
    (found,) = read_benchmarks([path])
    source = model or found.record["model"].get("from")
    if model is None and source not in NAMED:
        raise ValueError(f"model must be given with --check {path}, which is of models in a file")
    read = read_models(str(source), found.suite, algorithm=algorithm, trust=trust)
    if found.run not in read and len(read) == 1:
        read = {found.run: next(iter(read.values()))}
    if found.run not in read:
        raise ValueError(f"model must have the run {found.run}, got {', '.join(map(str, read))}")
    own = read[found.run]
    replay = check_benchmark(
        found, own.models, sha256=own.source.get("sha256"), tolerance=tolerance,
        progress=progress("tasks"),
    )  # fmt: skip
    for each in replay.complaints:
        warn(f"npend benchmark: {path}: {each}")
    if replay.complaints:
        warn(f"npend benchmark: {path} was made by {found.record['made_by']}")
    same = "to the last bit" if replay.same_bits else "but for rounding, or within the tolerance"
    if not found.complete:
        warn(f"npend benchmark: {path}: fewer than {EPISODES} episodes of a task are not complete")
    if replay.accepted:
        print(f"{printable(str(path))}: accepted, its episodes are the same {same}")
    return OK if replay.accepted else FAILED
