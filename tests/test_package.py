"""The package as a whole: what an import brings in, and the same bits everywhere."""

import ast
import inspect
import json
import os
import re
import shutil
import subprocess
import sys
from contextlib import suppress
from importlib import import_module, metadata
from pathlib import Path

import pytest
from scripts import run_python

import npend_gym
from npend_gym._extras import missing
from npend_gym.compiled import notice
from npend_gym.compiled.sources import PACKAGE, cache_folder

FACES = (
    "npend_gym", "npend_gym.physics", "npend_gym.envs", "npend_gym.rl", "npend_gym.experiments",
    "npend_gym.export", "npend_gym.report",
)  # fmt: skip
HEAVY = ("numba", "scipy", "matplotlib", "torch", "stable_baselines3", "pygame", "safetensors")


def python(code, **environment):
    return run_python("-c", code, env=os.environ | environment).strip()


def test_importing_the_faces_imports_nothing_heavy():
    code = f"import sys, {', '.join(FACES)}; print([m for m in {HEAVY!r} if m in sys.modules])"
    assert python(code) == "[]"


@pytest.mark.parametrize("name", ["npend_gym.torch.step", "npend_gym.rl.training.shac"])
def test_without_pytorch_a_name_that_needs_it_says_which_extra_has_it(name):
    face, _, name = name.rpartition(".")
    code = f"""
import sys
sys.modules["torch"] = None  # importing it fails
try:
    from {face} import {name}
except ImportError as error:
    print(error)
"""
    error = python(code)
    assert 'need torch: install it with pip install "npend-gym[rl]"' in error
    assert "pip install torch --index-url https://download.pytorch.org/whl/cpu" in error


def test_pages_name_the_index_of_the_small_pytorch_and_the_version_of_the_constraints():
    pinned = re.search(
        r"^torch==(\S+)$", (PACKAGE.parent / "constraints.txt").read_text(), re.MULTILINE
    )[1]
    wanted = f"pip install torch=={pinned} --index-url https://download.pytorch.org/whl/cpu"
    for name in ("constraints.txt", "docs/howto/troubleshooting.md"):
        assert wanted in (PACKAGE.parent / name).read_text("utf-8"), name
    assert "https://download.pytorch.org" not in str(missing("matplotlib", "plot", "figures"))


WITHOUT_EXTRAS = """
import contextlib, io, json, os, sys
from importlib.machinery import PathFinder

EXTRAS = {
    "PIL", "filelock", "imageio", "imageio_ffmpeg", "joblib", "matplotlib", "mujoco",
    "onnx", "pyarrow", "pygame", "sb3_contrib", "stable_baselines3", "sympy", "torch", "yaml",
}

class Finder(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        absent = name.partition(".")[0] in EXTRAS
        return None if absent else super().find_spec(name, path, target)

sys.meta_path[sys.meta_path.index(PathFinder)] = Finder
from npend_gym.cli import main

for command in sys.argv[1:]:
    before = set(os.listdir())
    error = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(error):
        code = main(command.split())
    print(json.dumps([code, error.getvalue(), set(os.listdir()) != before]))
"""
NEEDED = {  # the extra that is named
    "release --n 1 --trials 1 --out results": "plot",
    "release --n 1 --trials 1 --page page.html": None,
    "simulate --n 1 --film film.gif": "plot,render",
    "simulate --n 1 --csv motion.csv": None,
    "simulate --n 1 --plot motion.png": "plot",
    "campaign --n 1 --out campaign": "campaign",
    "analyse campaign": "campaign",
    "export calm-1 --to c --out policy.h": None,
    "export calm-1 --to onnx --out policy.onnx": "export",
}


@pytest.fixture(scope="module")
def without_extras(tmp_path_factory):
    """Of every command in NEEDED: its exit code, its errors, whether it wrote anything."""
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_EXTRAS, *NEEDED],
        capture_output=True, text=True, check=True, cwd=tmp_path_factory.mktemp("without_extras"),
    )  # fmt: skip
    return dict(zip(NEEDED, map(json.loads, done.stdout.splitlines()), strict=True))


@pytest.mark.long
@pytest.mark.parametrize(("command", "extra"), NEEDED.items())
def test_without_the_extras_each_command_works_or_names_the_one_it_needs(
    command, extra, without_extras
):
    code, error, wrote = without_extras[command]
    error = re.sub(r"^release \d+\n", "", error)  # how far a slow machine is
    assert code == (0 if wrote else 1), error
    if extra is None:
        assert error == ""
    else:
        assert error.count("\n") == 1
        assert f'pip install "npend-gym[{extra}]"' in error


