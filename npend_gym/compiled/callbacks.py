"""Functions of users, called from compiled code through their addresses.

A law is compiled by Numba where it can be, and called in Python otherwise. Either way it has one
signature in C, so that the kernels that call it are compiled once for all laws.
"""

# Numba's stubs leave parts unknown, and functions of users have no types
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
# pyright: reportUnknownParameterType=false, reportMissingParameterType=false
# ruff: noqa: ARG001  Numba hands these functions more than they need
from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from npend_gym._checks import FloatArray

_DOUBLES = ctypes.POINTER(ctypes.c_double)
_IN_C = ctypes.CFUNCTYPE(None, ctypes.c_double, _DOUBLES, _DOUBLES, _DOUBLES, ctypes.c_int64)

# Writes what a law says at an instant, for angles and angular velocities (n,), into an array
Law = Callable[[float, FloatArray, FloatArray, FloatArray], None]


class Callback:
    """A law as compiled code can call it.

    Parameters
    ----------
    law : callable
        ``law(t, theta, omega, out)`` writes into `out`, shape (n + entries,).
    entries : int
        How much longer than n it is.
    compiled : bool
        Whether `law` was made by Numba's ``njit``; otherwise Python is entered at every call.

    Attributes
    ----------
    address : int
        Of the function, as `call_law` takes it; valid as long as this object lives.
    compiled : bool
        Whether it is machine code.
    stopped : bool
        Set it to let a law in Python write NaN without being called.
    failure : BaseException or None
        What a law in Python raised; it then wrote NaN, and so does one in machine code.
    """

    def __init__(self, law: Any, entries: int, *, compiled: bool) -> None:
        self.failure: BaseException | None = None
        self.stopped = False
        self.compiled, self._law, self._entries = compiled, law, entries
        # kept alive as long as its address is used
        self._function: Any = _in_c(law, entries) if compiled else _IN_C(self._in_python)
        if compiled:
            self.address = int(self._function.address)
        else:
            self.address = int(ctypes.cast(self._function, ctypes.c_void_p).value or 0)

    def _in_python(self, t: float, theta: Any, omega: Any, out: Any, n: int) -> None:
        values = np.ctypeslib.as_array(out, (n + self._entries,))
        values[:] = np.nan
        if self.stopped or self.failure is not None:
            return
        try:
            state = (np.ctypeslib.as_array(each, (n,)).copy() for each in (theta, omega))
            self._law(t, *state, values)
        except BaseException as error:  # noqa: BLE001 - raised where the kernel returns
            self.failure = error
            values[:] = np.nan


def _no_torque(t: float, theta: FloatArray, omega: FloatArray, out: FloatArray) -> None:
    pass


def _nothing(t: float, n: int, out: FloatArray) -> None:
    pass


def _itself(function: Law) -> Law:
    return function


def _law_of(laws: Mapping[str, Any], fixed: FloatArray, *, scalar: bool, make: Any) -> Law:
    """Return one law of functions of users; `make` is Numba's ``njit``, or leaves them as is."""
    names = "torque", "force", "pivot_acceleration"
    torque, force, pivot = cast("Any", [laws.get(name) for name in names])

    def one(t, theta, omega, out):
        out[0] = torque(t, theta, omega)

    def each(t, theta, omega, out):
        values = torque(t, theta, omega)
        for i in range(theta.size):
            out[i] = values[i]

    def push(t, n, out):
        out[n] = force(t)

    def carry(t, n, out):
        across, up = pivot(t)
        out[n + 1], out[n + 2] = across, up

    turn = make(_no_torque if torque is None else one if scalar else each)
    push = make(_nothing if force is None else push)
    carry = make(_nothing if pivot is None else carry)
    constants = fixed.copy()

    def law(t, theta, omega, out):
        for i in range(out.size):
            out[i] = constants[i]
        turn(t, theta, omega, out)
        push(t, theta.size, out)
        carry(t, theta.size, out)

    return make(law)


def python_law(laws: Mapping[str, Any], fixed: FloatArray, *, scalar: bool) -> Law:
    """Return one law of functions by name, which Python calls."""
    return _law_of(laws, fixed, scalar=scalar, make=_itself)


def compiled_law(laws: Mapping[str, Any], fixed: FloatArray, *, scalar: bool) -> Law | None:
    """Return the same as machine code; None where Numba cannot compile a function.

    Parameters
    ----------
    laws : mapping of str to function
        "torque", of t, theta and omega; "force" and "pivot_acceleration", of t.
    fixed : ndarray, shape (n + 3,)
        What stands where there is no function.
    scalar : bool
        Whether the torque is one number, on joint 0.
    """
    from numba import config, njit, types
    from numba.core.errors import NumbaError

    if config.DISABLE_JIT:  # type: ignore[attr-defined]
        return None
    array = types.Array(types.float64, 1, "C")
    try:
        compiled = {
            name: law if hasattr(law, "py_func") else njit(law) for name, law in laws.items()
        }
        law = _law_of(compiled, fixed, scalar=scalar, make=njit)
        law.compile((types.float64, array, array, array))  # type: ignore[attr-defined]
    except (NumbaError, TypeError, ValueError, NotImplementedError):
        return None
    return law


if TYPE_CHECKING:

    def _in_c(law: Any, entries: int) -> Any:
        """Return a law of machine code as a function that C can call."""

    def call_law(
        address: int, t: float, theta: FloatArray, omega: FloatArray, out: FloatArray, n: int
    ) -> None:
        """Call the law that stands at `address`; the arrays are contiguous."""

else:
    from llvmlite import ir
    from numba import config, types
    from numba.core.typing import signature
    from numba.extending import intrinsic

    from npend_gym.compiled.jit import inlined_kernel

    def _in_c(law, entries):
        """Return a law of machine code as a function that C can call."""
        from numba import carray, cfunc

        doubles = types.CPointer(types.float64)
        arguments = types.float64, doubles, doubles, doubles, types.int64

        @cfunc(types.void(*arguments))
        def in_c(t, theta, omega, out, n):
            values = carray(out, (n + entries,))
            try:
                law(t, carray(theta, (n,)), carray(omega, (n,)), values)
            except Exception:  # noqa: BLE001 - told from NaN where the kernel returns
                values[:] = np.nan

        return in_c

    @intrinsic
    def _call_address(typingctx, address, t, theta, omega, out, n):
        def codegen(context, builder, sig, args):
            number, pointer = ir.DoubleType(), ir.DoubleType().as_pointer()
            kind = ir.FunctionType(
                ir.VoidType(), [number, pointer, pointer, pointer, ir.IntType(64)]
            )
            function = builder.inttoptr(args[0], kind.as_pointer())
            data = [
                context.make_array(array)(context, builder, value).data
                for array, value in zip(sig.args[2:5], args[2:5], strict=True)
            ]
            builder.call(function, [args[1], *data, args[5]])
            return context.get_dummy_value()

        return signature(types.none, types.int64, types.float64, theta, omega, out, types.int64), (
            codegen
        )

    if config.DISABLE_JIT:

        def call_law(address, t, theta, omega, out, n):
            """Call the law that stands at `address`."""
            pointers = (array.ctypes.data_as(_DOUBLES) for array in (theta, omega, out))
            _IN_C(address)(t, *pointers, n)

    else:

        @inlined_kernel
        def call_law(address, t, theta, omega, out, n):
            """Call the law that stands at `address`."""
            _call_address(address, t, theta, omega, out, n)
