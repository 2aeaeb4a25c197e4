"""`npend page`: a release in the browser, in one file."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from npend_gym.cli.common import (
    FAILED,
    INTERRUPTED,
    OK,
    add_release_options,
    prepare_file,
    printable,
    progress,
    tell,
)

if TYPE_CHECKING:
    from npend_gym.experiments.release import Release, Run

SUMMARY = "show a release in the browser: one HTML file that needs no network"
_ABOUT = """\
One HTML file with the motion of the chains, the pseudo-period of every bob as it completes, and
the pseudo-period against N with the models. It needs neither network nor server.
"""
_EXAMPLES = """\
examples:
  npend page --out release.html            the paper's N = 5, 10, 20, 100, three trials
  npend page --n 1,2,3,4 --trials 1 --spread 0 --out few.html
  npend page --from results --out release.html     what `npend release --out results` measured
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `npend page`."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description, parser.epilog = _ABOUT, _EXAMPLES
    add_release_options(parser)
    text = "results of `npend release --out FOLDER`, in place of a release of its own"
    parser.add_argument("--from", dest="folder", type=Path, metavar="FOLDER", help=text)
    text = "file to write, .html"
    parser.add_argument("--out", type=Path, metavar="FILE", required=True, help=text)


def run(given: dict[str, Any], parser: argparse.ArgumentParser) -> int:
    """Measure or read, and write the page; return the exit code."""
    from npend_gym.physics import IntegrationError
    from npend_gym.report import page

    out: Path = given.pop("out")
    try:
        prepare_file(out, page.SUFFIXES)
        plan, runs = _measured(given, parser)
        page.write(plan, runs, out, progress("recording"))
    except (ValueError, TypeError) as error:
        parser.error(str(error))
    except KeyboardInterrupt:
        tell("interrupted: nothing was written")
        return INTERRUPTED
    except IntegrationError as error:
        tell(f"npend page: {error}")
        return FAILED
    print(printable(str(out)) + f": {out.stat().st_size / 1e6:.2f} MB")
    return OK


def _measured(given: dict[str, Any], parser: argparse.ArgumentParser) -> tuple[Release, list[Run]]:
    from npend_gym.experiments.release import Release, run_release
    from npend_gym.report import release as report

    folder = given.pop("folder")
    if folder is None:
        plan = Release(**given)
        return plan, run_release(plan, progress("release"))
    foreign = [name for name, value in given.items() if value != parser.get_default(name)]
    if foreign:
        raise ValueError(f"{foreign[0]} cannot be given with --from, whose results have their own")
    return report.read(folder)
