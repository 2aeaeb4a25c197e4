"""Kernels as Python calls them: machine code that is kept on the disk, loaded and called.

A kernel is compiled for each kind of arguments that it is given: the types of arrays, tuples and
numbers. Its machine code is an object file, which LLVM loads. Python calls the function `entry` in
it with the tuple of arguments. It checks that they are of its kind, and reads the arrays. Then it
lets other threads of Python run, and runs the kernel. Numba is not needed for that.
"""

# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false
from __future__ import annotations

import ctypes
import json
import os
import sys
import threading
from collections.abc import Callable, Iterable
from enum import IntEnum
from functools import cache, cached_property, update_wrapper
from hashlib import sha256
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from llvmlite import binding

from npend_gym.compiled.machine_code import read_code, write_code
from npend_gym.compiled.processors import SHIPPED, levels, processor
from npend_gym.compiled.sources import PACKAGE, code_folder

_FORMAT = 1  # of files of machine code
_CALL = ctypes.PYFUNCTYPE(ctypes.c_int, ctypes.py_object, ctypes.c_void_p, ctypes.c_void_p)
DONE, OTHER_KIND = 0, 1  # what an entry returns
_LAYOUTS = "CFA"
_SCALARS: tuple[type, ...] = (np.float64, np.int64, np.bool_)
_NUMBERS = "biuf"  # kinds of the entries of arrays, as NumPy names them
_LOCK = threading.RLock()


class Word(IntEnum):
    """What an entry knows of Python: words of 64 bits, before the addresses that it needs."""

    ITEMS = 0  # place of the items in a tuple
    HEAD = 1  # size of an object's head, behind which an array has what describes it
    SAVE_THREAD = 2  # addresses of functions of Python
    RESTORE_THREAD = 3
    AS_INT = 4
    ERROR = 5
    FLOAT = 6  # addresses of types, and of the only objects of theirs
    INT = 7
    TUPLE = 8
    ARRAY = 9
    TRUE = 10
    FALSE = 11
    NONE = 12


class Code(NamedTuple):
    """Machine code of a kernel for one kind of arguments.

    Parameters
    ----------
    symbol : str
        Of its entry.
    needs : tuple of str
        Objects whose addresses follow those of `Word`: types of entries of arrays as NumPy writes
        them, and classes as "module:name".
    returns : str
        Letters of what it returns, of "fiub", in parentheses where it is a tuple; "" for None.
    object : bytes
        The object file.
    """

    symbol: str
    needs: tuple[str, ...]
    returns: str
    object: bytes

    def packed(self) -> bytes:
        """Return it as the bytes of a file."""
        head = json.dumps([_FORMAT, self.symbol, self.needs, self.returns]).encode()
        return len(head).to_bytes(4, "little") + head + self.object

    @classmethod
    def unpacked(cls, data: bytes) -> Code:
        """The value of which `packed` made bytes."""
        end = 4 + int.from_bytes(data[:4], "little")
        form, symbol, needs, returns = json.loads(data[4:end])
        if form != _FORMAT:
            raise ValueError(f"format {form}")
        return cls(symbol, tuple(needs), returns, data[end:])


