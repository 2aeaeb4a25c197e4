"""Controllers that are written for many environments, for one as well."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numpy as np

_Method = TypeVar("_Method", bound=Callable[..., Any])


def takes_one_too(method: _Method) -> _Method:
    """Return a method whose last argument may be the info of a single environment as well.

    It returns an array, or a NamedTuple of arrays, with a leading axis of B. For a single
    environment, whose ``info["theta"]`` has the shape (n,), it is called with B = 1, and the axis
    is left out.
    """

    @functools.wraps(method)
    def call(self: Any, *arguments: Any) -> Any:
        *others, info = arguments
        if np.ndim(info["theta"]) != 1:
            return method(self, *others, info)
        batch = {key: np.asarray(value)[None] for key, value in info.items()}
        found = method(self, *others, batch)
        if isinstance(found, np.ndarray):
            return found[0]  # pyright: ignore[reportUnknownVariableType]
        return type(found)(*(part[0] for part in found))

    return cast("_Method", call)
