"""`npend play`: a chain to play with, in a window."""

from __future__ import annotations

import argparse
import math
from typing import Any

from npend_gym.cli.common import FAILED, INTERRUPTED, OK, tell

SUMMARY = "push a chain about in a window, and see its pseudo-periods"
_ABOUT = """\
A window with a chain released from rest. Pull its bobs with the mouse, turn it at the pivot with
the left and right arrow keys; once you let go, the pseudo-period of every bob is measured anew and
appears beside the models as it completes.

keys: space pauses, r releases anew, up and down change the number of pendulums, page up and page
down the amplitude, q quits
"""
_EXAMPLES = """\
examples:
  npend play
  npend play --n 20 --amplitude 0.3
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `npend play`."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description, parser.epilog = _ABOUT, _EXAMPLES
    parser.add_argument("--n", type=int, default=5, help="number of pendulums (5)")
    text = "starting angle of all rods (pi/4)"
    parser.add_argument("--amplitude", type=float, default=math.pi / 4, metavar="RAD", help=text)
    text = "seed of what is added to that, up to 0.017 rad (0)"
    parser.add_argument("--seed", type=int, default=0, help=text)


def run(given: dict[str, Any], parser: argparse.ArgumentParser) -> int:
    """Play until the player quits; return the exit code."""
    from npend_gym.play import Game, play

    try:
        game = Game(**given)
    except (ValueError, TypeError) as error:
        parser.error(str(error))
    try:
        play(game)
    except KeyboardInterrupt:
        return INTERRUPTED
    except RuntimeError as error:  # pygame's own, where there is no display
        tell(f"npend play: no window can be opened: {error}")
        return FAILED
    return OK
