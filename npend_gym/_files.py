"""Files that appear whole or not at all, and archives of arrays from sources not trusted."""

from __future__ import annotations

import errno
import os
import secrets
import zipfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray


@contextmanager
def replacing(path: Path, *, binary: bool = False) -> Generator[IO[Any], None, None]:
    """Open a file that takes the place of `path` when the block ends without an error.

    Until then, and after an error, what stood at `path` stays untouched. Text is UTF-8 with the
    same line ends on every system.

    Raises
    ------
    OSError
        With the path, if it cannot be written, or exists and is not a regular file.
    """
    if path.exists() and not path.is_file():
        raise FileExistsError(errno.EEXIST, "exists and is not a regular file", str(path))
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


def read_arrays(path: Path, max_bytes: int) -> dict[str, NDArray[Any]]:
    """Return the arrays of an npz archive; sizes are looked at before anything is unpacked.

    Raises
    ------
    ValueError
        If it is no whole archive, would unpack to more than `max_bytes` or holds pickles, which
        are not run.
    OSError
        If it cannot be opened.
    """
    if path.exists() and not path.is_file():  # a FIFO would wait for ever
        raise ValueError("it is no file")
    with path.open("rb") as file:
        try:
            with zipfile.ZipFile(file) as archive:
                size = sum(member.file_size for member in archive.infolist())
            if size > max_bytes:
                raise ValueError(f"{size} bytes unpacked, at most {max_bytes}")
            file.seek(0)
            with np.load(file, allow_pickle=False) as data:
                return {name: np.asarray(data[name]) for name in data.files}
        except Exception as error:
            raise ValueError(str(error) or type(error).__name__) from error
