"""How fast and how accurate the package is beside its peers on this machine.

    python benchmarks/peers.py                              all suites, some minutes
    python benchmarks/peers.py --only environments -o results
    python benchmarks/peers.py --only dynamics --json       for a script
    python benchmarks/peers.py --only gpu                   on an NVIDIA GPU, with the extra "cuda"

Ratios to MuJoCo, Gymnasium's own environments, envpool, SciPy and heyoka, as far as they are
installed, timed in turns in one run on one core. README.md explains each row.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from suites import output, timing

from npend_gym.report import json_text, prepare_folder
from npend_gym.tools import INTERRUPTED, OK, Parser, can_draw, dispatch, show_written, warn

SUITES = ("dynamics", "environments", "episodes", "derivatives", "accuracy", "chaos",
          "ensembles", "start", "gpu")  # fmt: skip


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and print, row by row; return the exit code."""
    parser = Parser(prog="benchmarks/peers.py", description=__doc__)
    parser.add_argument("--only", choices=SUITES, metavar="|".join(SUITES), help="one suite (all)")
    text = "print the rows as JSON at the end; meanwhile they go to the error stream"
    parser.add_argument("--json", action="store_true", help=text)
    text = "write a CSV file for each suite, and the work-precision diagram, there"
    parser.add_argument("-o", "--out", type=Path, metavar="FOLDER", help=text)
    return dispatch(parser, _run, vars(parser.parse_args(argv)))


def _run(options: dict[str, Any]) -> int:
    out, only, as_json = options["out"], options["only"], options["json"]
    if out is not None:
        prepare_folder(out)
    lines = sys.stderr if as_json else sys.stdout
    print(timing.machine(), file=lines)
    written: list[Path] = []
    tables: dict[str, list[dict[str, Any]]] = {}
    code = OK
    peers = timing.Peers(warn)
    for suite in SUITES if only is None else [only]:
        done: list[Any] = []
        try:
            for result in import_module(f"suites.{suite}").rows(peers):
                done.append(result)
                print(output.line(result), file=lines, flush=True)
        except KeyboardInterrupt:
            code = INTERRUPTED
        tables[suite] = output.table(done)
        if out is not None and done:
            written += output.write(suite, done, out, figures=can_draw())
        if code == INTERRUPTED:
            warn("interrupted: the rows above are complete, the rest is missing")
            break
    if as_json:
        print(json_text({"only": only}, **tables))
    elif written:
        show_written(written)
    return code


if __name__ == "__main__":
    if code := main():
        raise SystemExit(code)
