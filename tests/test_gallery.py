"""The notebooks run, and print what they show."""

from copy import deepcopy
from operator import eq
from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat", reason="nbformat is not installed")
nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed")

DOCS = Path(__file__).parent.parent / "docs"


def outputs(notebook):
    return [cell.outputs for cell in notebook.cells if cell.cell_type == "code"]


def printed(notebook):
    return [
        "".join(out.text for out in cell if out.get("name") == "stdout")  # no notices
        for cell in outputs(notebook)
    ]


def same_text(one, other):
    """Return whether texts agree, numbers to 1e-5: networks differ between processors."""
    words, others = one.split(), other.split()
    return len(words) == len(others) and all(map(same_word, words, others))


def same_word(one, other):
    try:
        return float(one) == pytest.approx(float(other), abs=1e-5)
    except ValueError:
        return one == other


def shown_as(kind, notebook):
    data = [out.get("data", {}) for cell in outputs(notebook) for out in cell]
    return [one[kind] for one in data if kind in one]


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the libraries below the kernel
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("name", ["gallery.ipynb", "chaos.ipynb", "try_it.ipynb"])
def test_a_notebook_prints_what_it_shows(name, tmp_path):
    shown = nbformat.read(DOCS / name, as_version=4)
    again = deepcopy(shown)
    client = nbclient.NotebookClient(
        again, timeout=180, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    )
    client.execute()
    same = same_text if name == "try_it.ipynb" else eq  # which shows what networks do
    assert all(map(same, printed(again), printed(shown))), printed(again)
    pictures = [len(shown_as("image/png", one)) for one in (again, shown)]
    assert pictures[0] == pictures[1] > 0
    players = ["".join(shown_as("text/html", one)).count("<iframe") for one in (again, shown)]
    assert players[0] == players[1] == (name == "try_it.ipynb")
