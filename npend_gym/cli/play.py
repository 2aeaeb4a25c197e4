"""`npend play`: a chain to play with, in the browser."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from npend_gym.cli.common import CHAIN_OPTION, FAILED, OK, angle, prepare_file, printable, warn

ABOUT = """\
Pendulums that move in your browser, by this package's own compiled code. Pull their bobs, turn them
at the pivot, change the chain, let networks swing it up. Once you let go, the pseudo-period of
every bob appears beside the models as it completes.

It writes the page, npend-play.html, and opens it. The page is one file, which needs neither a
network nor a server nor Python: copy it, mail it, show it to a class. The first page on a machine
takes about a minute, because the code is compiled for the browser.
"""
EXAMPLES = """\
examples:
  npend play
  npend play --n 20 --amplitude 0.3
  npend play --chain acrobot
  npend play --out live.html               writes the page, and does not open it
"""
_PAGE = "npend-play.html"
_POLICIES = 2, 3, 4  # rods that are swung up


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `npend play`."""
    parser.add_argument("--n", type=int, help="number of pendulums at first (default 5)")
    option, field, kind, placeholder, text = CHAIN_OPTION
    parser.add_argument(option, dest=field, type=kind, metavar=placeholder, help=text)
    text = "angle of the first release, 0.09 to 3.05, to a degree; 60deg are degrees (default pi/4)"
    parser.add_argument("--amplitude", type=angle, metavar="RAD", help=text)
    text = f"only write the page, to this .html file (default: open {_PAGE})"
    parser.add_argument("--out", type=Path, metavar="FILE", help=text)


def run(options: dict[str, Any]) -> int:
    """Write the page and open it; return the exit code."""
    import webbrowser

    only_write = "out" in options
    out: Path = options.pop("out", Path(_PAGE))
    write(out, **options)
    print(printable(str(out)) + f": {out.stat().st_size / 1e6:.2f} MB")
    if not only_write and not webbrowser.open(out.absolute().as_uri()):
        warn(f"npend play: no browser could be opened; open {out.absolute()} in yours")
        return FAILED
    return OK


def write(
    out: Path, n: int | None = None, chain: Any = None, amplitude: float | None = None
) -> None:
    """Write the page to play with to `out`."""
    from npend_gym import _checks
    from npend_gym.chain import Chain, as_chain
    from npend_gym.envs import EnvConfig
    from npend_gym.envs.wasm import step_chain, step_constants, step_layout, step_module
    from npend_gym.experiments import ReleaseExperiment
    from npend_gym.report import live_page, player
    from npend_gym.rl import Policy

    if n is not None and chain is not None:
        raise ValueError(f"n must be left out where chain is given, got {_checks.show(n)}")
    count = 5 if n is None else n
    angle = ReleaseExperiment().amplitude if amplitude is None else amplitude
    given = None if chain is None else as_chain(chain)
    start = live_page.Start(angle, count, given)
    prepare_file(out, live_page.SUFFIXES)
    policies = [Policy.pretrained(f"swingup-{rods}") for rods in _POLICIES]
    networks = [
        live_page.Network(policy.env["n"], policy.scale, policy.weights, policy.biases)
        for policy in policies
        if given is None
    ]
    moving = given or Chain.uniform(count)
    constants = step_constants(EnvConfig(**policies[0].env))
    engine = live_page.Engine(
        step_module(moving), step_layout(moving), constants, step_chain(moving)
    )
    player.write(out, live_page.page(engine, networks, start))
