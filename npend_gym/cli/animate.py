"""Film a release, or an episode that a policy controls, as GIF or MP4.

The chain with the trace of its tip stands beside the directions of all bobs and the energy over
time. A black dot marks where, and when, a bob completes its pseudo-period. The file's comment says
what made it.

Examples
--------
  npend animate -o release.gif             5 pendulums, until all have completed
  npend animate -n 100 --speed 2 -o wave.mp4
  npend animate -n 3 --amplitude 3 --duration 20 --reading link -o wild.gif
  npend animate --chain acrobot --amplitude 2 -o acrobot.gif
  npend animate swingup-2 --duration 8 -o swingup.gif
  npend animate calm-2 --plain --size 240 -o small.gif
  npend animate mine.safetensors --seed 7 -o mine.mp4
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from npend_gym.cli.common import OK, prepare_file, progress, show_file
from npend_gym.cli.options import spelled

if TYPE_CHECKING:
    from npend_gym.recording import Recording

_FPS = 25.0
FILLS: dict[str, Any] = {
    "npend_gym.cli.evaluate:run": ("trust",),
    "npend_gym.report.animation:Film": ("fps", "speed", "size"),
    "npend_gym.experiments.release:ReleaseExperiment": (
        "n_values", "amplitude", "spread", "seed", "duration", "reading", "masses", "lengths",
        "gravity", "damping", "chain",
    ),
}  # fmt: skip


def run(
    policy: str | None = None,
    *,
    out: Path,
    fps: float | None = None,
    speed: float = 1.0,
    plain: bool = False,
    trust: bool = False,
    size: int = 480,
    **motion: Any,
) -> int:
    """Record and film; return the exit code.

    Parameters
    ----------
    policy : policy, optional
        The name of a policy in the package, or its file: an episode is filmed.
    out : file
        File to write, .gif or .mp4; folders that are missing are made.
    plain : bool
        The chain alone, without the diagrams: square pictures.
    """
    from npend_gym import _checks
    from npend_gym.report import animation

    speed = _checks.positive_number("speed", speed)
    fps = None if fps is None else _checks.positive_number("fps", fps)
    if policy is not None:
        recording = _episode(out, policy, trust=trust, **motion)
        fps = fps or min(_FPS, speed / float(recording.motion.times[1]))
    elif trust:
        raise ValueError("--trust is for files of policies: name one")
    else:
        fps = fps or _FPS
        recording = _release(out, speed / fps, **motion)
    film = animation.Film(recording, fps=fps, speed=speed, size=size, diagrams=not plain)
    animation.write(film, out, progress("picture"))
    show_file(out, f"{len(film)} pictures, {len(film) / film.fps:.1f} s, ")
    return OK


def _release(out: Path, interval: float, **options: Any) -> Recording:
    """Measure one release for the film `out`, and record it every `interval` [s]."""
    from npend_gym.experiments import ReleaseExperiment, measure
    from npend_gym.recording import record_release
    from npend_gym.report.animation import SUFFIXES

    if "chain" not in options:
        options.setdefault("n_values", [5])
    experiment = ReleaseExperiment(trials=1, **options)
    if len(experiment.n_values) > 1:
        raise ValueError("n must be one number of pendulums, which are filmed")
    prepare_file(out, SUFFIXES)
    return record_release(experiment, measure(experiment, *experiment.runs()[0]), interval)


def _episode(
    out: Path,
    policy: str,
    *,
    trust: bool,
    seed: int = 0,
    duration: float | None = None,
    **inapplicable: Any,
) -> Recording:
    """Record an episode for the film `out`, of a policy given by its name or its file."""
    from npend_gym import _checks
    from npend_gym.recording import DEFAULT_SECONDS, record_episode
    from npend_gym.report.animation import SUFFIXES
    from npend_gym.rl.policies.shipped import find_policy

    if inapplicable:
        raise ValueError(
            f"{spelled(next(iter(inapplicable)))} is for releases: with a policy the chain is the "
            "one that the policy was trained on"
        )
    seconds = DEFAULT_SECONDS if duration is None else duration
    _checks.positive_number("duration", seconds)
    loaded = find_policy(policy, trust=trust)
    prepare_file(out, SUFFIXES)
    name = Path(policy).stem
    return record_episode(loaded, loaded.env, seed=seed, seconds=seconds, name=name)
