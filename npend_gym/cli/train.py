r"""Train a policy for a task, by one of several algorithms.

TASK is a mode and a number of rods, such as swingup-2, balance-3, calm-5 or swingup-1-robust. The
command evaluates the policy in 100 held-out episodes, and writes OUT/TASK.safetensors and the
learning curve OUT/TASK.csv. If fewer than 10 episodes succeed, it writes both and exits with code
1. On one machine the same seed gives the same policy, with any number of threads. A run keeps
OUT/TASK.checkpoint: with --resume an interrupted run continues from it and ends with the same
policy. Needs the extra "rl".

Examples
--------
  npend train swingup-1                       ten seconds
  npend train swingup-2 --seed 3 -o runs
  npend train swingup-2-robust                survives wrong chains, noise, delay, pushes
  npend train balance-1-cart                  a pole on a cart
  npend train calm-2 --env damping=0.02 --set total_timesteps=100000
  npend train swingup-1 --env "randomize={\"masses\": [0.8, 1.2]}" -o heavy
  npend train swingup-4 --resume              continues an interrupted run
  npend evaluate runs/swingup-2.safetensors --robust
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from npend_gym.cli.common import FAILED, OK, printable, show_written, warn
from npend_gym.cli.evaluate import refuse_said

FILLS = {"npend_gym.cli.evaluate:run": ("env",)}
_DEFAULT = "shac"  # for a task that none has settings for


def run(
    task: str,
    *,
    algorithm: str | None = None,
    seed: int | None = None,
    env: Sequence[tuple[str, Any]] = (),
    around: Path | None = None,
    settings: Sequence[tuple[str, Any]] = (),
    out: Path = Path(),
    overwrite: bool = False,
    resume: bool = False,
) -> int:
    """Train, evaluate and write; return the exit code.

    Parameters
    ----------
    task : task
        Mode and number of rods, such as swingup-2; swingup-2-robust draws a chain each episode, and
        swingup-2-cart is on the cart of npend/CartDoublePole-v1.
    algorithm : name, optional
        shac, imitation, or one of another package (default: the one with settings for the task).
    seed : int, optional
        A number from 0 to 2^31 - 1 (default 0).
    around : file, optional
        The fit.json of npend identify: train on chains within two standard errors of this one.
    settings : setting, optional
        A setting of the algorithm, such as total_timesteps=300000; may be repeated.
    out : folder, optional
        Folder of the results (default: here).
    overwrite : bool
        Train again where OUT has a policy of this name, or the progress of an interrupted run.
    resume : bool
        Continue an interrupted run with the same options, from OUT/TASK.checkpoint.
    """
    from npend_gym import _files
    from npend_gym.report import outputs, write_csv
    from npend_gym.report.robustness_report import evaluation_text
    from npend_gym.rl.training.checkpoints import Checkpoint
    from npend_gym.rl.training.tasks import env_around, failure_of, row_of
    from npend_gym.rl.training.trainers import trainer

    algorithm = _algorithm(task, algorithm)
    path, kept = out / f"{task}.safetensors", out / f"{task}.checkpoint"
    outputs.prepare_folder(path.parent)
    if kept.exists() and not (resume or overwrite):
        raise ValueError(
            f"{kept} has the progress of an interrupted run: give --resume to continue it, or "
            "--overwrite to begin again"
        )
    if path.exists() and not overwrite:
        raise ValueError(f"{path} exists: give --overwrite to train it again, or another --out")
    chosen = trainer(algorithm)
    using = _settings(chosen, task, dict(settings), seed)
    keywords = using.env
    if around is not None:
        refuse_said(dict(env), ("chain",), "--around")  # whose ranges are of its own chain
        found = env_around(around)
        rods = len(found["chain"]["masses"])
        if rods != keywords.get("n", rods):
            raise ValueError(
                f"--around must be a fit of as many rods as TASK has, {keywords['n']}, got {rods} "
                f"in {around}"
            )
        keywords = {k: value for k, value in keywords.items() if k != "n"} | found
    refuse_said(dict(env), ("n",), f"TASK {task}")
    using = replace(using, env={**keywords, **dict(env)})
    checkpoint = Checkpoint(using, kept, resume=resume)
    try:
        policy, curve = chosen.train(using, task, checkpoint)
        row = row_of(policy, using)
        policy.provenance["evaluation"] = row
        policy.save(path)
    except BaseException as error:
        if checkpoint.is_kept:
            warn(f"{kept} keeps the progress: the same command with --resume continues from it")
        elif isinstance(error, KeyboardInterrupt):
            warn("nothing was written: the next run starts from the beginning")
        raise
    written = [write_csv(path.with_suffix(".csv"), curve), path]
    for left in (kept, *out.glob(f".{task}.*.part")):  # and what a kill has left half-written
        _files.remove(left)
    print(f"{printable(str(task))} by {algorithm}, {curve[-1]['steps']} steps")
    print(evaluation_text(row))
    show_written(written, figures=False)
    if failure := failure_of(row):
        warn(failure)
        return FAILED
    return OK


def _algorithm(task: str, name: str | None) -> str:
    """Return the algorithm asked for, or the first with settings for the task."""
    from npend_gym._extras import require
    from npend_gym.rl.training.tasks import env_of_task
    from npend_gym.rl.training.trainers import trainer, trainer_names

    env_of_task(task)  # refuses what is no task
    if name is not None and name not in (names := trainer_names()):
        raise ValueError(
            f"algorithm must be one of {', '.join(names)}; got {name!r}: examples/train_sb3.py "
            "trains by PPO of Stable-Baselines3"
        )
    require("torch", "rl", "trainers")
    known = [each for each in trainer_names() if name is None and task in trainer(each).TASKS]
    if name is None and not known:
        warn(
            f"no settings are known for {task}: {_DEFAULT} with its defaults, which --set "
            "changes; docs/results.md has what was reached"
        )
    return name or next(iter(known), _DEFAULT)


def _settings(trainer: Any, task: str, changes: dict[str, Any], seed: int | None) -> Any:
    """Return the settings of the trainer, with the user's changes."""
    names = [field.name for field in fields(trainer.Settings) if field.name not in ("env", "seed")]
    for name in changes:
        if name not in names:
            raise ValueError(f"--set must name one of {', '.join(names)}; got {name}")
    given = {} if seed is None else {"seed": seed}
    return trainer.settings_of(task, **changes, **given)