class Kernel:
    """A compiled function that Python calls by position; other kernels can call it too."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.__qualname__: str = function.__qualname__
        update_wrapper(self, function)
        self.py_func: Callable[..., Any] = function
        self.targetoptions: dict[str, Any] = {}
        self.stays_whole: bool = False
        self._loaded: tuple[_Loaded, ...] = ()
        self._by_kind: dict[str, _Loaded | None] = {}
        self.hits: int = 0  # how much machine code was kept

    def __call__(self, *arguments: Any) -> Any:
        """Run the machine code for arguments of this kind."""
        for loaded in self._loaded:
            if loaded.returns:
                out = (ctypes.c_int64 * len(loaded.returns))()
                if loaded.call(arguments, loaded.words, out) == DONE:
                    return loaded.result(out)
            elif loaded.call(arguments, loaded.words, None) == DONE:
                return None
        return self._first_call(arguments)

    def _first_call(self, arguments: tuple[Any, ...]) -> Any:
        """Run the kernel where nothing that is loaded is of this kind."""
        plain = tuple(map(_plain, arguments))
        kind = "" if _needs_numba() else kind_of(plain)
        if kind not in self._by_kind:
            with _LOCK:
                code = self._code(kind, plain) if kind else None
                loaded = self._by_kind[kind] = None if code is None else _Loaded(code)
                self._loaded = (*self._loaded, *([loaded] if loaded is not None else ()))
        loaded = self._by_kind[kind]
        if loaded is not None:
            out = (ctypes.c_int64 * max(1, len(loaded.returns)))()
            if loaded.call(plain, loaded.words, out) == DONE:
                return loaded.result(out)
        return self._by_numba(*arguments)

    def _code(self, kind: str, arguments: tuple[Any, ...]) -> Code | None:
        """Return machine code for a kind of arguments: kept, or else compiled and then kept."""
        place = None
        if self._from_text is not None:
            place = code_folder() / self._file(kind, processor())
            built = SHIPPED / code_folder().name
            shipped = [built / self._file(kind, level) for level in levels() if built.is_dir()]
            for path in (place, *shipped):
                code = read_code(path, Code.unpacked)
                if code is not None:
                    self.hits += 1
                    return code
        code: Code | None = compiler().compiled_code(self, arguments)
        if place is not None and code is not None:
            write_code(place, code.packed())
        return code

    def _file(self, kind: str, made_for: str) -> str:
        """Return the name of the file of machine code for a kind of arguments."""
        digest = sha256(f"{self._from_text} {kind} {made_for}".encode()).hexdigest()[:16]
        return f"{self.__module__}.{self.__qualname__}.{digest}.code"

    @cached_property
    def _from_text(self) -> str | None:
        """Which source it is made from; None where its machine code cannot be kept.

        The folder of machine code goes by the sources of the package, and not by those of others.
        """
        text = self.py_func.__code__
        try:
            stat = Path(text.co_filename).stat()
        except OSError:
            return None
        if self.py_func.__closure__:
            return None
        of_package = self.__module__.startswith(f"{PACKAGE.name}.")
        stamp = "" if of_package else f"{text.co_filename} {stat.st_mtime_ns} {stat.st_size}"
        return f"{self.__module__}.{self.__qualname__} {text.co_firstlineno} {stamp}"

    @cached_property
    def _by_numba(self) -> Any:
        """The kernel as Numba's own dispatcher, for what has no entry; it is not kept."""
        return compiler().dispatcher_of_kernel(self)

    @cached_property
    def _numba_type_(self) -> Any:
        """What Numba takes it for, in the text of other kernels."""
        return compiler().type_of_part(self)

    def __reduce__(self) -> str:
        return self.__qualname__


class _Loaded:
    """Machine code that can be called."""

    def __init__(self, code: Code) -> None:
        self.symbol: str = code.symbol
        self.returns: str = code.returns.strip("()")
        self._is_tuple = code.returns.startswith("(")
        self._kept_alive = [_needed(name) for name in code.needs]
        words = [*_words(), *map(id, self._kept_alive)]
        self._words = (ctypes.c_int64 * len(words))(*words)
        self.words = ctypes.c_void_p(ctypes.addressof(self._words))
        with _LOCK:
            engine = _engine()
            address = engine.get_function_address(code.symbol)
            if not address:
                engine.add_object_file(binding.ObjectFileRef.from_data(code.object))
                engine.finalize_object()
                address = engine.get_function_address(code.symbol)
        self.call: Any = _CALL(address)

    def result(self, out: Any) -> Any:
        """Result of a kernel, read from `out`."""
        if not self.returns:
            return None
        values = [_READ[letter](out, 8 * k) for k, letter in enumerate(self.returns)]
        return tuple(values) if self._is_tuple else values[0]


_READ: dict[str, Callable[[Any, int], Any]] = {
    "f": lambda out, at: ctypes.c_double.from_buffer(out, at).value,
    "i": lambda out, at: ctypes.c_int64.from_buffer(out, at).value,
    "u": lambda out, at: ctypes.c_uint64.from_buffer(out, at).value,
    "b": lambda out, at: ctypes.c_int64.from_buffer(out, at).value != 0,
}


