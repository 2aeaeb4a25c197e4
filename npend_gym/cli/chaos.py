"""`npend chaos`: pictures of chaos."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from npend_gym.cli.common import (
    OK,
    angle,
    angles,
    can_draw,
    numbers,
    progress,
    show_written,
    thread_count,
    warn,
)

ABOUT = """\
map: when a rod of a double pendulum first turns over, for a square of starting angles at rest.
Writes OUT/map.npz (the instants) and OUT/map.png. A million starts take about a minute on one core;
after Ctrl-C or a kill the same command resumes.
"""
EXAMPLES = """\
examples:
  npend chaos map                                  1000 x 1000, all angles
  npend chaos map --centre 1.9,2.2 --width 0.2     a part of it, larger
  npend chaos map --size 300 --lengths 1,0.5 --threads 2 --out small
"""

# Option, field of FlipMap that it sets, type, placeholder, help
_OPTIONS = (
    ("--size", "size", int, "COUNT", "starts along each side (default 1000)"),
    ("--centre", "centre", angles, "RAD,RAD", "angles in the middle (default 0,0)"),
    ("--width", "width", angle, "RAD", "of the square (default 2 pi)"),
    ("--duration", "duration", float, "S", "how long a release is followed (default 10)"),
    ("--masses", "masses", numbers, "KG[,KG]", "of the bobs (default 1)"),
    ("--lengths", "lengths", numbers, "M[,M]", "of the rods (default 1)"),
    ("--gravity", "gravity", float, "M/S2", "acceleration of gravity (default 9.81)"),
    ("--rtol", "rtol", float, "NUMBER", "relative tolerance of the integration (default 1e-9)"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `npend chaos`."""
    parser.add_argument("what", choices=["map"], help="which picture")
    for option, field, kind, placeholder, text in _OPTIONS:
        parser.add_argument(option, dest=field, type=kind, metavar=placeholder, help=text)
    parser.add_argument("--threads", type=int, metavar="COUNT", help="(default 1)")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="(default chaos)")


def run(options: dict[str, Any]) -> int:
    """Compute, write and draw; return the exit code."""
    from npend_gym.experiments import FlipMap
    from npend_gym.report import outputs

    options.pop("what")
    out, threads = options.pop("out", Path("chaos")), thread_count(options)
    if out.suffix in (".png", ".npz"):
        raise ValueError(f"out must be a folder, in which map.png and map.npz appear, got {out}")
    plan = FlipMap(**options)
    outputs.prepare_folder(out)
    try:
        times = plan.run(out, threads=threads, progress=progress("part"), tell=warn)
    except KeyboardInterrupt:
        warn("what was done is kept: the same command resumes")
        raise
    written = [out / "map.npz"]
    if can_draw():
        from npend_gym.report.flip_map_figure import flip_map_figure

        written.append(outputs.write_figure(out / "map.png", flip_map_figure(plan, times)))
    show_written(written)
    return OK
