"""`npend animate`: a film of a release, or of an episode that a policy controls."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from npend_gym.cli.common import (
    OK,
    add_release_options,
    add_trust_option,
    prepare_file,
    printable,
    progress,
)

if TYPE_CHECKING:
    from npend_gym.recording import Recording

ABOUT = """\
A GIF or MP4 of the chain with the trace of its tip, beside the directions of all bobs and the
energy over time. A black dot marks where, and when, a bob completes its pseudo-period. The file's
comment says what made it.
"""
EXAMPLES = """\
examples:
  npend animate --out release.gif          5 pendulums, until all have completed
  npend animate --n 100 --speed 2 --out wave.mp4
  npend animate --n 3 --amplitude 3 --duration 20 --reading link --out wild.gif
  npend animate --chain acrobot --amplitude 2 --out acrobot.gif
  npend animate --policy swingup-2 --duration 8 --out swingup.gif
  npend animate --policy calm-2 --plain --size 240 --out small.gif
  npend animate --policy mine.npz --seed 7 --out mine.mp4
"""
_FPS = 25.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `npend animate`."""
    parser.add_argument("--n", type=int, help="number of pendulums (default 5)")
    add_release_options(parser, leave_out=("n_values", "trials"))
    text = "film an episode of this policy: the name of one in the package, or its file"
    parser.add_argument("--policy", metavar="NAME|FILE", help=text)
    add_trust_option(parser)
    text = "pictures a second (default 25; with a policy one for each step, at most 25)"
    parser.add_argument("--fps", type=float, metavar="HZ", help=text)
    text = "seconds of the motion in a second of the film (default 1)"
    parser.add_argument("--speed", type=float, metavar="FACTOR", help=text)
    text = "height in pixels; the width is twice that (default 480)"
    parser.add_argument("--size", type=int, metavar="PIXELS", help=text)
    text = "the chain alone, without the diagrams: square pictures"
    parser.add_argument("--plain", action="store_true", help=text)
    text = "file to write, .gif or .mp4; folders that are missing are made"
    parser.add_argument("--out", type=Path, metavar="FILE", required=True, help=text)


def run(options: dict[str, Any]) -> int:
    """Record and film; return the exit code."""
    from npend_gym import _checks
    from npend_gym.report import animation

    out: Path = options.pop("out")
    size, speed = options.pop("size", 480), options.pop("speed", 1.0)
    fps: float | None = options.pop("fps", None)
    diagrams = not options.pop("plain", False)
    speed = _checks.positive_number("speed", speed)
    fps = None if fps is None else _checks.positive_number("fps", fps)
    if "policy" in options:
        recording = _episode(out, **options)
        fps = fps or min(_FPS, speed / float(recording.motion.times[1]))
    else:
        fps = fps or _FPS
        recording = _release(out, speed / fps, **options)
    film = animation.Film(recording, fps=fps, speed=speed, size=size, diagrams=diagrams)
    animation.write(film, out, progress("picture"))
    seconds, size = len(film) / film.fps, out.stat().st_size
    print(printable(str(out)) + f": {len(film)} pictures, {seconds:.1f} s, {size / 1e6:.2f} MB")
    return OK


def _release(out: Path, interval: float, *, trust: bool = False, **options: Any) -> Recording:
    """Measure one release for the film `out`, and record it every `interval` [s]."""
    from npend_gym.experiments import ReleaseExperiment, measure
    from npend_gym.recording import record_release
    from npend_gym.report.animation import SUFFIXES

    if trust:
        raise ValueError("--trust is for files of policies: give --policy with it")

    if "n" in options or "chain" not in options:
        options["n_values"] = [options.pop("n", 5)]
    experiment = ReleaseExperiment(trials=1, **options)
    prepare_file(out, SUFFIXES)
    return record_release(experiment, measure(experiment, *experiment.runs()[0]), interval)


def _episode(
    out: Path,
    policy: str,
    seed: int = 0,
    duration: float | None = None,
    trust: bool = False,
    **inapplicable: Any,
) -> Recording:
    """Record an episode for the film `out`, of a policy given by its name or its file."""
    from npend_gym import _checks
    from npend_gym.recording import DEFAULT_SECONDS, record_episode
    from npend_gym.report.animation import SUFFIXES
    from npend_gym.rl.policies.shipped import find_policy

    if inapplicable:
        raise ValueError(
            f"--{next(iter(inapplicable))} is for releases: with --policy the chain is the one "
            "that the policy was trained on"
        )
    seconds = DEFAULT_SECONDS if duration is None else duration
    _checks.positive_number("duration", seconds)
    loaded = find_policy(policy, trust=trust)
    prepare_file(out, SUFFIXES)
    return record_episode(
        loaded,
        loaded.env,
        seed=seed,
        seconds=seconds,
        name=Path(policy).stem,
    )