def compiler() -> Any:
    """Return the module that compiles, with Numba. It knows the kernels, and they know its name."""
    return import_module("npend_gym.compiled.compiling")


def kind_of(arguments: tuple[Any, ...]) -> str:
    """Return a text for the types of arguments; "" where an entry cannot take them."""
    try:
        return ",".join(map(_kind, arguments)) or "-"
    except TypeError:
        return ""


def _kind(value: Any) -> str:
    if type(value) is np.ndarray:
        flags, dtype = value.flags, value.dtype
        if dtype.kind not in _NUMBERS or not dtype.isnative or not flags.aligned:
            raise TypeError
        layout = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"
        return f"{dtype.str[1:]}.{value.ndim}{layout}{'' if flags.writeable else 'r'}"
    if isinstance(value, tuple):
        named = "" if type(value) is tuple else f"{name_of_class(type(value))}"
        return f"{named}({','.join(map(_kind, value))})"
    simple = {float: "f", int: "i", bool: "b", type(None): "n"}.get(type(value))
    if simple is None or (simple == "i" and not -(2**63) <= value < 2**63):
        raise TypeError
    return simple


def _plain(value: Any) -> Any:
    """Return an argument as an entry knows it: NumPy's numbers as Python's, its types as they are.

    A type of NumPy's may be equal to the usual one and another object, as after unpickling.
    """
    if type(value) is np.ndarray:
        usual = np.dtype(value.dtype.str)
        return value if value.dtype is usual else value.view(usual)
    if isinstance(value, _SCALARS):
        return value.item()
    if isinstance(value, tuple):
        parts = [_plain(part) for part in value]
        return type(value)(parts) if type(value) is tuple else type(value)(*parts)
    return value


def name_of_class(kind: type) -> str:
    """Return where a class is found."""
    return f"{kind.__module__}:{kind.__qualname__}"


def _needed(name: str) -> Any:
    """Return an object that an entry compares with."""
    module, _, names = name.partition(":")
    return attrgetter(names)(import_module(module)) if names else np.dtype(name)


@cache
def _words() -> list[int]:
    """Return the words of `Word`, in its order."""
    api = ctypes.pythonapi
    functions: Iterable[Any] = (
        api.PyEval_SaveThread, api.PyEval_RestoreThread, api.PyLong_AsLongLong, api.PyErr_Occurred
    )  # fmt: skip
    addresses = [ctypes.cast(each, ctypes.c_void_p).value or 0 for each in functions]
    objects = float, int, tuple, np.ndarray, True, False, None
    return [tuple.__basicsize__, object.__basicsize__, *addresses, *map(id, objects)]


@cache
def _needs_numba() -> bool:
    """Return whether Numba must run the kernels: to check indices, or as objects are laid out."""
    chosen = os.environ.get("NUMBA_BOUNDSCHECK", "0") not in ("", "0")
    return chosen or sys.implementation.name != "cpython" or not _are_laid_out_as_known()


def _are_laid_out_as_known() -> bool:
    """Return whether tuples and arrays have in memory what an entry reads there."""
    array = np.zeros((2, 3))[:, ::2]
    head, items = object.__basicsize__, tuple.__basicsize__
    pair = (array, head)

    def word(address: int) -> int:
        return ctypes.c_int64.from_address(address).value

    at = id(array)
    found = [word(at + head), word(at + head + 8) & 0xFFFFFFFF, word(at + head + 40)]
    dims, strides = word(at + head + 16), word(at + head + 24)
    found += [word(dims), word(dims + 8), word(strides), word(strides + 8)]
    known = [array.ctypes.data, 2, id(array.dtype), *array.shape, *array.strides]
    in_tuple = [word(id(pair) + head), word(id(pair) + items), word(id(pair) + head - 8)]
    return found == known and in_tuple == [2, at, id(tuple)]


@cache
def _engine() -> Any:
    """The loader of object files."""
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    machine = binding.Target.from_default_triple().create_target_machine()
    return binding.create_mcjit_compiler(binding.parse_assembly(""), machine)
