"""A campaign on paper: its manifest, tables of its analysis, figures, an HTML page."""

from __future__ import annotations

import base64
import hashlib
import html
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from npend_gym import _files
from npend_gym.experiments import AmplitudeLaw, Analysis, Campaign, CellGroup, PowerFit
from npend_gym.experiments.campaign.folder import Folder
from npend_gym.experiments.campaign.merge import STATISTICS, Summary
from npend_gym.experiments.campaign.status import CELLS, PLAN, FolderStatus
from npend_gym.experiments.campaign.tasks import Plan
from npend_gym.experiments.studies.release_statistics import FAR
from npend_gym.experiments.studies.release_tables import finite_or_none
from npend_gym.report import player
from npend_gym.report.outputs import (
    MANIFEST,
    manifest,
    prepare_folder,
    write_all,
    write_csv,
    write_figure,
    write_manifest,
)

_DRAWN, _SHOWN = 12, 200  # groups that get figures, rows of a table in the page
_NO_LAW = (
    "<p>No law is fitted: it takes three numbers of pendulums at one amplitude, or four "
    "amplitudes.</p>"
)


def finish(campaign: Campaign) -> tuple[str, bool]:
    """Write the manifest; return what to say, and whether every task is done.

    Parts have their digests in their names. A shard knows its own tasks alone, and writes none.
    """
    plan, status = campaign.plan, campaign.status
    number, count = campaign.shard
    tasks = campaign.share()
    complete = status.count == len(tasks)
    if count == 1:
        write_campaign_manifest(plan, campaign.folder, complete=complete)
        return status_text(plan, campaign.folder, status), complete
    text = f"{status.count} of {len(tasks)} tasks of shard {number}/{count} done"
    text += f", {status.failures} task(s) failed" if status.failures else ""
    return f"{text}: {campaign.out}", complete


def status_text(plan: Plan, folder: Folder, status: FolderStatus) -> str:
    """Return how much of a campaign is done."""
    text = f"{status.trials} of {plan.size} {plan.unit} done"
    text += f", {status.failures} task(s) failed" if status.failures else ""
    return f"{text}: {folder}"


def write_campaign_manifest(
    plan: Plan, folder: Folder, more: Sequence[str] = (), *, complete: bool
) -> None:
    """Write the manifest of a campaign; `more` are files beside the plan and the cells."""
    read = {name: folder.read(name) for name in (PLAN, CELLS)}
    digests = {name: hashlib.sha256(data).hexdigest() for name, data in read.items() if data}
    digests |= {name: folder.sha256(name) for name in more}
    record = manifest("campaign", plan.as_dict(), digests, complete=complete)
    folder.write(MANIFEST, (json.dumps(record, indent=2) + "\n").encode())


def fit_rows(analysis: Analysis) -> list[dict[str, Any]]:
    """Return a row for every fitted number, with its confidence interval."""
    fits: list[tuple[CellGroup, PowerFit | AmplitudeLaw, str, dict[str, float | None]]] = []
    for group in analysis.groups:
        for power in group.powers:
            cells = f"amplitude {power.amplitude:.6g}, spread {power.spread:.6g} rad"
            fits.append((group, power, cells, {"p": 0.5}))
        for law in group.laws:
            largest = max(abs(result.start) for result in law.points)
            cells = f"{len(law.points)} cells up to {largest:.3g} rad"
            fits.append((group, law, cells, {"c": law.exact, "b": None, "d": None}))
    return [
        {
            "group": group.label,
            "cells": cells,
            "n": _joined({result.n for result in fit.points}),
            "parameter": name,
            "value": getattr(fit, name).value,
            "+-": getattr(fit, name).error,
            "exact": value,
            "largest_residual": float(np.abs(fit.residuals).max()),
        }
        for group, fit, cells, exact in fits
        for name, value in exact.items()
    ]


def _joined(n_values: set[int]) -> str:
    return " ".join(map(str, sorted(n_values)))


def residual_rows(analysis: Analysis) -> list[dict[str, Any]]:
    """Return a row for every cell and law that it was used for, with the law's residual."""
    fits = [
        (name, fit)
        for group in analysis.groups
        for name, some in (("power of N", group.powers), ("amplitude", group.laws))
        for fit in some
    ]
    return [
        {
            "law": name,
            "cell": point.cell,
            "n": point.n,
            "n_fitted": _joined({result.n for result in fit.points}),
            "angle_rad": point.start,
            "period_s": point.period,
            "fundamental_s": point.fundamental,
            "residual": float(residual),
        }
        for name, fit in fits
        for point, residual in zip(fit.points, fit.residuals, strict=True)
    ]


