"""The figure of a controller's robustness: the share survived, and every value that was tried."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from npend_gym._palette import BLUE, FAINT, INK
from npend_gym.report.style import styled

LABELS = {
    "model": "wrong model",
    "velocity_noise": "velocity noise",
    "torque_noise": "torque noise",
    "motor_lag": "motor lag",
    "delay": "delay",
    "pushes": "pushes",
    "angle_noise": "angle noise",
    "angle_resolution": "angle resolution",
}
UNITS = {
    "masses": "kg", "lengths": "m", "centres": "m", "inertias": "kg m²", "damping": "N m s",
    "friction": "N m", "armature": "kg m²", "drag": "N s/m", "quadratic_drag": "N s²/m²",
}  # fmt: skip


@styled
def robustness_figure(result: Mapping[str, Any], title: str = "") -> Figure:
    """Draw the shares as bars, and beside them the values of each parameter that were survived.

    `result` is what `npend_gym.rl.Robustness.as_dict` returns.
    """
    outcomes: Mapping[str, Any] = result["outcomes"]
    rows = _rows(outcomes)
    figure = Figure(figsize=(9.2, max(3.0, 1.2 + 0.24 * len(rows))))
    bars, strips = figure.subplots(1, 2, width_ratios=(1.0, 1.6))
    _draw_bars(bars, {name: result[name] for name in outcomes})
    _draw_strips(strips, rows)
    name = f"{title}: score" if title else "score"
    figure.suptitle(f"{name} {result['score']:.3f}", fontweight="bold")
    return figure


def _draw_bars(axes: Any, shares: Mapping[str, float]) -> None:
    """Draw a bar for every criterion, the first one above."""
    places = -np.arange(len(shares), dtype=float)
    axes.barh(places, [1.0] * len(shares), color=FAINT, alpha=0.3, height=0.66)
    axes.barh(places, list(shares.values()), color=BLUE, height=0.66)
    for place, share in zip(places, shares.values(), strict=True):
        inside = share > 0.8
        axes.text(
            share + (-0.02 if inside else 0.02), place, f"{share:.0%}", va="center",
            ha="right" if inside else "left", color="white" if inside else INK,
        )  # fmt: skip
    axes.set_yticks(places, [LABELS.get(name, name) for name in shares])
    axes.set(xlim=(0.0, 1.0), xlabel="share survived")
    axes.tick_params(left=False)


def _rows(outcomes: Mapping[str, Any]) -> list[tuple[str, list[bool]]]:
    """Return a label and what was survived, from the least to the largest value, of every row."""
    rows: list[tuple[str, list[bool]]] = []
    for outcome in outcomes.values():
        names: list[str] = outcome["parameters"]
        for name in dict.fromkeys(names):
            own = [k for k, other in enumerate(names) if other == name]
            values = [outcome["values"][k] for k in own]
            kind, bracket, rod = name.partition("[")
            what = f"{LABELS.get(kind, kind)}{bracket}{rod}"
            unit = UNITS.get(kind, outcome["unit"])
            ends = f"{min(values):.3g} to {max(values):.3g} {unit}".strip()
            label = f"{len(own)} pushed rollouts" if name == "pushes" else f"{what}, {ends}"
            rows.append((label, [outcome["survived"][k] for k in own]))
    return rows


def _draw_strips(axes: Any, rows: list[tuple[str, list[bool]]]) -> None:
    """Draw a row of cells for every parameter, filled where the value was survived."""
    for place, (_, survived) in enumerate(rows):
        width = 1.0 / len(survived)
        colors = [BLUE if cell else "white" for cell in survived]
        axes.bar(
            width * np.arange(len(survived)), 0.7, width, bottom=-place - 0.35, align="edge",
            color=colors, edgecolor=FAINT, linewidth=0.4,
        )  # fmt: skip
    axes.set_yticks(-np.arange(len(rows)), [label for label, _ in rows], fontsize="small")
    axes.set(xlim=(0.0, 1.0), ylim=(-len(rows) + 0.4, 0.6), xticks=[])
    axes.set_xlabel("values tried, from the least to the largest; blue: survived")
    axes.tick_params(left=False)
    axes.spines[:].set_visible(False)
