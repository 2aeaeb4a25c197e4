"""`npend bench`: how fast the package is beside its peers on this machine."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, TextIO

from npend_gym.bench import SUITES
from npend_gym.cli.common import INTERRUPTED, OK, can_draw, show_written

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
        done, interrupted = _measure(suite, lines)
        tables[suite] = _report().table(done)
        if out is not None and done:
            written += _write(suite, done, out)
        if interrupted:
            print("interrupted: the rows above are complete, the rest is missing", file=sys.stderr)
            code = INTERRUPTED
            break
    if given["json"]:
        print(outputs.json_text({"only": given["only"]}, **tables))
    elif written:
        show_written(written)
    return code


def _measure(suite: str, lines: TextIO) -> tuple[list[Any], bool]:
    """Print the results of a suite as they come; return them, and whether it was interrupted."""
    module, report = import_module(f"npend_gym.bench.{suite}"), _report()
    results: Iterator[Any] = module.points() if suite == "accuracy" else module.rows()
    text: Callable[[Any], str] = report.point_text if suite == "accuracy" else report.row_text
    done: list[Any] = []
    try:
        for result in results:
            done.append(result)
            print(text(result), file=lines, flush=True)
    except KeyboardInterrupt:
        return done, True
    return done, False


def _write(suite: str, done: list[Any], out: Path) -> list[Path]:
    report = _report()
    if suite == "accuracy":
        return report.write_points(done, out, figures=can_draw())
    return report.write_rows(suite, done, out)


def _report() -> Any:
    from npend_gym.report import bench

    return bench
