"""The colours of all pictures: those of Okabe and Ito, made for every kind of colour vision."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

BLUE, ORANGE, GREEN, PINK, AMBER, SKY = (
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9",
)  # fmt: skip
BLACK, WHITE, FAINT = "#000000", "#FFFFFF", "#BBBBBB"
PAPER, INK, RIM, ROD = "#F3F4F6", "#2B333B", "#C4CAD0", "#5F6973"  # of the pictures of a chain


def rgb(color: str) -> tuple[int, int, int]:
    """Return red, green and blue, 0 to 255, of a colour written as "#RRGGBB"."""
    red, green, blue = bytes.fromhex(color[1:])
    return red, green, blue


def mixed(colors: Sequence[Sequence[int]], share: float) -> tuple[int, ...]:
    """Return the colour at a share, 0 to 1, of the way along several."""
    at = np.linspace(0.0, 1.0, len(colors))
    channels = zip(*colors, strict=True)
    return tuple(round(float(np.interp(share, at, channel))) for channel in channels)


def distinct(count: int) -> list[str]:
    """Return as many colours as "#RRGGBB" that are as unlike as they can be."""
    if count <= len(_UNLIKE):
        return [*_UNLIKE[:count]]
    ends = [rgb(color) for color in (BLUE, SKY, GREEN, AMBER, ORANGE, PINK)]
    return ["#" + bytes(mixed(ends, k / (count - 1))).hex().upper() for k in range(count)]


_UNLIKE = BLUE, ORANGE, GREEN, PINK, AMBER, SKY
RAMP = tuple(map(rgb, (BLUE, GREEN, AMBER)))  # of bobs: gains in lightness from pivot to tip
