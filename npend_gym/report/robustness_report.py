"""Evaluations as text and files: success, scores, and what a controller survives."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from npend_gym.report.outputs import write_figure, write_json


def evaluation_text(row: Mapping[str, Any], threshold: float | None = None) -> str:
    """Return the row of an `Evaluation` as lines of text; from `threshold` on a task is solved."""
    episodes, rate = row["episodes"], row["success"]
    interval = f"{row['success_low']:.1%} to {row['success_high']:.1%} (Wilson)"
    solved = "" if threshold is None else f", solved from {threshold:g} on"
    lines = [
        f"success  {round(episodes * rate)}/{episodes} = {rate:.1%}, 95 % confidence {interval}",
        f"return   {row['return']:.2f} in the mean{solved}",
        f"work     {row['motor_work']:.2f} J done by or on the motors in an episode",
    ]
    if row["settling_time"] is not None:
        lines.insert(1, f"success from {row['settling_time']:.2f} s on, in successful episodes")
    return "\n".join(lines)


def robustness_text(result: Mapping[str, Any]) -> str:
    """Return what `npend_gym.rl.Robustness.as_dict` has as a table."""
    outcomes: Mapping[str, Any] = result["outcomes"]
    lines = [f"{'criterion':16}{'survived':>10}{'values':>8}"]
    for name, outcome in outcomes.items():
        lines.append(f"{name:16}{result[name]:10.1%}{len(outcome['values']):8}")
    return "\n".join([*lines, f"{'score':16}{result['score']:10.3f}"])


def write_robustness(
    result: Mapping[str, Any], out: Path, *, title: str = "", figure: bool = True
) -> list[Path]:
    """Write `robustness.json`, and the figure `robustness.png`; return their paths."""
    written = [write_json(out / "robustness.json", result)]
    if figure:
        from npend_gym.report.robustness_figures import robustness_figure

        written.append(write_figure(out / "robustness.png", robustness_figure(result, title)))
    return written
