"""Checks of user input: each returns the value, or raises an error with name, rule and value."""

from __future__ import annotations

import difflib
import functools
import inspect
import math
import numbers
from collections.abc import Callable, Iterable
from os import PathLike
from pathlib import Path
from typing import Any, ParamSpec, cast

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_P = ParamSpec("_P")

# Sizes of numbers in SI units; products of several stay far from the ends of float64's range.
SMALLEST, LARGEST = 1e-30, 1e30
MAX_PICTURE_SIZE = 2160  # pixels
_MAX_DEPTH = 64  # of lists in lists; no array has more axes


def show(value: object) -> str:
    """Return a short text of `value` for an error message."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # an integer too long to print, a list inside itself
        text = f"a {type(value).__name__} too large to print"
    return text if len(text) <= 80 else text[:77] + "..."


def array(name: str, value: Any) -> FloatArray:
    """Return `value` as a new C-ordered array of finite float64 numbers, of any shape."""
    unmasked(name, value)
    try:
        raw = None if _holds_others(value) else np.asarray(value)
    except (ValueError, TypeError, OverflowError) as error:
        raise ValueError(
            f"{name} must be a number or a rectangular array, got {show(value)}"
        ) from error
    if raw is None or raw.dtype.kind not in "iuf":
        raise TypeError(
            f"{name} must hold real numbers, got {show(value)}; convert with np.asarray(..., float)"
        )
    out = np.array(raw, dtype=np.float64, order="C")
    if (abs(out) <= LARGEST).all():  # one pass, as most values are good; NaN fails it
        return out
    if not np.all(np.isfinite(out)):
        raise ValueError(f"{name} must be finite, got {show(value)}")
    return within(name, out, LARGEST)


def unmasked(name: str, value: Any) -> Any:
    """Return `value`; raise an error if it is an array with masked entries."""
    if hasattr(value, "mask") and np.ma.is_masked(value):
        raise ValueError(
            f"{name} must have no masked entries, got {show(value)}; leave them out, or fill them"
        )
    return value


def _holds_others(value: Any, depth: int = 0) -> bool:
    """Whether text or a boolean is somewhere in a list.

    NumPy would make room for as much text in every entry, and take the boolean for a number.
    """
    if not isinstance(value, (list, tuple)) or depth > _MAX_DEPTH:
        return False
    entries = cast("list[Any]", value)
    kinds = set(map(type, entries))
    if not kinds.isdisjoint((str, bytes, bool, np.bool_)):
        return True
    inner = not kinds.isdisjoint((list, tuple))
    return inner and any(_holds_others(each, depth + 1) for each in entries)


def within(name: str, value: FloatArray, limit: float) -> FloatArray:
    """Return `value`; raise an error if the absolute value of an entry exceeds `limit`."""
    if (abs(value) > limit).any():
        raise ValueError(f"{name} must lie within +-{limit:g}, got {show(value.tolist())}")
    return value


def in_radians(limit: str, angle: float) -> str:
    """Return "within `limit` rad, got `angle`", with a hint where `angle` may be in degrees."""
    text = f"within {limit} rad, got {angle:g}"
    if abs(angle) <= math.tau:
        return text
    return f"{text}: {angle:g} degrees are {math.radians(angle):.4g} rad ({converts(angle)})"


def converts(degrees: float) -> str:
    """Return how angles such as `degrees` are made radians: in Python, and by the commands."""
    return f"np.radians converts; npend takes {degrees:g}deg"


def broadcast(name: str, value: Any, shape: tuple[int, ...]) -> FloatArray:
    """Return `value`, one number or an array of `shape`, as a new array of `shape`."""
    if type(value) in (float, int) and abs(value) <= LARGEST:  # as most parameters are given
        return np.full(shape, value, np.float64)
    out = array(name, value)
    if out.shape not in ((), shape):
        raise ValueError(
            f"{name} must be one number or an array of shape {shape}, got shape {out.shape}"
        )
    return out if out.shape == shape else np.full(shape, out)


def vector(name: str, value: Any, n: int) -> FloatArray:
    """Return `value` as an array of shape (n,); one number stands for all rods."""
    return broadcast(name, value, (n,))


def at_least_zero(name: str, value: FloatArray) -> FloatArray:
    """Return `value`; raise an error if an entry is negative."""
    if ((value < SMALLEST) & (value != 0.0)).any():
        rule = "zero or more" if (value < 0.0).any() else f"zero or at least {SMALLEST:g}"
        raise ValueError(f"{name} must be {rule}, got {show(value.tolist())}")
    return value


def positive(name: str, value: FloatArray) -> FloatArray:
    """Return `value`; raise an error if an entry is zero or negative."""
    if (value < SMALLEST).any():
        rule = "greater than zero" if (value <= 0.0).any() else f"at least {SMALLEST:g}"
        raise ValueError(f"{name} must be {rule}, got {show(value.tolist())}")
    return value


def _is_bool(value: Any) -> bool:
    return isinstance(value, (bool, np.bool_))


def number(name: str, value: Any) -> float:
    """Return `value` as one finite float."""
    if _is_bool(value) or not isinstance(value, numbers.Real):
        raise TypeError(f"{name} must be a real number, got {show(value)}")
    try:
        out = float(value)
    except OverflowError:
        out = math.inf
    if not math.isfinite(out):
        raise ValueError(f"{name} must be finite, got {show(value)}")
    if abs(out) > LARGEST:
        raise ValueError(f"{name} must lie within +-{LARGEST:g}, got {show(value)}")
    return out


def positive_number(name: str, value: Any) -> float:
    """Return `value` as one finite float greater than zero."""
    out = number(name, value)
    if out < SMALLEST:
        rule = "greater than zero" if out <= 0.0 else f"at least {SMALLEST:g}"
        raise ValueError(f"{name} must be {rule}, got {show(value)}")
    return out


def nonnegative_number(name: str, value: Any) -> float:
    """Return `value` as one finite float, zero or more."""
    out = number(name, value)
    if out < SMALLEST and out != 0.0:
        rule = "zero or more" if out < 0.0 else f"zero or at least {SMALLEST:g}"
        raise ValueError(f"{name} must be {rule}, got {show(value)}")
    return out


def count(name: str, value: Any, *, low: int = 1, high: int | None = None) -> int:
    """Return `value` as an int in [low, high]; booleans and floats raise an error."""
    if _is_bool(value) or not isinstance(value, numbers.Integral):
        raise TypeError(f"{name} must be an integer, got {show(value)}")
    out: Any = value
    if out < low or (high is not None and out > high):
        rule = f"at least {low}" if high is None else f"between {low} and {high}"
        raise ValueError(f"{name} must be {rule}, got {show(value)}")
    return int(out)


def picture_size(name: str, value: Any, *, low: int = 32) -> int:
    """Return `value` as a size of pictures [pixels]."""
    return count(name, value, low=low, high=MAX_PICTURE_SIZE)


def truth(name: str, value: Any) -> bool:
    """Return `value`, which must be True or False."""
    if not _is_bool(value):
        raise TypeError(f"{name} must be True or False, got {show(value)}")
    return bool(value)


def choice(name: str, value: Any, options: tuple[str, ...]) -> str:
    """Return `value`, which must be one of `options`."""
    if not isinstance(value, str) or value not in options:
        text = "" if isinstance(value, str) else ", as a string"
        raise ValueError(f"{name} must be one of {', '.join(options)}{text}; got {show(value)}")
    return value


def listed(name: str, value: Any, example: str) -> list[Any]:
    """Return the entries of `value`, which must be a list or the like, such as `example`."""
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise TypeError(f"{name} must be a list such as {example}, got {show(value)}")
    return list(cast("Iterable[Any]", value))


def path(name: str, value: Any) -> Path:
    """Return `value` as a path."""
    if not isinstance(value, (str, PathLike)):
        raise TypeError(f"{name} must be a string or path-like, got {show(value)}")
    return Path(cast("str | PathLike[str]", value))


def nearest(name: object, valid: Iterable[str]) -> str:
    """Return "; did you mean ...?" with the name among `valid` that is like `name`, or ";"."""
    close = difflib.get_close_matches(str(name), list(valid), n=1)
    return f"; did you mean {close[0]!r}?" if close else ";"


def names_keywords(function: Callable[_P, None]) -> Callable[_P, None]:
    """Let an ``__init__`` refuse an unknown keyword with the nearest one, and with all it takes."""
    owner = function.__qualname__.partition(".")[0]
    valid = list(inspect.signature(function).parameters)[1:]

    @functools.wraps(function)
    def checked(*args: _P.args, **kwargs: _P.kwargs) -> None:
        for name in kwargs:
            if name not in valid:
                raise TypeError(
                    f"{owner} got an unexpected keyword argument {name!r}{nearest(name, valid)} "
                    f"It takes {', '.join(valid)}"
                )
        function(*args, **kwargs)

    return checked
