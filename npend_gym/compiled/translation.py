"""The text of the package's compiled functions, with what stands under its names on a GPU.

A kernel is written for numbers that are floats or packs, and a GPU's thread has floats: its text
does for a GPU too. `Translation` copies a function, and all functions that it calls. What
`chosen_by_type` chooses among is chosen there, by the kind that is named; `where` and `any_of` are
those of one lane; float constants are float32 where the numbers are; and `CUDA` and `FLOAT` become
Numba's module and the type of the numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from importlib import import_module
from types import CellType, CodeType, FunctionType
from typing import Any, NamedTuple

import numpy as np

from npend_gym.compiled.arrays import bare, packs
from npend_gym.compiled.packs import any_of, where
from npend_gym.compiled.sincos import FLOAT32_CONSTANTS


class _Named(NamedTuple):
    """A name that means something on a GPU alone."""

    name: str


# For the text of kernels: Numba's module, as in `CUDA.grid(1)`, and the type of the numbers
CUDA: Any = _Named("numba.cuda")
FLOAT: Any = _Named("float64 or float32")


def _where(condition: bool, a: float, b: float) -> float:
    return a if condition else b


def _itself(value: Any) -> Any:
    return value


_OF_ONE_LANE: dict[Any, Callable[..., Any]] = {
    where: _where, any_of: _itself, bare: _itself, packs: _itself
}  # fmt: skip


class Translation:
    """Copies functions, each once, with what stands under their names on a GPU.

    Parameters
    ----------
    cuda : module
        Numba's, for CUDA.
    device_function : function
        Compiles a copy for other functions on the GPU.
    kinds, dtype, replaced
        As for `npend_gym.compiled.gpu.DeviceKernel`.
    """

    def __init__(
        self,
        cuda: Any,
        device_function: Callable[[FunctionType, str], Any],
        kinds: Collection[type | int],
        dtype: np.dtype[Any],
        replaced: Mapping[Any, Any],
    ) -> None:
        self.cuda: Any = cuda
        self.device_function: Callable[[FunctionType, str], Any] = device_function
        self.kinds: Collection[type | int] = kinds
        self.single: bool = dtype == np.float32
        self.replaced: dict[Any, Any] = _OF_ONE_LANE | dict(replaced)
        self.float_type: Any = getattr(import_module("numba"), dtype.name)
        self.done: dict[FunctionType, Any] = {}

    def function(self, function: FunctionType) -> FunctionType:
        """Return the function with translated globals, constants and closure."""
        code, names = function.__code__, function.__globals__
        known = {name: self.value(names[name]) for name in _names(code) if name in names}
        known |= {"__builtins__": names["__builtins__"], "__name__": function.__module__}
        if self.single:
            code = code.replace(co_consts=tuple(self.number(c) for c in code.co_consts))
        closed = [CellType(self.value(cell.cell_contents)) for cell in function.__closure__ or ()]
        made = FunctionType(code, known, function.__name__, function.__defaults__, tuple(closed))
        made.__module__, made.__qualname__ = function.__module__, function.__qualname__
        return made

    def called(self, function: Any) -> Any:
        """Return a function that others call, compiled."""
        function = self.replaced.get(function, function)
        text = text_of(function)
        if text not in self.done:
            inline = getattr(function, "targetoptions", {}).get("inline", "never")
            self.done[text] = self.device_function(self.function(text), inline)
        return self.done[text]

    def value(self, value: Any) -> Any:
        """Counterpart on the GPU of the value of a name."""
        if value is CUDA:
            return self.cuda
        if value is FLOAT:
            return self.float_type
        if hasattr(value, "by_type"):
            return self.value(self.choice(value))
        if callable(value) and (value in self.replaced or hasattr(value, "py_func")):
            return self.called(value)
        return self.number(value)

    def choice(self, chosen: Any) -> Any:
        """Return the one of the functions to choose from that is of the kind named.

        Where none is, the choice is by another argument, which is an array on a GPU.
        """
        found = [kernel for kind, kernel in chosen.by_type.items() if kind in self.kinds]
        if not found and 0 in chosen.by_type:
            return chosen.by_type[0]
        if len(found) != 1:
            raise ValueError(
                f"{chosen.__name__} is there for {[*chosen.by_type]}, not {self.kinds}"
            )
        return found[0]

    def number(self, value: Any) -> Any:
        """Return a constant with the precision of the numbers."""
        if self.single and isinstance(value, float):
            return np.float32(FLOAT32_CONSTANTS.get(value, value))
        return value


def text_of(function: Any) -> FunctionType:
    """Return the function of Python that a compiled one was made from."""
    return getattr(function, "py_func", function)


def _names(code: CodeType) -> set[str]:
    """Return the names that a function uses: of globals, and more."""
    inner = [_names(part) for part in code.co_consts if isinstance(part, CodeType)]
    return set(code.co_names).union(*inner)
