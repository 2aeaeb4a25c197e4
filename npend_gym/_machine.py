"""Which libraries and which processor a result was computed with."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_LIBRARIES = ("npend_gym", "numba", "numpy", "scipy", "gymnasium")


def machine(more: Sequence[str] = ()) -> str:
    """Return the versions of the package, its libraries and `more`, and the processor."""
    found = [f"{name} {_version(name)}" for name in (*_LIBRARIES, *more) if _version(name)]
    info = Path("/proc/cpuinfo")
    if not info.exists():
        return ", ".join([*found, platform.machine(), platform.processor()])
    text = info.read_text()
    name = text.split("model name\t: ", 1)[-1].split("\n", 1)[0]
    widest = "AVX-512" if "avx512f" in text else "AVX2" if "avx2" in text else "SSE"
    return ", ".join([*found, platform.machine(), name, widest])


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""
