"""`npend page`: a release in the browser, in one file."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from npend_gym.cli.common import OK, add_release_options, prepare_file, printable, progress

if TYPE_CHECKING:
    from npend_gym.experiments import ReleaseExperiment, Run

ABOUT = """\
One HTML file with the motion of the chains, the pseudo-period of every bob as it completes, and
the pseudo-period against N with the models. It needs neither network nor server.

For pendulums to play with see `npend play`.
"""
EXAMPLES = """\
examples:
  npend page --out release.html            the paper's N = 5, 10, 20, 100, three trials
  npend page --n 1,2,3,4 --trials 1 --spread 0 --out few.html
  npend page --from results --out release.html     what `npend release --out results` measured
"""
_SUFFIXES = (".html",)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `npend page`."""
    add_release_options(parser)
    text = "show the results of `npend release --out FOLDER` instead of measuring"
    parser.add_argument("--from", dest="folder", type=Path, metavar="FOLDER", help=text)
    parser.add_argument("--live", action="store_true", help=argparse.SUPPRESS)  # `npend play` now
    text = "file to write, .html; folders that are missing are made"
    parser.add_argument("--out", type=Path, metavar="FILE", required=True, help=text)


def run(options: dict[str, Any]) -> int:
    """Measure or read, and write the page; return the exit code."""
    out: Path = options.pop("out")
    if options.pop("live", False):
        raise ValueError(f"--live is a command of its own: npend play --out {out}")
    _write_release(out, options)
    print(printable(str(out)) + f": {out.stat().st_size / 1e6:.2f} MB")
    return OK


def _write_release(out: Path, options: dict[str, Any]) -> None:
    from npend_gym.recording import record_first_trials
    from npend_gym.report import player, release_page

    experiment, runs = _measured(out, options)
    recordings = record_first_trials(experiment, runs, progress("recording"))
    player.write(out, release_page.page(experiment, runs, recordings))


def _measured(out: Path, options: dict[str, Any]) -> tuple[ReleaseExperiment, list[Run]]:
    """Return results that `out` is to show, measured or read; it is made ready as options are."""
    from npend_gym.experiments import ReleaseExperiment, run_release
    from npend_gym.report import release_tables as report

    if "folder" not in options:
        experiment = ReleaseExperiment(**options)
        prepare_file(out, _SUFFIXES)
        return experiment, run_release(experiment, progress("release"))
    folder = options.pop("folder")
    if options:
        name = "n" if "n_values" in options else next(iter(options))
        raise ValueError(f"--{name} must be left out with --from: the results have their own")
    read = report.read(folder)
    prepare_file(out, _SUFFIXES)
    return read
