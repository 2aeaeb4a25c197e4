"""Simulate a motion, or an episode of a policy: as numbers, a table, a plot, a film.

Without --csv, --plot and --film it prints the first state, the last state and the energy. Rods
count from 1 at the pivot; the columns of a table count as arrays do, from theta0. Angles are zero
where a rod hangs; give one for all rods or one for each. A film shows the chain with the trace of
its tip, the direction of each bob, and the energy. After a release from rest, a black dot marks
where and when a bob completes its pseudo-period.

Examples
--------
  npend simulate --theta 120deg,-10deg     two pendulums, 10 s
  npend simulate --theta 2,2.001 --omega 0,1 --duration 30 --csv motion.csv --plot motion.png
  npend simulate -n 20 --film wave.mp4
  npend simulate --theta 2,1 --duration 1000 --method gauss4 --dt 0.02
  npend simulate --chain acrobot --theta 2 --film acrobot.gif
  npend simulate swingup-2 --duration 8 --film swingup.gif
  npend simulate mine.safetensors --seed 7 --plain --size 240 --film small.gif
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from npend_gym.cli.common import OK, progress, refuse_unused, show_file
from npend_gym.cli.options import spelled

if TYPE_CHECKING:
    from npend_gym.physics import Trajectory
    from npend_gym.recording import Recording

_FPS, _SIZE = 25.0, 480
_RODS, _ANGLE, _SECONDS = 5, math.pi / 4, 10.0  # by default
_INTERVAL = 0.01  # s
_SHOWN = 10  # rods that are printed
FILLS: dict[str, Any] = {
    "npend_gym.cli.evaluate:run": ("trust",),
    "npend_gym.report.animation:Film": ("fps", "speed", "size"),
    "npend_gym.experiments.release:ReleaseExperiment": (
        "definition", "masses", "lengths", "gravity", "damping", "chain",
    ),
}  # fmt: skip


def run(
    policy: str | None = None,
    *,
    n: int | None = None,
    theta: float | Sequence[float] | None = None,
    omega: float | Sequence[float] | None = None,
    duration: float | None = None,
    seed: int | None = None,
    csv: Path | None = None,
    plot: Path | None = None,
    film: Path | None = None,
    interval: float | None = None,
    method: str | None = None,
    dt: float | None = None,
    fps: float | None = None,
    speed: float | None = None,
    plain: bool = False,
    trust: bool = False,
    size: int | None = None,
    **chain: Any,
) -> int:
    """Simulate, print and write; return the exit code.

    Parameters
    ----------
    policy : policy, optional
        The name of a policy in the package, or its file: its episode is simulated.
    n : int, optional
        Number of pendulums (default as many as there are angles, or 5).
    theta : float or sequence, optional
        Angle of all rods at the start, or of each [rad] (default pi/4).
    omega : float or sequence, optional
        Angular velocity of all rods at the start, or of each [rad/s] (default 0).
    duration : float, optional
        Duration of the motion [s] (default 10, with a policy 15).
    seed : int, optional
        Seed of the episode of a policy (default 0).
    csv : file, optional
        Write time, angles and angular velocities to this .csv file.
    plot : file, optional
        Draw angles, angular velocities and energy to this .png or .pdf file.
    film : file, optional
        Film to this .gif or .mp4 file.
    interval : float, optional
        Time between two rows of the table and two points of the plot [s] (default 0.01; an episode
        of a policy has the steps of its environment).
    method : str, optional
        How the steps are taken (default dop853): dop853 or tsit5, with steps of any length; rk4,
        midpoint, gauss4 or gauss6, with equal steps. The last three are symplectic.
    dt : float, optional
        The longest step [s], which methods with equal steps need.
    plain : bool
        Film the chain alone, in square pictures without the diagrams.
    """
    from npend_gym import _checks, _extras
    from npend_gym.report.outputs import FIGURES, prepare_file, write_figure

    if film is None:
        of_film = {"--fps": fps, "--speed": speed, "--size": size, "--plain": plain}
        refuse_unused(of_film, "without --film")
    speed = _checks.positive_number("speed", 1.0 if speed is None else speed)
    size = _SIZE if size is None else size
    fps = None if fps is None else _checks.positive_number("fps", fps)
    given: dict[str, Any] = {"n": n, "theta": theta, "omega": omega, "interval": interval}
    given |= {"method": method, "dt": dt} | chain
    start = {name: value for name, value in given.items() if value is not None}
    if policy is not None and start:
        raise ValueError(
            f"{spelled(next(iter(start)))} must be left out with a policy, whose chain, start and "
            "steps are those of its environment"
        )
    if policy is None and (trust or seed is not None):
        raise ValueError(f"--{'trust' if trust else 'seed'} is for policies: name one")
    if csv is not None:
        prepare_file(csv, (".csv",), "csv")
    if plot is not None:
        prepare_file(plot, [*FIGURES], "plot")
        _extras.require("matplotlib", "plot", "figures")
    if film is not None:
        from npend_gym.report import animation

        animation.check_size(size)
        prepare_file(film, animation.SUFFIXES, "film")
        animation.check_suffix(film, fps or _FPS)
    every: float = start.pop("interval", _INTERVAL)
    if policy is None:
        record = _of_chain(duration=duration, **start)
    else:
        record = _of_policy(policy, 0 if seed is None else seed, duration, trust=trust)
    intervals = [every] if film is None else [every, speed / (fps or _FPS)]
    recordings = record(*intervals)
    motion = recordings[0].motion
    _show(motion)
    if csv is not None:
        motion.to_csv(csv)
        show_file(csv, f"{motion.times.size} rows, ")
    if plot is not None:
        show_file(write_figure(plot, motion.plot()[0].figure))
    if film is not None:
        from npend_gym.report import animation

        fps = fps or (_FPS if policy is None else min(_FPS, speed / float(motion.times[1])))
        filmed = animation.Film(recordings[-1], fps=fps, speed=speed, size=size, diagrams=not plain)
        animation.write(filmed, film, progress("pictures"))
        show_file(film, f"{len(filmed)} pictures, {len(filmed) / fps:.1f} s, ")
    return OK


def _of_chain(
    n: int | None = None,
    theta: Sequence[float] = (_ANGLE,),
    omega: float | Sequence[float] = 0.0,
    duration: float | None = None,
    definition: str = "bob",
    method: str = "dop853",
    dt: float | None = None,
    **described: Any,
) -> Callable[..., list[Recording]]:
    """Recorder of the motion of a chain at intervals [s]."""
    import numpy as np

    from npend_gym.experiments import ReleaseExperiment
    from npend_gym.recording import record_simulation

    angles: Any = theta if len(theta) > 1 else theta[0]
    if n is None and "chain" not in described:
        each = angles, omega, described.get("masses", 1.0), described.get("lengths", 1.0)
        most = max(map(np.size, each))
        n = most if most > 1 else _RODS
    numbers = {} if n is None else {"n_values": [n]}
    experiment = ReleaseExperiment(trials=1, definition=definition, **numbers, **described)
    chain = experiment.chain_of(experiment.n_values[0])
    seconds = _SECONDS if duration is None else duration
    options: dict[str, Any] = {"definition": definition, "method": method, "dt": dt}
    return partial(record_simulation, chain, angles, omega, seconds, **options)


def _of_policy(
    policy: str, seed: int, duration: float | None, *, trust: bool
) -> Callable[..., list[Recording]]:
    """Recorder of an episode of a policy, given by its name or file."""
    from npend_gym import _checks
    from npend_gym.recording import DEFAULT_SECONDS, record_episode
    from npend_gym.rl.policies.shipped import find_policy

    seconds = DEFAULT_SECONDS if duration is None else duration
    _checks.positive_number("duration", seconds)
    loaded = find_policy(policy, trust=trust)
    name = Path(policy).stem
    recording = record_episode(loaded, loaded.env, seed=seed, seconds=seconds, name=name)
    return lambda *_: [recording]


def _show(motion: Trajectory) -> None:
    """Print how a motion begins and ends, and its energy."""
    import numpy as np

    energy, n, end = motion.energy(), motion.chain.n, motion.times[-1]
    heads = "rod", "theta [rad]", "omega [rad/s]", f"after {end:g} s", ""
    print("".join(f"{head:>14}" for head in heads).rstrip())
    state = np.column_stack([motion.theta[0], motion.omega[0], motion.theta[-1], motion.omega[-1]])
    for rod in range(min(n, _SHOWN)):
        print(f"{rod + 1:>14}" + "".join(f"{value:>14.6f}" for value in state[rod]))
    if n > _SHOWN:
        print(f"{'...':>14}{f'{n} rods':>14}")
    print(f"energy {energy[0]:.6g} J, at the end {energy[-1]:.6g} J")
