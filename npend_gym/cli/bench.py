"""`npend bench`: how fast the package is beside its peers on this machine."""

from __future__ import annotations

import argparse
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from npend_gym.cli.common import FAILED, INTERRUPTED, OK, can_draw, show_written, warn

_SUITES = ("dynamics", "environments", "episodes", "derivatives", "accuracy", "chaos",
           "ensembles", "gpu")  # fmt: skip
_FOLDER = Path(__file__).parents[2] / "benchmarks"  # in the repository, not in the wheel
ABOUT = """\
Ratios to MuJoCo, Gymnasium's own environments, envpool, SciPy and heyoka, as far as they are
installed, timed in turns in one run on one core. Each row is explained in benchmarks/README.md.
The measurements are in that folder, so the command works in the source tree of the package.
"""
EXAMPLES = """\
examples:
  npend bench                              everything, some minutes
  npend bench --only environments --out results
  npend bench --only dynamics --json       for a script
  npend bench --only gpu                   on an NVIDIA GPU, with the extra "cuda"
  pip install "npend-gym[bench]" envpool heyoka    more peers
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `npend bench`."""
    text = "one suite (all)"
    parser.add_argument("--only", choices=_SUITES, metavar="|".join(_SUITES), help=text)
    text = "print the rows as JSON at the end; meanwhile they go to the error stream"
    parser.add_argument("--json", action="store_true", help=text)
    text = "write a CSV file for each suite, and the work-precision diagram, there"
    parser.add_argument("--out", type=Path, metavar="FOLDER", help=text)


def run(options: dict[str, Any]) -> int:
    """Measure and print, row by row; return the exit code."""
    from npend_gym.report import outputs

    if not (_FOLDER / "suites").is_dir():
        warn(
            f"npend bench: there is no {_FOLDER}: the benchmarks come with the source tree only. "
            'Get it and run pip install -e ".[bench]" there'
        )
        return FAILED
    sys.path.insert(0, str(_FOLDER))
    output: Any = import_module("suites.output")
    timing: Any = import_module("suites.timing")
    out: Path | None = options.get("out")
    only: str | None = options.get("only")
    as_json: bool = options.get("json", False)
    if out is not None:
        outputs.prepare_folder(out)
    lines = sys.stderr if as_json else sys.stdout
    print(timing.machine(), file=lines)
    written: list[Path] = []
    tables: dict[str, list[dict[str, Any]]] = {}
    code = OK
    peers = timing.Peers(warn)
    for suite in _SUITES if only is None else [only]:
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
        print(outputs.json_text({"only": only}, **tables))
    elif written:
        show_written(written)
    return code