def cell_rows(analysis: Analysis) -> list[dict[str, Any]]:
    """Return a row for every cell that has been measured: its values and statistics."""
    stats, plan = analysis.statistics, analysis.plan
    means = {
        "start_rad": stats.start,
        "mean_s": stats.mean,
        "median_s": stats.median,
        "tip_s": stats.tip,
        "scatter_s": stats.scatter,
    }
    return [
        {
            "cell": k,
            **{name: _text(value) for name, value in plan.cell(k).items()},
            "releases": int(stats.releases[k]),
            "completed": int(stats.completed[k]),
            "bobs": int(stats.releases[k]) * plan.cell(k)["n"],
            **{name: finite_or_none(float(values[k])) for name, values in means.items()},
        }
        for k in np.flatnonzero(stats.releases).tolist()
    ]


def _notes(analysis: Analysis) -> list[str]:
    """Return sentences about the bobs that completed, and about what is not fitted or drawn."""
    plan, stats = analysis.plan, analysis.statistics
    bobs = stats.releases.reshape(plan.shape[0], -1).sum(axis=1) @ np.ravel(plan.n)
    notes = [f"{int(stats.completed.sum())} of {bobs} bobs completed"]
    unknown = [plan.chain_of(plan.cell(k)) for k in np.flatnonzero(stats.unknown).tolist()]
    still = sum(chain.gravity == 0.0 for chain in unknown)
    if left_out := len(unknown) - still:
        notes.append(
            f"fits leave out {left_out} of {plan.cells} cells, because too few bobs completed: "
            'a longer --duration (or "duration" in the plan) brings them in'
        )
    if still:
        notes.append(f"fits leave out {still} of {plan.cells} cells: nothing moves without gravity")
    fitted = sum(len(group.points) for group in analysis.groups)
    if lawless := int(np.sum((stats.releases > 0) & (stats.unknown == 0))) - fitted:
        notes.append(
            f"fits leave out {lawless} of {plan.cells} cells: the period of the slowest mode is "
            "known only without a cart, springs and balanced links"
        )
    if len(analysis.groups) > _DRAWN:
        notes.append(f"figures of the first {_DRAWN} of {len(analysis.groups)} groups")
    return notes


def _text(value: Any) -> Any:
    return " ".join(map(str, value)) if isinstance(value, tuple) else value  # pyright: ignore[reportUnknownArgumentType, reportUnknownVariableType]


def tables(analysis: Analysis) -> dict[str, list[dict[str, Any]]]:
    """Return the rows of all tables, by the table's name."""
    failed = analysis.status.failed
    return {
        "cells": cell_rows(analysis),
        "fits": fit_rows(analysis),
        "residuals": residual_rows(analysis),
        "outliers": [asdict(outlier) for outlier in analysis.statistics.outliers],
        "failures": [{"task": key, "error": text} for key, text in failed.items()],
    }


def write_analysis(analysis: Analysis | Summary, out: Path, *, figures: bool) -> list[Path]:
    """Write tables, figures, the page and a manifest into `out`; return what was written.

    Those of an earlier analysis are replaced or removed. Of a sweep it is one table, summary.csv.

    Raises
    ------
    ValueError
        If `out` cannot be written to, or is the campaign's folder, which has its own manifest.
    """
    if out.resolve() == analysis.out:
        raise ValueError(f"out must be another folder than the campaign's, got {out}")
    prepare_folder(out)
    complete = analysis.status.count == analysis.plan.task_count
    arguments = analysis.plan.as_dict()
    if isinstance(analysis, Summary):
        written = write_all(out, iter([write_csv(out / "summary.csv", analysis.rows)]))
        return [*written, write_manifest(out, "analyse", arguments, written, complete=complete)]
    contents = tables(analysis)
    files = (write_csv(out / f"{name}.csv", rows) for name, rows in contents.items() if rows)
    written = write_all(out, files)
    pictures = _figures(analysis, out) if figures else []
    player.write(out / "report.html", page(analysis, contents, pictures))
    written += [*pictures, out / "report.html"]
    made = [*(out / f"{name}.csv" for name in contents), out / "residuals.png"]
    for path in {*made, *out.glob("law_against_*_*.png")}.difference(written):
        _files.remove(path)
    return [*written, write_manifest(out, "analyse", arguments, written, complete=complete)]


