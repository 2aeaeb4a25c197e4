"""What the commands share: exit codes, short errors, a release's options, where files went."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import NoReturn, TypeVar

from tqdm import tqdm

_T = TypeVar("_T")

OK, FAILED, BAD_ARGUMENTS, INTERRUPTED = 0, 1, 2, 130


class Parser(argparse.ArgumentParser):
    """An argument parser that says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        """Leave with exit code 2."""
        self.exit(BAD_ARGUMENTS, f"{self.prog}: error: {printable(message)}\n")


def printable(text: str) -> str:
    """Return `text` with what a terminal would obey spelt out: escapes in a file's name, say."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def tell(text: str) -> None:
    """Print a line of trouble."""
    print(printable(text), file=sys.stderr)


def _numbers(text: str) -> float | list[float]:
    values = [float(part) for part in text.split(",")]
    return values if len(values) > 1 else values[0]


def _counts(text: str) -> list[int]:
    return [int(part) for part in text.split(",")]


_numbers.__name__, _counts.__name__ = "number or list", "list of integers"  # for error messages

# Option, field of Release that it sets, type, placeholder, help
_RELEASE_OPTIONS = (
    ("--n", "n_values", _counts, "N,N,...", "numbers of pendulums (5,10,20,100)"),
    ("--trials", "trials", int, "COUNT", "trials for each N (3)"),
    ("--amplitude", "amplitude", float, "RAD", "starting angle of all rods (pi/4)"),
    ("--spread", "spread", float, "RAD", "a trial adds one draw from [0, RAD) to all rods (0.017)"),
    ("--seed", "seed", int, "SEED", "seed of the draws (0)"),
    ("--duration", "duration", float, "S", "window, the paper's is 10 (until all have completed)"),
    ("--masses", "masses", _numbers, "KG[,KG...]", "mass of the bobs, one or per rod (1)"),
    ("--lengths", "lengths", _numbers, "M[,M...]", "length of the rods, one or per rod (1)"),
    ("--gravity", "gravity", float, "M/S2", "acceleration of gravity (9.81)"),
    ("--damping", "damping", float, "NMS", "viscous damping of every joint (0)"),
)


def add_release_options(parser: argparse.ArgumentParser, *, leave_out: Sequence[str] = ()) -> None:
    """Add an option for every field of `Release`, except those to `leave_out`."""
    from npend_gym.experiments.release import Release
    from npend_gym.period import READINGS

    default = Release()
    for option, field, kind, placeholder, text in _RELEASE_OPTIONS:
        if field not in leave_out:
            parser.add_argument(
                option, dest=field, type=kind, default=getattr(default, field),
                metavar=placeholder, help=text,
            )  # fmt: skip
    text = "what completes a pseudo-period (bob)"
    parser.add_argument("--reading", choices=READINGS, default=default.reading, help=text)


def prepare_file(out: Path, suffixes: Sequence[str]) -> None:
    """See that the file `out` can be written, before work begins.

    Raises
    ------
    ValueError
        If it has none of the `suffixes`, is a folder, or its folder cannot be made or written to.
    """
    from npend_gym.report import outputs

    if out.suffix not in suffixes or out.is_dir():
        raise ValueError(f"out must be a file that ends in {' or '.join(suffixes)}, got {out}")
    outputs.prepare_folder(out.parent)


def progress(unit: str) -> Callable[[Iterable[_T]], Iterable[_T]]:
    """Return what wraps an iteration over `unit`s in a bar, where the output is a terminal."""
    # disable=None: no bar where it is not
    return lambda items: tqdm(items, unit=unit, disable=None, leave=False)


def can_draw() -> bool:
    """Return whether matplotlib is there."""
    return find_spec("matplotlib") is not None


def show_written(written: Sequence[Path]) -> None:
    """Print which files were written, and why there are no figures."""
    print("\nwritten:", *(printable(str(path)) for path in written), sep="\n  ")
    if not can_draw():
        tell('no figures: they need matplotlib, pip install "npend-gym[plot]"')
