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
    _add_release(commands.add_parser("release", **_RELEASE_HELP))
    arguments = parser.parse_args(argv)
    return _release(arguments, commands.choices["release"])


_RELEASE_HELP = {
    "help": "release chains from rest and measure the pseudo-period of every bob",
    "description": "The paper's experiment: chains of N equal pendulums are released from rest, "
    "the pseudo-period of every bob is measured, averaged and compared with the models.",
    "epilog": "examples:\n"
    "  npend release --out results              the paper's N = 5, 10, 20, 100, three trials\n"
    "  npend release --n 1,2,3 --trials 1 --spread 0\n"
    "  npend release --n 100 --duration 10      the paper's window\n"
    "  npend release --n 3 --masses 1,2,0.5 --lengths 1,0.5,0.25",
}


def _numbers(text: str) -> float | list[float]:
    values = [float(part) for part in text.split(",")]
    return values if len(values) > 1 else values[0]


def _counts(text: str) -> list[int]:
    return [int(part) for part in text.split(",")]


_numbers.__name__, _counts.__name__ = "number or list", "list of integers"  # for error messages


def _add_release(parser: argparse.ArgumentParser) -> None:
    from npend_gym.experiments.release import Release
    from npend_gym.period import READINGS

    default = Release()
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    add = parser.add_argument
    add(
        "--n",
        type=_counts,
        default=list(default.n_values),
        metavar="N,N,...",
        help="numbers of pendulums (5,10,20,100)",
    )
    add("--trials", type=int, default=default.trials, help="trials for each N (%(default)s)")
    add(
        "--amplitude",
        type=float,
        default=default.amplitude,
        metavar="RAD",
        help="starting angle of all rods (pi/4)",
    )
    add(
        "--spread",
        type=float,
        default=default.spread,
        metavar="RAD",
        help="a trial adds one draw from [0, spread) to all rods (%(default)s)",
    )
    add("--seed", type=int, default=default.seed, help="seed of the draws (%(default)s)")
    add(
        "--duration",
        type=float,
        metavar="S",
        help="window; the paper's is 10 (until every bob has completed)",
    )
    add(
        "--reading",
        choices=READINGS,
        default=default.reading,
        help="what completes a pseudo-period (%(default)s)",
    )
    add(
        "--masses",
        type=_numbers,
        default=1.0,
        metavar="KG[,KG...]",
        help="mass of the bobs, one or per rod (1)",
    )
    add(
        "--lengths",
        type=_numbers,
        default=1.0,
        metavar="M[,M...]",
        help="length of the rods, one or per rod (1)",
    )
    add("--gravity", type=float, default=default.gravity, metavar="M/S2", help="(%(default)s)")
    add(
        "--damping",
        type=float,
        default=default.damping,
        metavar="NMS",
        help="viscous damping of every joint (%(default)s)",
    )
    add("--out", type=Path, metavar="FOLDER",
        help="write periods.csv, summary.csv, manifest.json and figures there")  # fmt: skip


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
        plan = Release(n_values=given.pop("n"), **given)
        if out is not None:
            report.prepare_folder(out)
    except (ValueError, TypeError) as error:
        parser.error(str(error))
    try:
        # disable=None: no bar where the output is not a terminal
        for run in tqdm(plan.runs(), unit="release", disable=None, leave=False):
            runs.append(measure(plan, *run))
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
