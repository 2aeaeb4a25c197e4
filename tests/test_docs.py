"""What the pages show is what the code does: blocks run, pictures are drawn, links have targets."""

import contextlib
import importlib.util
import io
import os
import re
import shutil
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from scripts import run_python

from npend_gym import Chain, simulate
from npend_gym.rl import Policy, pretrained_names
from npend_gym.rl.training.trainers import trainer_names

ROOT = Path(__file__).parent.parent
PAGES = sorted(
    page
    for page in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    if "```python\n" in page.read_text(encoding="utf-8")
)
BLOCK = re.compile(r"```python\n(.*?)```(?:\n\n```text\n(.*?)```)?", re.DOTALL)


TAKES_LONG = {"README.md", "bench_to_controller.md", "extensions.md", "transition.md"}
LONG_FOLDERS = {"explanation", "howto", "notes"}
SIMULATED = {"gpu.md"}
IN_C = {"bench_to_controller.md"}


def takes_long(page):
    return page.name in TAKES_LONG or page.parent.name in LONG_FOLDERS


@pytest.mark.parametrize(
    "page",
    [pytest.param(p, marks=pytest.mark.long) if takes_long(p) else p for p in PAGES],
    ids=lambda page: str(page.relative_to(ROOT)),
)
def test_code_of_the_page_prints_what_the_page_shows(page, tmp_path, monkeypatch):
    if page.name in IN_C and not (os.name == "posix" and shutil.which("cc")):
        pytest.skip("no C compiler here")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)  # as for a script that stands there
    for data in ("examples", "benchmarks/certify"):
        shutil.copytree(ROOT / data, tmp_path / data)
    blocks = BLOCK.findall(page.read_text(encoding="utf-8"))
    if page.name in SIMULATED:  # Numba reads once whether it simulates a GPU
        environment = os.environ | {"NUMBA_ENABLE_CUDASIM": "1"}
        code = "".join(code for code, _ in blocks)
        assert run_python("-c", code, env=environment) == "".join(shown for _, shown in blocks)
        return
    names = {"__name__": "page"}
    for code, shown in blocks:
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            exec(compile(code, page.name, "exec"), names)
        assert printed.getvalue() == shown


def test_the_gallery_has_every_picture_with_what_makes_it():
    gallery = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    command = r"```sh\n(?:npend |python (?:benchmarks|examples)/|python -m paper )"
    makes = rf"{command}|```\{{literalinclude\}} figures\.py\n:pyobject: "
    pictures = re.findall(rf"\(images/(\w+)\.\w+\)\n\n({makes})", gallery)
    assert {name for name, _ in pictures} == {
        path.stem for path in (ROOT / "docs" / "images").iterdir()
    }
    drawn = {name for name, made in pictures if "literalinclude" in made}
    assert drawn == set(script_of_docs("figures").FIGURES)


@pytest.mark.parametrize(
    "face", ["physics", "chaos", "envs", "rl", "torch", "experiments", "export", "identification"]
)
def test_the_reference_has_every_public_name(face):
    pages = (ROOT / "docs" / "reference").glob("*.md")
    reference = "".join(page.read_text(encoding="utf-8") for page in pages)
    described = re.findall(r"^\.\. auto\w+:: (.*)$", reference, re.MULTILINE)
    if f"npend_gym.{face}" not in described:
        names = {name.rpartition(".")[2] for name in described}
        assert names >= set(import_module(f"npend_gym.{face}").__all__)


@pytest.mark.parametrize(
    "name", ["conventions", "tensions", "definitions", "tutorial", "class_experiment"]
)
def test_figures_of_the_pages_are_drawn(name):
    figure = script_of_docs("figures").FIGURES[name]()
    assert len(figure.axes) >= 2
    assert all(ax.lines or ax.images for ax in figure.axes)


def test_figures_are_drawn_into_a_new_folder(tmp_path, monkeypatch):
    script = script_of_docs("figures")
    monkeypatch.setattr(script, "FIGURES", {"empty": script.Figure})
    monkeypatch.setattr("sys.argv", ["figures.py", str(tmp_path / "new" / "folder")])
    script.main()
    assert (tmp_path / "new" / "folder" / "empty.png").exists()


def script_of_docs(name):
    """Return a script of docs/ as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("page", script_of_docs("shipped_policies").TABLES)
def test_tables_of_the_policies_that_ship_are_what_docs_shipped_policies_writes(page):
    script, text = script_of_docs("shipped_policies"), (ROOT / page).read_text(encoding="utf-8")
    assert script.with_table(text, script.TABLES[page]()) == text


def test_the_page_of_all_names_is_what_docs_names_writes():
    script = script_of_docs("names")
    assert script.page() == script.PAGE.read_text(encoding="utf-8"), "python docs/names.py"


@pytest.mark.parametrize("face", ["physics", "chaos", "envs", "rl", "torch", "export", "theory"])
def test_the_page_of_all_names_can_be_read_in_a_clone(face):
    text = (ROOT / "docs" / "reference" / "names.md").read_text(encoding="utf-8")
    sources = (ROOT / "npend_gym" / face / "__init__.pyi").read_text(encoding="utf-8")
    names = re.findall(r"^from npend_gym\.\S+ import (\w+)", sources, re.MULTILINE)
    missing = [name for name in names if f"- `{name}" not in text]
    assert not [name for name in missing if not name.isupper()]
    assert "autoclass" not in text


def test_a_torque_turns_as_the_page_of_all_names_says():
    # from rest, hanging and without gravity: a motor at joint 1 turns rod 1 counter-clockwise and
    # rod 0 the other way, one at joint 0 turns rod 0; the tip goes where x and y say
    chain = Chain.uniform(2, gravity=0.0)
    first = simulate(chain, 0.0, 0.0, [0.0, 0.1], torque=[1.0, 0.0])
    second = simulate(chain, 0.0, 0.0, [0.0, 0.1], torque=[0.0, 1.0])
    assert first.theta[-1, 0] > 0.0
    assert second.theta[-1, 0] < 0.0 < second.theta[-1, 1]
    places = simulate(chain, [0.5 * np.pi, np.pi], 0.0, [0.0]).positions()[0]
    np.testing.assert_allclose(places, [[1.0, 0.0], [1.0, 1.0]], atol=1e-12)


def test_a_record_names_a_trainer_or_a_script_that_exists():
    for name in pretrained_names():
        about = Policy.pretrained(name).provenance
        by = about["trained_by"]
        assert about["clock"] == "processor time"
        assert by in trainer_names() or (ROOT / by).exists()
