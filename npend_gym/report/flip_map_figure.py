"""The picture of a map of chaos: dark where no rod turns over, bright where one does at once."""

# Matplotlib's stubs leave parts unknown
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
from __future__ import annotations

from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np

from npend_gym import _files
from npend_gym._checks import FloatArray
from npend_gym._extras import require

_EARLIEST = 0.05  # of the window: what turns over before has the brightest colour
_NEVER = (0.02, 0.02, 0.06, 1.0)


def draw_flip_map(times: FloatArray, duration: float, path: Path) -> Path:
    """Write the map as a PNG, a pixel for each start, the second angle upwards.

    Parameters
    ----------
    times : ndarray, shape (size, size)
        From `npend_gym.experiments.FlipMap.run`.
    duration : float
        Of the releases [s].
    path : Path
        Ends in ".png".
    """
    require("matplotlib", "plot", "figures")
    import matplotlib as mpl
    from matplotlib.image import imsave

    shown = np.clip(np.where(np.isfinite(times), times, duration), _EARLIEST * duration, duration)
    level = 1.0 - np.log(shown / (_EARLIEST * duration)) / np.log(1.0 / _EARLIEST)
    colours: Any = mpl.colormaps["inferno"](0.12 + 0.85 * level)
    colours[~np.isfinite(times)] = _NEVER
    pixels = np.asarray(np.round(255.0 * colours[::-1, :, :3]), np.uint8)
    with _files.replacing(path, binary=True) as file:
        imsave(cast("BinaryIO", file), pixels, format="png")
    return path
