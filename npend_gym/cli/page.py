"""Show a release in the browser: one HTML file, which needs neither network nor server.

It has the motion of the chains, the pseudo-period of every bob as it completes, and the
pseudo-period against N with the models. For pendulums to play with see `npend play`.

Examples
--------
  npend page -o release.html               the paper's N = 5, 10, 20, 100, three trials
  npend page -n 1,2,3,4 --trials 1 --spread 0 -o few.html
  npend page results -o release.html       what `npend release -o results` measured
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from npend_gym.cli.common import OK, prepare_file, progress, show_file
from npend_gym.cli.options import spelled

FILLS = {"npend_gym.experiments.release:ReleaseExperiment": ()}


def run(results: Path | None = None, *, out: Path, **release: Any) -> int:
    """Measure or read, and write the page; return the exit code.

    Parameters
    ----------
    results : folder, optional
        What `npend release --out FOLDER` measured, which is shown instead of measuring.
    out : file
        File to write, .html; folders that are missing are made.
    """
    from npend_gym.experiments import ReleaseExperiment, run_release
    from npend_gym.recording import record_first_trials
    from npend_gym.report import player, release_page, release_tables

    if results is not None and release:
        option = spelled(next(iter(release)))
        raise ValueError(f"{option} must be left out with results, which have their own")
    runs = None
    if results is not None:
        experiment, runs = release_tables.read(results)
    else:
        experiment = ReleaseExperiment(**release)
    prepare_file(out, player.SUFFIXES)
    runs = runs or run_release(experiment, progress("release"))
    recordings = record_first_trials(experiment, runs, progress("recording"))
    player.write(out, release_page.page(experiment, runs, recordings))
    show_file(out)
    return OK
