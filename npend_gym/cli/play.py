"""`npend play`: a chain to play with, in a window."""

from __future__ import annotations

import argparse
from typing import Any

from npend_gym.cli.common import CHAIN_OPTION, FAILED, OK, angle, warn

ABOUT = """\
A window with a chain released from rest. Pull its bobs with the mouse, turn it at the pivot with
the left and right arrow keys; once you let go, the pseudo-period of every bob is measured again and
appears beside the models as it completes.

keys: space pauses, r releases again, up and down change the number of pendulums, page up and page
down the amplitude, q quits
"""
EXAMPLES = """\
examples:
  npend play
  npend play --n 20 --amplitude 0.3
  npend play --chain acrobot
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `npend play`."""
    parser.add_argument("--n", type=int, help="number of pendulums (default 5)")
    option, field, kind, placeholder, text = CHAIN_OPTION
    parser.add_argument(option, dest=field, type=kind, metavar=placeholder, help=text)
    text = "starting angle of all rods; 60deg are degrees (default pi/4)"
    parser.add_argument("--amplitude", type=angle, metavar="RAD", help=text)
    text = "seed of the random angle that is added, up to 0.017 rad (default 0)"
    parser.add_argument("--seed", type=int, help=text)


def run(options: dict[str, Any]) -> int:
    """Play until the player quits; return the exit code."""
    from npend_gym.play import Game, play
    from npend_gym.window import check_display

    game = Game(**options)
    try:
        check_display()
        play(game)
    except RuntimeError as error:  # also pygame's own
        warn(f"npend play: no window can be opened: {error}; npend page needs none")
        return FAILED
    return OK
