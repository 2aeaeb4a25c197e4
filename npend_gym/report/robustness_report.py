"""Evaluations as text and files: success, scores, and what a controller survives."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from npend_gym.report.outputs import write_results


def evaluation_text(row: Mapping[str, Any], threshold: float | None = None) -> str:
    """Return the row of an `Evaluation` as lines of text; from `threshold` on a task is solved."""
    episodes, rate = row["episodes"], row["success"]
    success = f"success  none: the mode defines neither achieved nor failed; {episodes} episodes"
    if rate is not None:
        interval = f"{row['success_low']:.1%} to {row['success_high']:.1%} (Wilson)"
        share = f"{round(episodes * rate)}/{episodes} = {rate:.1%}"
        success = f"success  {share}, 95 % confidence {interval}"
    solved = "" if threshold is None else f", solved from {threshold:g} on"
    lines = [
        success,
        f"return   {row['return']:.2f} in the mean{solved}",
        f"work     {row['motor_work']:.2f} J done by or on the motors in an episode",
    ]
    if row["settling_time"] is not None:
        lines.insert(1, f"success from {row['settling_time']:.2f} s on, in successful episodes")
    return "\n".join(lines)


def robustness_text(result: Mapping[str, Any]) -> str:
    """Table of the numbers of `npend_gym.rl.Robustness.as_dict`."""
    outcomes: Mapping[str, Any] = result["outcomes"]
    lines = [f"{'criterion':16}{'survived':>10}{'values':>8}"]
    for name, outcome in outcomes.items():
        lines.append(f"{name:16}{result[name]:10.1%}{len(outcome['values']):8}")
    return "\n".join([*lines, f"{'score':16}{result['score']:10.3f}"])


def write_evaluation(result: Mapping[str, Any], out: Path, *, figures: bool) -> list[Path]:
    """Write what `npend evaluate` found into `out`; return what was written.

    ``robustness.json`` has what was survived, with `figures` ``robustness.png`` shows it, and
    ``evaluation.json`` has the rest.
    """
    name, tried = result["name"], result.get("robustness")
    records = {"evaluation": {key: result[key] for key in result if key != "robustness"}}
    drawn: dict[str, Any] = {}
    if tried is not None:
        records["robustness"] = {"name": name} | tried
    if tried is not None and figures:
        from npend_gym.report.robustness_figures import robustness_figure

        drawn["robustness"] = partial(robustness_figure, tried, name)
    return write_results(
        out, "evaluation", result["provenance"]["arguments"], complete=True,
        records=records, figures=drawn,
    )  # fmt: skip
