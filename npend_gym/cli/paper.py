"""`npend paper`: reproduce and audit the source paper."""

from __future__ import annotations

import argparse
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from npend_gym.cli.common import FAILED, INTERRUPTED, OK, can_draw, progress, show_written, warn

if TYPE_CHECKING:
    from npend_gym.paper import Finding

ABOUT = """\
Every equation, number and claim of the source paper, computed again and judged. All of it takes
some six minutes, most single findings take seconds: `npend paper --list` shows their keys.
"""
EXAMPLES = """\
examples:
  npend paper --out results                findings.csv, audit.md, tables and figures
  npend paper --only eom,series-value      two findings
  npend paper --only series-value --json   for a script
  npend paper --only chaos                 those of one module, `npend_gym.paper.checks.chaos`
  npend paper --only run-time --kane-n 12  Kane's method on more rods; 12 take minutes
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `npend paper`."""
    text = "findings, by their keys, or modules (all)"
    parser.add_argument("--only", type=_names, metavar="KEY,KEY,...", help=text)
    parser.add_argument("--list", action="store_true", help="list the keys and exit")
    parser.add_argument("--json", action="store_true", help="print the findings as JSON")
    text = "write findings.csv, audit.md, tables, figures and manifest.json there"
    parser.add_argument("--out", type=Path, metavar="FOLDER", help=text)
    text = "largest chain whose equations Kane's method derives (6)"
    parser.add_argument("--kane-n", type=int, metavar="N", help=text)


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",")]


def run(options: dict[str, Any]) -> int:
    """Audit the paper; return the exit code."""
    from npend_gym import paper
    from npend_gym.paper import report
    from npend_gym.paper.claims import claims
    from npend_gym.paper.findings import groups
    from npend_gym.physics import IntegrationError
    from npend_gym.report import outputs

    out: Path | None = options.get("out")
    only, kane_n = options.get("only"), options.get("kane_n", paper.KANE_N)
    as_json: bool = options.get("json", False)
    if options.get("list", False):
        for section, found in groupby(claims().values(), lambda claim: claim.section):
            print(section, *(f"  {one.key:20} {groups()[one.key]}" for one in found), sep="\n")
        return OK
    keys = paper.selected(only)
    pending = paper.audit(only, kane_n=kane_n)
    if out is not None:
        outputs.prepare_folder(out)
    findings: list[Finding] = []
    code, trouble = OK, ""
    try:
        findings.extend(progress("finding", len(keys))(pending))
    except KeyboardInterrupt:
        code = INTERRUPTED
        trouble = "interrupted: the findings above are complete, the rest is missing"
    except (ImportError, IntegrationError) as error:
        code, trouble = FAILED, f"npend paper: {error}"
    if findings and as_json:
        rows = report.audit_rows(findings)
        print(outputs.json_text({"only": only, "kane_n": kane_n}, findings=rows))
    elif findings:
        print(report.audit_text(findings))
    if findings and out is not None:
        written = report.write(findings, out, only=only, kane_n=kane_n, figures=can_draw())
        if not as_json:
            show_written(written)
    if trouble:
        warn(trouble)
    return code
