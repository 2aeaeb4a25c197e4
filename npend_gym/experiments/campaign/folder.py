"""The folder of a campaign: on the disk, or in an object store by fsspec."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from npend_gym import _checks, _extras, _files


def open_folder(out: Path | str) -> Folder:
    """Return the folder at a path or a URL, such as "s3://bucket/results"; nothing is made."""
    if isinstance(out, str) and "://" in out and not out.startswith("file://"):
        return Store(out)
    return Folder(out)


class Folder:
    """A folder on the disk; files are named by their paths in it, with slashes."""

    is_store = is_of_process = False

    def __init__(self, out: Path | str) -> None:
        try:
            self.path: Path = Path(str(out).removeprefix("file://")).resolve()
        except (OSError, RuntimeError, ValueError) as error:  # a loop of links, a null character
            shown = _checks.show(str(out))
            raise ValueError(f"out must be a path of a folder, got {shown}") from error

    def __str__(self) -> str:
        return str(self.path)

    def at(self, name: str) -> str:
        """Return the whole path of a file."""
        return str(self.path / name)

    def make(self) -> None:
        """Make the folder, if need be."""
        _files.make_folder(self.path)

    def names(self, start: str) -> list[str]:
        """Return the files whose names begin with `start`, which has a folder, in order."""
        folder, _, begin = start.rpartition("/")
        try:
            with os.scandir(self.path / folder) as found:
                names = sorted(each.name for each in found if each.name.startswith(begin))
        except (FileNotFoundError, NotADirectoryError):
            return []
        return [f"{folder}/{name}" if folder else name for name in names]

    def read(self, name: str) -> bytes | None:
        """Return the bytes of a file; None where there is none, or it cannot be read."""
        try:
            path = self.path / name
            return path.read_bytes() if path.is_file() else None  # a FIFO would wait for ever
        except OSError:
            return None

    def read_part(self, owner: str, name: str, most: float = float("inf")) -> bytes | None:
        """Return the bytes of a part; None where they are others than its name says."""
        return _files.read_part(owner, self.path / name, most)

    def sha256(self, name: str) -> str | None:
        """Return the SHA-256 of a file, read piece by piece; None where it cannot be read."""
        return _files.sha256(self.path / name)

    def read_text(self, name: str) -> str:
        """Return a text; raise FileNotFoundError where there is none, ValueError for another."""
        return _files.read_text(self.path / name)

    def write(self, name: str, data: bytes) -> None:
        """Write a file whole or not at all, in place of another."""
        with self.writing(name) as file:
            file.write(data)

    @contextmanager
    def writing(self, name: str) -> Generator[IO[bytes], None, None]:
        """Open a file that takes the place of another when the block ends without an error."""
        path = self.path / name
        _files.make_folder(path.parent)
        with _files.replacing(path, binary=True) as file:
            yield file

    create = write  # on the condition that there is none, in a store

    def write_part(self, owner: str, place: str, data: bytes, suffix: str) -> None:
        """Write a part whole or not at all; its name has the digest of its bytes."""
        _files.write_part(owner, self.path / place, data, suffix)

    def remove(self, name: str) -> None:
        """Remove a file, if there is one."""
        _files.remove(self.path / name)


class Store(Folder):
    """A folder in an object store: fsspec, and conditional writes in place of renames.

    A request may arrive twice. The second finds the key taken, and is harmless where the bytes are
    the same.
    """

    is_store = True

    def __init__(self, out: str) -> None:
        fsspec = _extras.require("fsspec", "cloud", "campaigns in an object store")
        self.url = out.rstrip("/")
        try:
            self.fs: Any
            # without a cache, because other machines write too
            self.fs, self.root = fsspec.core.url_to_fs(self.url, use_listings_cache=False)
        except (ValueError, ImportError) as error:
            raise ValueError(
                f"out must be a folder or the URL of one, got {out}: {error}. Its library may be "
                'missing: pip install "npend-gym[cloud]"'
            ) from error
        self.is_of_process: bool = self.url.startswith("memory:")

    def __str__(self) -> str:
        return self.url

    def at(self, name: str) -> str:
        """Return the whole URL of a file."""
        return f"{self.url}/{name}"

    def _key(self, name: str) -> str:
        return f"{self.root}/{name}"

    @contextmanager
    def _told(self, name: str) -> Generator[None, None, None]:
        """Turn errors of libraries into an OSError that names the URL; leave those of files."""
        try:
            yield
        except (FileNotFoundError, FileExistsError):
            raise
        except Exception as error:  # each library has its own
            message = f"{type(error).__name__}: {error}"
            raise OSError(5, message, self.at(name)) from error

    def make(self) -> None:
        """Do nothing: stores have no folders."""

    def names(self, start: str) -> list[str]:
        """Return the files whose names begin with `start`, in order."""
        folder, _, _ = start.rpartition("/")
        with self._told(start):
            try:
                self.fs.invalidate_cache()
                found = self.fs.ls(self._key(folder) if folder else self.root, detail=False)
            except FileNotFoundError:
                return []
        prefix = len(self.root) + 1
        names = (each.rstrip("/")[prefix:] for each in found)
        return sorted(name for name in names if name.startswith(start) and name != folder)

    def read(self, name: str) -> bytes | None:
        """Return the bytes of a file; None where there is none."""
        with self._told(name):
            try:
                return self.fs.cat_file(self._key(name))
            except FileNotFoundError:
                return None

    def read_part(self, owner: str, name: str, most: float = float("inf")) -> bytes | None:
        """Return the bytes of a part; None where they are others than its name says."""
        with self._told(name):
            if most < float("inf") and self.fs.info(self._key(name))["size"] > most:
                return None
        data = self.read(name)
        stem = name.rpartition(".")[0]
        return data if data and stem.endswith(_files.part_digest(owner, data)) else None

    def sha256(self, name: str) -> str | None:
        """Return the SHA-256 of a file, read piece by piece."""
        digest = hashlib.sha256()
        with self._told(name), self.fs.open(self._key(name), "rb") as file:
            while piece := file.read(1 << 22):
                digest.update(piece)
        return digest.hexdigest()

    def read_text(self, name: str) -> str:
        """Return a text; raise FileNotFoundError where there is none."""
        with self._told(name):
            data = self.fs.cat_file(self._key(name), end=_files.MAX_TEXT + 1)
        if len(data) > _files.MAX_TEXT:
            raise ValueError(f"it has more than {_files.MAX_TEXT} bytes")
        return data.decode("utf-8-sig")

    @contextmanager
    def writing(self, name: str) -> Generator[IO[bytes], None, None]:
        """Open a file that appears when the block ends without an error."""
        with self._told(name), self.fs.transaction, self.fs.open(self._key(name), "wb") as file:
            yield file

    def write(self, name: str, data: bytes) -> None:
        """Write a file whole, in place of another."""
        with self._told(name):
            self.fs.pipe_file(self._key(name), data)

    def create(self, name: str, data: bytes) -> None:
        """Write a file on the condition that there is none; raise FileExistsError for another."""
        with self._told(name):
            try:
                self.fs.pipe_file(self._key(name), data, mode="create")
            except Exception as error:  # or the reply to a request that succeeded was lost
                found = self.read(name)
                if found is None:
                    raise
                if found != data:
                    text = "exists with other bytes"
                    raise FileExistsError(17, text, self.at(name)) from error

    def write_part(self, owner: str, place: str, data: bytes, suffix: str) -> None:
        """Write a part on the condition that there is none; its name has its digest."""
        self.create(f"{place}-{_files.part_digest(owner, data)}{suffix}", data)

    def remove(self, name: str) -> None:
        """Remove a file, if there is one."""
        with self._told(name), suppress(FileNotFoundError):
            self.fs.rm_file(self._key(name))
