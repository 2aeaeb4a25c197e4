"""Pictures as arrays: their shape and type, and several of them side by side."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from npend_gym import _checks
from npend_gym._palette import PAPER, rgb

Frame = NDArray[np.uint8]


def check_frame(name: str, value: object, shape: tuple[int, ...] = ()) -> Frame:
    """Return the picture `value`, refused where it is not uint8 or not of `shape`."""
    out = np.asarray(value)
    right = out.shape == shape if shape else out.ndim == 3 and out.shape[2] == 3 and out.size
    if out.dtype != np.uint8 or not right:
        wanted, got = shape or "(height, width, 3)", f"{out.dtype} of shape {out.shape}"
        raise ValueError(f"{name} must be uint8 of shape {wanted}, got {got}")
    return out


def tile(frames: Sequence[Frame]) -> Frame:
    """Return equal frames in a near-square grid, row by row."""
    _checks.count("number of frames", len(frames))
    height, width, _ = shape = check_frame("frames[0]", frames[0]).shape
    columns = math.ceil(math.sqrt(len(frames)))
    rows = math.ceil(len(frames) / columns)
    cells = np.full((rows * columns, *shape), rgb(PAPER), dtype=np.uint8)
    for k, frame in enumerate(frames):
        cells[k] = check_frame(f"frames[{k}]", frame, shape)
    grid = cells.reshape(rows, columns, *shape).swapaxes(1, 2)
    return grid.reshape(rows * height, columns * width, 3)
