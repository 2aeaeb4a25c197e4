"""`npend verify`: whether this machine computes the same bits as the one of the makers."""

from __future__ import annotations

import argparse
import json
from typing import Any

from npend_gym.cli.common import FAILED, OK, tell

SUMMARY = "check that this machine computes the very same bits"
_ABOUT = """\
Short runs of everything that is compiled, and the SHA-256 of their results beside those committed
with the package. Exit code 1 if a byte differs anywhere.
"""
_EXAMPLES = """\
examples:
  npend verify
  npend verify --json > verified.json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `npend verify`."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description, parser.epilog = _ABOUT, _EXAMPLES
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")


def run(given: dict[str, Any], parser: argparse.ArgumentParser) -> int:
    """Compare, and print each check as it comes; return the exit code."""
    del parser
    from npend_gym._machine import machine
    from npend_gym.experiments.verify import Outcome, outcomes

    done: list[Outcome] = []
    for outcome in outcomes():
        done.append(outcome)
        if not given["json"]:
            verdict = "same" if outcome.same else "DIFFERS"
            print(f"{outcome.name:32}{verdict:9}{outcome.found[:16]}", flush=True)
    differing = [outcome.name for outcome in done if not outcome.same]
    if given["json"]:
        checks = [outcome._asdict() | {"same": outcome.same} for outcome in done]
        print(json.dumps({"machine": machine(), "same": not differing, "checks": checks}, indent=2))
    else:
        print(f"\n{len(done) - len(differing)} of {len(done)} the same; {machine()}")
    if differing:
        tell(f"npend verify: these differ: {'; '.join(differing)}")
    return FAILED if differing else OK
