"""Functions of the user's that drive a motion, put together into one that kernels can call."""

# Numba's stubs leave parts unknown, and functions of users have no types
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
# pyright: reportUnknownParameterType=false, reportMissingParameterType=false
# ruff: noqa: ARG001  what stands for another function has its parameters
from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any, cast

from npend_gym._checks import FloatArray
from npend_gym.compiled.callbacks import Writer, compiled_if_possible

NAMES = ("torque", "force", "pivot_acceleration")  # in the order of what kernels are given


def takes_time_alone(function: Any) -> bool:
    """Return whether a function of the user's takes t, and not (t, theta, omega)."""
    try:
        inspect.signature(getattr(function, "py_func", function)).bind(0.0, 0.0, 0.0)
    except TypeError:
        return True
    except ValueError:  # a function in C without a signature
        return False
    return False


def _writer_of(
    functions: Mapping[str, Any], fixed: FloatArray, *, scalar: bool, make: Any
) -> Writer:
    """Return one writer of functions of users; `make` is Numba's ``njit``, or leaves them as is."""
    torque, force, pivot = cast("Any", [functions.get(name) for name in NAMES])
    n, constants = fixed.size - 3, fixed.copy()

    def nothing(t, q, u, out):
        pass

    def one(t, q, u, out):
        out[0] = torque(t, q, u)

    def each(t, q, u, out):
        values = torque(t, q, u)
        for i in range(n):
            out[i] = values[i]

    def push(t, q, u, out):
        out[n] = force(t, q, u)

    def push_in_time(t, q, u, out):
        out[n] = force(t)

    def carry(t, q, u, out):
        out[n + 1], out[n + 2] = pivot(t, q, u)

    def carry_in_time(t, q, u, out):
        out[n + 1], out[n + 2] = pivot(t)

    turn = make(nothing if torque is None else one if scalar else each)
    late = takes_time_alone
    move = make(nothing if force is None else push_in_time if late(force) else push)
    shake = make(nothing if pivot is None else carry_in_time if late(pivot) else carry)

    def write(t, q, u, out):
        for i in range(out.size):
            out[i] = constants[i]
        turn(t, q, u, out)
        move(t, q, u, out)
        shake(t, q, u, out)

    return make(write)


def _itself(function: Any) -> Any:
    return function


def python_writer(functions: Mapping[str, Any], fixed: FloatArray, *, scalar: bool) -> Writer:
    """Return one writer of functions by name, which Python calls."""
    return _writer_of(functions, fixed, scalar=scalar, make=_itself)


def compiled_writer(
    functions: Mapping[str, Any], fixed: FloatArray, *, scalar: bool
) -> Writer | None:
    """Return the same as machine code; None where Numba cannot compile a function.

    Parameters
    ----------
    functions : mapping of str to function
        By NAMES: of (t, theta, omega), the last two also of t alone.
    fixed : ndarray, shape (n + 3,)
        What stands where there is no function.
    scalar : bool
        Whether the torque is one number, on joint 0.
    """

    def build(compiled: Mapping[str, Any], make: Any) -> Writer:
        return _writer_of(compiled, fixed, scalar=scalar, make=make)

    return compiled_if_possible(functions, build)
