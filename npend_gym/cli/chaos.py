"""Draw when a double pendulum first turns over, for a million starts.

map: when a rod of a double pendulum first turns over, for a square of starting angles at rest.
Writes OUT/map.npz (the instants) and OUT/map.png. A million starts take about a minute on one core;
after Ctrl-C or a kill the same command resumes.

Examples
--------
  npend chaos map                                  1000 x 1000, all angles
  npend chaos map --centre 1.9,2.2 --width 0.2     a part of it, larger
  npend chaos map --size 300 --lengths 1,0.5 --threads 2 -o small
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from npend_gym.cli.common import OK, can_draw, progress, show_written, warn

FILLS = {"npend_gym.experiments.flip_map:FlipMap": ()}


def run(what: Literal["map"], *, threads: int = 1, out: Path = Path("chaos"), **chosen: Any) -> int:
    """Compute, write and draw; return the exit code.

    Parameters
    ----------
    what : picture
        The picture to draw.
    threads : int
        Number of threads that share the starts.
    out : folder
        Folder of the results.
    """
    from npend_gym._threads import check_threads
    from npend_gym.experiments import FlipMap
    from npend_gym.report import outputs

    del what  # there is one
    check_threads(threads)
    if out.suffix in (".png", ".npz"):
        raise ValueError(f"out must be a folder, in which map.png and map.npz appear, got {out}")
    plan = FlipMap(**chosen)
    outputs.prepare_folder(out)
    try:
        times = plan.run(out, threads=threads, progress=progress("parts"), tell=warn)
    except KeyboardInterrupt:
        warn("what was done is kept: the same command resumes")
        raise
    written = [out / "map.npz"]
    if can_draw():
        from npend_gym.report.flip_map_figure import flip_map_figure

        written.append(outputs.write_figure(out / "map.png", flip_map_figure(plan, times)))
    show_written(written)
    return OK
