"""`npend bench`: how fast the package is beside its peers on this machine."""

from __future__ import annotations

import argparse
import sys
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from npend_gym.bench import SUITES
from npend_gym.cli.common import INTERRUPTED, OK, can_draw, show_written, tell

if TYPE_CHECKING:
    from npend_gym.bench.accuracy import Point
    from npend_gym.bench.timing import Row

SUMMARY = "measure speed and accuracy beside the peers that are installed"
_ABOUT = """\
Ratios to MuJoCo, Gymnasium's own environments, envpool, SciPy and heyoka, as far as they are
installed, timed in turns in one run on one core. Each row is explained in benchmarks/README.md.
"""
_EXAMPLES = """\
examples:
  npend bench                              everything, some minutes
  npend bench --only environments --out results
  npend bench --only dynamics --json       for a script
  pip install "npend-gym[bench]" envpool heyoka    more peers
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `npend bench`."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description, parser.epilog = _ABOUT, _EXAMPLES
    text = "one suite (all)"
    parser.add_argument("--only", choices=SUITES, metavar="|".join(SUITES), help=text)
    text = "print the rows as JSON in the end; those that come go to the error stream"
    parser.add_argument("--json", action="store_true", help=text)
    text = "write a CSV file for each suite, and the work-precision diagram, there"
    parser.add_argument("--out", type=Path, metavar="FOLDER", help=text)


def run(given: dict[str, Any], parser: argparse.ArgumentParser) -> int:
    """Measure and print, row by row; return the exit code."""
    from npend_gym.bench.timing import machine
    from npend_gym.report import bench as report
    from npend_gym.report import outputs

    out: Path | None = given["out"]
    try:
        if out is not None:
            outputs.prepare_folder(out)
    except ValueError as error:
        parser.error(str(error))
    lines = sys.stderr if given["json"] else sys.stdout
    print(machine(), file=lines)
    written: list[Path] = []
    tables: dict[str, list[dict[str, Any]]] = {}
    code = OK
    for suite in SUITES if given["only"] is None else [given["only"]]:
        done: list[Row | Point] = []
        try:
            for result in import_module(f"npend_gym.bench.{suite}").rows():
                done.append(result)
                print(report.line(result), file=lines, flush=True)
        except KeyboardInterrupt:
            code = INTERRUPTED
        tables[suite] = report.table(done)
        if out is not None and done:
            written += report.write(suite, done, out, figures=can_draw())
        if code == INTERRUPTED:
            tell("interrupted: the rows above are complete, the rest is missing")
            break
    if given["json"]:
        print(outputs.json_text({"only": given["only"]}, **tables))
    elif written:
        show_written(written)
    return code
