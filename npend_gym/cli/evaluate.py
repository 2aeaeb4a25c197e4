"""Evaluate a policy or a controller, and what it survives.

It plays held-out episodes, whose seeds no training uses. With --robust a policy must also survive a
wrong model, noise, delay, a slow motor and pushes; see docs/howto/robustness.md.

Examples
--------
  npend evaluate swingup-2                    a policy of the package
  npend evaluate mine.safetensors --episodes 500
  npend evaluate swingup-2 --robust -o results
  npend evaluate swingup-2 --env damping=0.05 --env "masses=[1.0, 1.1]"
  npend evaluate mine.safetensors --env chain=results/fit.json --env max_torque=0.5
  npend evaluate swingup-2 --engine mujoco
  npend evaluate --controller plan --task swingup-3 --scores
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from npend_gym.cli.common import (
    OK,
    can_draw,
    finishing,
    prepare_results,
    progress,
    show_written,
    warn,
)

if TYPE_CHECKING:
    from npend_gym.rl import Controller

FILLS = {"npend_gym.rl.evaluation.episodes:evaluate": ("episodes", "seed")}
_TASK = "swingup-2"  # of a controller, by default


def run(
    policy: str | None = None,
    *,
    trust: bool = False,
    controller: str | None = None,
    task: str | None = None,
    env: Sequence[tuple[str, Any]] = (),
    env_id: str = "NPendulum-v0",
    episodes: int = 100,
    seed: int | None = None,
    engine: Literal["npend", "mujoco"] = "npend",
    robust: bool = False,
    scores: bool = False,
    as_json: bool = False,
    out: Path | None = None,
) -> int:
    """Evaluate and report; return the exit code.

    Parameters
    ----------
    policy : policy, optional
        The name of a policy in the package, or a file (.safetensors).
    trust : bool
        Allow the file to import a mode of your own, package.module:Class.
    controller : name, optional
        A controller in place of a policy: LQR, MPC, damping, energy or plan.
    task : task, optional
        Task of the controller, such as balance-3 (default swingup-2).
    env : setting, optional
        A keyword of the environment, such as damping=0.05; may be repeated.
    env_id : id
        Id of the environment, such as npend/SwingUp-v1.
    engine : name
        Simulator of the chain: this package (npend), or MuJoCo.
    robust : bool
        Try wrong models, noise, delay, lag and pushes, and print the share survived.
    scores : bool
        Print RealAIGym's scores of the swing-up and of recovery from disturbances.
    as_json : bool
        Print everything as JSON.
    out : folder, optional
        Write evaluation.json, manifest.json, and with --robust robustness.json and a figure there.
    """
    import gymnasium as gym

    from npend_gym import _files, rl
    from npend_gym._provenance import provenance
    from npend_gym.chain import plain_keywords
    from npend_gym.export import in_mujoco
    from npend_gym.report import robustness_report as report
    from npend_gym.rl.evaluation.settings import setting_of
    from npend_gym.rl.policies.shipped import policy_path

    if robust and engine == "mujoco":
        raise ValueError("--robust must be left out with --engine mujoco, which has ideal motors")
    if out is not None:
        prepare_results(out, "npend evaluate")
    figures = out is not None and robust and can_draw()
    seed = rl.HELD_OUT if seed is None else seed
    changed = [key for key, _ in env if policy is not None]
    try:
        name, model, keywords = chosen(policy, controller, task, dict(env), env_id, trust=trust)
        evaluated: Any = keywords | {"id": env_id}
        threshold = setting_of(evaluated).reward_threshold
    except gym.error.Error as error:
        raise ValueError(f"--env-id must name an environment: {error}") from error
    if engine == "mujoco":
        evaluated = in_mujoco(evaluated)
    row = rl.evaluate(model, evaluated, episodes=episodes, seed=seed).as_row()
    made: dict[str, Any] = {"controller": controller, "task": task or _TASK}
    if policy is not None:
        made = {"policy": policy, "sha256": _files.sha256(policy_path(policy))}
    made |= {"env": plain_keywords(keywords), "env_id": env_id, "episodes": episodes}
    made |= {"engine": engine, "seed": seed}
    about = {"name": name, "provenance": provenance(made, seed)}
    result: dict[str, Any] = about | {"evaluation": row}
    if row["success"] == 0.0:
        failure = f"{name} succeeds in no episode"
        if changed:
            failure += f": --env gives it another {', '.join(changed)} than it was made for"
        warn(failure + ("; no criterion can be survived more often" if robust else ""))
    text = [report.evaluation_text(row, threshold)]
    if scores:
        for score in (rl.performance, rl.recovery):
            found = score(model, evaluated, seed=seed).as_row()
            result[score.__name__] = found
            rest = ", ".join(f"{key} {value:g}" for key, value in found.items() if key != "score")
            text.append(f"{score.__name__} {found['score']:.3f}: {rest}")
    if robust:
        show = progress("criteria")
        tried = rl.robustness(model, evaluated, seed=seed, progress=show).as_dict()
        result["robustness"] = tried
        text.append(report.robustness_text(tried))
    with finishing():
        print(json.dumps(result, indent=2, allow_nan=False) if as_json else "\n\n".join(text))
        if out is not None:
            written = report.write_evaluation(result, out, figures=figures)
            if not as_json:
                show_written(written, figures=robust)
    return OK


def chosen(
    policy: str | None,
    controller: str | None,
    task: str | None,
    env: dict[str, Any],
    env_id: str = "NPendulum-v0",
    *,
    trust: bool,
) -> tuple[str, Controller, dict[str, Any]]:
    """Return name, policy or controller, and keywords of the environment of this id."""
    from npend_gym.rl.controllers.references import reference_controller
    from npend_gym.rl.policies.shipped import find_policy
    from npend_gym.rl.training.tasks import env_of_task

    if (policy is None) == (controller is None):
        raise ValueError("give either a policy, or --controller with its --task")
    refuse_said(env, ("id",), "--env-id")
    if controller is not None:
        task = task or _TASK
        refuse_said(env, ("n", "mode"), f"--task {task}")
        keywords = {**env_of_task(task), **env}
        made = reference_controller(controller, keywords | {"id": env_id}, progress("plans"))
        return f"{controller} in {task}", made, keywords
    if task is not None:
        raise ValueError("--task is for a --controller: a policy knows its environment")
    loaded = find_policy(str(policy), trust=trust)
    return Path(str(policy)).stem, loaded, {**loaded.env, **env}


def refuse_said(env: Mapping[str, Any], names: Sequence[str], task: str) -> None:
    """Refuse keywords of these names, which the name of the `task` says."""
    from npend_gym import _checks

    for name in names:
        if name in env:
            value = _checks.show(env[name])
            raise ValueError(f"--env {name} must be left out, {task} says it; got {value}")
