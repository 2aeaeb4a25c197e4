"""The paper's experiment: release chains from rest, and time every bob.

The pseudo-period of every bob of N equal pendulums is measured, averaged and compared with the
models. The page has the motion of the chains, the pseudo-period of every bob as it completes, and
the pseudo-period against N with the models; it is one file, which needs neither network nor server.

Examples
--------
  npend release -o results                 the paper's N = 5, 10, 20, 100, three trials
  npend release -n 1,2,3 --trials 1 --spread 0
  npend release -n 100 --duration 10       the paper's window
  npend release -n 5 --json                for a script
  npend release -n 3 --masses 1,2,0.5 --lengths 1,0.5,0.25
  npend release --chain "multiarm 3" --amplitude 0.5
  npend release -n 20 --sensor-interval 0.01 --sensor-offset 0.02
  npend release -n 1,2,3,4 --page few.html
  npend release results --page all.html    what `npend release -o results` measured
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from npend_gym.cli.common import (
    INTERRUPTED,
    OK,
    can_draw,
    finishing,
    prepare_results,
    progress,
    refuse_unused,
    show_file,
    show_written,
    warn,
)
from npend_gym.cli.options import spelled

if TYPE_CHECKING:
    from npend_gym.experiments import Run

FILLS = {"npend_gym.experiments.release:ReleaseExperiment": ()}


def run(
    results: Path | None = None,
    *,
    as_json: bool = False,
    out: Path | None = None,
    page: Path | None = None,
    **release: Any,
) -> int:
    """Run the experiment; return the exit code.

    Parameters
    ----------
    results : folder, optional
        A folder of `npend release --out FOLDER`: show its results instead of measuring.
    as_json : bool
        Print the summary and its provenance as JSON.
    out : folder, optional
        Write tables (CSV), release.json, manifest.json and figures there, in place of older ones.
    page : file, optional
        Write a page for the browser, with the motions, to this .html file.
    """
    from npend_gym.experiments import ReleaseExperiment, measure
    from npend_gym.recording import record_first_trials
    from npend_gym.report import player, prepare_file, release_page
    from npend_gym.report import release_tables as report

    runs: list[Run] = []
    interrupted = False
    if results is not None:
        given = {spelled(name): value for name, value in release.items()}
        refuse_unused(given, "with results, which have their own")
        experiment, runs = report.read(results)
        if len(runs) < (planned := len(experiment.runs())):
            warn(f"{results} has {len(runs)} of {planned} releases: the run was interrupted")
    else:
        experiment = ReleaseExperiment(**release)
    if page is not None:
        prepare_file(page, player.SUFFIXES, "page")
    if out is not None:
        prepare_results(out, "npend release")
    figures = out is not None and can_draw()
    try:
        for one in progress("releases")([] if runs else experiment.runs()):
            runs.append(measure(experiment, *one))
    except KeyboardInterrupt:
        interrupted = True
    with finishing():
        if runs:
            show = report.summary_json if as_json else report.summary_text
            print(show(experiment, runs))
        if runs and out is not None:
            written = report.write(experiment, runs, out, figures=figures)
            if not as_json:
                show_written(written)
    if page is not None and not interrupted:
        recordings = record_first_trials(experiment, runs, progress("chains"))
        player.write(page, release_page.page(experiment, runs, recordings))
        if not as_json:
            show_file(page)
    if interrupted:
        done = "the runs above are complete, the rest is missing"
        warn(f"interrupted: {done if runs else 'nothing was measured'}")
        return INTERRUPTED
    return OK
