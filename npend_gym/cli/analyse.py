"""`npend analyse`: fits and statistics of a campaign's results."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from npend_gym.cli.common import OK, can_draw, show_written, warn

ABOUT = """\
The period against N and the amplitude is fitted with confidence intervals, see docs/campaigns.md.
It uses the tasks that are finished, while a campaign runs or after it.
"""
EXAMPLES = """\
examples:
  npend analyse results                    tables, figures and report.html in results/analysis
  npend analyse results --out elsewhere
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `npend analyse`."""
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="a campaign's folder")
    text = "where to write (default FOLDER/analysis)"
    parser.add_argument("--out", type=Path, metavar="FOLDER", help=text)


def run(options: dict[str, Any]) -> int:
    """Analyse, print and write; return the exit code."""
    from npend_gym.experiments import analyse
    from npend_gym.report.campaign_report import analysis_text, write_analysis

    result = analyse(options["folder"])
    text = result.status.text()
    print(analysis_text(result))
    if text:
        warn(text)
    out = options.get("out", result.out / "analysis")
    show_written(write_analysis(result, out, figures=can_draw()))
    return OK
