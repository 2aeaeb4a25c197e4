"""What the commands share: exit codes, messages, a release's options, progress, files written."""

from __future__ import annotations

import argparse
import difflib
import errno
import json
import math
import os
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from npend_gym import _checks, _files, _interrupts

_T = TypeVar("_T")

OK, FAILED, BAD_ARGUMENTS, INTERRUPTED = 0, 1, 2, _interrupts.INTERRUPTED
_ALIASES = {"angle": "amplitude", "theta": "amplitude", "friction": "damping"}  # of options
_NUMBER = r"\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+"
_DEGREES = re.compile(rf"([+-]?(?:{_NUMBER})) ?(?:deg|degrees)")
_PI = re.compile(rf"([+-]?)(?:({_NUMBER}) ?\*? ?)?pi(?:/({_NUMBER}))?")


class Parser(argparse.ArgumentParser):
    """An argument parser that reports an error in one line and keeps line ends in its texts."""

    def __init__(self, **options: Any) -> None:
        super().__init__(formatter_class=argparse.RawDescriptionHelpFormatter, **options)
        self._negative_number_matcher = re.compile(r"-(\d|\.\d|pi)")  # -60deg is no option

    def error(self, message: str) -> NoReturn:
        """Leave with exit code 2."""
        self.exit(BAD_ARGUMENTS, f"{self.prog}: error: {printable(message)}\n")

    def refuse(self, unknown: Sequence[str]) -> NoReturn:
        """Leave because of `unknown` arguments, and name the option that may be meant."""
        name = unknown[0].lstrip("-").partition("=")[0]
        meant = f"--{_ALIASES.get(name, name)}"
        near = difflib.get_close_matches(meant, self._option_string_actions, 1, 0.7)
        guess = f"did you mean {near[0]}? " if near and unknown[0].startswith("-") else ""
        self.error(f"unrecognized arguments: {' '.join(unknown)}; {guess}See {self.prog} --help")


def printable(text: str) -> str:
    """Return `text` with control characters escaped: those in a file's name, for example."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def warn(text: str) -> None:
    """Print a line to the error stream."""
    print(printable(text), file=sys.stderr)


def dispatch(command: Parser, run: Callable[[dict[str, Any]], int], options: dict[str, Any]) -> int:
    """Run a command and return its exit code; an expected failure is reported in one line."""
    try:
        code = run(options)
        sys.stdout.flush()  # output that cannot be printed fails here, not at the exit
    except (ValueError, TypeError) as error:
        command.error(str(error))
    except (ImportError, OSError, RuntimeError) as error:
        is_closed = isinstance(error, OSError) and error.errno in (errno.EPIPE, errno.EBADF)
        is_closed |= isinstance(error, BrokenPipeError)
        reason = "the output was closed before its end" if is_closed else error
        return _failed(f"{command.prog}: {reason}")
    except KeyboardInterrupt:
        warn(f"{command.prog}: interrupted")
        return INTERRUPTED
    return code


def _failed(message: str) -> int:
    warn(message)
    try:
        sys.stdout.flush()
    except OSError:  # nothing more can be printed: the interpreter must not try at its exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return FAILED


def numbers(text: str) -> float | list[float]:
    """Return one number, or the numbers of a list joined by commas."""
    values = _items(float, text, "a number, or numbers joined by commas such as 1,0.5,2")
    return values if len(values) > 1 else values[0]


def integers(text: str) -> list[int]:
    """Return the integers of a list joined by commas."""
    return _items(int, text, "whole numbers joined by commas such as 1,2,3")


def angle(text: str) -> float:
    """Return an angle [rad] that is written as 0.5, pi/3 or 60deg."""
    if degrees := _DEGREES.fullmatch(text):
        return math.radians(float(degrees[1]))
    if multiple := _PI.fullmatch(text):
        sign, factor, divisor = multiple.groups()
        if float(divisor or 1.0) > 0.0:
            return float(f"{sign}1") * float(factor or 1.0) * math.pi / float(divisor or 1.0)
    try:
        return float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(
            f"must be an angle in radians such as 0.5 or pi/3, or in degrees such as 60deg; "
            f"got {text}"
        ) from error


def angles(text: str) -> list[float]:
    """Return the angles [rad] of a list joined by commas."""
    return [angle(part) for part in text.split(",")]


def _items(kind: Callable[[str], _T], text: str, rule: str) -> list[_T]:
    try:
        return [kind(part) for part in text.split(",")]
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"must be {rule}; got {text}") from error


def chain_argument(text: str) -> Any:
    """Return a preset's name as it is, or the parameters in a JSON file of that name."""
    from npend_gym.chain import PRESETS

    if text in PRESETS:
        return text
    rule = f"must be one of {', '.join(PRESETS)}, or a JSON file with a chain's parameters"
    try:
        return _files.parse_json(_files.read_text(Path(text)))
    except FileNotFoundError as error:
        raise argparse.ArgumentTypeError(f"{rule}; got {text}") from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise argparse.ArgumentTypeError(f"{rule}; {text} cannot be read: {reason}") from error


