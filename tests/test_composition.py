"""What works with what: every ability with every kind of mechanism, or of environment."""

import composition
import env_composition
import pytest
from matrices import REFERENCE

MATRICES = {"mechanisms": composition.MATRIX, "environments": env_composition.MATRIX}
DEAR = {  # whose cells `.ci/nightly` tries alone
    "robustness", "imitation", "imitation with drawn chains", "imitation with errors",
    "many motions, rk4", "torque as a function, rk4", "gradient, dop853", "sensitivities, rk4",
}  # fmt: skip
LONG = [
    pytest.param(name, row, marks=pytest.mark.nightly if row in DEAR else ())
    for name, matrix in MATRICES.items()
    for row in matrix.rows
]
# Kinds with the most features. An ability is tried with these and one of the others in turn;
# `.ci/nightly` tries all.
RICH = {
    "friction, rotors", "springs, cart", "cart, rail damping, force", "pivot shaken",
    "RealAIGym robot", "cart, 2 rods", "noise and delay", "transition",
}  # fmt: skip


def test_the_kinds_with_the_most_features_are_columns_of_the_tables():
    columns = {column for matrix in MATRICES.values() for column in matrix.columns}
    assert RICH.issubset(columns)


@pytest.mark.long
@pytest.mark.parametrize(("name", "row"), LONG)
def test_an_ability_works_or_is_refused_for_a_stated_reason(name, row):
    matrix = MATRICES[name]
    cells = matrix.published()
    others = [column for column in matrix.columns if column not in RICH]
    turn = others[[*matrix.rows].index(row) % len(others)]
    for column in matrix.columns:
        if column in RICH or column == turn or cells[row, column]:
            assert matrix.outcome(row, column) == cells[row, column], column


@pytest.mark.parametrize(("name", "least"), [("mechanisms", 0.94), ("environments", 0.97)])
def test_the_page_has_all_combinations_and_nearly_all_work(name, least):
    matrix = MATRICES[name]
    cells = matrix.published()
    assert set(cells) == {(row, column) for row in matrix.rows for column in matrix.columns}
    assert sum(not reason for reason in cells.values()) >= least * len(cells)
    assert matrix.table(cells) == (REFERENCE / matrix.page).read_text(encoding="utf-8")
