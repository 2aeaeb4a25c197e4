"""Files that appear whole or not at all."""

from __future__ import annotations

import errno
import os
import secrets
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any


@contextmanager
def replacing(path: Path, *, binary: bool = False) -> Generator[IO[Any], None, None]:
    """Open a file that takes the place of `path` when the block ends without an error.

    Until then, and after an error, what stood at `path` stays untouched. Text is UTF-8 with the
    same line ends on every system.

    Raises
    ------
    OSError
        Naming the path, if it cannot be written, or is there and no regular file.
    """
    if path.exists() and not path.is_file():
        raise FileExistsError(errno.EEXIST, "is there already and no regular file", str(path))
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")
    opened: IO[Any] = (
        temporary.open("xb") if binary else temporary.open("x", encoding="utf-8", newline="")
    )
    try:
        with opened as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        if error.filename is None:  # the disk is full, say
            error.filename = str(path)
        temporary.unlink(missing_ok=True)
        raise
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
