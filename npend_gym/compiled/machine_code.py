"""The files of machine code: each has a checksum, and a damaged one is compiled again.

A file that is cut or overwritten, as a full disk or a failing one leaves it, would end the program.
Like Numba's own, the files are as trustworthy as the folder that they lie in.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from npend_gym import _files
from npend_gym.compiled.notice import say


def write_code(path: Path, content: bytes) -> None:
    """Keep machine code; where the disk refuses it, say so and go on without."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _files.write_checked(path, content)
    except OSError as error:
        say(
            f"machine code cannot be kept in {path.parent} "
            f"({error.strerror or error}): the next process compiles it again, unless "
            "NUMBA_CACHE_DIR names a folder that can be written to"
        )


def read_code(path: Path, unpack: Callable[[bytes], Any] = bytes) -> Any:
    """Return the unpacked content of a file of `write_code`.

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
    except Exception:  # noqa: BLE001 - what was written by another version raises anything
        say(f"machine code in {path.parent} is damaged: compiling it again")
        with suppress(OSError):
            path.unlink()
        return None
