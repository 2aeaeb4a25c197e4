"""What the commands share: exit codes, a parser with short errors, where files went."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import NoReturn

OK, FAILED, BAD_ARGUMENTS, INTERRUPTED = 0, 1, 2, 130


class Parser(argparse.ArgumentParser):
    """An argument parser that says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        """Leave with exit code 2."""
        self.exit(BAD_ARGUMENTS, f"{self.prog}: error: {message}\n")


def can_draw() -> bool:
    """Return whether matplotlib is there."""
    return find_spec("matplotlib") is not None


def show_written(written: Sequence[Path]) -> None:
    """Print which files were written, and why there are no figures."""
    print("\nwritten:", *(str(path) for path in written), sep="\n  ")
    if not can_draw():
        print('no figures: they need matplotlib, pip install "npend-gym[plot]"', file=sys.stderr)
