"""What made a result: one record, kept with everything that a user keeps, and the machine.

The record is for people. No program reads its own state back from it.
"""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from npend_gym._version import __version__

_LIBRARIES = ("npend_gym", "numba", "numpy", "scipy", "gymnasium")


@cache
def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def provenance(arguments: Mapping[str, Any], seed: int | None = None) -> dict[str, Any]:
    """Return the provenance of a result, ready for JSON.

    Parameters
    ----------
    arguments : mapping
        The arguments of the call, as plain numbers, texts, lists and dicts.
    seed : int, optional
        The seed of the random draws; None where nothing was drawn.

    Returns
    -------
    dict
        "package", "version", "python", "numpy", "numba", "arguments" and "seed".
    """
    return {
        "package": "npend_gym",
        "version": __version__,
        "python": platform.python_version(),
        "numpy": _version("numpy"),
        "numba": _version("numba"),
        "arguments": dict(arguments),
        "seed": seed,
    }


def machine(more: Sequence[str] = ()) -> str:
    """Return the versions of the package, its libraries and `more`, and the processor."""
    found = [f"{name} {_version(name)}" for name in (*_LIBRARIES, *more) if _version(name)]
    info = Path("/proc/cpuinfo")
    text = info.read_text() if info.exists() else ""
    _, known, rest = text.partition("model name\t: ")
    if not known:  # another system, or ARM
        return ", ".join([*found, platform.machine(), platform.processor()])
    widest = "AVX-512" if "avx512f" in text else "AVX2" if "avx2" in text else "SSE"
    return ", ".join([*found, platform.machine(), rest.partition("\n")[0], widest])
