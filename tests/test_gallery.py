"""The notebook for a class runs, and prints what it shows."""

from copy import deepcopy
from pathlib import Path

import pytest

nbformat = pytest.importorskip("nbformat", reason="nbformat is not installed")
nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed")

NOTEBOOK = Path(__file__).parent.parent / "docs" / "gallery.ipynb"


def printed(notebook):
    return [
        "".join(out.text for out in cell.outputs if out.output_type == "stream")
        for cell in notebook.cells
        if cell.cell_type == "code"
    ]


def pictures(notebook):
    return sum(
        "image/png" in out.get("data", {})
        for cell in notebook.cells
        if cell.cell_type == "code"
        for out in cell.outputs
    )


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the libraries below the kernel
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_the_gallery_prints_what_it_shows(tmp_path):
    shown = nbformat.read(NOTEBOOK, as_version=4)
    again = deepcopy(shown)
    client = nbclient.NotebookClient(
        again, timeout=180, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    )
    client.execute()
    assert printed(again) == printed(shown)
    assert pictures(again) == pictures(shown) == 5
    text = "".join(printed(again))
    assert "45 degrees: measured 2.086256 s, exact 2.086256 s" in text
    assert "T1 / T0 = 0.8337" in text
