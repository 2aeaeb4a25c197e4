"""Lines on the terminal about what is compiled, so that nobody is puzzled."""

from __future__ import annotations

import os
import sys
from typing import Any

from numba.core import event as events

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


class FirstCompilation(events.Listener):
    """Prints `NOTICE` when Numba begins to compile a function of this package, once per process.

    Numba announces what it compiles, and not what it loads from its files.
    """

    def __init__(self) -> None:
        self._announced = False

    def on_start(self, event: Any) -> None:
        """Print the line, unless nobody waits at a terminal or a notebook."""
        module: str = event.data["dispatcher"].py_func.__module__
        if self._announced or not module.startswith("npend_gym."):
            return
        self._announced = True
        if somebody_waits():
            print(NOTICE, file=sys.stderr, flush=True)

    def on_end(self, event: Any) -> None:
        """Do nothing."""


def somebody_waits() -> bool:
    """Return whether the standard error stream is seen while the program runs."""
    if sys.stderr is None or os.environ.get("NPEND_GYM_QUIET"):
        return False
    return sys.stderr.isatty() or "ipykernel" in sys.modules


def announce_first_compilation() -> None:
    """Print `NOTICE` before the first function is compiled in this process."""
    events.register("numba:compile", FirstCompilation())
