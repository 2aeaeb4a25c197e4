"""`npend examples`: the examples that the package brings along, listed or copied."""

from __future__ import annotations

import argparse
import ast
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from npend_gym.cli.common import OK, printable

ABOUT = """\
Scripts to read, run and change: first steps, the paper's experiment, training, evaluation, plans.
Their settings (configs/) and measured motions (data/) are copied with them.
"""
EXAMPLES = """\
examples:
  npend examples                           list them
  npend examples --copy examples           then: python examples/quickstart.py
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `npend examples`."""
    text = "copy them to this new folder"
    parser.add_argument("--copy", type=Path, metavar="FOLDER", help=text)


def run(options: dict[str, Any]) -> int:
    """List or copy the examples; return the exit code."""
    source = folder()
    if "copy" in options:
        copy(source, options["copy"])
        print(f"{printable(str(options['copy']))}: start with quickstart.py")
        return OK
    scripts = sorted(source.rglob("*.py"), key=lambda path: (len(path.parts), path))
    names = [path.relative_to(source).as_posix() for path in scripts]
    width = max(map(len, names)) + 2
    for name, path in zip(names, scripts, strict=True):
        print(f"{name:{width}}{_about(path)}")
    return OK


def folder() -> Path:
    """Return the folder of the examples: inside an installed package, beside it in a checkout."""
    package = Path(__file__).parents[1]
    inside = package / "examples"
    return inside if inside.is_dir() else package.parent / "examples"


def copy(source: Path, target: Path) -> None:
    """Copy the folder `source` to `target`, whole or not at all.

    Raises
    ------
    ValueError
        If `target` exists already.
    """
    if target.exists():
        raise ValueError(f"copy must name a new folder, got {target}, which exists")
    parent = target.absolute().parent
    parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(prefix=f".{target.name}.", dir=parent) as temporary:
        ready = Path(temporary) / "examples"
        shutil.copytree(source, ready, ignore=shutil.ignore_patterns("__pycache__"))
        ready.rename(target)


def _about(script: Path) -> str:
    """Return the first sentence of a script's docstring."""
    text = ast.get_docstring(ast.parse(script.read_text("utf-8"))) or ""
    return text.partition("\n")[0]
