"""Files that appear whole or not at all, and files from sources not trusted.

All that a campaign writes goes through `disk`, in whose place tests put one that fails.

A long run writes *parts*. The name of a part ends in a digest of its owner, such as a campaign's
plan, and of the part's bytes. So a part that exists and has the right name is done; nothing else
needs to be recorded, and it does not matter who wrote it.
"""

from __future__ import annotations

import errno
import hashlib
import io
import json
import math
import os
import secrets
import zipfile
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

_CHUNK = 1 << 20  # bytes read at a time
_DIGEST = hashlib.sha256().digest_size
MAX_TEXT = 10_000_000  # bytes of a JSON file
MAX_DEPTH = 32  # lists and dicts inside each other


class Disk:
    """The operations of the system by which files are written; each may raise an OSError."""

    open = staticmethod(io.FileIO)
    sync = staticmethod(os.fsync)
    replace = staticmethod(os.replace)
    unlink = staticmethod(os.unlink)
    mkdir = staticmethod(os.mkdir)


disk = Disk()


@contextmanager
def replacing(path: Path, *, binary: bool = False) -> Generator[IO[Any], None, None]:
    """Open a file that takes the place of `path` when the block ends without an error.

    Until then, and after an error, what stood at `path` stays untouched. Text is UTF-8 with the
    same line ends on every system. The file is written beside `path`.

    Raises
    ------
    OSError
        With the path, if it cannot be written, or exists and is not a regular file.
    """
    if path.exists() and not path.is_file():
        raise FileExistsError(errno.EEXIST, "exists and is not a regular file", str(path))
    # names of files have at most 255 bytes, four for each character of the worst
    temporary = path.parent / f".{path.name[:40]}.{secrets.token_hex(4)}.part"
    try:
        raw = io.BufferedWriter(disk.open(temporary, "x"))
        with raw if binary else io.TextIOWrapper(raw, encoding="utf-8", newline="") as file:
            yield file
            file.flush()
            disk.sync(file.fileno())
        disk.replace(temporary, path)
    except BaseException as error:
        # a full disk names no file, and others a file that the user never chose
        if isinstance(error, OSError) and error.filename in (None, temporary):
            error.filename = str(path)
            del error.filename2
        with suppress(OSError):  # it may never have been made; the first error is the one to tell
            disk.unlink(temporary)
        raise


def make_folder(path: Path) -> None:
    """Make the folder `path`, and those above it, if they do not exist.

    Raises
    ------
    OSError
        With the path, if it cannot be made.
    """
    for folder in (*reversed(path.parents), path):
        if not folder.is_dir():
            try:
                disk.mkdir(folder)
            except FileExistsError:
                if not folder.is_dir():  # otherwise another process has made it just now
                    raise


def remove(path: Path) -> None:
    """Remove the file at `path`, if there is one."""
    with suppress(FileNotFoundError):
        disk.unlink(path)


def part_digest(owner: str, data: bytes) -> str:
    """Suffix of the name of a part with these bytes: digits of their hash."""
    return hashlib.sha256(owner.encode() + data).hexdigest()[:16]


def write_part(owner: str, place: Path, data: bytes, suffix: str) -> Path:
    """Write a part whole or not at all; return its path: `place`, the digest and the suffix."""
    make_folder(place.parent)
    path = place.with_name(f"{place.name}-{part_digest(owner, data)}{suffix}")
    with replacing(path, binary=True) as file:
        file.write(data)
    return path


def read_part(owner: str, path: Path, most: float = math.inf) -> bytes | None:
    """Return the bytes of a part; None where its name says others, or they are more than `most`."""
    try:
        if not path.is_file() or path.stat().st_size > most:  # a FIFO would wait for ever
            return None
        data = path.read_bytes()
    except OSError:
        return None
    return data if path.stem.endswith(part_digest(owner, data)) else None


def write_checked(path: Path, content: bytes) -> None:
    """Write a file whole or not at all: the SHA-256 of the content, and the content."""
    with replacing(path, binary=True) as file:
        file.write(hashlib.sha256(content).digest())
        file.write(content)


def read_checked(path: Path) -> bytes | None:
    """Return the content of a file of `write_checked`; None where its SHA-256 does not fit."""
    data = path.read_bytes()
    digest, content = data[:_DIGEST], data[_DIGEST:]
    return content if hashlib.sha256(content).digest() == digest else None


def sha256(path: Path) -> str | None:
    """Return the SHA-256 of a file, read piece by piece; None where it cannot be read."""
    digest = hashlib.sha256()
    try:
        if not path.is_file():  # a FIFO would wait for ever
            return None
        with path.open("rb") as file:
            while piece := file.read(_CHUNK):
                digest.update(piece)
    except OSError:
        return None
    return digest.hexdigest()


def read_text(path: Path) -> str:
    """Return the text of a file of people or programs, in UTF-8, without a byte order mark.

    Raises
    ------
    ValueError
        If it is no file, too large, or not in UTF-8.
    OSError
        If it cannot be opened.
    """
    if path.exists() and not path.is_file():  # a FIFO would wait for ever
        raise ValueError("it is no file")
    with path.open("rb") as file:
        text = file.read(MAX_TEXT + 1)
    if len(text) > MAX_TEXT:
        raise ValueError(f"it has more than {MAX_TEXT} bytes")
    return text.decode("utf-8-sig")


def parse_json(text: str) -> dict[str, Any]:
    """Return the names and values in JSON of a source not trusted.

    Raises
    ------
    ValueError
        If it is no JSON, no object, or one with too many lists and objects inside each other.
    """
    try:
        value: Any = json.loads(text)
    except RecursionError as error:
        raise ValueError("its lists and objects are nested too deep") from error
    if not isinstance(value, dict):
        raise ValueError(f"it must be an object, names and values, got a {type(value).__name__}")
    check_depth(value)
    return value  # pyright: ignore[reportUnknownVariableType]


def check_depth(value: Any) -> None:
    """Refuse a value whose lists and dicts are nested deeper than what is ever written."""
    level: list[Any] = [value]
    for _ in range(MAX_DEPTH):
        entries: list[Any] = [
            entry
            for each in level
            for entry in (each.values() if isinstance(each, dict) else each)  # pyright: ignore[reportUnknownVariableType]
        ]
        level = [entry for entry in entries if isinstance(entry, (dict, list))]  # pyright: ignore[reportUnknownVariableType]
        if not level:
            return
    raise ValueError(f"its lists and objects are nested deeper than {MAX_DEPTH}")


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
                arrays = dict[str, NDArray[Any]]()
                for name in archive.namelist():
                    with archive.open(name) as member:
                        array = np.lib.format.read_array(member, allow_pickle=False)
                    arrays[name.removesuffix(".npy")] = array
                return arrays
        except Exception as error:
            raise ValueError(str(error) or type(error).__name__) from error
