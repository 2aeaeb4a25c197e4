"""Scripts and commands, run as a user would run them."""

import io
import os
import runpy
import shutil
import subprocess
import sys
import warnings
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]


def run_script(script, *arguments, cwd):
    """Run `python SCRIPT ARGUMENTS` in the folder `cwd`, within this process; return its output.

    A process of its own would spend more time on its imports than most scripts do on their work.
    """
    with (
        pytest.MonkeyPatch.context() as patch,
        warnings.catch_warnings(),
        redirect_stdout(io.StringIO()) as printed,
    ):
        warnings.simplefilter("ignore")
        patch.setattr(sys, "argv", [str(script), *map(str, arguments)])
        patch.chdir(cwd)
        patch.syspath_prepend(script.parent)
        runpy.run_path(str(script), run_name="__main__")
    return printed.getvalue()


def run_uncompiled(code):
    """Run Python code with nothing compiled, in a process of its own; return the numbers printed.

    A warning is an error there.
    """
    printed = run_python("-W", "error", "-c", code, env=os.environ | {"NUMBA_DISABLE_JIT": "1"})
    return np.array(printed.split(), float)


def run_python(*arguments, cwd=None, env=None):
    """Run `python ARGUMENTS` in the folder `cwd`, as a process of its own; return its output."""
    done = subprocess.run(
        [sys.executable, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        cwd=cwd,
        env=env,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def changed_copy(folder, changes):
    """Copy the package into `folder` and replace texts there, by file; each stands there once.

    Return the environment of a process that imports the copy, and keeps its machine code there.
    """
    shutil.copytree(
        ROOT / "npend_gym", folder / "npend_gym", ignore=shutil.ignore_patterns("__pycache__")
    )
    for name, replaced in changes:
        text = (folder / name).read_text(encoding="utf-8")
        for old, new in replaced:
            assert text.count(old) == 1, old
            text = text.replace(old, new)
        (folder / name).write_text(text, encoding="utf-8")
    return os.environ | {
        "PYTHONPATH": str(folder), "NUMBA_DISABLE_JIT": "0",
        "NUMBA_CACHE_DIR": str(folder / "cache"),
    }  # fmt: skip
