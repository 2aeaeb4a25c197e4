"""What the commands share: exit codes, messages, streams, progress, files written."""

from __future__ import annotations

import argparse
import contextlib
import difflib
import errno
import os
import re
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from npend_gym import _interrupts
from npend_gym.cli.options import with_options

_T = TypeVar("_T")

OK, FAILED, BAD_ARGUMENTS, INTERRUPTED = 0, 1, 2, _interrupts.INTERRUPTED
# What people try for an option of any command
_MEANT = {
    "--angle": "--amplitude",
    "--theta": "--amplitude",
    "--amplitude": "--theta",
    "--time": "--duration",
    "--friction": "--damping",
    "--set": "--env",
}


class Parser(argparse.ArgumentParser):
    """An argument parser that reports an error in one line and keeps line ends in its texts."""

    def __init__(self, **options: Any) -> None:
        super().__init__(formatter_class=argparse.RawDescriptionHelpFormatter, **options)
        self._negative_number_matcher = re.compile(r"-(\d|\.\d|pi)")  # -60deg is no option

    def error(self, message: str) -> NoReturn:
        """Leave with exit code 2."""
        self.exit(BAD_ARGUMENTS, f"{self.prog}: error: {printable(message)}\n")

    def _print_message(self, message: str, file: Any = None) -> None:
        """Print; leave with exit code 1 where stdout fails, which argparse ignores."""

        def show(_: object) -> int:
            file.write(message)
            return OK

        if file is not sys.stdout:
            super()._print_message(message, file)
        elif code := dispatch(self, show, {}):
            self.exit(code)

    def refuse(self, unknown: Sequence[str]) -> NoReturn:
        """Leave because of `unknown` arguments, and name what may be meant."""
        option = unknown[0].partition("=")[0]
        meant = _MEANT.get(option, f"--{option.lstrip('-')}")
        near = difflib.get_close_matches(meant, self._option_string_actions, 1, 0.7)
        guess = f"did you mean {near[0]}? " if near and option.startswith("-") else ""
        self.error(f"unrecognized arguments: {' '.join(unknown)}; {guess}See {self.prog} --help")


def refuse_unused(options: Mapping[str, Any], where: str) -> None:
    """Raise an error for the first option, by its name, that is given and would do nothing."""
    for name, value in options.items():
        if value is not None and value is not False:
            raise ValueError(f"{name} must be left out {where}; got {value}")


def printable(text: str) -> str:
    """Return `text` with control characters escaped: those in a file's name, for example."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def warn(text: str) -> None:
    """Print a line to the error stream, if it is open: a closed terminal closes it."""
    with contextlib.suppress(OSError):
        print(printable(text), file=sys.stderr)


def open_closed_streams() -> None:
    """Put stand-ins where the shell has closed streams, by `>&-` or `2>&-`.

    Writing to stdout then fails, as for a closed pipe. Messages to stderr vanish without a failure.
    Python leaves `sys.stdout` or `sys.stderr` as None, and the next file that is opened gets the
    number of the stream.
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


def dispatch(command: Parser, run: Callable[[dict[str, Any]], int], options: dict[str, Any]) -> int:
    """Run a command and return its exit code; an expected failure is reported in one line.

    A command that fails leaves no new folder that is empty.
    """
    try:
        with _plain_warnings(command.prog), _empty_folders_removed(options.values()):
            code = run(options)
        sys.stdout.flush()  # output that cannot be printed fails here, not at the exit
    except (ValueError, TypeError) as error:
        command.error(with_options(str(error)))
    except (ImportError, OSError, RuntimeError, KeyboardInterrupt) as error:
        if _is_interrupt(error):
            warn(f"{command.prog}: interrupted")
            return INTERRUPTED
        is_closed = isinstance(error, OSError) and error.errno in (errno.EPIPE, errno.EBADF)
        is_closed |= isinstance(error, BrokenPipeError)
        reason = "the output was closed before its end" if is_closed else error
        return _failed(f"{command.prog}: {reason}")
    return code


