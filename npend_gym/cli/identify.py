"""Fit a chain to measured motion, with standard errors and held-out data.

Inertia and lift (mass times lever) of each link, and those of damping, friction and drag that the
data support, are fitted to measured angles. Segments held out of the fit test the result. The CSV
files have columns time [s], theta0, theta1, ... [rad, absolute, 0 where it hangs]. They may have
tau0, ... [N m] and piece, the number of the recording. Exports of Tracker, phyphox, Capstone,
Logger Pro, RealAIGym and others are recognised, and ROS 2 bags (MCAP). Columns that --columns
names are taken as they stand; a name with a comma has quotation marks: 'theta0="angle, left"'. See
docs/howto/real_pendulum.md.

Examples
--------
  npend identify motion.csv --lengths 0.17,0.23 --masses 0.1,0.14 --centres 0.11,0.12
  npend identify examples/data/multiarm_double.csv --chain "multiarm 2"
  npend identify first.csv second.csv --chain robot.json --segment 1 --json
  npend identify encoders.csv --lengths 0.2,0.3 --degrees --relative
  npend identify markers.txt --fps 400 --chain pendulum.json
  npend identify rosbag2_0.mcap --lengths 0.2,0.3 --columns theta0=shoulder,theta1=elbow --relative
  npend identify log.csv --lengths 0.2,0.3 --columns "time=t [s],theta0=q1,theta1=q2,tau0=motor"
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from npend_gym.cli.common import (
    OK,
    can_draw,
    finishing,
    prepare_results,
    show_written,
    warn,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from npend_gym._checks import FloatArray
    from npend_gym.chain import Chain
    from npend_gym.identification import Motion

FILLS = {
    "npend_gym.identification.fit:identify": ("fit", "segment", "held_out"),
    "npend_gym.identification.recordings:read_motion": ("columns", "degrees", "relative", "fps"),
}


def run(
    files: Sequence[Path],
    *,
    chain: Chain | Mapping[str, Any] | str | None = None,
    lengths: ArrayLike | None = None,
    masses: ArrayLike | None = None,
    centres: ArrayLike | None = None,
    gravity: float | None = None,
    columns: Mapping[str, str] | None = None,
    degrees: bool = False,
    relative: bool = False,
    fps: float | None = None,
    as_json: bool = False,
    out: Path | None = None,
    **chosen: Any,
) -> int:
    """Read, fit and report; return the exit code.

    Parameters
    ----------
    files : file
        Recordings: CSV files, and exports of programs for measurements.
    chain : Chain, optional
        The known chain, in place of the next four options: a preset's name or a JSON file.
    lengths : array_like, optional
        Length [m] of each link, from joint to joint.
    masses : array_like, optional
        Mass [kg] of each link (default 1).
    centres : array_like, optional
        Distance [m] of each link's centre of mass from its upper joint (default its length: a bob).
    gravity : float, optional
        Acceleration of gravity [m/s^2] (default 9.81).
    as_json : bool
        Print everything as JSON.
    out : folder, optional
        Write fit.json (the chain), identification.json, residuals.csv and figures there.
    """
    from npend_gym.identification.problem import FitProblem
    from npend_gym.report import identification_report as report

    single = {"lengths": lengths, "masses": masses, "centres": centres, "gravity": gravity}
    single = {name: value for name, value in single.items() if value is not None}
    motion, shown = read_files(
        "npend identify", files, columns=columns, degrees=degrees, relative=relative, fps=fps
    )
    if chain is None and lengths is None:
        seen = "" if shown is None else ",".join(f"{length:.4g}" for length in shown.tolist())
        ratio = f"; positions show {seen} in their unit" if seen else ""
        raise ValueError(
            f"--lengths or --chain must be given: angles do not determine lengths{ratio}"
        )
    known: Any = {"masses": 1.0} | single if chain is None else chain
    problem = FitProblem(motion, known, **chosen)
    if out is not None:
        prepare_results(out, "npend identify")
    figures = out is not None and can_draw()
    result = problem.solve()
    with finishing():
        if as_json:
            print(json.dumps(result.as_dict(), indent=2, allow_nan=False))
        else:
            print(report.identification_text(result))
        if out is not None:
            written = report.write_identification(result, motion, out, figures=figures)
            if not as_json:
                show_written(written)
    return OK


def read_files(command: str, files: Sequence[Path], **how: Any) -> tuple[Motion, FloatArray | None]:
    """Return the motion in files, and lengths that positions show; say how files were understood.

    `how` is that of `read_motion`.
    """
    from npend_gym.identification.recordings import read_recording

    try:
        read = read_recording(*files, **how)
    except OSError as error:
        raise ValueError(
            f"files must be CSV files: {error.filename} cannot be read: {error.strerror}"
        ) from error
    *options, last = (f"--{name}" for name in how)
    for sentence in read.said:
        warn(f"{command}: {sentence}. {', '.join(options)} and {last} overrule this")
    return read.motion, read.lengths
