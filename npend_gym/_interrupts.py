"""Ctrl-C while the command line starts or ends: one line, and the exit code of an interruption.

The start of `npend` takes long, because it imports this package and its libraries before any code
of the command line runs. A KeyboardInterrupt there would show a traceback of wherever the import
stood. Programs that only import the package keep Python's own handler.
"""

from __future__ import annotations

import os
import sys

TYPE_CHECKING = False  # that of `typing`, whose import takes as long as all else before the handler
if TYPE_CHECKING:
    import signal
    from typing import NoReturn
else:
    import _signal as signal  # without the enums of `signal`, for the same reason

INTERRUPTED = 130  # exit code, as of shells: 128 + SIGINT


def is_command() -> bool:
    """Return whether this process was started as `npend` or as `python -m npend_gym`.

    Workers have the arguments of the program that started them in `sys.argv`, but not in
    `sys.orig_argv`.
    """
    program, given = os.path.basename(sys.argv[0] if sys.argv else ""), sys.orig_argv  # noqa: PTH119
    if program in ("npend", "npend.exe"):
        return sys.argv[0] in given
    return "-m" in given and given[given.index("-m") + 1 : given.index("-m") + 2] == ["npend_gym"]


def leave_at_interrupts() -> None:
    """Let Ctrl-C end the process at once, if it is that of the command line."""
    if is_command() and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)


def raise_at_interrupts() -> None:
    """Let Ctrl-C raise a KeyboardInterrupt again."""
    if signal.getsignal(signal.SIGINT) is _leave:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _leave(*_: object) -> NoReturn:
    try:
        os.write(2, b"npend: interrupted\n")
    finally:
        os._exit(INTERRUPTED)
