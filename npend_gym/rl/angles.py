"""Angles without whole turns."""

from __future__ import annotations

import numpy as np

from npend_gym._checks import FloatArray


def wrap(angle: FloatArray) -> FloatArray:
    """Return angles [rad] in [-pi, pi)."""
    return np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi
