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
from numba.core.caching import FunctionCache
from numba.core.serialize import dumps

from npend_gym import _files
from npend_gym.compiled.notice import say

_DIGEST = hashlib.sha256().digest_size


class CheckedCache(FunctionCache):
    """Numba's cache of one function, with files that are checked when they are read."""

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
                f"machine code cannot be kept in {self._cache_path} ({error.strerror or error}): "
                "the next process compiles it again"
            )


class CodeFiles:
    """The files of one function, in place of Numba's ``IndexDataCacheFile``.

    A file is the SHA-256 of what follows, and a pickle of two: what the machine code belongs to
    (the source's time stamp and the key) and the machine code. Like Numba's, the files are as
    trustworthy as the folder that they lie in.

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
        content = dumps(((self._stamp, key), data))
        with _files.replacing(self._path(key), binary=True) as file:
            file.write(hashlib.sha256(content).digest() + content)

    def load(self, key: Any) -> Any:
        """Return the machine code of `key`; None where there is none, or it is damaged."""
        path = self._path(key)
        try:
            file = path.read_bytes()
        except OSError:
            return None
        try:
            if hashlib.sha256(file[_DIGEST:]).digest() != file[:_DIGEST]:
                raise ValueError("checksum")
            belongs_to, data = pickle.loads(file[_DIGEST:])  # noqa: S301 - as Numba does
        except Exception:  # noqa: BLE001 - unpickling raises anything
            say(f"machine code in {self._folder} is damaged: compiling it again")
            with suppress(OSError):
                path.unlink()
            return None
        return data if belongs_to == (self._stamp, key) else None

    def flush(self) -> None:
        """Remove all files of the function."""
        for path in self._folder.glob(f"{self._name}.*.code"):
            path.unlink(missing_ok=True)
