"""List the examples that come with the package, or copy them.

Scripts to read, run and change: first steps, the paper's experiment, training, evaluation, plans.
Their settings (configs/) and measured motions (data/) are copied with them.

Examples
--------
  npend examples                           list them
  npend examples -o examples               then: python examples/quickstart.py
"""

from __future__ import annotations

import ast
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

from npend_gym.cli.common import OK, printable


def run(*, out: Path | None = None) -> int:
    """List or copy the examples; return the exit code.

    Parameters
    ----------
    out : folder, optional
        Copy them to this new folder.
    """
    source = folder()
    if out is not None:
        copy(source, out)
        print(f"{printable(str(out))}: start with quickstart.py")
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
    """Copy the folder `source` to `target`, whole or not at all."""
    if target.exists():
        raise ValueError(f"out must name a new folder, got {target}, which exists")
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
