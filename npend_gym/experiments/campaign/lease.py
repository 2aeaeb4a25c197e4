"""The right to write into a campaign's folder, which a driver lends to its workers.

A worker writes a part inside the folder of its driver's lease, and moves it from there to its
place. The next driver renames that folder before it reads a part: from then on no move from there
succeeds, whatever workers an earlier driver has left behind, stopped, on another machine or in the
middle of a call. A move within a file system is one operation; there is nothing between a check
and a write.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from npend_gym import _files

_LEASE, _ENDED = ".lease-", ".ended-"
_PATIENCE = 10.0  # s, with files that a worker has open, which Windows does not rename


def take_lease(out: Path) -> Path:
    """Return a new folder inside `out` to write in, the only one from now on.

    Only the driver that holds the lock of `out` may call this.

    Raises
    ------
    OSError
        If it cannot be made, or the folder of an earlier lease cannot be renamed.
    """
    end_leases(out)
    lease = out / f"{_LEASE}{secrets.token_hex(8)}"
    _files.make_folder(lease)
    return lease


def end_leases(out: Path) -> None:
    """Let nobody write into `out` who has a lease now."""
    deadline = time.monotonic() + _PATIENCE
    for lease in out.glob(f"{_LEASE}*"):
        ended = lease.with_name(lease.name.replace(_LEASE, _ENDED))
        while True:
            try:
                _files.disk.replace(lease, ended)
                break
            except PermissionError:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.1)


def half_written(out: Path) -> Iterator[Path]:
    """Yield the files that were being written under leases that have ended."""
    return out.glob(f"{_ENDED}*/*")


def remove_ended(out: Path) -> None:
    """Remove what leases that have ended leave behind, as far as the system lets."""
    for path in half_written(out):
        with suppress(OSError):
            _files.remove(path)
    for ended in out.glob(f"{_ENDED}*"):
        with suppress(OSError):
            ended.rmdir()
