"""Functions of users, called from compiled code through their addresses.

A function is compiled by Numba where it can be, and called in Python otherwise. Either way it has
one signature in C, so that the kernels that call it are compiled once for all functions.
"""

# Numba's stubs leave parts unknown, and functions of users have no types
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
# pyright: reportUnknownParameterType=false, reportMissingParameterType=false
# pyright: reportPrivateImportUsage=false

from __future__ import annotations

import ctypes
import dis
from collections.abc import Callable, Mapping
from types import CodeType
from typing import Any

import numpy as np

from npend_gym._checks import FloatArray
from npend_gym.compiled.jit import inlined_kernel

_DOUBLES = ctypes.POINTER(ctypes.c_double)
_IN_C = ctypes.CFUNCTYPE(
    None, ctypes.c_double, _DOUBLES, _DOUBLES, _DOUBLES, ctypes.c_int64, ctypes.c_int64
)

# Writes what it computes from an instant and two arrays (m,) into a third
Writer = Callable[[float, FloatArray, FloatArray, FloatArray], None]


class Callback:
    """A function as compiled code can call it.

    Parameters
    ----------
    writer : callable
        ``writer(t, q, u, out)`` writes into `out`, shape (n + entries,).
    entries : int
        How much longer than n it is.
    broken : int, optional
        Where the machine code of `writer`, made by Numba's ``njit``, always writes: NaN stands
        there after an exception. By default Python is entered at every call.

    Attributes
    ----------
    address : int
        Of the function, as `call_function` takes it; valid as long as this object lives.
    compiled : bool
        Whether it is machine code.
    stopped : bool
        Set it to let a function in Python write NaN without being called.
    failure : BaseException or None
        What a function in Python raised; it then wrote NaN, and so does one in machine code.
    """

    def __init__(self, writer: Any, entries: int, broken: int | None = None) -> None:
        self.failure: BaseException | None = None
        self.stopped = False
        self.compiled: bool = broken is not None
        self._writer = writer
        self._entries = entries
        # kept alive as long as its address is used
        if broken is not None:
            self._function: Any = _in_c(writer, entries, broken)
            self.address: int = int(self._function.address)
        else:
            self._function = _IN_C(self._in_python)
            self.address = int(ctypes.cast(self._function, ctypes.c_void_p).value or 0)

    def _in_python(self, t: float, q: Any, u: Any, out: Any, m: int, n: int) -> None:
        values = np.ctypeslib.as_array(out, (n + self._entries,))
        values[:] = np.nan
        if self.stopped or self.failure is not None:
            return
        try:
            state = (np.ctypeslib.as_array(each, (m,)).copy() for each in (q, u))
            self._writer(t, *state, values)
        except BaseException as error:  # noqa: BLE001 - raised where the kernel returns
            self.failure = error
            values[:] = np.nan


def compiled_if_possible(
    functions: Mapping[str, Any], build: Callable[[Mapping[str, Any], Any], Writer]
) -> Writer | None:
    """Functions compiled by `build`, for machine code; None where Numba cannot compile them.

    `build` is given the compiled functions, and what compiles those that it makes of them. All are
    parts of the one function that C calls, which alone becomes machine code (`Callback`).
    Functions that assign to variables of the function around them are left to Python: machine code
    would take such variables for constants. So are those that write into the state, of which Python
    is given copies.
    """
    from numba import config, njit, types

    from npend_gym.compiled.inner import InnerCompiler

    def part(function: Any) -> Any:
        options: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
        return njit(**options, boundscheck=True, pipeline_class=InnerCompiler)(function)

    codes = (getattr(each, "__code__", None) for each in functions.values())
    if config.DISABLE_JIT or any(map(_assigns_outside, codes)):  # type: ignore[attr-defined]
        return None
    array = types.Array(types.float64, 1, "C")
    state = types.Array(types.float64, 1, "C", readonly=True)
    try:
        compiled = {
            name: each if hasattr(each, "py_func") else part(each)
            for name, each in functions.items()
        }
        writer = build(compiled, part)
        writer.compile((types.float64, state, state, array))  # type: ignore[attr-defined]
        writer.disable_compile()  # type: ignore[attr-defined]
    except Exception:  # noqa: BLE001 - Numba raises anything, even bare AssertionErrors
        return None
    return writer


def _assigns_outside(code: Any) -> bool:
    """Return whether a function, or one within it, assigns to variables of one around it."""
    return isinstance(code, CodeType) and (
        any(
            each.opname == "STORE_DEREF" and each.argval in code.co_freevars
            for each in dis.get_instructions(code)
        )
        or any(map(_assigns_outside, code.co_consts))
    )


def _in_c(writer: Any, entries: int, broken: int) -> Any:
    """Return a writer of machine code as a function that C can call."""
    from numba import carray, cfunc, types

    doubles = types.CPointer(types.float64)
    arguments = types.float64, doubles, doubles, doubles, types.int64, types.int64

    @cfunc(types.void(*arguments))
    def in_c(t, q, u, out, m, n):
        values = carray(out, (n + entries,))
        try:
            writer(t, carray(q, (m,)), carray(u, (m,)), values)
        except Exception:  # noqa: BLE001 - told from NaN where the kernel returns
            values[broken] = np.nan

    return in_c


def call_address(
    address: int, t: float, q: FloatArray, u: FloatArray, out: FloatArray, m: int, n: int
) -> None:
    """Call the function that stands at `address`; the arrays are contiguous."""
    pointers = (array.ctypes.data_as(_DOUBLES) for array in (q, u, out))
    _IN_C(address)(t, *pointers, m, n)


@inlined_kernel
def call_function(
    address: int, t: float, q: FloatArray, u: FloatArray, out: FloatArray, m: int, n: int
) -> None:
    """Call the function that stands at `address`; the arrays are contiguous."""
    call_address(address, t, q, u, out, m, n)
