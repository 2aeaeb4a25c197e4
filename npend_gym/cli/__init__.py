"""The command line, `npend ...`: arguments, progress, printing; no physics.

Each command is a module of this folder: its docstring is the help, and its function `run` the
command, from whose signature the options follow (see `options`). Options that the user leaves out
are not among those that `run` gets, so that the defaults stand in one place.

Exit codes: 0 done, 1 the work failed, 2 bad arguments, 130 interrupted (what was done is kept), as
by SIGTERM (143) and SIGHUP (129).
"""

from __future__ import annotations

import argparse
import ast
import os
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from npend_gym import _interrupts
from npend_gym._version import __version__
from npend_gym.cli.common import (
    INTERRUPTED,
    Parser,
    dispatch,
    ending_signals,
    open_closed_streams,
    warn,
)
from npend_gym.cli.options import add_options, tree

COMMANDS = (
    "release", "simulate", "play", "campaign", "analyse", "chaos", "identify", "measure", "train",
    "evaluate", "benchmark", "dataset", "export", "examples", "verify", "compile",
)  # fmt: skip
_REPLACED = "lengths", "masses", "centres", "gravity", "damping"  # by --chain
_EXAMPLES = """\
examples:
  npend release                        the paper's experiment as a table
  npend release --page release.html    the same in the browser, with the motions
  npend simulate --theta 120deg,-10deg --film chain.gif
  npend play
  npend COMMAND --help                 has more

exit codes: 0 done, 1 the work failed, 2 bad arguments, 130 interrupted
"""


class _Command(Parser):
    """The parser of one command, whose module is imported when its arguments are first parsed."""

    run: Callable[..., int]
    loaded = False

    def load(self) -> None:
        """Import the module of the command, and take its options, description and examples."""
        if self.loaded:
            return
        self.loaded = True
        module: Any = import_module(f"npend_gym.cli.{self.prog.split()[-1]}")
        self.run = module.run
        about = str(ast.get_docstring(tree(module.__name__)))
        self.description, _, examples = about.partition("\n\nExamples\n--------")
        self.epilog = f"examples:{examples}"
        self.argument_default = argparse.SUPPRESS  # see the head of this module
        add_options(self, f"{module.__name__}:run", getattr(module, "FILLS", {}))

    def parse_known_args(self, args: Any = None, *more: Any, **named: Any) -> Any:
        """Add the options of the command, then parse; the rest raises an error here."""
        self.load()
        options, unknown = super().parse_known_args(args, *more, **named)
        if unknown:
            self.refuse(unknown)
        if "chain" in options and (extra := [name for name in _REPLACED if name in options]):
            self.error(f"--{extra[0]} must be left out with --chain, which has its own")
        return options, unknown


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    received: list[int] = []
    try:
        _interrupts.raise_at_interrupts()
        open_closed_streams()
        with ending_signals(received):
            code = _run(argv)
    except KeyboardInterrupt:
        warn("npend: interrupted")
        code = INTERRUPTED
    finally:
        _interrupts.leave_at_interrupts()
    return 128 + received[0] if code and received else code


def _run(argv: Sequence[str] | None) -> int:
    """Parse the arguments, and run the command that they name."""
    parser, commands = parsers()
    if "_ARGCOMPLETE" in os.environ:  # a shell asks how the line may go on
        from argcomplete import autocomplete

        for command in commands.values():
            command.load()
        autocomplete(parser)
    options = vars(parser.parse_args(argv))
    command = commands[options.pop("command")]
    return dispatch(command, lambda given: command.run(**given), options)


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
    for name in COMMANDS:
        with Path(__file__).with_name(f"{name}.py").open(encoding="utf-8") as module:
            commands.add_parser(name, help=module.readline().strip('r".\n'))
    return parser, commands.choices
