"""The audit as text for the terminal, CSV files, Markdown and figures."""

import textwrap
from collections import Counter
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from npend_gym import _files
from npend_gym.paper.findings import KANE_N, Finding, by_section, selected
from npend_gym.paper.registry import DRAWINGS, TABLES, Verdict, call
from npend_gym.report.outputs import prepare_folder, write_csv, write_figure, write_manifest

_WIDTH = 100
_COLUMNS = ("section", "key", "place", "claim", "printed", "ours", "verdict", "note")
_VERBS = {  # of one finding, and of several
    Verdict.HOLDS: ("holds", "hold"),
    Verdict.CORRECTED: ("holds with a correction", "hold with a correction"),
    Verdict.FAILS: ("does not hold", "do not hold"),
    Verdict.UNDECIDABLE: ("is not decidable", "are not decidable"),
}


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
    ordered = [finding for some in by_section(findings).values() for finding in some]
    rows = [vars(finding) | {"verdict": finding.verdict.value} for finding in ordered]
    return [{name: row[name] for name in _COLUMNS} for row in rows]


def audit_markdown(findings: Sequence[Finding]) -> str:
    """Return the audit as Markdown: a summary, then each finding with its note and command."""
    about = files("npend_gym.paper").joinpath("about.md").read_text("utf-8")
    lines = [about, f"**{_count(findings)}.**", ""]
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
    return text.translate({ord(character): "\\" + character for character in "\\*<|"})


def write(
    findings: Sequence[Finding], out: Path, *, only: Sequence[str] | None = None,
    kane_n: int = KANE_N, figures: bool,
) -> list[Path]:  # fmt: skip
    """Write findings, tables, manifest and (with `figures`) pictures into `out`.

    Tables and figures are those that belong to the findings. Each file appears whole, by rename;
    the manifest, with the digests of the others, comes last.
    """
    prepare_folder(out)
    with _files.replacing(out / "audit.md") as file:
        file.write(audit_markdown(findings))
    written = [out / "audit.md", write_csv(out / "findings.csv", audit_rows(findings))]
    keys = {finding.key for finding in findings}
    for name, table in TABLES.items():
        if table.claim in keys:
            written.append(write_csv(out / f"{name}.csv", call(table.rows, kane_n=kane_n)))
    for name, drawing in DRAWINGS.items():
        if figures and drawing.claim in keys:
            written += draw(name, out, kane_n=kane_n)
    arguments: dict[str, Any] = {"only": only, "kane_n": kane_n}
    complete = len(findings) == len(selected(only))
    return [*written, write_manifest(out, "paper", arguments, written, complete=complete)]


def draw(name: str, out: Path, **options: Any) -> list[Path]:
    """Draw the figure `name` and write it to the folder `out` as PDF and as PNG."""
    drawing = DRAWINGS[name]
    figure = drawing.draw(call(drawing.data, **options))
    return [write_figure(out / f"{name}.{kind}", figure) for kind in ("pdf", "png")]
