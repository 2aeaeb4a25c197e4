"""`npend release`: the paper's experiment."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from npend_gym.cli.common import (
    INTERRUPTED,
    OK,
    add_release_options,
    can_draw,
    prepare_results,
    progress,
    show_written,
    warn,
)

if TYPE_CHECKING:
    from npend_gym.experiments import Run

ABOUT = """\
The paper's experiment: chains of N equal pendulums are released from rest, the pseudo-period of
every bob is measured, averaged and compared with the models.
"""
EXAMPLES = """\
examples:
  npend release --out results              the paper's N = 5, 10, 20, 100, three trials
  npend release --n 1,2,3 --trials 1 --spread 0
  npend release --n 100 --duration 10      the paper's window
  npend release --n 5 --json               for a script
  npend release --n 3 --masses 1,2,0.5 --lengths 1,0.5,0.25
  npend release --chain "multiarm 3" --amplitude 0.5
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `npend release`."""
    add_release_options(parser)
    text = "print the summary and its provenance as JSON"
    parser.add_argument("--json", action="store_true", help=text)
    text = (
        "write tables (CSV), release.json, manifest.json and figures there, in place of older ones"
    )
    parser.add_argument("--out", type=Path, metavar="FOLDER", help=text)


def run(options: dict[str, Any]) -> int:
    """Run the experiment; return the exit code."""
    from npend_gym.experiments import ReleaseExperiment, measure
    from npend_gym.report import release_tables as report

    out: Path | None = options.pop("out", None)
    as_json: bool = options.pop("json", False)
    runs: list[Run] = []
    interrupted = False
    experiment = ReleaseExperiment(**options)
    if out is not None:
        prepare_results(out, "npend release")
    try:
        for one in progress("release")(experiment.runs()):
            runs.append(measure(experiment, *one))  # noqa: PERF401 - kept when interrupted
    except KeyboardInterrupt:
        interrupted = True
    if runs:
        print(
            report.summary_json(experiment, runs)
            if as_json
            else report.summary_text(experiment, runs)
        )
    if runs and out is not None:
        written = report.write(experiment, runs, out, figures=can_draw())
        if not as_json:
            show_written(written)
    if interrupted:
        warn("interrupted: the runs above are complete, the rest is missing")
        return INTERRUPTED
    return OK
