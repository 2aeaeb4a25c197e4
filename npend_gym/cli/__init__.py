"""The command line, `npend ...`: arguments, progress, printing; no physics.

Exit codes: 0 done, 1 the work failed, 2 bad arguments, 130 interrupted (what was done is kept).
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from typing import Any

from npend_gym._version import __version__
from npend_gym.cli import (
    analyse,
    animate,
    bench,
    campaign,
    page,
    paper,
    play,
    release,
    verify,
)
from npend_gym.cli.common import FAILED, INTERRUPTED, Parser, tell

_EXAMPLES = """\
examples:
  npend release                        the paper's experiment as a table
  npend page --out release.html        the same in the browser, to be played
  npend animate --n 20 --out chain.gif
  npend play
  npend COMMAND --help                 has more

exit codes: 0 done, 1 the work failed, 2 bad arguments, 130 interrupted
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = Parser(
        prog="npend",
        description="The N-pendulum: release it, measure it, look at it.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"npend_gym {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    modules = {
        "release": release,
        "animate": animate,
        "page": page,
        "play": play,
        "paper": paper,
        "campaign": campaign,
        "analyse": analyse,
        "bench": bench,
        "verify": verify,
    }
    arguments = sys.argv[1:] if argv is None else argv
    for name, module in modules.items():
        command = commands.add_parser(name, help=module.SUMMARY)
        if name in arguments:  # the options of the others would import Numba and SciPy
            module.add_arguments(command)
    given = vars(parser.parse_args(arguments))
    name = given.pop("command")
    return _carried_out(modules[name], given, commands.choices[name])


def _carried_out(module: Any, given: dict[str, Any], parser: Any) -> int:
    """Return the exit code of a command; what is refused or not installed is said in one line."""
    try:
        code: int = module.run(given, parser)
        sys.stdout.flush()  # what cannot be printed fails here, not at the exit
    except BrokenPipeError:
        return _without_output(f"{parser.prog}: the output was closed before its end")
    except (ImportError, OSError) as error:
        return _without_output(f"{parser.prog}: {error}")
    except KeyboardInterrupt:
        tell(f"{parser.prog}: interrupted")
        return INTERRUPTED
    return code


def _without_output(trouble: str) -> int:
    tell(trouble)
    try:
        sys.stdout.flush()
    except OSError:  # nothing more can be printed: the interpreter need not try at its exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return FAILED