# Where the libraries of an extra are missing, the names that need them cannot be loaded
EXTRA_OF_FACE = {
    "npend_gym.experiments": "pyarrow",
    "npend_gym.report": "pyarrow",
    "npend_gym.rl": "stable_baselines3",
}


@pytest.mark.parametrize("face", FACES)
def test_every_public_name_of_a_face_is_there(face):
    if face in EXTRA_OF_FACE:
        pytest.importorskip(EXTRA_OF_FACE[face])
    package = import_module(face)
    for name in package.__all__:
        assert getattr(package, name) is not None
    assert set(dir(package)) == set(package.__all__)
    with pytest.raises(AttributeError, match=f"module '{face}' has no attribute 'simulat'"):
        package.simulat  # noqa: B018


def test_what_the_physics_offers_takes_at_most_twelve_arguments_but_simulate():
    physics = import_module("npend_gym.physics")
    offered = {name: getattr(physics, name) for name in physics.__all__}
    functions = {name: found for name, found in offered.items() if inspect.isfunction(found)}
    for name, found in offered.items():
        if inspect.isclass(found):
            methods = inspect.getmembers(found, inspect.isfunction)
            functions |= {f"{name}.{m}": method for m, method in methods if m[0] != "_"}
    counts = {name: len(inspect.signature(f).parameters) for name, f in functions.items()}
    assert {name for name, count in counts.items() if count > 12} == {"simulate"}


LOADED = """
import sys
import npend_gym
before = set(sys.modules)
from importlib import import_module
for name in sys.argv[1:]:
    import_module(name)
names = sorted(name for name in set(sys.modules) - before if name.startswith("npend_gym."))
print(*(name for name in names if not sys.modules[name].__file__.endswith("__init__.py")))
"""


def defines_kernels(file):
    """Whether a function of a file has one of the decorators of `npend_gym.compiled.jit`."""
    names = {"kernel", "inner_kernel", "inlined_kernel", "spliced_kernel", "chosen_by_type"}
    return any(
        getattr(getattr(decorator, "func", decorator), "id", "") in names
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef)
        for decorator in node.decorator_list
    )


@pytest.mark.long
def test_a_change_of_any_module_that_kernels_can_read_makes_new_machine_code(tmp_path):
    package = tmp_path / "npend_gym"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__", "pretrained"))
    modules = [
        ".".join(file.relative_to(tmp_path).with_suffix("").parts)
        for file in package.rglob("*.py")
        if defines_kernels(file)
    ]
    assert "npend_gym.physics.kernels.dynamics" in modules
    loaded = run_python("-c", LOADED, *modules).split()
    assert set(modules) < set(loaded)  # what Python imported for them is all that they can read
    before, without_effect = cache_folder(package, ""), []
    for name in loaded:
        file = tmp_path.joinpath(*name.split(".")).with_suffix(".py")
        original = file.read_bytes()
        file.write_bytes(original + b"CHANGED = 1\n")
        if cache_folder(package, "") == before:
            without_effect.append(name)
        file.write_bytes(original)
    assert without_effect == []
    (package / "cli" / "train.py").write_text("CHANGED = 1")  # which no kernel can read
    assert cache_folder(package, "") == before
    assert cache_folder(package, "/elsewhere") == Path("/elsewhere") / before.name


