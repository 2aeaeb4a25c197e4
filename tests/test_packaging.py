"""What an installation brings and says of itself, and the workflows that build and publish it."""

import importlib.util
import os
import re
import subprocess
import sys
import types
from pathlib import Path

import pytest
from scripts import run_python

from npend_gym import __version__
from npend_gym.cli import main
from npend_gym.cli.examples import folder
from npend_gym.rl import pretrained_names

tomllib = pytest.importorskip("tomllib", reason="Python 3.10 reads no TOML by itself")
yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")

ROOT = Path(__file__).parent.parent
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
PROJECT = PYPROJECT["project"]
REPOSITORY = PYPROJECT["tool"]["hatch"]["metadata"]["hooks"]["custom"]["repository"]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
WORKFLOWS = {
    path.stem: yaml.safe_load(path.read_text("utf-8"))
    for path in sorted((ROOT / ".github" / "workflows").glob("*.yml"))
}
PYTHONS = ["3.10", "3.11", "3.12", "3.13", "3.14"]


@pytest.fixture
def hook(monkeypatch):
    """Return the module that makes addresses and the README of the index, without Hatchling."""
    for name, base in {
        "hatchling.metadata.plugin.interface": "MetadataHookInterface",
        "hatchling.builders.hooks.plugin.interface": "BuildHookInterface",
    }.items():
        monkeypatch.setitem(sys.modules, name, types.SimpleNamespace(**{base: object}))
    spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_citation_says_what_the_package_says_of_itself():
    assert CITATION["version"] == __version__
    assert CITATION["license"] == PROJECT["license"]
    assert CITATION.get("repository-code", "") == REPOSITORY
    assert [one["name"] for one in CITATION["authors"]] == [a["name"] for a in PROJECT["authors"]]


def test_the_bibtex_of_the_pages_is_what_the_citation_says():
    page = (ROOT / "docs" / "index.md").read_text("utf-8")
    entry = re.search(r"```bibtex\n@software\{npend_gym,\n(.*?)\n\}\n```", page, re.DOTALL)
    said = dict(re.findall(r"^  (\w+) = \{(.*)\},?$", entry[1], re.MULTILINE))
    year = re.search(r"Copyright \(c\) (\d+)", (ROOT / "LICENSE").read_text("utf-8"))[1]
    archived = {one["type"]: one["value"] for one in CITATION.get("identifiers", [])}
    assert said == archived | {
        "author": "{" + " and ".join(one["name"] for one in CITATION["authors"]) + "}",
        "title": CITATION["title"],
        "version": CITATION["version"],
        "license": CITATION["license"],
        "year": year,
    }


def test_pages_say_how_many_rods_the_policies_swing_up():
    counted = "no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine"
    found = [re.fullmatch(r"swingup-(\d+)(-cart)?", name) for name in pretrained_names()]
    at_pivot, on_cart = (
        counted[max(int(each[1]) for each in found if each and bool(each[2]) == cart)]
        for cart in (False, True)
    )
    said = f"policies that swing up {at_pivot} rods at a pivot or {on_cart} on a cart"
    assert said in " ".join(CITATION["abstract"].split())
    page = (ROOT / "docs" / "tasks" / "swing_up.md").read_text("utf-8")
    assert f"networks for three to {at_pivot} imitate a planner" in " ".join(page.split())


def test_one_setting_has_the_address_and_the_citation_repeats_it():
    if not REPOSITORY:
        pytest.skip("there is no address yet")
    owner = REPOSITORY.split("/")[-2].encode()
    tracked = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False
    ).stdout.split("\0")
    naming = {
        name
        for name in filter(None, tracked)
        if (path := ROOT / name).is_file()
        and re.search(rb"github\.com/%b/|%b\.github\.io" % (owner, owner), path.read_bytes())
    }
    assert naming <= {"pyproject.toml", "CITATION.cff"}


@pytest.mark.parametrize("repository", ["", "https://github.com/someone/npend_gym"])
def test_the_readme_of_the_index_has_no_link_into_a_clone(repository, hook):
    text = (ROOT / "README.md").read_text("utf-8")
    shown = hook.readme(text, repository)
    targets = re.findall(r"\]\(([^)]*)\)", shown)
    assert all(target.startswith(("https://", "#")) for target in targets)
    assert len(targets) == (
        len(re.findall(r"\]\(([^)]*)\)", text)) if repository else shown.count("](")
    )
    paths = [t.split("/main/")[1] for t in targets if repository and "/main/" in t]
    assert all((ROOT / path.partition("#")[0]).exists() for path in paths)
    assert set(hook.addresses(repository)) >= ({"Source", "Documentation"} if repository else set())
    assert bool(hook.addresses(repository)) == bool(repository)


