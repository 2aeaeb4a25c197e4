"""The files that machine code is made from: those that define kernels, and all that they import.

Numba compiles the numbers that a kernel reads from other modules into its machine code. A change
of any such module must therefore lead to new machine code.
"""

from __future__ import annotations

import os
import re
import tempfile
from functools import cache
from hashlib import sha256
from pathlib import Path

PACKAGE = Path(__file__).parent.parent
_IMPORT = re.compile(
    r"^[ \t]*(?:from ([\w.]+) import (?:\(([^)]*)\)|([^\n#]*))|import ([\w.]+))", re.MULTILINE
)
_COMMENT = re.compile(r"#[^\n]*")
_DECORATORS = b"compiled.jit import"  # in every file that defines kernels


def cache_folder(package: Path, chosen: str) -> Path:
    """Return the folder that keeps the machine code made from the sources in `package`.

    A kernel is made of the functions that it calls, too: an edit or an upgrade of one kernel file
    would leave stale machine code of another in use. Each state of the sources therefore has a
    folder of its own: in the one that was `chosen` (NUMBA_CACHE_DIR), else beside the sources,
    else, where these are read-only, in the user's cache.
    """
    if chosen:
        base = Path(chosen)
    elif os.access(package, os.W_OK):
        base = package / "__pycache__"
    else:
        try:
            base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        except RuntimeError:  # there is no home
            base = Path(tempfile.gettempdir())
    return base / f"npend_gym-{sources_digest(package)}"


@cache
def code_folder() -> Path:
    """Return the folder of the machine code of this package."""
    return cache_folder(PACKAGE, os.environ.get("NUMBA_CACHE_DIR", ""))


def sources_digest(package: Path) -> str:
    """Return a digest of all sources of machine code in the folder `package`."""
    digest = sha256()
    for path, content in sorted(compiled_sources(package).items()):
        digest.update(path.encode() + b"\0" + content + b"\0")
    return digest.hexdigest()[:16]


def compiled_sources(package: Path) -> dict[str, bytes]:
    """Return the files on which machine code depends, by their path within `package`.

    A name that a package imports in its stub stands for the module that defines it. The files are
    searched by a regular expression: to parse them would take ten times as long, in every process.
    """
    contents = {
        file.relative_to(package.parent).as_posix(): file.read_bytes()
        for file in package.rglob("*.py")
    }
    found = dict[str, bytes]()
    room = f"{package.name}/compiled/"  # which holds the compiler, too
    kernels = [
        path
        for path, content in contents.items()
        if _DECORATORS in content or path.startswith(room)
    ]
    waiting = [(path.removesuffix(".py").replace("/", "."), "") for path in kernels]
    done = set[tuple[str, str]]()
    while waiting:
        module, name = waiting.pop()
        if (module, name) in done:
            continue
        done.add((module, name))
        place = module.replace(".", "/")
        inner, own = f"{place}/{name}", f"{place}.py"
        if own not in contents:
            if name and (f"{inner}.py" in contents or f"{inner}/__init__.py" in contents):
                waiting.append((f"{module}.{name}", ""))
                continue
            own = f"{place}/__init__.py"
            stub = (package.parent / own).with_suffix(".pyi")
            if stub.is_file():
                named = _imports(stub.read_bytes(), package.name)
                waiting += [pair for pair in named if name in ("", pair[1])]
        if own in contents and own not in found:
            found[own] = contents[own]
            waiting += _imports(contents[own], package.name)
    return {path.removeprefix(f"{package.name}/"): content for path, content in found.items()}


def _imports(content: bytes, root: str) -> list[tuple[str, str]]:
    """Return the modules of the package `root` that a file imports, each with a name, or ""."""
    pairs = list[tuple[str, str]]()
    for module, several, one, whole in _IMPORT.findall(content.decode()):
        if (module or whole).partition(".")[0] == root:
            names = _COMMENT.sub("", several or one).split(",")
            pairs += [(module, name.split()[0]) for name in names if name.strip()]
            pairs += [(whole, "")] if whole else []
    return pairs
