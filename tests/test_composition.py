"""What works with what: every ability of the physics with every kind of mechanism."""

from pathlib import Path

import pytest
from composition import COLUMNS, REASONS, ROWS, outcome, table

PAGE = Path(__file__).parent.parent / "docs" / "reference" / "composition.md"
SAMPLE = [("simulate, dop853", "ideal"), ("torque as an array (n,)", "uneven"),
          ("accelerations", "cart"), ("mass_matrix", "springs, cart")]  # fmt: skip


def published():
    """Return the cells of the page, by row and column: "yes", or the number of a reason."""
    lines = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line[:1] == "|"]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    columns = rows[0][1:]
    return {
        (row[0], column): cell
        for row in rows[2:]
        for column, cell in zip(columns, row[1:], strict=True)
    }


@pytest.mark.parametrize(("row", "column"), SAMPLE)
def test_a_sample_of_abilities_works(row, column):
    assert outcome(row, column) == ""


@pytest.mark.long
@pytest.mark.parametrize("row", ROWS)
def test_an_ability_works_with_every_mechanism_or_is_refused_for_a_stated_reason(row):
    cells = published()
    for column in COLUMNS:
        found = outcome(row, column)
        expected = cells[row, column]
        assert (found == "") == (expected == "yes"), (row, column, found)
        if found:
            assert list(REASONS).index(found) + 1 == int(expected)


def test_the_page_has_all_combinations_and_at_least_95_percent_work():
    cells = published()
    assert set(cells) == {(row, column) for row in ROWS for column in COLUMNS}
    works = sum(cell == "yes" for cell in cells.values())
    assert works >= 0.95 * len(cells)
    reasons = list(REASONS)
    again = {key: "" if cell == "yes" else reasons[int(cell) - 1] for key, cell in cells.items()}
    assert table(again) == PAGE.read_text(encoding="utf-8")
