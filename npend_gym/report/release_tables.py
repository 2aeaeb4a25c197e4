"""The release experiment on paper: a table for the terminal, CSV files, a manifest, figures."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from npend_gym import _checks, _files
from npend_gym.experiments import ReleaseExperiment, Run, bob_rows, summary_rows
from npend_gym.report.outputs import json_text, write_results

COLUMNS = (  # of the summary: title, unit, width as text
    ("N", "", 4), ("measured", "s", 9), ("over bobs", "s", 10), ("over trials", "s", 12),
    ("completed", "", 10), ("T0", "s", 8), ("T0+a", "s", 8), ("T1", "s", 8), ("e(T0)", "", 7),
    ("e(T0+a)", "", 8), ("e(T1)", "", 6), ("com", "s", 9), ("T(N,a)", "s", 8), ("e", "", 7),
)  # fmt: skip


LEGEND = """\
measured: mean pseudo-period [s] over bobs and trials, definition "{definition}", seed {seed};
it includes the bobs near the pivot that complete half a swing early; com is the whole chain's
T0: the paper's 2 pi N / sum sqrt(g m/(l M)), for point masses; T0+a: times its corrected series
T1: period of the slowest normal mode; e: |measured - model| / measured
com: measured, of the centre of mass; T(N,a): 0.8223 2 pi sqrt((N + 1/2) l/g) times the corrected
series (unequal rods: the exact period of small swings times it); e: between these two"""


def summary_text(experiment: ReleaseExperiment, runs: Sequence[Run]) -> str:
    """Return the table of `summary_rows` as text, with a legend."""
    titles = [title for title, _, _ in COLUMNS]
    table = [titles, *map(summary_cells, summary_rows(experiment, runs))]
    widths = [width for _, _, width in COLUMNS]
    lines = ["".join(f"{c:>{w}}" for c, w in zip(row, widths, strict=True)) for row in table]
    return "\n".join([*lines, "", legend(experiment)])


# What a reader must know of a definition beside the models, which are of whole swings
_NOTES = {"height": "height: one pendulum is back at its height after half of its period"}
_AROUND = "a start beyond 90 degrees: bobs and com reverse around the pivot"
_NOTES_BEYOND = {
    "bob": _AROUND,
    "com": _AROUND,
    "horizontal": "horizontal: from beyond 90 degrees one pendulum completes in half of its period",
}


def legend(experiment: ReleaseExperiment) -> str:
    """Text on the columns, and on the sensor that measured the bobs, if one did."""
    definition = experiment.definition
    lines = [LEGEND.format(definition=definition, seed=experiment.seed)]
    beyond = abs(experiment.amplitude) + experiment.spread > 0.5 * math.pi
    notes = _NOTES | _NOTES_BEYOND if beyond else _NOTES
    lines += [notes[definition]] if definition in notes else []
    sensor = experiment.sensor
    if sensor.interval > 0.0:
        lines.append(
            f"sensor: a sample every {sensor.interval:g} s, noise {sensor.noise:g}, offset "
            f'{sensor.offset:g}, scale {sensor.scale:g}; com is exact but for definition "com"'
        )
    return "\n".join(lines)


def summary_cells(row: Mapping[str, Any]) -> list[str]:
    """Return a row of `summary_rows` as texts, one for each of `COLUMNS`."""
    return [
        f"{row['n']}",
        _seconds(row["measured_s"]),
        _spread(row["bob_spread_s"]),
        _spread(row["trial_spread_s"]),
        f"{row['completed']}/{row['bobs']}",
        _seconds(row["ideal_s"]),
        _seconds(row["corrected_s"]),
        _seconds(row["fundamental_s"]),
        *(_percent(row[f"{key}_error"]) for key in ("ideal", "corrected", "fundamental")),
        _seconds(row["com_s"]),
        _seconds(row["law_s"]),
        _percent(row["law_error"], 2),
    ]


def summary_json(experiment: ReleaseExperiment, runs: Sequence[Run]) -> str:
    """Return `summary_rows` and their provenance as JSON; NaN becomes null."""
    return json_text(experiment.as_dict(), summary=summary_rows(experiment, runs))


def _seconds(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.4f}"


def _spread(value: float) -> str:
    return "-" if math.isnan(value) else f"+- {value:.4f}"


def _percent(value: float, digits: int = 1) -> str:
    digits = digits if value < 1.0 else 0
    return "-" if math.isnan(value) else f"{100 * value:.{digits}f}%"


def write(
    experiment: ReleaseExperiment, runs: Sequence[Run], out: Path, *, figures: bool
) -> list[Path]:
    """Write tables, manifest and (with `figures`) pictures into `out`; return what was written."""
    drawn: dict[str, Any] = {}
    if figures:
        from npend_gym.report import release_figures as draw  # matplotlib, an extra

        drawn["period_against_n"] = partial(draw.period_against_n, experiment, runs)
        drawn["period_of_each_bob"] = partial(draw.period_of_each_bob, experiment, runs)
    arguments = experiment.as_dict()
    return write_results(
        out, "release", arguments, complete=len(runs) == len(experiment.runs()),
        records={"release": arguments}, figures=drawn,
        tables={"periods": bob_rows(runs), "summary": summary_rows(experiment, runs)},
    )  # fmt: skip


def read(folder: Path) -> tuple[ReleaseExperiment, list[Run]]:
    """Read what `write` wrote to `folder`: the release and its runs, to the last bit.

    Raises
    ------
    ValueError
        If the folder holds no results of a release, or they have been changed since.
    """
    try:
        manifest = _files.parse_json(_files.read_text(folder / "manifest.json"))
        if manifest["experiment"] != "release":
            raise ValueError(
                f"its manifest.json is that of {_checks.show(manifest['experiment'])}, which was "
                "written there later: release into a folder of its own"
            )
        digests = manifest["sha256"]
        for name in ("release.json", "periods.csv"):
            if digests[name] != _files.sha256(folder / name):
                raise ValueError(f"{name} has been changed since")
        described = _files.parse_json(_files.read_text(folder / "release.json"))
        experiment = ReleaseExperiment(**described)
        return experiment, _read_runs(folder / "periods.csv", experiment)
    except (OSError, KeyError, TypeError, ValueError, csv.Error) as error:
        raise ValueError(
            f"{folder} must hold results that `npend release --out` has written: {error}"
        ) from error


def _read_runs(path: Path, experiment: ReleaseExperiment) -> list[Run]:
    """Return the runs in a table of periods, each of which must be of `experiment`."""
    periods: dict[tuple[int, int, float], list[float]] = {}
    com: dict[tuple[int, int, float], float] = {}
    low, high = experiment.amplitude, experiment.amplitude + experiment.spread
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            key = (int(row["n"]), int(row["trial"]), float(row["start_rad"]))
            own = periods.setdefault(key, [])
            own.append(float(row["pseudo_period_s"]))
            com[key] = float(row["com_s"])
            known = key[0] in experiment.n_values and 1 <= key[1] <= experiment.trials
            timed = all(math.isnan(t) or 0.0 < t <= _checks.LARGEST for t in (own[-1], com[key]))
            if not (known and low <= key[2] <= high and len(own) <= key[0] and timed):
                raise ValueError(f"periods.csv has a row of no such release: {_checks.show(row)}")
    if any(len(own) != n for (n, _, _), own in periods.items()):
        raise ValueError("periods.csv must have a row for every bob")
    if len({key[:2] for key in periods}) < len(periods) or not periods:
        raise ValueError("periods.csv must have each trial once")
    return [Run(*key, np.array(values), com[key]) for key, values in periods.items()]
