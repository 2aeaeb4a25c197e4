"""Write a policy for programs that are not Python.

A C99 header needs no library and allocates nothing: it builds observations of measured angles and
velocities, and acts. See docs/howto/export.md.

Examples
--------
  npend export swingup-2 --to c -o policy.h
  npend export mine.npz --to c --prefix arm --relative -o arm.h
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from npend_gym.cli.common import OK, prepare_file, show_file

FILLS = {"npend_gym.cli.evaluate:run": ("trust",)}
_SUFFIXES = {"c": (".h",)}


def run(
    policy: str,
    *,
    to: Literal["c"],
    out: Path,
    prefix: str | None = None,
    relative: bool = False,
    trust: bool = False,
) -> int:
    """Write the file; return the exit code.

    Parameters
    ----------
    policy : policy
        The name of a policy in the package, or a file (.npz).
    to : format
        What is written: c, a header.
    out : file
        File to write, .h; folders that are missing are made.
    prefix : name, optional
        What the names in the header begin with (default npend).
    relative : bool
        Sensors show the angle of each rod relative to the rod above it.
    """
    from npend_gym import export
    from npend_gym.rl.policies.shipped import find_policy

    loaded = find_policy(policy, trust=trust)
    prepare_file(out, _SUFFIXES[to])
    export.to_c(loaded, out, "npend" if prefix is None else prefix, relative=relative)
    show_file(out)
    return OK
