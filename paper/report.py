"""The audit as text for the terminal, CSV files, Markdown and figures."""

import re
import textwrap
from collections import Counter
from collections.abc import Collection, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from npend_gym.report import prepare_folder, write_csv, write_figure, write_manifest
from npend_gym.tools import replacing
from paper.claims import claims, render
from paper.findings import KANE_N, Finding, by_section, selected
from paper.registry import DRAWINGS, TABLES, Verdict, call

_WIDTH = 100
_COLUMNS = ("section", "key", "place", "claim", "printed", "ours", "verdict", "note", "cause")
_VERBS = {  # of one finding, and of several
    Verdict.HOLDS: ("holds", "hold"),
    Verdict.SLIP: ("holds but for a slip", "hold but for a slip"),
    Verdict.FAILS: ("does not hold", "do not hold"),
    Verdict.UNDECIDABLE: ("is not decidable", "are not decidable"),
}


def audit_text(findings: Sequence[Finding]) -> str:
    """Return the audit as text: verdict, place, what is printed, our value and why."""
    lines: list[str] = []
    for section, some in by_section(findings).items():
        lines += [section, ""]
        for one in some:
            lines.append(f"  {one.verdict.value.upper()}: {_capital(one.place)} [{one.key}]")
            for label, text in (
                ("", _capital(one.claim)), ("printed: ", one.printed), ("ours:    ", one.ours),
                ("note:    ", one.note), ("follows from ", one.cause and f"[{one.cause}]"),
            ):  # fmt: skip
                if text and text != "-":
                    first, later = " " * 6 + label, " " * (6 + len(label))
                    lines += textwrap.wrap(
                        text,
                        _WIDTH,
                        initial_indent=first,
                        subsequent_indent=later,
                        break_on_hyphens=False,
                    )
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


def audit_markdown(findings: Sequence[Finding], figures: Collection[str] = ()) -> str:
    """Return the audit as Markdown: what matters most, a glossary, then each finding.

    `figures` are the names of those that stand beside the text, as images/NAME.png.
    """
    sections = by_section(findings)
    lines = [*_opening(findings), f"**{_count(findings)}.**", ""]
    lines += ["| section | " + " | ".join(v.value for v in Verdict) + " |", "|---|" + 4 * "---:|"]
    for section, some in sections.items():
        counts = Counter(finding.verdict for finding in some)
        lines.append(f"| {section} | " + " | ".join(str(counts[v] or "") for v in Verdict) + " |")
    keys = {finding.key for finding in findings}
    for section, some in sections.items():
        lines += ["", f"## {section}"]
        for finding in some:
            if finding.like not in keys:  # it stands with the one that it is like
                lines += ["", *_item(finding, [one for one in some if one.like == finding.key])]
                drawn = (name for name in figures if DRAWINGS[name].claim == finding.key)
                lines += [text for name in drawn for text in _picture(name)]
    return "\n".join(lines) + "\n"


def _opening(findings: Sequence[Finding]) -> list[str]:
    """Return what the paper is, the headlines if all are known, and the glossary."""
    about, headlines, glossary = (
        files("paper").joinpath(f"{name}.md").read_text("utf-8")
        for name in ("about", "headlines", "glossary")
    )
    numbers = {
        f"{one.key}.{name}": value for one in findings for name, value in one.numbers.items()
    }
    try:
        headlines = _linked(render(headlines, numbers))
    except KeyError:  # of a part of the audit
        return [about, glossary]
    return [about, headlines, glossary]


