"""Machine code on the disk: damage is noticed, processes and versions can share a folder."""

import os
import random
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from damage import flipped

import npend_gym
from npend_gym.compiled.machine_code import read_code, write_code

FILE = "*sincos.sincos_all*.code"
SINES = """
import sys
import numpy as np
from npend_gym.compiled.sincos import sincos_all

stride = int(sys.argv[1])  # each compiles for arrays of its own kind
x = np.linspace(-9.0, 9.0, 14)[::stride]
s, c = np.empty((2, 14))[:, ::stride]
for _ in range(2):
    sincos_all(x, s, c)
assert np.abs(s - np.sin(x)).max() < 1e-15, s
assert np.abs(c - np.cos(x)).max() < 1e-15, c
print(sincos_all.hits)
"""


def start(folder, stride=1, package=None):
    return subprocess.Popen(
        [sys.executable, "-c", SINES, str(stride)],
        env={**os.environ, "NUMBA_CACHE_DIR": str(folder), "PYTHONPATH": ":".join(sys.path)},
        cwd=package,  # which comes before the others
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def hits(process):
    """Return how much machine code a process loaded, and what it said."""
    out, error = process.communicate(timeout=300)
    assert process.returncode == 0, error
    return int(out), error


def damages(whole):
    """Yield a file as a full disk, a kill or a failing disk leaves it."""
    draw = random.Random(0)
    yield from (b"", whole[:1], whole[:32], whole[: len(whole) // 2], whole[:-1], whole + b"\0")
    yield bytes(len(whole))
    yield draw.randbytes(len(whole))
    yield from flipped(whole, (draw.randrange(8 * len(whole)) for _ in range(200)))


def test_no_damage_of_a_file_of_machine_code_is_loaded(tmp_path, capfd):
    path, data = tmp_path / "name.code", np.arange(100).tobytes()
    write_code(path, data)
    whole = path.read_bytes()
    for damaged in damages(whole):
        path.write_bytes(damaged)
        assert read_code(path) is None
        assert not path.exists()
    assert capfd.readouterr().err.count("\n") <= 1  # the same line once
    path.write_bytes(whole)
    assert read_code(path) == data
    assert read_code(tmp_path / "other name.code") is None


@pytest.mark.long
def test_damaged_machine_code_is_compiled_again_and_said_in_one_line(tmp_path):
    assert hits(start(tmp_path)) == (0, "")
    (path,) = tmp_path.rglob(FILE)
    whole = path.read_bytes()
    for damaged in (b"", whole[:-100]):
        path.write_bytes(damaged)
        loaded, said = hits(start(tmp_path))
        assert loaded == 0
        assert said == f"npend_gym: machine code in {path.parent} is damaged: compiling it again\n"
    assert hits(start(tmp_path)) == (1, "")


@pytest.mark.long
def test_machine_code_that_cannot_be_kept_is_said_in_one_line(tmp_path):
    assert hits(start(tmp_path)) == (0, "")
    (path,) = tmp_path.rglob(FILE)
    path.unlink()
    path.mkdir()  # nothing can be written there
    loaded, said = hits(start(tmp_path))
    assert loaded == 0
    assert said.startswith("npend_gym: machine code cannot be kept in")
    assert said.count("\n") == 1


@pytest.mark.long
def test_where_no_folder_can_be_written_to_kernels_run_and_one_line_says_so(tmp_path):
    (tmp_path / "file").touch()
    loaded, said = hits(start(tmp_path / "file" / "folder"))
    assert loaded == 0
    assert said.startswith(f"npend_gym: machine code cannot be kept in {tmp_path / 'file'}")
    assert said.endswith("unless NUMBA_CACHE_DIR names a folder that can be written to\n")
    assert said.count("\n") == 1


@pytest.mark.long
def test_eight_processes_that_compile_at_once_leave_whole_files(tmp_path):
    together = [start(tmp_path, stride) for stride in (1, 2) * 4]
    for process in together:
        assert hits(process)[1] == ""
    assert len(list(tmp_path.rglob(FILE))) == 2
    for stride in (1, 2):
        assert hits(start(tmp_path, stride)) == (1, "")


def copy_of_the_package(to):
    ignored = shutil.ignore_patterns("__pycache__", "*.safetensors")
    shutil.copytree(Path(npend_gym.__file__).parent, to / "npend_gym", ignore=ignored)
    return to


@pytest.mark.long
def test_two_versions_that_share_a_folder_never_load_each_others_kernels(tmp_path):
    cache = tmp_path / "cache"
    old, new = (copy_of_the_package(tmp_path / name) for name in ("old", "new"))
    kernels = new / "npend_gym" / "compiled" / "sincos.py"
    kernels.write_text(kernels.read_text() + "\n_OF_THE_NEW_VERSION = True\n")
    together = [start(cache, package=package) for package in (old, new) * 2]
    for process in together:
        assert hits(process)[1] == ""
    assert len(list(cache.iterdir())) == 2  # a folder for each state of the sources
    for package in (old, new):
        assert hits(start(cache, package=package)) == (1, "")
