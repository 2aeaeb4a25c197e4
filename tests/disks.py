"""Disks that fail on purpose, and one that remembers, so that a power cut can be played."""
# ruff: noqa: PTH102, PTH105, PTH108, PTH110 - the very calls of `npend_gym._files.Disk`

from __future__ import annotations

import errno
import io
import os
import random
from pathlib import Path

from npend_gym import _files

KINDS = ("before", "after", "half")


class FaultyDisk(_files.Disk):
    """Does what it is asked for, but its operation number `fatal` fails, once.

    Attributes
    ----------
    done : list of str
        The operations so far.
    kind : {"before", "after", "half"}
        Whether the operation that fails has done nothing, everything, or (a write) half.
    """

    def __init__(self, fatal: int = -1, kind: str = "before", code: int = errno.EIO) -> None:
        self.done: list[str] = []
        self.fatal, self.kind, self.code = fatal, kind, code

    def step(self, name, act, half=None):
        """Count the operation, and do it, or fail."""
        number = len(self.done)
        self.done.append(name)
        if number != self.fatal:
            return act()
        if self.kind == "after":
            made = act()
            if isinstance(made, io.FileIO):
                io.FileIO.close(made)
        elif self.kind == "half" and half is not None:
            half()
        raise OSError(self.code, os.strerror(self.code))

    def open(self, path, mode):
        disk = self

        class File(io.FileIO):
            def write(self, data):
                own, whole = super(), bytes(data)
                return disk.step(
                    "write", lambda: own.write(whole), lambda: own.write(whole[: len(whole) // 2])
                )

            def close(self):
                if self.closed:
                    return
                own = super()
                try:
                    disk.step("close", lambda: None)
                finally:
                    own.close()

        return self.step("open", lambda: File(path, mode))

    def sync(self, descriptor):
        self.step("sync", lambda: os.fsync(descriptor))

    def replace(self, source, target):
        self.step("replace", lambda: os.replace(source, target))

    def unlink(self, path):
        self.step("unlink", lambda: os.unlink(path))

    def mkdir(self, path):
        self.step("mkdir", lambda: os.mkdir(path))


class KillingDisk(FaultyDisk):
    """Kills the process at its operation number `fatal`: no block of Python's ends."""

    def step(self, name, act, half=None):
        """Count the operation, and do it, or end the process before, after or half-way."""
        if len(self.done) == self.fatal:
            {"before": lambda: None, "after": act, "half": half or act}[self.kind]()
            os._exit(9)
        return super().step(name, act, half)


class Log(_files.Disk):
    """Does what it is asked for and remembers it, for `after_power_cut`.

    Attributes
    ----------
    entries : list of tuple
        ("write", file, bytes), ("sync", file or folder), and changes of names: ("name", folder,
        path, file), ("unname", folder, path); a file is a number, a folder its path.
    """

    def __init__(self) -> None:
        self.entries: list[tuple] = []
        self._files: dict[tuple[int, int], int] = {}

    def _number(self, descriptor):
        status = os.fstat(descriptor)
        return self._files.setdefault((status.st_dev, status.st_ino), len(self._files))

    def open(self, path, mode):
        log = self

        class File(io.FileIO):
            def write(self, data):
                log.entries.append(("write", log._number(self.fileno()), bytes(data)))
                return super().write(data)

        new = not os.path.exists(path)
        file = File(path, mode)
        if new:
            # the numbers of files that were removed are used again
            status = os.fstat(file.fileno())
            self._files[(status.st_dev, status.st_ino)] = 1000 + len(self.entries)
            self.entries.append(("name", Path(path).parent, Path(path), log._number(file.fileno())))
        return file

    def sync(self, descriptor):
        os.fsync(descriptor)
        place = Path(f"/proc/self/fd/{descriptor}").resolve()
        self.entries.append(("sync", place if place.is_dir() else self._number(descriptor)))

    def replace(self, source, target):
        status, folder = Path(source).stat(), Path(source).is_dir()
        number = None if folder else self._files[(status.st_dev, status.st_ino)]
        os.replace(source, target)
        self.entries.append(("name", Path(target).parent, Path(target), number))
        self.entries.append(("unname", Path(source).parent, Path(source)))

    def unlink(self, path):
        os.unlink(path)
        self.entries.append(("unname", Path(path).parent, Path(path)))

    def mkdir(self, path):
        os.mkdir(path)
        self.entries.append(("name", Path(path).parent, Path(path), None))


LOSSES = ("nothing", "data", "names", "both", "half", "zeros", "some")


def after_power_cut(
    entries: list[tuple], loss: str, folder: Path, out: Path, rng: random.Random
) -> None:
    """Make in `out` what `folder` may hold after a power cut that follows `entries`.

    POSIX promises only what was synced: the bytes of a file up to its last sync, the names in a
    folder up to the folder's. Of what came later `loss` is lost: nothing; all bytes ("data"); all
    names ("names"); both; the second half of the bytes; all bytes, with zeros in their place; or
    some of the names at random, with a random part of the bytes.
    """
    synced = {entry[1]: at for at, entry in enumerate(entries) if entry[0] == "sync"}
    names: dict[Path, int | None] = {}
    safe: dict[int, bytes] = {}
    whole: dict[int, bytes] = {}
    for at, (kind, key, *rest) in enumerate(entries):
        durable = at < synced.get(key, -1)
        if kind == "write":
            whole[key] = whole.get(key, b"") + rest[0]
            if durable:
                safe[key] = whole[key]
        elif kind in ("name", "unname") and (
            durable or loss in ("nothing", "data", "half", "zeros")
            or (loss == "some" and rng.random() < 0.5)
        ):  # fmt: skip
            if kind == "name":
                names[rest[0]] = rest[1]
            elif names.pop(rest[0], 0) is None:  # what is in a folder goes where its name goes
                for path in [path for path in names if rest[0] in path.parents]:
                    del names[path]
    out.mkdir()
    for path, number in sorted(names.items(), key=lambda item: len(item[0].parts)):
        place = out / path.relative_to(folder)
        if not place.parent.is_dir() or place == out:
            continue  # the folder's own name was lost
        if number is None:
            place.mkdir(exist_ok=True)
        else:
            place.write_bytes(_left(safe.get(number, b""), whole.get(number, b""), loss, rng))


def _left(safe: bytes, whole: bytes, loss: str, rng: random.Random) -> bytes:
    rest = whole[len(safe) :]
    if loss in ("nothing", "names"):
        return whole
    if loss == "half":
        return safe + rest[: len(rest) // 2]
    if loss == "zeros":
        return safe + bytes(len(rest))
    return safe + rest[: rng.randint(0, len(rest))] if loss == "some" else safe


def chosen(total: int, part: int) -> list[int]:
    """Return every number below `total` whose remainder by `part` is 0, and the last."""
    return sorted({*range(0, total, part), total - 1})