def _item(finding: Finding, alike: Sequence[Finding]) -> list[str]:
    title = _escaped(f"{_capital(finding.place)}: {_capital(finding.claim)}")
    lines = [f"### {finding.key}", "", f"**{title}.** *{finding.verdict.value}*", ""]
    if finding.printed != "-":
        lines.append(f"- Printed: `{finding.printed}`")
    if finding.ours != "-":
        lines.append(f"- Computed: {_escaped(finding.ours)}")
    if finding.note:
        lines.append(f"- {_linked(_escaped(finding.note))}")
    if finding.cause:
        lines.append(f"- Follows from {_linked(f'[{finding.cause}]')}.")
    follow = [f"[{key}]" for key, claim in claims().items() if claim.cause == finding.key]
    if follow:
        lines.append(f"- From this follow {_linked(', '.join(follow))}.")
    lines.append(f"- `python -m paper --only {finding.key}`")
    for one in alike:
        text = f"**{one.place}:** *{one.verdict.value}*. Printed: `{one.printed}`. Computed: "
        note = f" {_linked(_escaped(one.note))}" if one.note != finding.note else ""
        ours = f"{_escaped(one.ours)}." if not one.ours.endswith(".") else _escaped(one.ours)
        lines.append(f"- {text}{ours}{note} `python -m paper --only {one.key}`")
    return lines


def _picture(name: str) -> list[str]:
    caption = DRAWINGS[name].caption
    drawn = f"Drawn by `python -m paper --only {DRAWINGS[name].claim} --out FOLDER`."
    return ["", f"![{caption}](images/{name}.png)", "", f"*{caption} {drawn}*"]


def _linked(text: str) -> str:
    """Return `text` with the keys of claims in brackets as links to them."""

    def link(found: re.Match[str]) -> str:
        base = claims()[found[1]].like or found[1] if found[1] in claims() else ""
        return f"[{found[1]}](#{base})" if base else found[0]

    return re.sub(r"\[([a-z0-9-]+)\](?!\()", link, text)


def _capital(text: str) -> str:
    """Return `text` with a capital, unless it starts with a symbol such as e or dL/dt."""
    first = text.split(" ", 1)[0].rstrip(",:")
    return text[0].upper() + text[1:] if first.isalpha() and len(first) > 1 else text


def _escaped(text: str) -> str:
    """Return `text` with the characters escaped that Markdown would take for its own."""
    return text.translate({ord(character): "\\" + character for character in "\\*<|"})


def write(
    findings: Sequence[Finding], out: Path, written: list[Path], *,
    only: Sequence[str] | None = None, kane_n: int = KANE_N, figures: bool,
    interrupted: bool = False,
) -> None:  # fmt: skip
    """Write findings, tables, manifest and (with `figures`) pictures into `out`.

    Tables and figures are those that belong to the findings; after an interruption none is
    computed. Each file appears whole, by rename; the manifest, with the digests of the others,
    comes last. An error or an interruption meanwhile leaves out the tables and figures that are
    missing. The paths are added to `written`, also then.
    """
    prepare_folder(out)
    made = [write_csv(out / "findings.csv", audit_rows(findings))]
    keys = set[str]() if interrupted else {finding.key for finding in findings}
    drawn: list[str] = []
    complete = False
    try:
        for name, table in TABLES.items():
            if table.claim in keys:
                made.append(write_csv(out / f"{name}.csv", call(table.rows, kane_n=kane_n)))
        for name, one in DRAWINGS.items():
            if figures and one.claim in keys:
                made += draw(name, out / "images", kane_n=kane_n)
                drawn.append(name)
        complete = not interrupted and len(findings) == len(selected(only))
    finally:
        with replacing(out / "audit.md") as file:
            file.write(audit_markdown(findings, drawn))
        made.append(out / "audit.md")
        arguments: dict[str, Any] = {"only": only, "kane_n": kane_n}
        made.append(write_manifest(out, "paper", arguments, made, complete=complete))
        written += made


def draw(name: str, out: Path, **options: Any) -> list[Path]:
    """Draw the figure `name` and write it to the folder `out` as PDF and as PNG."""
    prepare_folder(out)
    drawing = DRAWINGS[name]
    figure = drawing.draw(call(drawing.data, **options))
    return [write_figure(out / f"{name}.{kind}", figure) for kind in ("pdf", "png")]