@contextlib.contextmanager
def _plain_warnings(prog: str) -> Generator[None]:
    """Print warnings of the package as one line each, and at once: what follows may take long."""

    def show(message: Warning | str, category: type[Warning], *more: Any, **named: Any) -> None:
        if issubclass(category, UserWarning):
            warn(f"{prog}: {message}")
        else:
            before(message, category, *more, **named)

    with warnings.catch_warnings():
        before = warnings.showwarning
        warnings.simplefilter("always", UserWarning)
        warnings.showwarning = show
        yield


def _is_interrupt(error: BaseException | None) -> bool:
    """Return whether an error is of Ctrl-C, from which a compiled import makes an ImportError."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__
    return error is not None


@contextlib.contextmanager
def _empty_folders_removed(options: Iterable[Any]) -> Generator[None]:
    """Remove new folders among these options, or above them, where an error ends the block."""
    paths = [path for each in options if isinstance(each, Path) for path in (each, *each.parents)]
    missing = [path for path in paths if not path.exists()]
    try:
        yield
    except BaseException:
        for path in missing:
            with contextlib.suppress(OSError):  # there is none, or it holds something
                path.rmdir()
        raise


def _failed(message: str) -> int:
    warn(message)
    try:
        sys.stdout.flush()
    except OSError:  # nothing more can be printed: the interpreter must not try at its exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return FAILED


@contextlib.contextmanager
def ending_signals(received: list[int]) -> Generator[None]:
    """Let SIGTERM and SIGHUP do what Ctrl-C does, and append those `received`.

    Every second one is ignored: `timeout` sends two, and the second would stop the removal of what
    is half written. Signals that are ignored, as SIGHUP under `nohup`, stay so.
    """

    def act(number: int, frame: Any) -> None:
        received.append(number)
        if len(received) % 2:
            at_ctrl_c = signal.getsignal(signal.SIGINT)  # shells ignore it for jobs behind `&`
            (at_ctrl_c if callable(at_ctrl_c) else signal.default_int_handler)(number, frame)

    changed: list[int] = []
    if threading.current_thread() is threading.main_thread():
        numbers = [getattr(signal, name, None) for name in ("SIGTERM", "SIGHUP")]
        changed += [each for each in numbers if each and signal.getsignal(each) is signal.SIG_DFL]
    try:
        for number in changed:
            signal.signal(number, act)
        yield
    finally:
        for number in changed:
            signal.signal(number, signal.SIG_DFL)


@contextlib.contextmanager
def finishing() -> Generator[None]:
    """Let the block write its results: Ctrl-C acts at its end, a second one at once."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    pressed: list[int] = []
    before = signal.getsignal(signal.SIGINT)

    def hold(number: int, _: object) -> None:
        pressed.append(number)
        signal.signal(signal.SIGINT, before)

    signal.signal(signal.SIGINT, hold)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if signal.SIGINT in pressed:
        signal.raise_signal(signal.SIGINT)
    elif pressed:  # SIGINT itself may be ignored
        raise KeyboardInterrupt


def prepare_results(out: Path, command: str) -> None:
    """Make the folder `out` if needed, and print a line if results of another run are replaced."""
    from npend_gym.report import outputs

    outputs.prepare_folder(out)
    if (out / "manifest.json").exists():
        warn(f"{command}: replaces the results in {out}")


def progress(unit: str, total: int | None = None) -> Callable[[Iterable[_T]], Iterable[_T]]:
    """Return a function that shows how far a loop is, as "2 of 4 chains"; `unit` is "chains" there.

    On a terminal it is a bar; where the error stream goes elsewhere, a line every ten seconds.
    """
    from npend_gym._progress import bar

    return lambda items: bar(items, unit=unit, total=total, leave=False)


def can_draw() -> bool:
    """Return whether figures can be drawn."""
    return not _why_undrawn()


def _why_undrawn() -> str:
    """Return why figures cannot be drawn, "" where they can."""
    try:
        import_module("npend_gym.report.style")
    except ImportError as error:
        return str(error)
    return ""


def show_file(out: Path, about: str = "") -> None:
    """Print what is to be said about a file that was written, and its size."""
    print(printable(str(out)) + f": {about}{out.stat().st_size / 1e6:.2f} MB")


def show_written(written: Sequence[Path], *, figures: bool = True) -> None:
    """Print which files were written, and why there are no `figures`."""
    print("\nwritten:", *(printable(str(path)) for path in written), sep="\n  ")
    if figures and (reason := _why_undrawn()):
        warn(reason)
