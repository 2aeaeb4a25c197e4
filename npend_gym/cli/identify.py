"""`npend identify`: a chain from measured motion."""

from __future__ import annotations

import argparse
import json
import warnings
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from npend_gym.cli.common import (
    CHAIN_OPTION,
    OK,
    can_draw,
    numbers,
    show_written,
    warn,
)

if TYPE_CHECKING:
    from npend_gym.identification import Motion

ABOUT = """\
Fits inertia, lift (mass times lever), damping, friction and drag of each link to measured angles,
with standard errors; segments that were not fitted judge the result. The CSV files have columns
time [s], theta0, theta1, ... [rad, absolute, 0 where it hangs], and may have tau0, ... [N m] and
piece, the number of the recording. See docs/howto/real_pendulum.md.
"""
EXAMPLES = """\
examples:
  npend identify motion.csv --lengths 0.17,0.23 --masses 0.1,0.14 --centres 0.11,0.12
  npend identify examples/data/multiarm_double.csv --chain "multiarm 2"
  npend identify first.csv second.csv --chain robot.json --segment 1 --json
  npend identify encoders.csv --lengths 0.2,0.3 --degrees --relative
  npend identify log.csv --lengths 0.2,0.3 --columns "time=t [s],theta0=q1,theta1=q2,tau0=motor"
"""


def _names(text: str) -> list[str]:
    return text.split(",")


def _columns(text: str) -> dict[str, str]:
    """Return what "time=t,theta0=q1" means."""
    pairs = [pair.partition("=") for pair in text.split(",")]
    if not all(name and sign and column for name, sign, column in pairs):
        raise argparse.ArgumentTypeError(f"must be like time=t,theta0=q1, got {text!r}")
    return {name.strip(): column.strip() for name, _, column in pairs}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `npend identify`."""
    parser.add_argument("files", type=Path, nargs="+", metavar="FILE", help="CSV files")
    option, field, kind, placeholder, _ = CHAIN_OPTION
    text = "what is known, in place of the four options below: a preset's name or a JSON file"
    parser.add_argument(option, dest=field, type=kind, metavar=placeholder, help=text)
    text = "length of each link, from joint to joint"
    parser.add_argument("--lengths", type=numbers, metavar="M,...", help=text)
    text = "mass of each link (default 1)"
    parser.add_argument("--masses", type=numbers, metavar="KG,...", help=text)
    text = "distance of each link's centre of mass from its upper joint (default its length: a bob)"
    parser.add_argument("--centres", type=numbers, metavar="M,...", help=text)
    text = "acceleration of gravity (default 9.81)"
    parser.add_argument("--gravity", type=float, metavar="M/S2", help=text)
    text = (
        "what to fit: inertia, lift, damping, friction, drag, quadratic_drag, armature, length, "
        "offset (default the first four and quadratic_drag; with torques armature)"
    )
    parser.add_argument("--fit", type=_names, metavar="NAME,...", help=text)
    text = "longest time that is simulated from one first state (default: four periods)"
    parser.add_argument("--segment", type=float, metavar="S", help=text)
    text = "share of the segments that judge the fit (default 0.25)"
    parser.add_argument("--held-out", type=float, metavar="SHARE", help=text)
    text = "what the columns are called in the files, where it is not as above"
    parser.add_argument("--columns", type=_columns, metavar="NAME=COLUMN,...", help=text)
    parser.add_argument("--degrees", action="store_true", help="the angles are in degrees")
    text = "each angle is relative to the link above: that of the joint"
    parser.add_argument("--relative", action="store_true", help=text)
    parser.add_argument("--json", action="store_true", help="print everything as JSON")
    text = "write fit.json (the chain), identification.json, residuals.csv and figures there"
    parser.add_argument("--out", type=Path, metavar="FOLDER", help=text)


def run(options: dict[str, Any]) -> int:
    """Read, fit and report; return the exit code."""
    from npend_gym.identification.fit import Problem
    from npend_gym.report import identification_report as report
    from npend_gym.report import outputs

    out: Path | None = options.pop("out", None)
    as_json: bool = options.pop("json", False)
    with _warnings_in_lines():
        motion = _read(options)
        problem = Problem(motion, _known(options), **options)
        if out is not None:
            outputs.prepare_folder(out)
        result = problem.solve()
    if as_json:
        print(json.dumps(result.as_dict(), indent=2, allow_nan=False))
    else:
        print(report.identification_text(result))
    if out is not None:
        written = report.write_identification(result, motion, out, figures=can_draw())
        if not as_json:
            show_written(written)
    return OK


@contextmanager
def _warnings_in_lines() -> Generator[None, None, None]:
    """Print each warning as one line, at once: what follows may take minutes."""

    def show(message: Warning | str, *_: Any) -> None:
        warn(f"npend identify: {message}")

    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        warnings.showwarning = show
        yield


def _read(options: dict[str, Any]) -> Motion:
    """Return the motion in the files."""
    from npend_gym.identification import read_motion

    names = ("columns", "degrees", "relative")
    given = {name: options.pop(name) for name in names if name in options}
    return read_motion(*options.pop("files"), **given)


def _known(options: dict[str, Any]) -> Any:
    """Take what is known of the chain out of the options."""
    names = ("lengths", "masses", "centres", "gravity")
    single = {name: options.pop(name) for name in names if name in options}
    if "chain" in options:
        if single:
            raise ValueError(f"--{next(iter(single))} must be left out with --chain, which has it")
        return options.pop("chain")
    if "lengths" not in single:
        raise ValueError("--lengths or --chain must be given: angles do not tell lengths")
    return {"masses": 1.0} | single
