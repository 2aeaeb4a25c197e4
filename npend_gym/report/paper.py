"""The audit of the paper on paper: text for the terminal, CSV files, Markdown, figures."""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from npend_gym import _files
from npend_gym.experiments.paper import CONTENTS, KANE_N, Finding, Verdict, in_order, selected
from npend_gym.report.outputs import prepare_folder, write_csv, write_manifest

_WIDTH = 100
_COMMAND = "npend paper --only {}"

# Name of a figure or table -> the finding that it belongs to
_FIGURES = {
    "trajectory": "figure-2",
    "pseudo_periods": "figure-7",
    "readings": "tables-together",
    "law_against_n": "sqrt-scaling",
    "law_against_angle": "period-law",
    "runge_kutta": "rk4-orders",
    "kane_cost": "run-time",
    "lyapunov": "chaos-n",
}
_TABLES = {
    "errors_by_reading": "tables-together",
    "digits": "t0-digits",
    "law": "period-law",
    "kane_cost": "run-time",
    "lyapunov": "chaos-n",
}


def audit_text(findings: Sequence[Finding]) -> str:
    """Return the audit as text: verdict, place, what is printed and our value of each finding."""
    lines: list[str] = []
    for section, some in _by_section(findings):
        lines += [section, ""]
        for finding in some:
            lines.append(
                f"  {finding.verdict.value.upper()}: {_capital(finding.place)} [{finding.key}]"
            )
            lines += _paragraph("", _capital(finding.claim))
            lines += _paragraph("printed: ", finding.printed)
            lines += _paragraph("ours:    ", finding.ours)
        lines.append("")
    return "\n".join([*lines, _count(findings)])


def _paragraph(label: str, text: str) -> list[str]:
    return textwrap.wrap(
        text, _WIDTH, initial_indent=" " * 6 + label, subsequent_indent=" " * (6 + len(label))
    )


def _count(findings: Sequence[Finding]) -> str:
    counts = Counter(finding.verdict for finding in findings)
    found = ", ".join(f"{counts[v]} {v.value}" for v in Verdict if counts[v])
    return f"{len(findings)} findings: {found}"


def _by_section(findings: Sequence[Finding]) -> Iterator[tuple[str, list[Finding]]]:
    for section, keys in CONTENTS.items():
        some = [finding for finding in in_order(findings) if finding.key in keys]
        if some:
            yield section, some


def audit_rows(findings: Sequence[Finding]) -> list[dict[str, str]]:
    """Return the tidy table: a row for every finding, in the order of the paper."""
    return [
        {
            "section": section,
            "key": finding.key,
            "place": finding.place,
            "claim": finding.claim,
            "printed": finding.printed,
            "ours": finding.ours,
            "verdict": finding.verdict.value,
            "note": finding.note,
        }
        for section, some in _by_section(findings)
        for finding in some
    ]


_ABOUT = """\
# The paper, audited

S. Charles, *The Lagrangian Mechanics and Pseudo-Periodicity of The Many-Body Planar Pendulum
System* (10 March 2019): every numbered equation, number and claim, in the paper's order, with what
was computed about it. Equations, figures and tables are numbered as LaTeX numbers the source; what
defines or assumes, and so can be neither true nor false, is left out.

This file is made by `npend paper --out FOLDER`, as `audit.md`; each item names the command that
computes it alone. Verdicts follow from comparisons of computed numbers. Notation: theta' is the
time derivative, N the number of rods, T0 the paper's ideal period 2 pi N / sum sqrt(g m/(l M)), T1
the period of the slowest normal mode, S a measured pseudo-period, a starting angle is that of all
rods, released from rest. "Off by" is the largest error relative to the largest value, on 20 random
motions of a chain of unequal rods where nothing else is said; 1e-15 is rounding.
"""


