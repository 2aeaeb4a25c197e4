"""Exponents of power laws, and numbers as text."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from npend_gym._checks import FloatArray


def exponent(x: FloatArray, y: FloatArray) -> float:
    """Return the power p of the fit y = c x^p, the slope between the logarithms."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def show(values: Iterable[float | tuple[float, ...]], digits: int = 3) -> str:
    """Return numbers as a list with `digits` significant digits; tuples of them in brackets."""
    return ", ".join(
        f"({show(value, digits)})" if isinstance(value, tuple) else f"{value:.{digits}g}"
        for value in values
    )
