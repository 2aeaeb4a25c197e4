"""Functions of the user's that drive a motion, put together into one that kernels can call."""

# Numba's stubs leave parts unknown, and functions of users have no types
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
# pyright: reportUnknownParameterType=false, reportMissingParameterType=false
# ruff: noqa: ARG001  what stands for another function has its parameters
from __future__ import annotations

import inspect
import threading
from collections import OrderedDict
from collections.abc import Hashable, Mapping
from functools import partial
from typing import Any, cast

import numpy as np

from npend_gym import _checks
from npend_gym._checks import FloatArray
from npend_gym.compiled.callbacks import Callback, Writer, compiled_if_possible
from npend_gym.compiled.identity import identity_of
from npend_gym.physics.kernels.driven import ACROSS, AFTER_TORQUES, FORCE, UP

NAMES = ("torque", "force", "pivot_acceleration")  # in the order of what kernels are given
_MOST_KEPT = 128
_KEPT: OrderedDict[Hashable, Callback | None] = OrderedDict()  # None where Numba compiles nothing
_LOCK = threading.Lock()


def takes_time_alone(function: Any) -> bool:
    """Return whether a function of the user's takes t, and not (t, theta, omega).

    It does where t alone must be given: ``f(t, size=2.0, rate=3.0)`` is a function of time.
    """
    try:
        given = inspect.signature(getattr(function, "py_func", function)).parameters.values()
    except ValueError:  # a function in C without a signature
        return False
    if any(each.kind is each.VAR_POSITIONAL for each in given):
        return False
    positional = [each for each in given if each.kind <= each.POSITIONAL_OR_KEYWORD]
    return len(positional) < 3 or sum(each.default is each.empty for each in positional) == 1


def called(name: str, function: Any, t: float, *state: FloatArray) -> FloatArray:
    """Value of a function at an instant, perhaps in a state.

    Raises
    ------
    ValueError
        That names the function, where it raises an exception.
    """
    try:
        return np.asarray(_numbers(function(t, *(each.copy() for each in state))), float)
    except Exception as error:
        raise ValueError(f"{name} raised {type(error).__name__} at t = {t:g} s: {error}") from error


def _numbers(values: Any) -> Any:
    """Check the value of a function, which may be no text."""
    if np.asarray(values).dtype.kind in "US":
        raise TypeError(f"it must return real numbers, got {_checks.show(values)}")
    return values


def callback_of(functions: Mapping[str, Any], fixed: FloatArray, *, scalar: bool) -> Callback:
    """Return functions as kernels call them: as machine code where Numba can compile them all.

    Parameters
    ----------
    functions : mapping of str to function
        By NAMES: of (t, theta, omega), or of t alone.
    fixed : ndarray, shape (n + AFTER_TORQUES,)
        What stands where there is no function; machine code leaves it as it was.
    scalar : bool
        Whether the torque is one number, on joint 0.

    Notes
    -----
    Machine code of functions that compute the same is made once in a process, see `identity_of`,
    and that Numba cannot make it is found out once.
    """
    build = partial(_writer_of, fixed=fixed, scalar=scalar)
    each = [(name, takes_time_alone(function), identity_of(function))
            for name, function in functions.items()]  # fmt: skip
    whole = all(identity.whole for _, _, identity in each)
    key = fixed.size, scalar, *((name, alone, identity.key) for name, alone, identity in each)
    known, made = _known(key)
    if known and (made is None or whole):
        return made or Callback(build(functions, _itself), AFTER_TORQUES)
    writer = compiled_if_possible(functions, build)
    if writer is not None:
        n = fixed.size - AFTER_TORQUES
        broken = min({"torque": 0, "force": n + FORCE}.get(name, n + ACROSS) for name in functions)
        made = Callback(writer, AFTER_TORQUES, broken)
    if made is None or whole:
        _keep(key, made)
    return made or Callback(build(functions, _itself), AFTER_TORQUES)


def _known(key: Hashable) -> tuple[bool, Callback | None]:
    """Return whether functions of this key were met before, and their machine code, if any."""
    with _LOCK:
        known = key in _KEPT
        if known:
            _KEPT.move_to_end(key)
        return known, _KEPT.get(key)


def _keep(key: Hashable, made: Callback | None) -> None:
    with _LOCK:
        _KEPT[key] = made
        while len(_KEPT) > _MOST_KEPT:
            _KEPT.popitem(last=False)


def _itself(function: Any) -> Any:
    return function


def _writer_of(
    functions: Mapping[str, Any], make: Any, *, fixed: FloatArray, scalar: bool
) -> Writer:
    """Return one writer of functions of users; `make` compiles a function, or leaves it as is."""
    n, constants = fixed.size - AFTER_TORQUES, fixed.copy()
    at_force, at_across, at_up = n + FORCE, n + ACROSS, n + UP

    def of_state(function: Any) -> Any:
        """Return a function of t alone as one of the state too; Python may return text."""
        if function is None:
            return None
        alone = takes_time_alone(function)

        def in_python(t, q, u):
            return _numbers(function(t) if alone else function(t, q, u))

        def in_time(t, q, u):
            return function(t)

        return in_python if make is _itself else make(in_time) if alone else function

    torque, force, pivot = cast("Any", [of_state(functions.get(name)) for name in NAMES])

    def nothing(t, q, u, out):
        pass

    def one(t, q, u, out):
        out[0] = torque(t, q, u)

    def each(t, q, u, out):
        values = torque(t, q, u)
        if len(values) != n:
            raise ValueError("it must always return as many numbers as there are rods")
        for i in range(n):
            out[i] = values[i]

    def push(t, q, u, out):
        out[at_force] = force(t, q, u)

    def carry(t, q, u, out):
        out[at_across], out[at_up] = pivot(t, q, u)

    turn = make(nothing if torque is None else one if scalar else each)
    move = make(nothing if force is None else push)
    shake = make(nothing if pivot is None else carry)

    def write(t, q, u, out):
        turn(t, q, u, out)
        move(t, q, u, out)
        shake(t, q, u, out)

    def write_all(t, q, u, out):
        out[:] = constants
        write(t, q, u, out)

    return write_all if make is _itself else make(write)
