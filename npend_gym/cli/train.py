"""`npend train`: a policy for a task, by one of several algorithms."""

from __future__ import annotations

import argparse
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from npend_gym.cli.common import (
    OK,
    add_env_option,
    printable,
    setting,
    show_written,
    warn,
    with_settings,
)

_DEFAULT = "shac"  # for a task that none has settings for
ABOUT = """\
Trains a policy for a task such as swingup-2, balance-3, calm-5 or swingup-1-robust, evaluates it in
100 held-out episodes, and writes OUT/TASK.npz and its learning curve TASK.csv. On one
machine a seed gives the same policy again, with any number of threads. Now and then it writes
OUT/TASK.checkpoint, from which --resume goes on, to the same policy. Needs the extra "rl".
"""
EXAMPLES = """\
examples:
  npend train swingup-1                       ten seconds
  npend train swingup-2 --seed 3 --out runs
  npend train swingup-2-robust                survives wrong chains, noise, delay, pushes
  npend train calm-2 --env damping=0.02 --set total_timesteps=100000
  npend train swingup-1 --env "randomize={\\"masses\\": [0.8, 1.2]}" --out heavy
  npend train swingup-4 --resume              goes on with what was interrupted
  npend evaluate runs/swingup-2.npz --robust
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `npend train`."""
    text = "mode and number of rods, such as swingup-2; swingup-2-robust draws a chain each episode"
    parser.add_argument("task", metavar="TASK", help=text)
    text = (
        "shac, imitation, or of another package (default: the one that has settings for the task)"
    )
    parser.add_argument("--algorithm", metavar="NAME", help=text)
    parser.add_argument("--seed", type=int, help="from 0 to 2^31 - 1 (default 0)")
    add_env_option(parser)
    text = "fit.json of npend identify: train on chains within two standard errors of this one"
    parser.add_argument("--around", type=Path, metavar="FILE", help=text)
    text = "a setting of the algorithm, such as total_timesteps=300000; may be repeated"
    parser.add_argument("--set", dest="changes", type=setting, action="append",
                        metavar="NAME=VALUE", help=text)  # fmt: skip
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="(default: here)")
    text = "train again where OUT has a policy of this name"
    parser.add_argument("--overwrite", action="store_true", help=text)
    text = "go on from OUT/TASK.checkpoint, which an interrupted run with these options has left"
    parser.add_argument("--resume", action="store_true", help=text)


def run(options: dict[str, Any]) -> int:
    """Train, evaluate and write; return the exit code."""
    from npend_gym.report import outputs, write_csv
    from npend_gym.report.robustness_report import evaluation_text
    from npend_gym.rl import evaluate
    from npend_gym.rl.training.checkpoints import Checkpoint
    from npend_gym.rl.training.trainers import trainer

    task: str = options["task"]
    algorithm = _algorithm(task, options.get("algorithm"))
    path = options.get("out", Path()) / f"{task}.npz"
    outputs.prepare_folder(path.parent)
    if path.exists() and not options.get("overwrite", False):
        raise ValueError(f"{path} exists: give --overwrite to train it again, or another --out")
    chosen = trainer(algorithm)
    settings = _settings(chosen, task, options)
    kept = path.with_suffix(".checkpoint")
    checkpoint = Checkpoint(settings, kept, resume=options.get("resume", False))
    try:
        policy, curve = chosen.train(settings, task, checkpoint)
    except KeyboardInterrupt:
        if kept.exists():
            warn(f"{kept} holds what was learned: the same command with --resume goes on from it")
        else:
            warn("nothing was written: training begins again when it is run again")
        raise
    row = evaluate(policy, policy.env).as_row()
    policy.provenance["evaluation"] = row
    written = [write_csv(path.with_suffix(".csv"), curve), path]
    policy.save(path)
    kept.unlink(missing_ok=True)
    print(f"{printable(str(task))} by {algorithm}, {curve[-1]['steps']} steps")
    print(evaluation_text(row))
    show_written(written, figures=False)
    return OK


def _algorithm(task: str, name: str | None) -> str:
    """Return the algorithm asked for, or the first with settings for the task."""
    from npend_gym import _checks
    from npend_gym._extras import require
    from npend_gym.rl.training.tasks import env_of_task
    from npend_gym.rl.training.trainers import trainer, trainer_names

    env_of_task(task)  # refuses what is no task
    if name is not None:
        _checks.choice("algorithm", name, (*trainer_names(),))
    require("torch", "rl", "trainers")
    known = [each for each in trainer_names() if name is None and task in trainer(each).TASKS]
    if name is None and not known:
        warn(
            f"no settings are known for {task}: {_DEFAULT} with its defaults, which --set "
            "changes; docs/results.md has what was reached"
        )
    return name or next(iter(known), _DEFAULT)


def _settings(trainer: Any, task: str, options: dict[str, Any]) -> Any:
    """Return the settings of the trainer, with the user's changes."""
    from npend_gym.rl.training.tasks import env_around

    changes = dict(options.get("changes", []))
    names = [field.name for field in fields(trainer.Settings) if field.name not in ("env", "seed")]
    for name in changes:
        if name not in names:
            raise ValueError(f"--set must name one of {', '.join(names)}; got {name}")
    if "seed" in options:
        changes["seed"] = options["seed"]
    settings = trainer.settings_of(task, **changes)
    if "around" in options:
        others = {name: value for name, value in settings.env.items() if name != "n"}
        settings = replace(settings, env=others | env_around(options["around"]))
    return replace(settings, env=with_settings(settings.env, options.get("settings")))
