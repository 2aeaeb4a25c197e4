"""Readers of files under mutated files: taken, or refused as documented, without a warning."""

import os
import shutil
import subprocess
import warnings
from pathlib import Path

import pytest
from readers import CORPUS, make_readers, mutants

NAMES = (
    "policy", "trajectory", "part", "plan", "plan_toml", "plan_yaml", "plan_json", "manifest",
    "release", "periods", "motion", "chain", "transitions",
    "benchmark", "episodes",
)  # fmt: skip
NIGHTLY = Path(__file__).parents[1] / ".ci" / "nightly"
of_the_night = pytest.mark.skipif(
    not (NIGHTLY.exists() and shutil.which("bash")), reason="only a clone has it, a script of bash"
)


@pytest.fixture(scope="module")
def readers(tmp_path_factory):
    made = make_readers(tmp_path_factory.mktemp("readers"))
    assert sorted(made) == sorted(NAMES)
    return made


@pytest.fixture
def strict():
    """Every warning is an error, but for the documented ones about degrees and times."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message="theta reaches|times are rounded")
        yield


@pytest.mark.usefixtures("strict")
@pytest.mark.parametrize("name", [*NAMES[:-1], pytest.param(NAMES[-1], marks=pytest.mark.long)])
def test_good_files_are_taken_and_what_once_was_a_fault_is_refused(name, readers):
    reader = readers[name]
    for data in reader.seeds:
        reader.path.write_bytes(data)
        reader.read()
    kept = sorted(file for file in (CORPUS / name).glob("*"))
    assert not any(reader.attempt(file.read_bytes()) for file in kept)
    assert kept or name not in ("trajectory", "plan_yaml")


@pytest.mark.long
@pytest.mark.usefixtures("strict")
@pytest.mark.parametrize("name", NAMES)
def test_mutated_files_are_taken_or_refused_as_documented(name, readers):
    source = mutants(readers[name], 0, [])
    data = next(source)
    for _ in range(300):
        data = source.send(readers[name].attempt(data))


@of_the_night
def test_the_command_of_the_night_runs_parts_by_their_numbers_and_refuses_others():
    refused = subprocess.run([NIGHTLY, "x=1"], capture_output=True, text=True, check=False)
    assert (refused.returncode, refused.stdout) == (2, "")
    assert "a part is NAME=NUMBER" in refused.stderr
    assert "readers" in refused.stderr


@pytest.mark.long
@of_the_night
def test_a_rehearsal_of_the_night_ends_well(tmp_path):
    done = subprocess.run(
        [NIGHTLY, "readers=28", "properties=7"], capture_output=True, text=True, check=False,
        env={**os.environ, "CORPUS": str(tmp_path), "SEED": "3"},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "1 cases of each of 7 properties" in done.stdout
