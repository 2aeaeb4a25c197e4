"""The command line, `npend ...`: arguments, progress, printing; no physics.

Exit codes: 0 done, 1 the work failed, 2 bad arguments, 130 interrupted (what was done is kept).
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from npend_gym._version import __version__
from npend_gym.cli import analyse, animate, bench, campaign, page, paper, play, release
from npend_gym.cli.common import Parser

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
    }
    for name, module in modules.items():
        module.add_arguments(commands.add_parser(name, help=module.SUMMARY))
    given = vars(parser.parse_args(argv))
    name = given.pop("command")
    return modules[name].run(given, commands.choices[name])
