"""`python -m paper`: every finding, table and figure of the study, and the law of the chain."""

from __future__ import annotations

from argparse import SUPPRESS
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from npend_gym import IntegrationError
from npend_gym.report import json_text
from npend_gym.tools import (
    FAILED,
    INTERRUPTED,
    OK,
    Parser,
    angles,
    can_draw,
    check_threads,
    dispatch,
    integers,
    open_closed_streams,
    prepare_results,
    progress,
    show_written,
    warn,
)
from paper import law_tables, report
from paper.claims import claims
from paper.com_law import LawCell, LawGrid, law_rows, limit_rows
from paper.findings import KANE_N, Finding, audit, groups, selected

PROGRAM = "python -m paper"
_STOPPED = "interrupted: the results above are complete, the rest is missing"
LAW = "com-law"  # the key of the law of the centre of mass
# Options of what is computed, and its key
OPTIONS = dict.fromkeys(("full", "n", "amplitudes", "threads"), LAW) | {"kane_n": "run-time"}
ABOUT = """\
Every equation, number and claim of the source paper, computed again and judged. All of it takes
about four minutes, most single findings take seconds: `python -m paper --list` shows their keys.

The key com-law compares the law T(N, a) = 0.8223 2 pi sqrt((N + 1/2) l/g) (2/pi) K(sin(a/2)) of
the centre of mass of N equal rods, released straight from the angle a, with simulation: its error
at every N and a, and the limits of small angles.
"""
EXAMPLES = """\
examples:
  python -m paper --out results                findings.csv, audit.md, tables and figures
  python -m paper --only eom,series-value      two findings
  python -m paper --only series-value --json   for a script
  python -m paper --only chaos                 those of one module, `paper.checks.chaos`
  python -m paper --only run-time --kane-n 12  Kane's method on more rods; 12 take minutes
  python -m paper --only com-law --n 2,3 --amplitudes 0.5,1
  python -m paper --only com-law --full        N = 1 to 1600, up to 1.2 rad; half an hour
"""


def command() -> Parser:
    """Return the parser of the command line."""
    parser = Parser(prog=PROGRAM, description=ABOUT, epilog=EXAMPLES, argument_default=SUPPRESS)
    text = "findings, by their keys, or modules, or com-law (all)"
    parser.add_argument("--only", type=_names, metavar="KEY,KEY,...", help=text)
    parser.add_argument("--list", action="store_true", help="list the keys and exit")
    parser.add_argument("--json", action="store_true", help="print the results as JSON")
    text = (
        "write findings.csv, audit.md, tables, figures and manifest.json there, and law.csv, "
        "limits.csv and manifest.json of the law in its folder com-law"
    )
    parser.add_argument("--out", type=Path, metavar="FOLDER", help=text)
    text = "largest chain whose equations Kane's method derives (6)"
    parser.add_argument("--kane-n", type=int, metavar="N", help=text)
    law = parser.add_argument_group("of the law")
    text = "N = 1 to 1600, sixteen angles"
    law.add_argument("--full", action="store_true", help=text)
    law.add_argument("--n", type=integers, metavar="N,N,...", help="numbers of pendulums")
    text = "starting angles of all rods"
    law.add_argument("--amplitudes", type=angles, metavar="RAD,...", help=text)
    law.add_argument("--threads", type=int, metavar="COUNT", help="threads (default 1)")
    return parser


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",")]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    open_closed_streams()
    parser = command()
    options, unknown = parser.parse_known_args(argv)
    if unknown:
        parser.refuse(unknown)
    return dispatch(parser, run, vars(options))


def run(options: dict[str, Any]) -> int:
    """Compute what is asked for, print it and write it; return the exit code."""
    if options.get("list", False):
        for section, found in groupby(claims().values(), lambda claim: claim.section):
            print(section, *(f"  {one.key:20} {groups()[one.key]}" for one in found), sep="\n")
        print("Our own", f"  {LAW}", sep="\n")
        return OK
    wanted: list[str] | None = options.get("only")
    only = wanted and [key for key in wanted if key != LAW]
    keys = selected(only) if only != [] else []
    computed = {*keys} if wanted is not None and LAW not in wanted else {*keys, LAW}
    for name, key in OPTIONS.items():
        if name in options and key not in computed:
            option = name.replace("_", "-")
            raise ValueError(f"--{option} is an option of {key}, which --only leaves out")
    grid = LawGrid.full() if options.get("full") else LawGrid()
    grid = LawGrid(options.get("n", grid.n_values), options.get("amplitudes", grid.amplitudes))
    threads, kane_n = check_threads(options.get("threads", 1)), options.get("kane_n", KANE_N)
    pending = audit(keys, kane_n=kane_n)
    out: Path | None = options.get("out")
    if out is not None:
        prepare_results(out, PROGRAM)
    findings: list[Finding] = []
    cells: list[LawCell] = []
    limits: list[dict[str, Any]] = []
    code, trouble = OK, ""
    try:
        findings.extend(progress("findings", len(keys))(pending))
        if LAW in computed:
            for n in progress("chains")(list(dict.fromkeys(grid.n_values))):
                measured, small = grid.measure(n, threads), limit_rows([n])
                cells, limits = cells + measured, limits + small
    except KeyboardInterrupt:
        code, trouble = INTERRUPTED, _STOPPED
    except (ImportError, IntegrationError) as error:
        code, trouble = FAILED, f"{PROGRAM}: {error}"
    if options.get("json", False) and (findings or cells):
        arguments = {"only": wanted, "kane_n": kane_n} | (grid.as_dict() if cells else {})
        tables = {"findings": report.audit_rows(findings), "law": law_rows(cells), "limits": limits}
        print(json_text(arguments, **{name: rows for name, rows in tables.items() if rows}))
    elif findings or cells:
        texts = [report.audit_text(findings)] if findings else []
        print(*texts, *([law_tables.law_text(cells, limits)] if cells else []), sep="\n\n")
    written: list[Path] = []
    if cells and out is not None:
        written += law_tables.write_law(grid, cells, limits, out / LAW, complete=code == OK)
    if findings and out is not None:
        try:
            report.write(findings, out, written, only=only, kane_n=kane_n, figures=can_draw(),
                         interrupted=code == INTERRUPTED)  # fmt: skip
        except KeyboardInterrupt:
            code, trouble = INTERRUPTED, _STOPPED
    if written and "json" not in options:
        show_written(written, figures=bool(findings) and code != INTERRUPTED)
    if trouble:
        warn(trouble)
    return code


if __name__ == "__main__":
    raise SystemExit(main())
