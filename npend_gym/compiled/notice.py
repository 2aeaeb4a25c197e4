"""Lines on the terminal about what is compiled, so that nobody is puzzled."""

from __future__ import annotations

import os
import sys

NOTICE = (
    "npend_gym: compiling for this machine, for up to half a minute; the machine code is kept"
    " (NPEND_GYM_QUIET=1 hides this line)"
)


_said: set[str] = set()


def say(text: str) -> None:
    """Print a line about the machine code, the same one once per process."""
    if text not in _said and sys.stderr is not None and not os.environ.get("NPEND_GYM_QUIET"):
        print(f"npend_gym: {text}", file=sys.stderr, flush=True)
    _said.add(text)


def announce_compilation() -> None:
    """Print `NOTICE`, once per process, unless nobody waits at a terminal or a notebook."""
    if NOTICE not in _said and is_watched():
        print(NOTICE, file=sys.stderr, flush=True)
    _said.add(NOTICE)


def is_watched() -> bool:
    """Return whether the standard error stream is seen while the program runs."""
    if sys.stderr is None or os.environ.get("NPEND_GYM_QUIET"):
        return False
    return sys.stderr.isatty() or "ipykernel" in sys.modules