def test_a_read_only_installation_compiles_into_the_users_cache(tmp_path, monkeypatch):
    monkeypatch.setattr("os.access", lambda *_: False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert cache_folder(tmp_path, "").parent == tmp_path / "cache"


@pytest.mark.long
@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")
def test_the_first_compilation_on_a_machine_is_announced_in_one_line_on_the_terminal(tmp_path):
    def shown_on_a_terminal():
        ours, theirs = os.openpty()
        code = "from npend_gym.compiled.sincos import sincos; sincos(1.0), sincos(1)"
        around = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
        subprocess.run([sys.executable, "-c", code], stderr=theirs, check=True, env=around)
        os.write(theirs, b"end\n")
        os.close(theirs)
        shown = b""
        while not shown.endswith(b"end\r\n"):
            shown += os.read(ours, 4096)
        os.close(ours)
        return shown.decode()

    assert shown_on_a_terminal() == f"{notice.NOTICE}\r\nend\r\n"
    assert shown_on_a_terminal() == "end\r\n"  # loaded, not compiled


def test_the_announcement_is_for_terminals_and_notebooks_unless_it_is_hidden(monkeypatch):
    monkeypatch.delenv("NPEND_GYM_QUIET", raising=False)
    monkeypatch.delitem(sys.modules, "ipykernel", raising=False)
    monkeypatch.setattr("sys.stderr.isatty", lambda: False, raising=False)
    assert not notice.is_watched()
    monkeypatch.setitem(sys.modules, "ipykernel", sys)
    assert notice.is_watched()
    monkeypatch.delitem(sys.modules, "ipykernel")
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    assert notice.is_watched()
    monkeypatch.setenv("NPEND_GYM_QUIET", "1")
    assert not notice.is_watched()


def test_a_name_that_a_package_lacks_is_answered_with_where_it_stands():
    with pytest.raises(AttributeError, match=r"no attribute 'Policy'; it is in npend_gym\.rl"):
        npend_gym.Policy  # noqa: B018
    with pytest.raises(AttributeError, match="did you mean 'simulate'"):
        npend_gym.simulat  # noqa: B018


@pytest.fixture(scope="module")
def pinned():
    """Return what constraints.txt pins: for each name, how it is written there."""
    requirements = pytest.importorskip("packaging.requirements")
    lines = (Path(__file__).parents[1] / "constraints.txt").read_text().splitlines()
    found = [requirements.Requirement(line) for line in lines if not line.startswith("#")]
    return {plain_name(each.name): each for each in found}


def plain_name(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def installed_as_pinned(pinned, name):
    """Return the package if it is installed in the pinned version."""
    with suppress(metadata.PackageNotFoundError):
        found = metadata.distribution(name)
        return found if pinned[name].specifier.contains(found.version) else None


@pytest.mark.skipif(
    sys.platform != "linux" or sys.version_info[:2] != (3, 11),
    reason="constraints.txt is for Linux and Python 3.11; others need more, such as colorama",
)
def test_constraints_pin_all_that_a_pinned_package_needs(pinned):
    needs, todo, done = {}, {(name, "") for name in pinned}, set()
    while todo:
        name, extra = one = todo.pop()
        done.add(one)
        package = name in pinned and installed_as_pinned(pinned, name)
        for text in (package and package.requires) or ():
            need = type(pinned[name])(text)
            if need.marker is None or need.marker.evaluate({"extra": extra}):
                needs.setdefault(plain_name(need.name), []).append((name, need))
                todo |= {(plain_name(need.name), each) for each in need.extras} - done
    assert not {name: users for name, users in needs.items() if name not in pinned}
    for name, users in needs.items():
        (pin,) = pinned[name].specifier
        for user, need in users:
            assert need.specifier.contains(pin.version, prereleases=True), (user, name)


@pytest.mark.long
def test_dm_control_loads_and_steps_a_task_with_the_mujoco_of_the_constraints(pinned):
    suite = pytest.importorskip("dm_control.suite")
    for name in ("dm-control", "mujoco"):
        if not installed_as_pinned(pinned, name):
            pytest.skip(f"{name} is installed in another version than constraints.txt has")
    env = suite.load("acrobot", "swingup", task_kwargs={"random": 0})
    env.reset()
    before = env.physics.data.qpos.copy()
    assert 0.0 <= env.step([1.0]).reward <= 1.0
    assert abs(env.physics.data.qpos - before).max() > 1e-6


def test_the_versions_with_digests_are_those_of_the_constraints():
    root = Path(__file__).parents[1]
    if not (root / ".ci").is_dir():
        pytest.skip("only a clone has .ci")
    pin = re.compile(r"^([A-Za-z0-9_.-]+)==(\S+)", re.MULTILINE)

    def versions(path):
        found = pin.findall((root / path).read_text())
        return {plain_name(name): version for name, version in found}

    text = (root / ".ci" / "requirements.txt").read_text()
    assert versions(".ci/requirements.txt") == versions("constraints.txt")
    each = re.split(r"\n(?=\S)", text.partition("\nabsl")[2])
    assert all("--hash=sha256:" in one for one in each)


def test_a_docstring_names_its_thing():
    nodes = (
        (path, node)
        for path in Path(npend_gym.__file__).parent.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef)
    )
    vague = [
        f"{path.name}: {node.name}"
        for path, node in nodes
        if (ast.get_docstring(node) or "").startswith("Return what")
    ]
    assert not vague
