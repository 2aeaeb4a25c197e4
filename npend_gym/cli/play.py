"""Pull pendulums about in your browser, by this package's own compiled code.

Pull their bobs, turn them at the pivot, change the chain, let networks swing it up. Once you let
go, the pseudo-period of every bob appears beside the models as it completes.

It writes the page, npend-play.html, and opens it. The page is one file, which needs neither a
network nor a server nor Python: copy it, mail it, show it to a class. The first page on a machine
takes about a minute, because the code is compiled for the browser.

Examples
--------
  npend play
  npend play -n 20 --amplitude 0.3
  npend play --chain acrobot
  npend play --chain cartpole
  npend play -o live.html                  writes the page, and does not open it
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from npend_gym.cli.common import FAILED, OK, show_file, warn

FILLS = {"npend_gym.experiments.release:ReleaseExperiment": ("amplitude", "chain")}
_PAGE = Path("npend-play.html")
_POLICIES = 2, 3, 4  # rods that are swung up


def run(
    *, n: int | None = None, out: Path | None = None, amplitude: Any = None, chain: Any = None
) -> int:
    """Write the page and open it; return the exit code.

    Parameters
    ----------
    n : int, optional
        Number of pendulums at first (default 5).
    out : file, optional
        Only write the page, to this .html file (default: open npend-play.html).
    """
    import webbrowser

    from npend_gym import _checks
    from npend_gym.chain import Chain, as_chain
    from npend_gym.envs.wasm import step_chain, step_constants, step_layout, step_module
    from npend_gym.experiments import ReleaseExperiment
    from npend_gym.report import live_page, player, prepare_file
    from npend_gym.rl import Policy

    if n is not None and chain is not None:
        raise ValueError(f"n must be left out where chain is given, got {_checks.show(n)}")
    count = 5 if n is None else n
    angle = ReleaseExperiment().amplitude if amplitude is None else amplitude
    given = None if chain is None else as_chain(chain)
    start = live_page.FirstState(angle, count, given)
    page = out or _PAGE
    prepare_file(page, player.SUFFIXES)
    policies = [Policy.pretrained(f"swingup-{rods}") for rods in _POLICIES]
    moving = given or Chain.uniform(count)
    constants = step_constants(policies[0].config)
    engine = live_page.Engine(
        step_module(moving), step_layout(moving), constants, step_chain(moving)
    )
    player.write(page, live_page.page(engine, policies if given is None else [], start))
    show_file(page)
    if out is None and not webbrowser.open(page.absolute().as_uri()):
        warn(f"npend play: no browser could be opened; open {page.absolute()} in yours")
        return FAILED
    return OK