def test_an_address_elsewhere_is_refused_and_a_picture_in_a_link_is_absolute(hook):
    with pytest.raises(ValueError, match="repository must be https://github"):
        hook.addresses("https://gitlab.com/someone/npend_gym")
    shown = hook.readme("[![a](docs/a.png)](docs/b.md)", "https://github.com/c/d")
    at = "https://github.com/c/d"
    assert shown == f"[![a]({at}/raw/main/docs/a.png)]({at}/blob/main/docs/b.md)"


@pytest.mark.skipif(not WORKFLOWS, reason="only a clone has workflows")
def test_every_python_that_is_named_is_tested_on_every_system():
    named = re.findall(r"Python :: (3\.\d+)\n", "\n".join(PROJECT["classifiers"]) + "\n")
    assert named == PYTHONS
    assert PROJECT["requires-python"] == f">={PYTHONS[0]}"
    systems = {"ubuntu-latest", "ubuntu-24.04-arm", "macos-15", "windows-latest"}
    for job in (WORKFLOWS["ci"]["jobs"]["tests"], WORKFLOWS["package"]["jobs"]["wheel"]):
        matrix = job["strategy"]["matrix"]
        assert matrix["python"] == PYTHONS
        assert set(matrix["system"]) == systems
        assert any("npend verify" in step.get("run", "") for step in job["steps"])


@pytest.mark.parametrize("name", WORKFLOWS)
def test_workflows_run_what_is_pinned_and_may_do_no_more_than_they_must(name):
    workflow = WORKFLOWS[name]
    assert workflow["permissions"] == {"contents": "read"}
    for job in workflow["jobs"].values():
        assert set(job.get("permissions", {})) <= {"attestations", "id-token", "pages"}
        for step in job.get("steps", []):
            action = step.get("uses", "actions/none@" + "0" * 40)
            assert re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40}", action), action
            if action.startswith("actions/checkout@"):
                assert step["with"]["persist-credentials"] is False
            for script in re.findall(r"^\.ci/\w+", step.get("run", ""), re.MULTILINE):
                assert os.access(ROOT / script, os.X_OK), f"{script} cannot be run"


def test_jobs_that_prove_who_they_are_run_none_of_our_code():
    for workflow in WORKFLOWS.values():
        for job in workflow["jobs"].values():
            if "id-token" in job.get("permissions", {}):
                for step in job["steps"]:
                    assert "checkout" not in step.get("uses", "")
                    assert not re.search(r"pip|python|pytest|\.ci", step.get("run", ""))


def test_examples_are_listed_with_what_they_do(capsys):
    assert main(["examples"]) == 0
    listed = capsys.readouterr().out.splitlines()
    scripts = {path.relative_to(folder()).as_posix() for path in folder().rglob("*.py")}
    assert {line.split()[0] for line in listed} == scripts
    assert all(len(line.split()) > 4 for line in listed)


def contents(folder):
    """Every file below a folder, but for what Python compiled."""
    return {
        path.relative_to(folder): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }


def test_examples_are_copied_whole(tmp_path, capsys, refusal):
    target = tmp_path / "new" / "examples"
    assert main(["examples", "--out", str(target)]) == 0
    assert "quickstart.py" in capsys.readouterr().out
    assert contents(target) == contents(folder())
    assert [path.name for path in target.parent.iterdir()] == ["examples"]
    assert "out must name a new folder" in refusal("examples", "--out", str(target))


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        pytest.param("npend rel", {"release "}, marks=pytest.mark.long),
        ("npend release --am", {"--amplitude "}),
        pytest.param("npend chaos m", {"map "}, marks=pytest.mark.long),
    ],
)
def test_the_shell_completes_commands_options_and_choices(line, expected, tmp_path):
    pytest.importorskip("argcomplete", reason="argcomplete is not installed")
    out = tmp_path / "completions"
    asked = {
        "COMP_LINE": line, "COMP_POINT": str(len(line)), "COMP_TYPE": "9", "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_IFS": "\n", "_ARGCOMPLETE_SHELL": "bash",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(out),
    }  # fmt: skip
    run_python("-m", "npend_gym", env=os.environ | asked)
    assert set(out.read_text().split("\n")) == expected
