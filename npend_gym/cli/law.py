"""`npend law`: the law of the centre of mass against simulation."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from npend_gym.cli.common import (
    INTERRUPTED,
    OK,
    angles,
    integers,
    prepare_results,
    progress,
    show_written,
    thread_count,
    warn,
)

if TYPE_CHECKING:
    from npend_gym.experiments import LawCell

ABOUT = """\
The law T(N, a) = 0.8223 2 pi sqrt((N + 1/2) l/g) (2/pi) K(sin(a/2)) of the centre of mass of N
equal rods, released straight from the angle a, against simulation: its error at every N and a. The
same for the limits of small angles: the period of the slowest mode, and the exact profile.
"""
EXAMPLES = """\
examples:
  npend law                                N = 1 to 20, in seconds
  npend law --full --out results           N = 1 to 1600, up to 1.2 rad; half an hour
  npend law --n 2,3 --amplitudes 0.5,1
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `npend law`."""
    text = "N = 1 to 1600, sixteen angles"
    parser.add_argument("--full", action="store_true", help=text)
    parser.add_argument("--n", type=integers, metavar="N,N,...", help="numbers of pendulums")
    text = "starting angles of all rods"
    parser.add_argument("--amplitudes", type=angles, metavar="RAD,...", help=text)
    parser.add_argument("--threads", type=int, metavar="COUNT", help="threads (default 1)")
    text = "print the tables and their provenance as JSON"
    parser.add_argument("--json", action="store_true", help=text)
    text = "write law.csv, limits.csv and manifest.json there"
    parser.add_argument("--out", type=Path, metavar="FOLDER", help=text)


def run(options: dict[str, Any]) -> int:
    """Measure, print and write; return the exit code."""
    import numpy as np

    from npend_gym.experiments import LawGrid, limit_rows
    from npend_gym.report import law_tables

    grid = LawGrid.full() if options.get("full") else LawGrid()
    grid = LawGrid(
        options.get("n", grid.n_values), np.ravel(options.get("amplitudes", grid.amplitudes))
    )
    threads = thread_count(options)
    out: Path | None = options.get("out")
    if out is not None:
        prepare_results(out, "npend law")
    cells: list[LawCell] = []
    code = OK
    try:
        for n in progress("chain")(grid.n_values):
            cells += grid.measure(n, threads)
    except KeyboardInterrupt:
        code = INTERRUPTED
    if cells:
        limits = limit_rows(list(dict.fromkeys(cell.n for cell in cells)))
        as_json = options.get("json", False)
        print(
            law_tables.law_json(grid, cells, limits)
            if as_json
            else law_tables.law_text(cells, limits)
        )
        if out is not None:
            written = law_tables.write_law(grid, cells, limits, out, complete=code == OK)
            if not as_json:
                show_written(written, figures=False)
    if code == INTERRUPTED:
        warn("interrupted: the chains above are complete, the rest is missing")
    return code
