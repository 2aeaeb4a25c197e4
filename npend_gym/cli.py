"""The command line, `npend ...`: arguments, progress, printing; no physics.

Exit codes: 0 done, 1 the work failed, 2 bad arguments, 130 interrupted (what was done is kept).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from tqdm import tqdm

from npend_gym._version import __version__

if TYPE_CHECKING:
    from npend_gym.experiments.release import Release, Run

OK, FAILED, BAD_ARGUMENTS, INTERRUPTED = 0, 1, 2, 130


class _Parser(argparse.ArgumentParser):
    """An argument parser that says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(BAD_ARGUMENTS, f"{self.prog}: error: {message}\n")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = _Parser(prog="npend", description="The N-pendulum: release it, measure it.")
    parser.add_argument("--version", action="version", version=f"npend_gym {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    _add_release(commands.add_parser("release", help=_RELEASE_SUMMARY))
    arguments = parser.parse_args(argv)
    return _release(arguments, commands.choices["release"])


def _numbers(text: str) -> float | list[float]:
    values = [float(part) for part in text.split(",")]
    return values if len(values) > 1 else values[0]


def _counts(text: str) -> list[int]:
    return [int(part) for part in text.split(",")]


_numbers.__name__, _counts.__name__ = "number or list", "list of integers"  # for error messages

_RELEASE_SUMMARY = "release chains from rest and measure the pseudo-period of every bob"
_RELEASE_ABOUT = """\
The paper's experiment: chains of N equal pendulums are released from rest, the pseudo-period of
every bob is measured, averaged and compared with the models.
"""
_RELEASE_EXAMPLES = """\
examples:
  npend release --out results              the paper's N = 5, 10, 20, 100, three trials
  npend release --n 1,2,3 --trials 1 --spread 0
  npend release --n 100 --duration 10      the paper's window
  npend release --n 3 --masses 1,2,0.5 --lengths 1,0.5,0.25
"""
# Option, field of Release that it sets, type, placeholder, help
_RELEASE_OPTIONS = (
    ("--n", "n_values", _counts, "N,N,...", "numbers of pendulums (5,10,20,100)"),
    ("--trials", "trials", int, "COUNT", "trials for each N (3)"),
    ("--amplitude", "amplitude", float, "RAD", "starting angle of all rods (pi/4)"),
    ("--spread", "spread", float, "RAD", "a trial adds one draw from [0, RAD) to all rods (0.017)"),
    ("--seed", "seed", int, "SEED", "seed of the draws (0)"),
    ("--duration", "duration", float, "S", "window, the paper's is 10 (until all have completed)"),
    ("--masses", "masses", _numbers, "KG[,KG...]", "mass of the bobs, one or per rod (1)"),
    ("--lengths", "lengths", _numbers, "M[,M...]", "length of the rods, one or per rod (1)"),
    ("--gravity", "gravity", float, "M/S2", "acceleration of gravity (9.81)"),
    ("--damping", "damping", float, "NMS", "viscous damping of every joint (0)"),
)


def _add_release(parser: argparse.ArgumentParser) -> None:
    from npend_gym.experiments.release import Release
    from npend_gym.period import READINGS

    default = Release()
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description, parser.epilog = _RELEASE_ABOUT, _RELEASE_EXAMPLES
    for option, field, kind, placeholder, text in _RELEASE_OPTIONS:
        parser.add_argument(
            option, dest=field, type=kind, default=getattr(default, field),
            metavar=placeholder, help=text,
        )  # fmt: skip
    text = "what completes a pseudo-period (bob)"
    parser.add_argument("--reading", choices=READINGS, default=default.reading, help=text)
    text = "write periods.csv, summary.csv, manifest.json and figures there"
    parser.add_argument("--out", type=Path, metavar="FOLDER", help=text)


def _release(arguments: argparse.Namespace, parser: argparse.ArgumentParser) -> int:
    from npend_gym.experiments.release import Release, measure
    from npend_gym.physics.simulate import IntegrationError
    from npend_gym.report import release as report

    given = vars(arguments)
    out: Path | None = given.pop("out")
    del given["command"]
    runs: list[Run] = []
    interrupted = False
    try:
        plan = Release(**given)
        if out is not None:
            report.prepare_folder(out)
    except (ValueError, TypeError) as error:
        parser.error(str(error))
    try:
        # disable=None: no bar where the output is not a terminal
        for run in tqdm(plan.runs(), unit="release", disable=None, leave=False):
            runs.append(measure(plan, *run))  # noqa: PERF401 - kept when interrupted
    except KeyboardInterrupt:
        interrupted = True
    except (IntegrationError, ValueError) as error:
        print(f"npend release: {error}", file=sys.stderr)
        return FAILED
    if runs:
        print(report.summary_text(plan, runs))
    if runs and out is not None:
        _write(plan, runs, out)
    if interrupted:
        print("interrupted: the runs above are complete, the rest is missing", file=sys.stderr)
        return INTERRUPTED
    return OK


def _write(plan: Release, runs: list[Run], out: Path) -> None:
    from npend_gym.report import release as report

    figures = find_spec("matplotlib") is not None
    written = report.write(plan, runs, out, figures=figures)
    print("\nwritten:", *(str(path) for path in written), sep="\n  ")
    if not figures:
        print('no figures: they need matplotlib, pip install "npend-gym[plot]"', file=sys.stderr)
