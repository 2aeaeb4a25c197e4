"""A release in the browser: one HTML file that needs neither network nor server."""

from __future__ import annotations

import html
import math
import shlex
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from npend_gym import theory
from npend_gym._provenance import provenance
from npend_gym.chain import Chain, preset_name
from npend_gym.experiments import ReleaseExperiment, Run, summary_rows
from npend_gym.recording import Recording
from npend_gym.report import player
from npend_gym.report.release_tables import COLUMNS, legend, summary_cells

_SCRIPTS = "player.js", "diagram.js", "periods.js", "page.js"


def page(
    experiment: ReleaseExperiment, runs: Sequence[Run], recordings: Sequence[Recording]
) -> str:
    """Return the page as text: the animation of `recordings`, and what all `runs` measured."""
    rows = summary_rows(experiment, runs)
    data = {
        "provenance": provenance(experiment.as_dict(), experiment.seed),
        "releases": [_recorded(experiment, recording) for recording in recordings],
        "law": _law(experiment, runs, rows),
    }
    n_values = ", ".join(str(row["n"]) for row in rows)
    start, spread = math.degrees(experiment.amplitude), math.degrees(experiment.spread)
    trials = f"{experiment.trials} trials" if experiment.trials > 1 else "one trial"
    measured, planned = f"{trials} for each N", len(experiment.runs())
    if len(runs) < planned:
        measured = f"{len(runs)} of {planned} releases: the run was interrupted"
    texts = {
        "title": f"Release of N = {n_values} pendulum{'s' * (n_values != '1')}",
        "about": f"Released from rest at {start:.4g} degrees plus up to {spread:.3g} degrees; "
        f'definition "{experiment.definition}", seed {experiment.seed}, {measured}. '
        "The animation shows the first.",
        "legend": legend(experiment),
        "command": command(experiment),
    }
    heads = [f"{title} [{unit}]" if unit else title for title, unit, _ in COLUMNS]
    return player.page(
        "page.html",
        data,
        _SCRIPTS,
        **{name: html.escape(text) for name, text in texts.items()},
        playback=player.playback("Pendulums"),
        summary=player.table(heads, map(summary_cells, rows)),
    )


def command(experiment: ReleaseExperiment) -> str:
    """Return the `npend release` command that measures `experiment`.

    A chain that is no preset stands in the file chain.json, as `Chain.as_dict` gives it.
    """
    default, words = ReleaseExperiment().as_dict(), ["npend release"]
    values = experiment.as_dict()
    if isinstance(experiment.chain, Chain):
        words += ["--chain", shlex.quote(preset_name(experiment.chain) or "chain.json")]
        del values["chain"]
    for name, value in values.items():
        if value is not None and value != default[name]:
            option = "--n" if name == "n_values" else f"--{name.replace('_', '-')}"
            words += [option, ",".join(str(one) for one in np.atleast_1d(value).tolist())]
    return " ".join(words)


def _models(experiment: ReleaseExperiment, n: int, start: float) -> dict[str, float]:
    """Return the models of the pseudo-period [s] that have a scale; none has without gravity."""
    values = zip(player.MODELS, theory.models(experiment.chain_of(n), start), strict=True)
    return {name: value for name, value in values if math.isfinite(value)}


def _recorded(experiment: ReleaseExperiment, recording: Recording) -> dict[str, Any]:
    motion, n = recording.motion, recording.motion.chain.n
    start = float(motion.theta[0, 0])
    size = player.extent(motion.chain, motion.positions())
    cart = None if motion.chain.base is None else recording.cart() / size
    return {
        "label": f"{n}, from {math.degrees(start):.4g} degrees",
        **player.moving(
            recording.positions() / size, float(motion.times[1]), player.centres(motion), cart
        ),
        "periods": [float(t) if math.isfinite(t) else None for t in recording.periods],
        "models": {
            name: {"value": value, **player.MODELS[name]}
            for name, value in _models(experiment, n, start).items()
        },
    }


def _law(
    experiment: ReleaseExperiment, runs: Sequence[Run], rows: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    """Return the diagram of the pseudo-period against N: its series and the ranges of its axes."""
    n_values: list[int] = sorted(row["n"] for row in rows)
    grid = n_values
    if experiment.has_any_n:
        between = np.geomspace(n_values[0], n_values[-1], 40)
        grid = sorted({*between.round().astype(int).tolist(), *n_values})
    curves = {n: _models(experiment, n, experiment.amplitude) for n in grid}
    series: list[dict[str, Any]] = [
        {
            "name": name, "kind": "line", **look,
            "points": [[n, values[name]] for n, values in curves.items() if name in values],
        }
        for name, look in player.MODELS.items()
        if any(name in values for values in curves.values())
    ]  # fmt: skip
    bobs = [(run, f"bob {k}", float(t)) for run in runs for k, t in enumerate(run.periods, start=1)]
    means = [(run, "mean", run.mean) for run in runs]
    centres = [(run, "centre of mass", run.com) for run in runs]
    blue, pink = {"color": "blue", "kind": "points"}, {"color": "pink", "kind": "points"}
    series += [
        {"name": "each bob", "points": _finite(bobs), **blue, "style": "small"},
        {"name": "mean of a trial", "points": _finite(means), **blue, "style": ""},
        {"name": "centre of mass", "points": _finite(centres), **pink, "style": "ring"},
    ]
    heights = [point[1] for one in series for point in one["points"]] or [1.0]
    axis = {"log": True}
    return {
        "series": series,
        "x": {"low": 0.8 * min(grid), "high": 1.25 * max(grid), "marks": n_values, **axis},
        "y": {"low": 0.8 * min(heights), "high": 1.25 * max(heights), **axis},
    }


def _finite(measured: Sequence[tuple[Run, str, float]]) -> list[list[Any]]:
    """Return the points of the diagram, for finite values: N, the value [s], what is said of it."""
    return [
        [run.n, value, f"N = {run.n}, trial {run.trial}, {name}: {value:.4f} s"]
        for run, name, value in measured
        if math.isfinite(value)
    ]
