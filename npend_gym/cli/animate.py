"""`npend animate`: a film of a release, or of an episode that a policy controls."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from npend_gym.cli.common import (
    FAILED,
    INTERRUPTED,
    OK,
    add_release_options,
    prepare_file,
    printable,
    progress,
    tell,
)

if TYPE_CHECKING:
    from npend_gym.experiments.recording import Recording

SUMMARY = "film a release, or an episode that a policy controls"
_ABOUT = """\
A GIF or MP4 of the chain with the trace of its tip, beside the directions of all bobs and the
energy over time. A black dot marks where, and when, a bob completes its pseudo-period. The file's
comment says what made it.
"""
_EXAMPLES = """\
examples:
  npend animate --out release.gif          5 pendulums, until all have completed
  npend animate --n 100 --speed 2 --out wave.mp4
  npend animate --n 3 --amplitude 3 --duration 20 --reading link --out wild.gif
  npend animate --policy swingup-2 --duration 8 --out swingup.gif
  npend animate --policy mine.npz --seed 7 --out mine.mp4
"""
_FPS = 25.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `npend animate`."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.description, parser.epilog = _ABOUT, _EXAMPLES
    parser.add_argument("--n", type=int, default=5, help="number of pendulums (5)")
    add_release_options(parser, leave_out=("n_values", "trials"))
    text = "film this policy instead: one of the package's by its name, or a file (.npz)"
    parser.add_argument("--policy", metavar="NAME|FILE", help=text)
    text = "pictures a second (25; with a policy one for each step, at most 25)"
    parser.add_argument("--fps", type=float, metavar="HZ", help=text)
    text = "seconds of the motion in a second of the film (1)"
    parser.add_argument("--speed", type=float, default=1.0, metavar="FACTOR", help=text)
    text = "height in pixels; the width is twice that (480)"
    parser.add_argument("--size", type=int, default=480, metavar="PIXELS", help=text)
    text = "file to write, .gif or .mp4"
    parser.add_argument("--out", type=Path, metavar="FILE", required=True, help=text)


def run(given: dict[str, Any], parser: argparse.ArgumentParser) -> int:
    """Record and film; return the exit code."""
    from npend_gym.physics import IntegrationError
    from npend_gym.report import animation

    out: Path = given.pop("out")
    film = {name: given.pop(name) for name in ("fps", "speed", "size")}
    try:
        prepare_file(out, animation.SUFFIXES)
        recording, film["fps"] = _recording(given, film["fps"], film["speed"], parser)
        whole = animation.Film(recording, **film)
        animation.write(whole, out, progress("picture"))
    except (ValueError, TypeError) as error:
        parser.error(str(error))
    except KeyboardInterrupt:
        tell("interrupted: nothing was written")
        return INTERRUPTED
    except IntegrationError as error:
        tell(f"npend animate: {error}")
        return FAILED
    seconds, size = len(whole) / whole.fps, out.stat().st_size
    print(printable(str(out)) + f": {len(whole)} pictures, {seconds:.1f} s, {size / 1e6:.2f} MB")
    return OK


def _recording(
    given: dict[str, Any], fps: float | None, speed: float, parser: argparse.ArgumentParser
) -> tuple[Recording, float]:
    """Return what is to be filmed, and the pictures a second."""
    if given["policy"] is not None:
        return _episode(given, fps, speed, parser)
    from npend_gym import _checks
    from npend_gym.experiments.recording import record_release
    from npend_gym.experiments.release import Release, measure

    fields = {name: value for name, value in given.items() if name not in ("n", "policy")}
    plan = Release(n_values=[given["n"]], trials=1, **fields)
    fps = _checks.positive_number("fps", _FPS if fps is None else fps)
    interval = _checks.positive_number("speed", speed) / fps
    return record_release(plan, measure(plan, *plan.runs()[0]), interval), fps


def _episode(
    given: dict[str, Any], fps: float | None, speed: float, parser: argparse.ArgumentParser
) -> tuple[Recording, float]:
    from npend_gym.experiments.recording import DEFAULT_SECONDS, record_episode
    from npend_gym.rl.policies import Policy, pretrained_names

    policies_own = ("policy", "seed", "duration")
    foreign = [k for k, v in given.items() if k not in policies_own and v != parser.get_default(k)]
    if foreign:
        raise ValueError(
            f"--{foreign[0]} is for releases: with --policy the chain is the one it was trained on"
        )
    name: str = given["policy"]
    names = pretrained_names()
    if name not in names and not Path(name).is_file():
        raise ValueError(f"policy must be a file or one of {', '.join(names)}; got {name}")
    policy = Policy.pretrained(name) if name in names else Policy.load(Path(name))
    if "env" not in policy.provenance:
        raise ValueError(f'{name} must have a .json beside it whose "env" says what it acts on')
    recording = record_episode(
        policy,
        policy.provenance["env"],
        seed=given["seed"],
        seconds=given["duration"] or DEFAULT_SECONDS,
        name=Path(name).stem,
    )
    step = float(recording.motion.times[1])
    return recording, fps or min(_FPS, speed / step)
