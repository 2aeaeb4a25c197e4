"""Tables of results: read as CSV, joined with new rows, put into a page of the documentation."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from npend_gym.tools import replacing


def texts(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a CSV file; none where there is no file."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def read_rows(path: Path) -> list[dict[str, Any]]:
    """Return the rows of a CSV file with numbers; an empty cell is None."""
    return [{name: value_of(text) for name, text in row.items()} for row in texts(path)]


def value_of(text: str) -> int | float | str | None:
    """Return the value of a cell in a CSV file."""
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    return text or None


def merged_rows(path: Path, done: Sequence[dict[str, Any]], *names: str) -> list[dict[str, Any]]:
    """Return the rows of a file with `done`, which replace those of the same values of `names`."""
    rows = [*texts(path), *done]
    return [*{tuple(row[name] for name in names): row for row in rows}.values()]


def publish_table(page: Path, head: str, table: str) -> None:
    """Put a table into a page, in place of the one that begins with `head`."""
    old, text = re.compile(re.escape(head) + ".*?\n\n", re.DOTALL), page.read_text("utf-8")
    if not old.search(text):
        raise ValueError(f"{page} must have a table that begins with {head!r}")
    with replacing(page) as file:
        file.write(old.sub(lambda _: table + "\n", text, count=1))
