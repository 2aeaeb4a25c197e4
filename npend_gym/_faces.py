"""Public faces: a package lists its names once, in its stub, and imports each when first used."""

from __future__ import annotations

import ast
import difflib
import sys
from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path
from types import MethodType, ModuleType
from typing import Any

from npend_gym._extras import missing


def attach_stub(
    package: str, file: str
) -> tuple[Callable[[str], object], Callable[[], list[str]], list[str]]:
    """Return `__getattr__`, `__dir__` and `__all__` of a package whose stub imports its names.

    Type checkers read the stub, `__init__.pyi`; so does this function: there is no second list.
    An ``import`` of the package stays fast, because no module behind it is imported before one of
    its names is used. SciPy's packages do the same, with a library (Scientific Python's SPEC 1).

    Parameters
    ----------
    package, file : str
        ``__name__`` and ``__file__`` of the package.
    """
    sources = _read_stub(Path(file).with_suffix(".pyi"), package)

    def get_attribute(name: str) -> object:
        if name not in sources:
            hint = "" if name.startswith("_") else _hint(package, name, sources)
            raise AttributeError(f"module {package!r} has no attribute {name!r}{hint}")
        if sources[name] == package:  # a module of the package itself
            return _import(f"{package}.{name}")
        value = getattr(_import(sources[name]), name)
        setattr(sys.modules[package], name, value)
        return value

    return get_attribute, lambda: sorted(sources), list(sources)


def _import(module: str) -> ModuleType:
    """Import a module; where PyTorch is missing, say which extra has it."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if error.name == "torch":
            raise missing("torch", "rl", "tensors and training", error) from error
        raise


def _read_stub(path: Path, package: str) -> dict[str, str]:
    """Return the module that each name of a stub is imported from."""
    stub = ast.parse(path.read_text(encoding="utf-8"))
    return {
        alias.asname or alias.name: node.module or package
        for node in stub.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


def _hint(package: str, name: str, own: Iterable[str]) -> str:
    """Return where a public name stands that a package lacks, or the nearest one that it has."""
    root = Path(__file__).parent
    for stub in sorted(root.glob("**/__init__.pyi")):
        face = ".".join((root.name, *stub.parent.relative_to(root).parts))
        if face != package and name in _read_stub(stub, face):
            return f"; it is in {face}"
    close = difflib.get_close_matches(name, own, n=1)
    return f"; did you mean {close[0]!r}?" if close else ""


class MethodFromAbove:
    """A method whose code is in a room above its class, imported when it is first looked up.

    Physics draws nothing, but a motion in a notebook shall show itself. The class names the
    function by a string, as an entry point does, and so depends on nothing above it.

    Parameters
    ----------
    source : str
        Module and function, such as "package.module:function". Its first argument is the object.
    static : bool
        Whether it is a static method, which is not given the object.
    """

    def __init__(self, source: str, *, static: bool = False) -> None:
        self._source, self._static = source, static

    def __get__(self, instance: object | None, owner: type) -> Callable[..., Any]:
        module, _, name = self._source.partition(":")
        function = getattr(import_module(module), name)
        return function if instance is None or self._static else MethodType(function, instance)
