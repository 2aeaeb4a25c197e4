"""What made a result: one record, kept with everything that a user keeps.

The record is for people. No program reads its own state back from it.
"""

from __future__ import annotations

import platform
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version
from typing import Any

from npend_gym._version import __version__


@cache
def _versions() -> dict[str, str]:
    return {
        "package": "npend_gym",
        "version": __version__,
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "numba": version("numba"),
    }


def provenance(arguments: Mapping[str, Any], seed: int | None = None) -> dict[str, Any]:
    """Return the record of what made a result, ready for JSON.

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
    return {**_versions(), "arguments": dict(arguments), "seed": seed}
