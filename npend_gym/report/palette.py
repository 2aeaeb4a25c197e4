"""What the figures share: colours that colour-blind readers tell apart, markers, panels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure

BLUE, ORANGE, GREEN, PINK, AMBER, SKY, BLACK = (
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"
)  # fmt: skip
FAINT = "#BBBBBB"
TRIALS = (("o", SKY), ("s", BLUE), ("^", BLACK))


def panels(
    figure: Figure, rows: int, columns: int, *, sharex: bool = False,
    height_ratios: Sequence[float] | None = None,
) -> list[Any]:  # fmt: skip
    """Return the axes of a grid of panels, row by row."""
    axes = figure.subplots(rows, columns, sharex=sharex, squeeze=False, height_ratios=height_ratios)
    return list(axes.flat)


def shade(share: float) -> tuple[float, float, float]:
    """Return a blue, the darker the larger `share` (0 to 1)."""
    return 0.65 * (1.0 - share), 0.25 + 0.55 * (1.0 - share), 0.45 + 0.5 * (1.0 - share)
