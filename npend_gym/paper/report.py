"""The audit as text for the terminal, CSV files, Markdown and figures."""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from npend_gym import _files
from npend_gym.paper.claims import claims
from npend_gym.paper.findings import KANE_N, Finding, by_section, groups, selected
from npend_gym.paper.registry import Verdict, call, drawings, tables
from npend_gym.report.outputs import prepare_folder, write_csv, write_figure, write_manifest

_WIDTH = 100
_COLUMNS = ("section", "key", "place", "claim", "printed", "ours", "verdict", "note")
_VERBS = {  # of one finding, and of several
    Verdict.HOLDS: ("holds", "hold"),
    Verdict.CORRECTED: ("holds with a correction", "hold with a correction"),
    Verdict.FAILS: ("does not hold", "do not hold"),
    Verdict.UNDECIDABLE: ("is not decidable", "are not decidable"),
}


def contents_text() -> str:
    """Return the keys of all claims and their modules, by sections of the paper."""
    lines: list[str] = []
    for key, group in groups().items():
        section = claims()[key].section
        if section not in lines:
            lines.append(section)
        lines.append(f"  {key:20} {group}")
    return "\n".join(lines)


def audit_text(findings: Sequence[Finding]) -> str:
    """Return the audit as text: verdict, place, what is printed and our value of each finding."""
    lines: list[str] = []
    for section, some in by_section(findings).items():
        lines += [section, ""]
        for one in some:
            lines.append(f"  {one.verdict.value.upper()}: {_capital(one.place)} [{one.key}]")
            for label, text in (
                ("", _capital(one.claim)), ("printed: ", one.printed), ("ours:    ", one.ours),
            ):  # fmt: skip
                first, later = " " * 6 + label, " " * (6 + len(label))
                lines += textwrap.wrap(text, _WIDTH, initial_indent=first, subsequent_indent=later)
        lines.append("")
    return "\n".join([*lines, _count(findings)])


def _count(findings: Sequence[Finding]) -> str:
    counts = Counter(finding.verdict for finding in findings)
    found = [f"{counts[v]} {verbs[counts[v] > 1]}" for v, verbs in _VERBS.items() if counts[v]]
    return f"{len(findings)} finding{'s' * (len(findings) != 1)}: {', '.join(found)}"


def audit_rows(findings: Sequence[Finding]) -> list[dict[str, str]]:
    """Return the tidy table: a row for every finding, in the order of the paper."""
    rows = [
        vars(finding) | {"verdict": finding.verdict.value}
        for some in by_section(findings).values()
        for finding in some
    ]
    return [{name: row[name] for name in _COLUMNS} for row in rows]


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
    sections = by_section(findings)
    for section, some in sections.items():
        counts = Counter(finding.verdict for finding in some)
        lines.append(f"| {section} | " + " | ".join(str(counts[v] or "") for v in Verdict) + " |")
    for section, some in sections.items():
        lines += ["", f"## {section}"]
        for finding in some:
            lines += ["", *_item(finding)]
    return "\n".join(lines) + "\n"


def _item(finding: Finding) -> list[str]:
    title = _escaped(f"{_capital(finding.place)}: {_capital(finding.claim)}")
    lines = [f"**{title}.** *{finding.verdict.value}*", ""]
    if finding.printed != "-":
        lines.append(f"- Printed: `{finding.printed}`")
    if finding.ours != "-":
        lines.append(f"- Computed: {_escaped(finding.ours)}")
    if finding.note:
        lines.append(f"- {_escaped(finding.note)}")
    return [*lines, f"- `npend paper --only {finding.key}`"]


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

    Tables and figures are those that belong to the findings. Each file appears whole, by rename;
    the manifest, with the digests of the others, comes last.
    """
    prepare_folder(out)
    with _files.replacing(out / "audit.md") as file:
        file.write(audit_markdown(findings))
    written = [out / "audit.md", write_csv(out / "findings.csv", audit_rows(findings))]
    keys = {finding.key for finding in findings}
    for name, table in tables().items():
        if table.claim in keys:
            written.append(write_csv(out / f"{name}.csv", call(table.rows, kane_n=kane_n)))
    for name, drawing in drawings().items():
        if figures and drawing.claim in keys:
            written += draw(name, out, kane_n=kane_n)
    arguments: dict[str, Any] = {"only": only, "kane_n": kane_n}
    complete = len(findings) == len(selected(only))
    return [*written, write_manifest(out, "paper", arguments, written, complete=complete)]


def draw(name: str, out: Path, **options: Any) -> list[Path]:
    """Draw the figure `name` and write it to the folder `out` as PDF and as PNG.

    Raises
    ------
    ImportError
        If matplotlib is not installed.
    """
    drawing = drawings()[name]
    figure = drawing.draw(call(drawing.data, **options))
    return [write_figure(out / f"{name}.{kind}", figure) for kind in ("pdf", "png")]
