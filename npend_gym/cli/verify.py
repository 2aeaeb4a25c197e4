"""`npend verify`: whether this machine computes the same bits as the committed digests."""

from __future__ import annotations

import argparse
import json
from typing import Any

from npend_gym.cli.common import FAILED, OK, warn

ABOUT = """\
Runs everything that is compiled for a short time, and compares the SHA-256 of the results with the
digests in the package. Exit code 1 if one byte differs.
"""
EXAMPLES = """\
examples:
  npend verify
  npend verify --json > verified.json
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `npend verify`."""
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")


def run(options: dict[str, Any]) -> int:
    """Compare, and print each check when it is done; return the exit code."""
    from npend_gym._provenance import machine
    from npend_gym.digests import Outcome, outcomes

    as_json = options.get("json", False)
    done: list[Outcome] = []
    for outcome in outcomes():
        done.append(outcome)
        if not as_json:
            verdict = "same" if outcome.same else "DIFFERS"
            print(f"{outcome.name:32}{verdict:9}{outcome.found[:16]}", flush=True)
    differing = [outcome.name for outcome in done if not outcome.same]
    if as_json:
        checks = [outcome._asdict() | {"same": outcome.same} for outcome in done]
        print(json.dumps({"machine": machine(), "same": not differing, "checks": checks}, indent=2))
    else:
        print(f"\n{len(done) - len(differing)} of {len(done)} the same; {machine()}")
    if differing:
        warn(f"npend verify: these differ: {'; '.join(differing)}")
    return FAILED if differing else OK
