"""Sixteen chains as one: a number of many lanes, for compiled code.

A *pack* holds one quantity of WIDTH chains in the vector registers of the processor. It is added,
multiplied and compared as a float is. So a kernel written for one chain serves many when it
receives arrays of packs, which are views of arrays of floats: see `arrays`. Each lane's arithmetic
is that of a float, to the last bit, whatever the processor.

What a comparison of packs returns is a truth for each lane. An array of NumPy's bools may be seen
as packs too, and takes them as they are.

`where` and `any_of` do for packs, and for floats too, what `if` cannot.
"""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np

WIDTH = 16  # more than fit the registers, so that the processor need not wait for results

_T = TypeVar("_T")


def where(condition: bool, a: _T, b: _T) -> _T:
    """Return `a` in the lanes where `condition` holds, `b` in the others."""
    either: Any = np.where
    return either(condition, a, b)


def any_of(condition: Any) -> bool:
    """Return whether `condition` holds in any lane."""
    return bool(np.any(condition))
