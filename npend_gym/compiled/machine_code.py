"""The files of machine code: each has a checksum, and a damaged one is compiled again.

Numba keeps an index and data files for each function and trusts all of them: one that is cut or
overwritten, as a full disk or a failing one leaves it, ends the program. Two processes that add to
one index at the same time can give a name twice. One signature then gets the machine code of
another. Here each signature has one file, which holds all that is needed to recognise it.
"""

# Numba's stubs leave parts unknown
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUntypedBaseClass=false
from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.serialize import dumps

from npend_gym import _files
from npend_gym.compiled.notice import say

_NumbasFolder: Any = CompileResultCacheImpl._locator_classes[0]  # noqa: SLF001 - of NUMBA_CACHE_DIR


class _Folder(_NumbasFolder):
    """The folder of the machine code, which may be read-only: Numba would take another, or none."""

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _Folder:
        """Return the folder of a function."""
        return cls(py_func, py_file)


class _Files(CompileResultCacheImpl):
    _locator_classes = [_Folder]  # noqa: RUF012 - as Numba has it


class CheckedCache(FunctionCache):
    """Numba's cache of one function, with files that are checked when they are read."""

    _impl_class = _Files

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        locator, name = self._impl.locator, self._impl.filename_base
        self._cache_file = CodeFiles(Path(self._cache_path), name, locator.get_source_stamp())

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep machine code; where the disk refuses it, say so and go on without."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            say(
                f"machine code cannot be kept in {Path(self._cache_path).parent} "
                f"({error.strerror or error}): the next process compiles it again, unless "
                "NUMBA_CACHE_DIR names a folder that can be written to"
            )


def read_code(path: Path, unpack: Callable[[bytes], Any] = bytes) -> Any:
    """Return the unpacked content of a file of `_files.write_checked`.

    None where there is none, or it is damaged: it is removed then.
    """
    try:
        content = _files.read_checked(path)
    except OSError:
        return None
    try:
        if content is None:
            raise ValueError("checksum")
        return unpack(content)
    except Exception:  # noqa: BLE001 - unpickling raises anything
        say(f"machine code in {path.parent} is damaged: compiling it again")
        with suppress(OSError):
            path.unlink()
        return None


class CodeFiles:
    """The files of one function, in place of Numba's ``IndexDataCacheFile``.

    A file holds a pickle of two: what the machine code belongs to (the source's time stamp and the
    key) and the machine code. Like Numba's, the files are as trustworthy as the folder that they
    lie in.

    Parameters
    ----------
    folder : Path
    name : str
        With which the names of the files begin.
    stamp : object
        Of the source: machine code of another one is not used.
    """

    def __init__(self, folder: Path, name: str, stamp: Any) -> None:
        self._folder, self._name, self._stamp = folder, name, stamp

    def _path(self, key: Any) -> Path:
        text = f"{numba.__version__} {key}"
        return self._folder / f"{self._name}.{hashlib.sha256(text.encode()).hexdigest()[:16]}.code"

    def save(self, key: Any, data: Any) -> None:
        """Write the machine code of `key`, a signature with the processor it is for."""
        _files.write_checked(self._path(key), dumps(((self._stamp, key), data)))

    def load(self, key: Any) -> Any:
        """Return the machine code of `key`; None where there is none, or it is damaged."""
        belongs_to, data = read_code(self._path(key), pickle.loads) or (None, None)
        return data if belongs_to == (self._stamp, key) else None

    def flush(self) -> None:
        """Remove all files of the function."""
        for path in self._folder.glob(f"{self._name}.*.code"):
            path.unlink(missing_ok=True)
