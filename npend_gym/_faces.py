"""Public faces: a package lists its names once, in its stub, and imports each when first used."""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import MethodType
from typing import Any


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
    stub = ast.parse(Path(file).with_suffix(".pyi").read_text(encoding="utf-8"))
    sources = {
        alias.asname or alias.name: node.module or package
        for node in stub.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }

    def get_attribute(name: str) -> object:
        if name not in sources:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        if sources[name] == package:  # a module of the package itself
            return import_module(f"{package}.{name}")
        value = getattr(import_module(sources[name]), name)
        setattr(sys.modules[package], name, value)
        return value

    return get_attribute, lambda: sorted(sources), list(sources)


class MethodFromAbove:
    """A method whose code is in a room above its class, imported when it is first looked up.

    Physics draws nothing, but a motion in a notebook shall show itself. The class names the
    function by a string, as an entry point does, and so depends on nothing above it.

    Parameters
    ----------
    source : str
        Module and function, such as "package.module:function". Its first argument is the object.
    """

    def __init__(self, source: str) -> None:
        self._source = source

    def __get__(self, instance: object | None, owner: type) -> Callable[..., Any]:
        module, _, name = self._source.partition(":")
        function = getattr(import_module(module), name)
        return function if instance is None else MethodType(function, instance)
