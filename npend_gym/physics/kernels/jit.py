"""The one decorator of all compiled functions, and the flags it stands for."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from os import utime
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

_F = TypeVar("_F", bound=Callable[..., object])


def _refresh_stamps(folder: Path) -> None:
    """Give every kernel file the age of the newest.

    Numba's disk cache looks at the age of the file that a function stands in, not at the files of
    the functions that it calls: without this, an edit in one kernel file would leave stale
    machine code of another in use.
    """
    files = list(folder.glob("*.py"))
    newest = max(file.stat().st_mtime_ns for file in files)
    for file in files:
        if file.stat().st_mtime_ns != newest:
            with suppress(OSError):  # a read-only installation is not being edited
                utime(file, ns=(newest, newest))


if TYPE_CHECKING:

    def kernel(function: _F) -> _F:
        """Compile `function` with Numba."""
        return function

    def inlined_kernel(function: _F) -> _F:
        """Compile `function` with Numba as a part of its callers."""
        return function

else:
    import numba

    _refresh_stamps(Path(__file__).parent)

    # cache: compiled once per machine, not per process.
    # nogil: other Python threads run on while a kernel does.
    # error_model: 1/0 is inf as in C, without the branch that stops vectorisation.
    # fastmath stays off: it reorders sums, and the bits would depend on the machine.
    kernel = numba.njit(cache=True, nogil=True, error_model="numpy")
    # for the innermost function: passing its many arrays takes a tenth of its time at n = 5
    inlined_kernel = numba.njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