def setting(text: str) -> tuple[str, Any]:
    """Return name and value of NAME=VALUE: a value of JSON, or else a text.

    A text for the chain is that of `chain_argument`, a preset's name or a file.
    """
    name, equals, value = text.partition("=")
    if not (name and equals):
        raise argparse.ArgumentTypeError(f"must be NAME=VALUE, got {text}")
    try:
        given = json.loads(value)
    except ValueError:
        given = value
    except RecursionError as error:
        raise argparse.ArgumentTypeError(f"{name} has too many lists inside each other") from error
    return name, chain_argument(given) if name == "chain" and isinstance(given, str) else given


def add_env_option(parser: argparse.ArgumentParser) -> None:
    """Add the option for keywords of the environment; `with_settings` takes what it gives."""
    text = "a keyword of the environment, such as damping=0.05; may be repeated"
    parser.add_argument("--env", dest="settings", type=setting, action="append",
                        metavar="KEY=VALUE", help=text)  # fmt: skip


def add_trust_option(parser: argparse.ArgumentParser) -> None:
    """Add the option that lets a policy's file name a module to import."""
    text = "the file may name a mode of yours, package.module:Class, which is imported"
    parser.add_argument("--trust", action="store_true", help=text)


def with_settings(
    keywords: Mapping[str, Any], settings: Sequence[tuple[str, Any]] | None
) -> dict[str, Any]:
    """Return keywords of an environment with those that the user gave."""
    return {**keywords, **dict(settings or ())}


CHAIN_OPTION = (
    "--chain", "chain", chain_argument, "NAME|FILE",
    "preset such as acrobot, or JSON file with a chain, for n, masses, lengths, gravity, damping",
)  # fmt: skip

# Option, field of ReleaseExperiment that it sets, type, placeholder, help
_RELEASE_OPTIONS = (
    ("--n", "n_values", integers, "N,N,...", "numbers of pendulums (default 5,10,20,100)"),
    ("--trials", "trials", int, "COUNT", "trials for each N (default 3)"),
    ("--amplitude", "amplitude", angle, "RAD",
     "starting angle of all rods; 60deg are degrees (default pi/4)"),
    ("--spread", "spread", angle, "RAD",
     "each trial adds one random angle from [0, RAD) to all rods (default 0.017)"),
    ("--seed", "seed", int, "SEED", "seed of the random angles (default 0)"),
    ("--duration", "duration", float, "S",
     "longest time of a trial; the paper's is 10 (default: until all bobs have completed)"),
    ("--masses", "masses", numbers, "KG[,KG...]", "mass of all bobs, or of each (default 1)"),
    ("--lengths", "lengths", numbers, "M[,M...]", "length of all rods, or of each (default 1)"),
    ("--gravity", "gravity", float, "M/S2", "acceleration of gravity (default 9.81)"),
    ("--damping", "damping", float, "NMS", "viscous damping of every joint (default 0)"),
    ("--reading", "reading", str, "NAME",
     "what completes a pseudo-period: bob, link, height or com (default bob)"),
    CHAIN_OPTION,
)  # fmt: skip


def add_release_options(parser: argparse.ArgumentParser, *, leave_out: Sequence[str] = ()) -> None:
    """Add an option for every field of `ReleaseExperiment`, except those in `leave_out`."""
    for option, field, kind, placeholder, text in _RELEASE_OPTIONS:
        if field not in leave_out:
            parser.add_argument(option, dest=field, type=kind, metavar=placeholder, help=text)


def thread_count(options: dict[str, Any]) -> int:
    """Take the number of threads out of the options: 1 if there is none; refused if it is bad."""
    from npend_gym._threads import MAX_THREADS

    return _checks.count("threads", options.pop("threads", 1), high=MAX_THREADS)


def prepare_results(out: Path, command: str) -> None:
    """Make the folder `out` if need be, and say so where results of another run are replaced.

    Raises
    ------
    ValueError
        If `out` is no folder, or cannot be made or written to.
    """
    from npend_gym.report import outputs

    outputs.prepare_folder(out)
    if (out / "manifest.json").exists():
        warn(f"{command}: replaces the results in {out}")


def prepare_file(out: Path, suffixes: Sequence[str]) -> None:
    """Check that the file `out` can be written, before work begins.

    Raises
    ------
    ValueError
        If it has none of the `suffixes`, is a folder, or its folder cannot be made or written to.
    """
    from npend_gym.report import outputs

    if out.suffix not in suffixes or out.is_dir():
        raise ValueError(f"out must be a file that ends in {' or '.join(suffixes)}, got {out}")
    outputs.prepare_folder(out.parent)


def progress(unit: str, total: int | None = None) -> Callable[[Iterable[_T]], Iterable[_T]]:
    """Return a function that shows how far a loop over `unit`s is.

    On a terminal it is a bar; where the error stream goes elsewhere, a line every ten seconds.
    """
    from npend_gym._progress import bar

    return lambda items: bar(items, unit=unit, total=total, leave=False)


def can_draw() -> bool:
    """Return whether matplotlib is installed."""
    return find_spec("matplotlib") is not None


def show_written(written: Sequence[Path], *, figures: bool = True) -> None:
    """Print which files were written, and why there are no `figures`."""
    print("\nwritten:", *(printable(str(path)) for path in written), sep="\n  ")
    if figures and not can_draw():
        from npend_gym._extras import missing

        warn(str(missing("matplotlib", "plot", "figures")))
