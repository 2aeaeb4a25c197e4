"""What a function of the user's computes, as a key: functions of one key compute the same.

Numba compiles what a function reads from elsewhere, the variables of the function around it and of
its module, as constants. The key has their values, and so changes with them.
"""

from __future__ import annotations

import dis
from collections.abc import Hashable, Sequence
from enum import Enum
from functools import lru_cache
from hashlib import sha256
from types import BuiltinFunctionType, CellType, CodeType, FunctionType, ModuleType
from typing import Any, NamedTuple, cast

import numpy as np

_LIBRARIES = {"numpy", "numba", "math"}  # whose functions nobody changes
_SCALAR: Any = np.generic  # Any: pyright knows no part of these types
_ARRAY: Any = np.ndarray
_FIXED: Any = np.ufunc, type(np.where), type, Enum  # values that stay the same


class Identity(NamedTuple):
    """A key of a function, and whether all that it reads is in the key."""

    key: Hashable
    whole: bool


def identity_of(function: Any) -> Identity:
    """Return the key of what a function computes, with all that it closes over and calls."""
    reader = _Reader()
    return Identity(reader.of(function), reader.whole)


class _Reader:
    """Makes keys of values; `whole` is False after one that is known by its type alone."""

    def __init__(self) -> None:
        self.whole = True
        self._seen: dict[Hashable, int] = {}

    def of(self, value: Any, names: Sequence[str] = ()) -> Hashable:
        """Return the key of a value, of a module that of its attributes by these names."""
        kind = cast("Any", type(value))
        if value is None or kind in (bool, int, str, bytes):
            return kind, value
        if kind is float or kind is complex:  # as bits: NaN is itself, -0.0 is not 0.0
            return kind, np.array(value).tobytes()
        if isinstance(value, _SCALAR) and not value.dtype.hasobject:
            return value.dtype, value.tobytes()
        if kind is _ARRAY and not value.dtype.hasobject:
            digest = sha256(value.tobytes()).digest()
            return kind, value.dtype, value.shape, value.strides, digest
        if isinstance(value, _FIXED) or _is_of_library(value):
            return value
        if isinstance(value, tuple):
            return kind, *map(self.of, cast("tuple[Any, ...]", value))
        place = id(value), *names
        if place in self._seen:
            return "again", self._seen[place]
        self._seen[place] = len(self._seen)
        if isinstance(value, list):
            return kind, *map(self.of, cast("list[Any]", value))
        if isinstance(value, ModuleType):
            own = vars(value)
            return value, *((name, self.of(own[name], names)) for name in names if name in own)
        if isinstance(value, FunctionType):
            return self._function(value)
        if hasattr(value, "py_func"):  # of Numba, which keeps what it compiled before
            return value, self.of(value.py_func)
        self.whole = False
        return "unknown", kind

    def _function(self, function: FunctionType) -> Hashable:
        code, outside = function.__code__, function.__globals__
        loaded, names = _names(code)
        defaults = function.__defaults__, *(function.__kwdefaults__ or {}).items()
        globals_ = [name for name in loaded if name in outside]
        return (
            code,
            *map(self.of, defaults),
            *(self._cell(cell, names) for cell in function.__closure__ or ()),
            *((name, self.of(outside[name], names)) for name in globals_),
        )

    def _cell(self, cell: CellType, names: Sequence[str]) -> Hashable:
        try:
            content = cell.cell_contents
        except ValueError:  # nothing is assigned to the variable yet
            return "empty"
        return self.of(content, names)


def _is_of_library(value: Any) -> bool:
    """Return whether a value is a function of a library, or one in C of no object."""
    if isinstance(value, BuiltinFunctionType):
        return value.__self__ is None or isinstance(value.__self__, ModuleType)
    module = str(value.__module__) if isinstance(value, FunctionType) else ""
    return module.partition(".")[0] in _LIBRARIES


@lru_cache(maxsize=256)
def _names(code: CodeType) -> tuple[list[str], list[str]]:
    """Return the variables of the module that code reads, and all its names, of attributes too."""
    loaded = {
        each.argval
        for each in dis.get_instructions(code)
        if each.opname in ("LOAD_GLOBAL", "LOAD_NAME")
    }
    names = set(code.co_names)
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            its_loaded, its_names = _names(inner)
            loaded |= set(its_loaded)
            names |= set(its_names)
    return sorted(loaded), sorted(names)
