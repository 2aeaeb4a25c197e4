"""The command line, `npend ...`: arguments, progress, printing; no physics.

Each command is a module of this folder with ABOUT and EXAMPLES for its help, `add_arguments` and
`run`. What they have in common stands here. Options that the user leaves out are not among those
that `run` gets, so that the defaults stand in one place: the function that the command calls.

Exit codes: 0 done, 1 the work failed, 2 bad arguments, 130 interrupted (what was done is kept).
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

from npend_gym import _interrupts
from npend_gym._version import __version__
from npend_gym.cli.common import INTERRUPTED, Parser, dispatch, warn
from npend_gym.cli.streams import open_closed_streams

COMMANDS = {
    "release": "release chains from rest and measure the pseudo-period of every bob",
    "animate": "film a release, or an episode that a policy controls",
    "page": "show a release in the browser: one HTML file that needs no network",
    "play": "pull a chain about in the browser, and see its pseudo-periods",
    "campaign": "sweep the release experiment over anything, on one machine or many",
    "analyse": "fit the law of the pseudo-period to a campaign, list outliers, write a report",
    "chaos": "draw when a double pendulum first turns over, for a million starts",
    "identify": "fit a chain to measured motion, with standard errors and held-out data",
    "train": "train a policy for a task, by one of several algorithms",
    "evaluate": "evaluate a policy or a controller, and what it survives",
    "examples": "list the examples that come with the package, or copy them",
    "verify": "check that this machine computes the very same bits",
}
# Former commands, which need what only a clone of the repository has
_IN_A_CLONE = {
    "bench": "python benchmarks/peers.py",
    "law": "python -m paper --only com-law",
    "paper": "python -m paper",
}
_EXAMPLES = """\
examples:
  npend release                        the paper's experiment as a table
  npend page --out release.html        the same in the browser, with an animation
  npend animate --n 20 --out chain.gif
  npend play
  npend COMMAND --help                 has more

exit codes: 0 done, 1 the work failed, 2 bad arguments, 130 interrupted
"""


class _Command(Parser):
    """The parser of one command, whose module is imported when its arguments are first parsed."""

    run: Callable[[dict[str, Any]], int]
    loaded = False

    def load(self) -> None:
        """Import the module of the command, and take its options, description and examples."""
        if self.loaded:
            return
        self.loaded = True
        module: Any = import_module(f"npend_gym.cli.{self.prog.split()[-1]}")
        self.run = module.run
        self.description, self.epilog = module.ABOUT, module.EXAMPLES
        self.argument_default = argparse.SUPPRESS  # see the head of this module
        module.add_arguments(self)

    def parse_known_args(self, *args: Any, **kwargs: Any) -> Any:
        """Add the options of the command, then parse; what it does not know is refused here."""
        self.load()
        options, unknown = super().parse_known_args(*args, **kwargs)
        if unknown:
            self.refuse(unknown)
        return options, unknown


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    try:
        _interrupts.raise_at_interrupts()
        open_closed_streams()
        return _run(argv)
    except KeyboardInterrupt:
        warn("npend: interrupted")
        return INTERRUPTED
    finally:
        _interrupts.leave_at_interrupts()


def _run(argv: Sequence[str] | None) -> int:
    """Parse the arguments, and run the command that they name."""
    parser, commands = parsers()
    first = next(iter(sys.argv[1:] if argv is None else argv), "")
    if first in _IN_A_CLONE:
        parser.error(f"{first} is not in the package: run `{_IN_A_CLONE[first]}` in a clone")
    if "_ARGCOMPLETE" in os.environ:  # a shell asks how the line may go on
        from argcomplete import autocomplete

        for command in commands.values():
            command.load()
        autocomplete(parser)
    try:
        options = vars(parser.parse_args(argv))
    except SystemExit as left:  # of argparse, which ignores that its output cannot be printed
        raise SystemExit(left.code or dispatch(parser, lambda _: 0, {})) from None
    command = commands[options.pop("command")]
    return dispatch(command, command.run, options)


def parsers() -> tuple[Parser, dict[str, _Command]]:
    """Return the parser of the command line, and that of each command by its name."""
    parser = Parser(
        prog="npend",
        description="The N-pendulum: release it, measure it, look at it.",
        epilog=_EXAMPLES,
    )
    parser.add_argument("--version", action="version", version=f"npend_gym {__version__}")
    commands = parser.add_subparsers(
        dest="command", required=True, metavar="COMMAND", parser_class=_Command
    )
    for name, summary in COMMANDS.items():
        commands.add_parser(name, help=summary)
    return parser, commands.choices
