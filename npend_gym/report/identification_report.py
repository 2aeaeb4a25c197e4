"""An identification on paper: text for the terminal, the chain and all values as JSON, figures."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from npend_gym.identification import Identification, Motion
from npend_gym.report.outputs import write_results

_MRAD = 1e3


def identification_text(result: Identification) -> str:
    """Text of the values fitted, their errors, and the values that the data do not determine."""
    held = sum(one["held_out"] for one in result.segments)
    longest = max(one["end"] - one["start"] for one in result.segments)
    outliers = int(result.outliers[result.held_out].sum())
    counts = f"{len(result.segments) - held} segments fitted, {held} held out"
    lines = [
        f"{counts}, each up to {longest:.2f} s from a first state that is fitted",
        "",
        "error of the angles (RMSE) [mrad]",
        f"  held out, fitted chain {_mrad(result.held_out_rmse):>10}",
        f"  held out, given chain  {_mrad(result.given_rmse):>10}",
        f"  fitted segments        {_mrad(result.fitted_rmse):>10}",
        f"  held out, {outliers} outliers left out: {_mrad(result.clean_rmse)}",
        "",
        f"{'fitted value':<18}{'':>12}   standard error",
    ]
    for name, unit, value, error in result.rows():
        spread = f"{error:.2g}" if math.isfinite(error) else "not determined"
        bound = ", at its bound" * (value == 0.0 and math.isfinite(error))
        lines.append(f"{name:<18}{value:>12.6g}   {spread:<14} {unit}{bound}")
    lines += ["", f"chain: {result.chain!r}"]
    if result.left_out:
        lines += ["", "left out, because the data do not support it (--fit fits what you name):"]
        lines += [f"  - {sentence}" for sentence in result.left_out]
    lines += ["", *_swings(result), "", "not determined by the data:"]
    lines += [f"  - {sentence}" for sentence in result.undetermined]
    return "\n".join(lines)


def _swings(result: Identification) -> list[str]:
    """Return the periods of small swings, and those measured, in lines."""
    measured = [
        f"theta{link} " + (f"{period:.4g} s" if math.isfinite(period) else "- (no whole swing)")
        for link, period in enumerate(result.mean_periods.tolist())
    ]
    lines = ["measured, mean time from swing to swing: " + ", ".join(measured)]
    if not np.all(np.isfinite(result.small_periods)):
        return [*lines, "small swings: none, because gravity does not turn every link"]
    heads = "period [s]", "standard error", "g/L [1/s^2]", "equivalent length L [m]"
    lines += ["small swings of the fitted chain about hanging:"]
    lines += [f"{'mode':>6}{heads[0]:>14}{heads[1]:>17}{heads[2]:>14}{heads[3]:>26}"]
    columns = result.small_periods, result.small_period_errors, result.equivalent_lengths
    for mode, (period, error, length) in enumerate(
        zip(*(c.tolist() for c in columns), strict=True)
    ):
        spread = f"{error:.2g}" if math.isfinite(error) else "not determined"
        square = (2.0 * math.pi / period) ** 2
        lines.append(f"{mode:>6}{period:>14.6g}{spread:>17}{square:>14.6g}{length:>26.6g}")
    return lines


def _mrad(value: float) -> str:
    return "-" if math.isnan(value) else f"{_MRAD * value:.2f}"


def write_identification(
    result: Identification, motion: Motion, out: Path, *, figures: bool
) -> list[Path]:
    """Write the chain, all values, the residuals and (with `figures`) pictures into `out`.

    ``fit.json`` is the chain, as ``gym.make("npend/SwingUp-v1", chain=...)`` takes it.
    ``identification.json`` has everything else, ``residuals.csv`` a line for each row of the data.

    Parameters
    ----------
    result : Identification
    motion : Motion
        What was measured.
    out : Path
    figures : bool
        Whether to draw; this needs matplotlib, an extra.

    Returns
    -------
    list of Path
        The files.
    """
    drawn: dict[str, Any] = {}
    if figures:
        from npend_gym.report import identification_figures as draw

        drawn["held_out"] = partial(draw.motions, result, motion)
        drawn["errors"] = partial(draw.errors, result)
        drawn["parameters"] = partial(draw.parameters, result)
    return write_results(
        out, "identification", result.provenance["arguments"], complete=True,
        records={"fit": result.chain.as_dict(), "identification": result.as_dict()},
        tables={"residuals": _residual_rows(result, motion)}, figures=drawn,
    )  # fmt: skip


def _residual_rows(result: Identification, motion: Motion) -> list[dict[str, Any]]:
    """Return a row for each row of the data; simulated less measured angles, NaN where neither."""
    names = [f"residual{link}" for link in range(motion.links)]
    measured = zip(motion.piece, motion.times, result.held_out, result.residuals, strict=True)
    return [
        {"piece": int(piece), "time": float(time), "held_out": int(held)}
        | dict(zip(names, (float(one) for one in row), strict=True))
        for piece, time, held, row in measured
    ]
