"""Tables of what works with what: every ability with every kind of thing, run cell by cell."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

REFERENCE = Path(__file__).parent.parent / "docs" / "reference"
Outcomes = dict[tuple[str, str], str]  # "", or the reason why a cell is refused


@dataclass(frozen=True)
class Matrix:
    """Abilities, what they are tried with, and why some combinations are refused."""

    page: str  # a file of docs/reference
    title: str
    text: str  # of the page, with {works} and {cells}
    rows: Mapping[str, Callable[[Any], None]]  # each raises where its argument is refused
    columns: Mapping[str, Any]
    reasons: Mapping[str, tuple[str, ...]]  # with texts, one of which the error has

    def outcome(self, row: str, column: str) -> str:
        """Return "" where a cell works, or the reason why it is refused; an error is raised."""
        try:
            self.rows[row](self.columns[column])
        except (ValueError, TypeError) as error:
            for reason, texts in self.reasons.items():
                if any(text in str(error) for text in texts):
                    return reason
            raise
        return ""

    def table(self, outcomes: Outcomes) -> str:
        """Return the page: a list of what works with everything, and a table of the rest."""
        marks = {reason: str(k) for k, reason in enumerate(self.reasons, start=1)}
        everywhere, lines = list[str](), list[str]()
        for row in self.rows:
            cells = [marks.get(outcomes[row, column], "yes") for column in self.columns]
            if set(cells) == {"yes"}:
                everywhere.append(f"- {row}")
            else:
                lines.append(f"| {row} | " + " | ".join(cells) + " |")
        works = sum(not each for each in outcomes.values())
        notes = [f"{mark}. {reason}" for reason, mark in marks.items()]
        text = self.text.format(works=works, cells=len(outcomes))
        head = ["| |" + "|".join(self.columns) + "|", "|---|" + ":-:|" * len(self.columns)]
        some = ["## With some", "", *head, *lines, "", *notes, ""]
        return "\n".join(
            [f"# {self.title}", "", text, "", *some, "## With all", "", *everywhere, ""]
        )

    def published(self) -> Outcomes:
        """Return the cells of the page."""
        lines = (REFERENCE / self.page).read_text(encoding="utf-8").splitlines()
        cells = [
            [cell.strip() for cell in line.strip("|").split("|")]
            for line in lines
            if line.startswith("|")
        ]
        reasons, columns = list(self.reasons), cells[0][1:]
        everywhere = [line.removeprefix("- ") for line in lines if line.startswith("- ")]
        return {
            (row[0], column): "" if cell == "yes" else reasons[int(cell) - 1]
            for row in [*cells[2:], *([name] + ["yes"] * len(columns) for name in everywhere)]
            for column, cell in zip(columns, row[1:], strict=True)
        }

    def write(self) -> None:
        """Run all cells and write the page."""
        page = REFERENCE / self.page
        cells = [(row, column) for row in self.rows for column in self.columns]
        page.write_text(self.table({cell: self.outcome(*cell) for cell in cells}), encoding="utf-8")
        sys.stdout.write(f"{page}\n")