def _figures(analysis: Analysis, out: Path) -> list[Path]:
    from npend_gym.report import campaign_figures as draw  # matplotlib, an extra

    drawn: dict[str, Any] = {}
    for k, group in enumerate(analysis.groups[:_DRAWN]):
        if group.powers:
            drawn[f"law_against_n_{k}"] = draw.law_against_n(group)
        if group.laws:
            drawn[f"law_against_amplitude_{k}"] = draw.law_against_amplitude(group)
    if analysis.statistics.histogram.any():
        drawn["residuals"] = draw.residuals(analysis.statistics)
    return [write_figure(out / f"{name}.png", figure) for name, figure in drawn.items()]


def page(analysis: Analysis, rows: dict[str, list[dict[str, Any]]], pictures: list[Path]) -> str:
    """Return the HTML page of the `tables`; whatever comes from a file or the user is escaped."""
    plan, status, stats = analysis.plan, analysis.status, analysis.statistics
    texts = {
        "title": f"Campaign {analysis.out.name}",
        "measured": int(stats.releases.sum()),
        "releases": plan.releases,
        "cells": plan.cells,
        "failed": status.failures,
        "missing": plan.task_count - status.count - status.failures,
        "wrong": status.text(),
        "folder": analysis.out,
        "plan": json.dumps(plan.as_dict()),
        "far": f"{FAR:g}",
        "outlier_count": stats.outlier_count,
        "notes": "; ".join(_notes(analysis)),
    }
    encoded = {path.stem: base64.b64encode(path.read_bytes()).decode() for path in pictures}
    shown = (
        f'<p><img alt="{name}" src="data:image/png;base64,{picture}"></p>'
        for name, picture in encoded.items()
    )
    return player.page(
        "campaign.html",
        None,
        (),
        ("page.css", "campaign.css"),
        **{name: html.escape(str(text)) for name, text in texts.items()},
        fits=_table(rows["fits"]) or _NO_LAW * bool(analysis.groups),
        pictures="\n".join(shown),
        outliers=_table(rows["outliers"]),
        failures="<h2>Failed tasks</h2>\n" * bool(status.failed) + _table(rows["failures"]),
        measured_cells=_table(rows["cells"]),
    )


def _table(rows: list[dict[str, Any]]) -> str:
    """Return the first rows as an HTML table; nothing where there are none."""
    if not rows:
        return ""
    more = len(rows) - _SHOWN
    below = f"\n<p>{more} more rows are in the CSV file.</p>" if more > 0 else ""
    return player.table(rows[0], (row.values() for row in rows[:_SHOWN])) + below


def analysis_text(analysis: Analysis | Summary) -> str:
    """Return the fits, or the statistics of a sweep, as text for the terminal."""
    if isinstance(analysis, Summary):
        return _summary_text(analysis)
    stats = analysis.statistics
    completed, *others = _notes(analysis)
    lines = [
        (
            f"{int(stats.releases.sum())} of {analysis.plan.releases} releases, "
            f"{completed}, {stats.outlier_count} outliers, "
            f"{analysis.status.failures} failed tasks"
        ),
        *others,
    ]
    for group in analysis.groups:
        lines += ["", group.label]
        for fit in group.powers:
            n_values = [point.n for point in fit.points]
            lines.append(
                f"  N = {n_values[0]} to {n_values[-1]} at {fit.amplitude:.4g} rad: "
                f"T ~ (N + 1/2)^p, p = {fit.p}"
            )
        for law in group.laws:
            exact = "" if law.exact is None else f" (exact {law.exact:.4f})"
            lines.append(
                f"  N = {' '.join(map(str, law.n_values))}: c = {law.c}{exact}, b = {law.b}, "
                f"d = {law.d}, residuals up to {100.0 * np.abs(law.residuals).max():.2g}%"
            )
    return "\n".join(lines)


def _summary_text(analysis: Summary) -> str:
    """Return a line for each of the first rows."""
    plan, rows = analysis.plan, analysis.rows
    lines = [f"{analysis.status.trials} of {plan.size} {plan.unit} of {plan.study}"]
    for row in rows[:_SHOWN]:
        given = {name: value for name, value in row.items() if name not in STATISTICS}
        shown = ", ".join(
            f"{name} {_text(value)}" for name, value in given.items() if name != "cell"
        )
        numbers = f"{row['mean']:.6g}, sd {row['sd']:.3g}, {row['min']:.6g} to {row['max']:.6g}"
        lines.append(f"  {shown}: {row['column']} {numbers} ({row['count']})")
    return "\n".join([*lines, *[f"  {len(rows) - _SHOWN} more rows"] * (len(rows) > _SHOWN)])
