"""What stands beside the package uses its public names: those that a package's stub lists."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
STUBS = {
    ".".join(stub.parent.relative_to(ROOT).parts): {
        alias.asname or alias.name
        for node in ast.parse(stub.read_text("utf-8")).body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    for stub in (ROOT / "npend_gym").rglob("__init__.pyi")
}
# Kernels that benchmarks measure by themselves. The list gets shorter, never longer
INSIDE = {
    "benchmarks": {
        "compiled.arrays", "compiled.jit", "compiled.packs", "experiments.campaign.task",
        "physics.kernels.dynamics", "physics.kernels.member_rows", "physics.kernels.rk4",
        "physics.kernels.tensions", "physics.step",
    },
    "paper": set(),
}  # fmt: skip


def private_imports(text):
    """Yield what a program imports of the package beside the public names, as "module: name"."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "npend_gym":
            public = STUBS.get(node.module, set()) | {
                face.rpartition(".")[2] for face in STUBS if face.startswith(f"{node.module}.")
            }
            yield from (f"{node.module}: {a.name}" for a in node.names if a.name not in public)
        elif isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.startswith("npend_gym.") and alias.name not in STUBS:
                    yield f"{alias.name}: "


def of_folder(folder):
    for path in sorted((ROOT / folder).rglob("*.py")):
        for each in private_imports(path.read_text("utf-8")):
            yield f"{path.relative_to(ROOT)} {each}"


@pytest.mark.parametrize(
    "line",
    [
        "from npend_gym._checks import FloatArray", "from npend_gym import _checks",
        "from npend_gym.rl.training.checkpoints import Checkpoint", "import npend_gym.envs.config",
        "def f():\n    from npend_gym.rl import evaluating", "from npend_gym.physics import energy",
    ],
)  # fmt: skip
def test_the_check_finds_a_private_name(line):
    assert len(list(private_imports(line))) == 1


def test_the_check_passes_public_names():
    lines = (
        "from npend_gym import Chain, __version__, envs", "import npend_gym",
        "from npend_gym.rl import training", "from npend_gym.envs import ENV_ID", "import numpy",
        "from npend_gym.rl.training import Checkpoint", "import npend_gym.rl.training as t",
    )  # fmt: skip
    assert list(private_imports("\n".join(lines))) == []


def test_examples_import_public_names_alone():
    assert list(of_folder("examples")) == []


def test_the_programs_of_pages_import_public_names_alone():
    found = []
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").glob("**/*.md"))):
        text = path.read_text("utf-8")
        for block in re.findall(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
            found += [f"{path.relative_to(ROOT)} {each}" for each in private_imports(block)]
    assert found == []


@pytest.mark.parametrize("folder", list(INSIDE))
def test_other_programs_of_a_clone_import_from_no_more_of_the_inside_than_is_listed(folder):
    used = {each.split(" ", 1)[1].partition(": ") for each in of_folder(folder)}
    modules = {f"{module}.{name}" if module in STUBS else module for module, _, name in used}
    assert {module.removeprefix("npend_gym.") for module in modules} == INSIDE[folder]


def test_no_two_classes_of_the_package_have_one_name():
    folder = ROOT / "npend_gym"
    classes = [
        (node.name, path.relative_to(folder).as_posix())
        for path in sorted(folder.rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    ]
    places = dict[str, list[str]]()
    for name, place in classes:
        places.setdefault(name, []).append(place)
    # what one kernel or another, one trainer or another, calls the same thing
    same = {"Settings": {"rl/training/shac.py", "rl/training/imitation_settings.py"}}
    assert len(classes) > 200
    shared = {name: {*found} for name, found in places.items() if len(found) > 1}
    assert shared == same
