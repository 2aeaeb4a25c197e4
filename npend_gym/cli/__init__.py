"""The command line, `npend ...`: arguments, progress, printing; no physics.

Exit codes: 0 done, 1 the work failed, 2 bad arguments, 130 interrupted (what was done is kept).
"""

from __future__ import annotations

from collections.abc import Sequence

from npend_gym._version import __version__
from npend_gym.cli import analyse, bench, campaign, paper, release
from npend_gym.cli.common import Parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = Parser(prog="npend", description="The N-pendulum: release it, measure it.")
    parser.add_argument("--version", action="version", version=f"npend_gym {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    modules = {
        "release": release,
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
