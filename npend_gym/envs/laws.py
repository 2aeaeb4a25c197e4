"""Laws that compiled kernels and the tensors of `npend_gym.torch` share, each written once.

A law is a function of numbers: floats, packs, arrays or tensors. It reads the settings of motors
and sensors as ``numbers[Setting.motor_lag, g]``, whatever these numbers are.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import FunctionType
from typing import Any, TypeVar

from npend_gym.compiled.jit import inlined_kernel

_F = TypeVar("_F", bound=Callable[..., Any])
LAWS: dict[str, Callable[..., Any]] = {}  # by name


def law(function: _F) -> _F:
    """Compile `function` as a part of the kernels that call it; `of_kind` gives it to others.

    So do kernels for what tensors take from them as it is, such as random numbers.
    """
    LAWS[function.__name__] = function
    return inlined_kernel(function)


def of_kind(function: Any, kind: Mapping[str, Any] | None = None) -> Callable[..., Any]:
    """Return a law for another kind of numbers: the functions it calls are those of `kind`.

    Other parts of kernels that it calls become functions of Python, of this kind too.
    """
    plain = getattr(function, "py_func", function)
    names, kind = plain.__globals__, kind or {}
    parts = {
        name: of_kind(names[name], kind)
        for name in plain.__code__.co_names
        if name not in kind and (name in LAWS or hasattr(names.get(name), "py_func"))
    }
    return FunctionType(plain.__code__, {**names, **parts, **kind}, plain.__name__)


def names_in_laws() -> set[str]:
    """Return all names that laws read, of settings among them."""
    return {name for each in LAWS.values() for name in each.__code__.co_names}  # type: ignore[attr-defined]
