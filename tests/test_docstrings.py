"""Examples in docstrings: they run and print what they show, and every public function has one."""

import doctest
import inspect
from importlib import import_module
from pathlib import Path

import pytest

import npend_gym

pytestmark = pytest.mark.long

PACKAGE = Path(npend_gym.__file__).parent
FACES = ("chaos", "experiments", "export", "identification", "physics", "rl", "theory", "torch")
NEEDS = {"torch": "torch", "rl": "stable_baselines3", "notebook": "PIL", "networks": "onnx",
         "read_mjcf": "mujoco"}  # fmt: skip


def modules_with_examples():
    for folder in (PACKAGE, Path(__file__).parents[1] / "paper"):
        for path in sorted(folder.rglob("*.py")):
            if ">>> " in path.read_text("utf-8") and "examples" not in path.parts:
                yield ".".join(path.relative_to(folder.parent).with_suffix("").parts)


@pytest.mark.parametrize("name", list(modules_with_examples()))
def test_examples_print_what_they_show(name, tmp_path, monkeypatch):
    for part in name.split(".")[1:]:
        if part in NEEDS:
            pytest.importorskip(NEEDS[part], reason=f"{NEEDS[part]} is not installed")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    found = doctest.testmod(import_module(name), raise_on_error=False)
    assert found.attempted > 1
    assert found.failed == 0


def test_no_public_function_lacks_an_example():
    pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")
    faces = [import_module(f"npend_gym.{name}") for name in FACES]
    public = {name: getattr(face, name) for face in faces for name in face.__all__}
    functions = {
        name: found
        for name, found in public.items()
        if not inspect.isclass(found) and not inspect.ismodule(found) and callable(found)
    }
    lacking = {name for name, found in functions.items() if ">>> " not in found.__doc__}
    assert lacking == set()
