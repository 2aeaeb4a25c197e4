"""Check that this machine computes the same bits as others.

Runs every compiled function for a short time, and compares the SHA-256 of the results with the
digests in the package. The exit code is 1 if a byte differs.

Examples
--------
  npend verify
  npend verify --json > verified.json
"""

from __future__ import annotations

import json

from npend_gym.cli.common import FAILED, OK, warn


def run(*, as_json: bool = False) -> int:
    """Compare, and print each check when it is done; return the exit code.

    Parameters
    ----------
    as_json : bool
        Print JSON instead of a table.
    """
    from npend_gym._provenance import machine
    from npend_gym.digests import Digest, outcomes

    done: list[Digest] = []
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
