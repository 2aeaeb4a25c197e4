"""Streams that the shell has closed, `npend ... >&-` or `2>&-`: stand-ins for them.

Python leaves `sys.stdout` or `sys.stderr` as None then, and the next file that is opened gets the
number of the stream.
"""

from __future__ import annotations

import os
import sys


def open_closed_streams() -> None:
    """Put stand-ins where streams are closed: writing fails to stdout, and vanishes to stderr.

    Output that cannot be printed is a failure, as for a closed pipe; messages are not.
    """
    ways = os.O_RDONLY, os.O_RDONLY, os.O_WRONLY
    for number, (name, way) in enumerate(zip(("stdin", "stdout", "stderr"), ways, strict=True)):
        if getattr(sys, name) is not None:
            continue
        opened = os.open(os.devnull, way)  # gets the lowest number that is free
        if opened != number:  # somebody has a file with the number of the stream: leave it
            continue
        os.set_inheritable(number, True)
        if name != "stdin":
            setattr(sys, name, open(number, "w", encoding="utf-8", closefd=False))  # noqa: SIM115
