"""Imports of libraries that an extra installs, with one error text where one is missing."""

from __future__ import annotations

from importlib import import_module
from typing import Any

_WITH_TORCH = ("rl",)  # extras that bring PyTorch, from PyPI with CUDA on Linux
CPU_TORCH = (
    "without a GPU, first the small build of PyTorch: "
    "pip install torch --index-url https://download.pytorch.org/whl/cpu"
)


def require(module: str, extra: str, purpose: str) -> Any:
    """Import `module` and return it.

    Parameters
    ----------
    module : str
        Name of the module, such as "sympy" or "ray.util.joblib".
    extra : str
        Extra of the package that installs it, such as "plot".
    purpose : str
        What needs it, in the plural: "figures".

    Raises
    ------
    ImportError
        If the module cannot be imported, see `missing`.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise missing(module, extra, purpose, error) from error


def missing(module: str, extra: str, purpose: str, error: Exception | None = None) -> ImportError:
    """Return the error to raise in place of `error`, which importing `module` raised.

    Its text says which command installs the library, or why a library that is installed cannot be
    imported. Without `error` the library is taken to be absent. Other parameters are those of
    `require`.
    """
    library = module.partition(".")[0]
    absent = isinstance(error, ModuleNotFoundError) and (error.name or "").split(".")[0] == library
    if error is None or absent:
        way_out = f'install it with pip install "npend-gym[{extra}]"'
        way_out += f" ({CPU_TORCH})" if extra in _WITH_TORCH else ""
    else:
        way_out = f"it is installed but cannot be imported: {error}"
    return ImportError(f"{purpose} need {library}: {way_out}", name=library)
