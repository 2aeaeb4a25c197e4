"""Parts of a long run: files written whole, each named by what is in it.

The name of a part ends in a digest of its owner, such as a campaign's plan, and of the part's
bytes. So a part that exists and has the right name is done; nothing else needs to be recorded, and
it does not matter who wrote it.
"""

from __future__ import annotations

import hashlib
import math
from pathlib import Path

from npend_gym import _files


def part_digest(owner: str, data: bytes) -> str:
    """Return what the name of a part with these bytes ends in."""
    return hashlib.sha256(owner.encode() + data).hexdigest()[:16]


def write_part(owner: str, place: Path, data: bytes, suffix: str) -> Path:
    """Write a part whole or not at all; return its path: `place`, the digest and the suffix."""
    _files.make_folder(place.parent)
    path = place.with_name(f"{place.name}-{part_digest(owner, data)}{suffix}")
    with _files.replacing(path, binary=True) as file:
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