def audit_markdown(findings: Sequence[Finding]) -> str:
    """Return the audit as Markdown: a summary, then each finding with its note and command."""
    lines = [_ABOUT, f"**{_count(findings)}.**", ""]
    lines += ["| section | " + " | ".join(v.value for v in Verdict) + " |", "|---|" + 4 * "---:|"]
    for section, some in _by_section(findings):
        counts = Counter(finding.verdict for finding in some)
        cells = [str(counts[v] or "") for v in Verdict]
        lines.append(f"| {section} | " + " | ".join(cells) + " |")
    for section, some in _by_section(findings):
        lines += ["", f"## {section}"]
        for finding in some:
            lines += ["", *_item(finding)]
    return "\n".join(lines) + "\n"


def _item(finding: Finding) -> list[str]:
    printed = "" if finding.printed == "-" else f"- Printed: `{finding.printed}`"
    ours = "" if finding.ours == "-" else f"- Computed: {_escaped(finding.ours)}"
    note = f"- {_escaped(finding.note)}" if finding.note else ""
    lines = [
        f"**{_title(finding)}.** *{finding.verdict.value}*",
        "",
        printed,
        ours,
        note,
        f"- `{_COMMAND.format(finding.key)}`",
    ]
    return [line for k, line in enumerate(lines) if line or k == 1]


def _title(finding: Finding) -> str:
    return _escaped(f"{_capital(finding.place)}: {_capital(finding.claim)}")


def _capital(text: str) -> str:
    """Return `text` with a capital, unless it starts with a symbol such as e or dL/dt."""
    first = text.split(" ", 1)[0].rstrip(",:")
    return text[0].upper() + text[1:] if first.isalpha() and len(first) > 1 else text


def _escaped(text: str) -> str:
    """Return `text` with the characters escaped that Markdown would take for its own."""
    for character in "\\*<|":
        text = text.replace(character, "\\" + character)
    return text


def write(
    findings: Sequence[Finding],
    out: Path,
    *,
    only: Sequence[str] | None = None,
    kane_n: int = KANE_N,
    figures: bool,
) -> list[Path]:
    """Write findings, tables, manifest and (with `figures`) pictures into `out`.

    Tables and figures are those of the findings at hand. Each file appears whole, by rename; the
    manifest, with the digests of the others, comes last.
    """
    prepare_folder(out)
    with _files.replacing(out / "audit.md") as file:
        file.write(audit_markdown(findings))
    written = [out / "audit.md", write_csv(out / "findings.csv", audit_rows(findings))]
    keys = {finding.key for finding in findings}
    rows = _table_rows(kane_n)
    for name, key in _TABLES.items():
        if key in keys:
            written.append(write_csv(out / f"{name}.csv", rows[name]()))
    if figures:
        from npend_gym.report.paper_figures import write_figures  # matplotlib, an extra

        data = _figure_data(kane_n)
        for name, key in _FIGURES.items():
            if key in keys:
                written += write_figures({name: data[name]()}, out)
    complete = len(findings) == len(selected(only))
    arguments = {"only": only, "kane_n": kane_n}
    manifest = write_manifest(out, "paper", arguments, written, complete=complete)
    return [*written, manifest]


def _figure_data(kane_n: int) -> dict[str, Callable[[], Any]]:
    from npend_gym.experiments.paper.figure_data import SOURCES, kane_cost

    return {**SOURCES, "kane_cost": partial(kane_cost, kane_n)}


def _table_rows(kane_n: int) -> dict[str, Callable[[], list[dict[str, Any]]]]:
    from npend_gym.experiments.law import scan, scan_rows
    from npend_gym.experiments.paper.chaos import growth_rows
    from npend_gym.experiments.paper.grid import grid, grid_rows
    from npend_gym.experiments.paper.kane import cost_rows
    from npend_gym.experiments.paper.periods import digit_rows

    return {
        "errors_by_reading": lambda: grid_rows(grid()),
        "digits": digit_rows,
        "law": lambda: scan_rows(scan()),
        "kane_cost": lambda: cost_rows(kane_n),
        "lyapunov": growth_rows,
    }
