"""Angles without whole turns."""

from __future__ import annotations

import numpy as np

from npend_gym._checks import FloatArray


def wrap(angle: FloatArray) -> FloatArray:
    """Return angles [rad] in [-pi, pi), but for rounding; those that are there keep their bits."""
    return angle - 2.0 * np.pi * np.floor((angle + np.pi) * (0.5 / np.pi))
